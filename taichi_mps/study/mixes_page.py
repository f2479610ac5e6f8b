"""mixes-calibrated.html: what was found of a laboratory's list, one page that opens from the disk without a network."""

import json
import os
from collections import Counter
from pathlib import Path
from string import Template

from .. import __version__
from ..report import page
from ..report.words import safe
from ..viz.plots import COLOURS
from .calibration import CONSTANTS, WORDS, short
from .mixes import BOUNDED, EXPLAINED, MEANING, REFUSED, TWO_ANSWERS, WITH_FRICTION

HERE = Path(__file__).parent
FOUND = ["yield stress", "by", "plastic viscosity", "by", "friction angle", "comes out as", "reason"]
LAYOUT = {
    "margin": {"t": 10},
    "xaxis": {"title": {"text": "slump [cm]"}},
    "yaxis": {"title": {"text": "slump flow [cm]"}},
}
ABOUT = (
    "Intervals are of 95 %, by the errors of the measurements and of the model's tables. 'By' names the measurement "
    "without which the constant is least certain, 'usual' that it was not measured. The model: a Bingham mix, with "
    "internal friction where an angle stands, that sticks to floor and funnel; mould and flap gone at once. taichi-mps "
    "{version}, calibrate --table."
)


def write(rows: list[dict], columns: list[str], out, source) -> Path:
    """The page of the rows that mixes.calibrate_list found of a list, a file ``source`` of these ``columns``; its path.
    SceneError where plotly is missing."""
    out = Path(out)
    script = page.library()
    drawn = json.dumps({"traces": traces(rows, columns), "layout": LAYOUT}, allow_nan=False, separators=(",", ":"))
    text = Template((HERE / "mixes.html").read_text(encoding="utf-8")).substitute(
        title=safe(f"{Path(source).name}: mixes calibrated"),
        lead=safe(lead(rows)),
        tally=table(["mixes", "come out as", ""], counted(rows)),
        mixes=table([*columns, *FOUND], [[*(row[name] or "" for name in columns), *cells(row)] for row in rows]),
        about=safe(ABOUT.format(version=__version__)),
        data=drawn.replace("<", "\\u003c"),
        style=(page.HERE / "page.css").read_text(encoding="utf-8"),
        library=script,
    )
    partial = out.with_suffix(".partial")
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, out)
    return out


def table(head: list[str], rows: list[list[str]]) -> str:
    """Texts as a table."""
    lines = [f"<tr>{''.join(f'<td>{safe(cell)}</td>' for cell in row)}</tr>" for row in rows]
    top = "".join(f'<th scope="col">{safe(cell)}</th>' for cell in head)
    return f"<table>\n<thead><tr>{top}</tr></thead>\n<tbody>\n{chr(10).join(lines)}\n</tbody>\n</table>"


def lead(rows) -> str:
    """How many there are, and how many one mix of the model explains or bounds."""
    count = Counter(row["verdict"] for row in rows)
    text = f"{len(rows)} mixes; one Bingham mix explains or bounds {count[EXPLAINED] + count[BOUNDED]} of them"
    return text + f", one with internal friction {count[WITH_FRICTION]} more" * bool(count[WITH_FRICTION]) + "."


def counted(rows) -> list[list[str]]:
    """How many came out how, and what that means."""
    count = Counter(row["verdict"] for row in rows)
    return [[str(count[name]), name, MEANING[name]] for name in MEANING if count[name]]


def cells(row: dict) -> list[str]:
    """What was found of a row, in the words of FOUND."""
    if row["verdict"] in (TWO_ANSWERS, REFUSED):  # the nearest mix of a contradiction is nobody's
        return ["", "", "", "", "", row["verdict"], row["reason"]]
    constants = [
        text for name, (_, unit) in CONSTANTS.items() for text in (found(row, name, unit), row.get(f"{name}_from", ""))
    ]
    rubs = found(row, "friction_angle", WORDS["friction_angle"][1]) if row["verdict"] == WITH_FRICTION else ""
    return [*constants, rubs, row["verdict"], row["reason"]]


def found(row: dict, name: str, unit: str) -> str:
    """A constant with its interval or its bound."""
    value, lower, upper = (row.get(f"{name}_{end}") for end in ("found", "lower", "upper"))
    if value is None:
        known = [f"at {word} {short(end)} {unit}" for word, end in (("least", lower), ("most", upper)) if end]
        return ", ".join(known) or "not determined"
    return f"{short(value)} {unit}" + f" ({short(lower)} to {short(upper)})" * (lower != upper)


def traces(rows: list[dict], columns: list[str]) -> list[dict]:
    """Of Plotly: slump flow against slump [cm], measured and of the nearest mix, those of a verdict together."""
    drawn = []
    for kind, colour in zip(MEANING, COLOURS, strict=False):
        here = [(row, *pair) for row in rows if row["verdict"] == kind and (pair := both(row))]
        if not here:
            continue
        ends = [[100.0 * measured[k] for _, measured, _ in here] for k in range(2)]
        near = [[100.0 * model[k] for _, _, model in here] for k in range(2)]
        joined = [
            [end for pair in zip(x, y, strict=True) for end in (*pair, None)] for x, y in zip(ends, near, strict=True)
        ]
        shared = {"type": "scatter", "legendgroup": kind, "showlegend": False, "hoverinfo": "skip"}
        drawn.append(shared | {"x": joined[0], "y": joined[1], "mode": "lines", "line": {"color": colour, "width": 1}})
        drawn.append(
            shared | {"x": near[0], "y": near[1], "mode": "markers", "marker": {"color": "#262a30", "size": 4}}
        )
        marks = {"mode": "markers", "marker": {"color": colour, "size": 8}, "name": f"{kind}, measured"}
        names = [", ".join(str(row[name]) for name in columns if row[name]) for row, _, _ in here]
        shown = {"showlegend": True, "hoverinfo": "text", "text": [safe(name) for name in names]}
        drawn.append(shared | marks | shown | {"x": ends[0], "y": ends[1]})
    return drawn


def both(row: dict):
    """Slump and slump flow [m], measured and of the model; None where one of them was not measured."""
    if row.get("slump_m_missed") is None or row.get("spread_m_missed") is None:
        return None
    model = row["slump_m_model"], row["spread_m_model"]
    return (model[0] - row["slump_m_missed"], model[1] - row["spread_m_missed"]), model
