"""The texts and tables of the page, as HTML; all that comes from outside is escaped."""

import shlex
from html import escape

from .. import __version__
from ..problem import accuracy
from ..problem.labels import in_words
from ..problem.materials import FLOWS
from ..units import plain
from . import inputs, sentences
from .film import Film
from .told import Told

OWN = " This is the error of the computation alone: those of the test and of the constants of the mix come to it."


def words(run: Told, film: Film) -> dict[str, str]:
    """What page.html asks for, by name."""
    summary, resume = run.summary, f"taichi-mps resume {shlex.quote(str(run.path))}"
    return {
        "title": safe(f"{in_words(str(summary['scene']))}: report of a run"),
        "lead": safe(" ".join(lead(run))),
        "doubts": "\n".join(f'<p class="doubt">{safe(text)}</p>' for text in doubts(run)),
        "about": safe(" ".join(about(film, bool(run.scene.outline)))),
        "results": table(sentences.rows(summary), ("", "value", "meaning")) or "<p>Nothing was measured.</p>",
        "inputs": table(given(run), ("", "value")),
        "accuracy": accuracy_expected(run),
        "command": safe(inputs.command(run.source, summary, run.every) if run.ended else resume),
        "versions": safe(versions(run)),
        "numerics": table(sentences.numerics(summary), ("", "")) + f"<p>{safe(sentences.cost(summary))}</p>"
        if run.ended
        else "<p>Known when the run has ended.</p>",
    }


def safe(text) -> str:
    """Text as HTML shows it."""
    return escape(plain(text))


def table(rows, classes) -> str:
    """Rows of texts as a table, the first of each as its head; empty where there is none."""
    lines = []
    for head, *cells in rows:
        marked = (f'<td class="{kind}">{safe(cell)}</td>' for cell, kind in zip(cells, classes[1:], strict=True))
        lines.append(f'<tr><th scope="row">{safe(head)}</th>{"".join(marked)}</tr>')
    return f"<table>\n{chr(10).join(lines)}\n</table>" if lines else ""


def lead(run: Told) -> list[str]:
    """What was measured, and why it ended."""
    ending = [sentences.ending(run.summary)] if run.ended else []
    return [sentences.measured(run.summary), *ending]


def doubts(run: Told) -> list[str]:
    """What speaks against the result."""
    if not run.ended:
        reached = f"{run.summary['simulated_seconds']:.2f} s"
        return [f"This run has not ended: it has reached {reached}, and can go on by the command below."]
    failed = [str(run.summary["error"])] if run.summary.get("error") else []
    return failed + sentences.doubts(run.summary)


def about(film: Film, outlined: bool) -> list[str]:
    """How to read the view, and what of the run it leaves out."""
    told = ["Drag to turn.", *(["Red: the mould, or the bars."] if outlined else [])]
    told.append(f"Flowing: the viscous part of the stress is over {FLOWS:.0%} of the yield stress.")
    parts = []
    if len(film.times) < film.outputs:
        parts.append(f"{len(film.times)} of {film.outputs} outputs")
    if film.share < 1.0:
        parts.append(f"{film.share:.0%} of the particles, drawn larger")
    return told + ([f"To keep the page small it shows {' and '.join(parts)}; run.h5 has all."] if parts else [])


def given(run: Told) -> list[tuple[str, str]]:
    """The inputs of the scene; of a mix that is no keyword, its constants."""
    rows = inputs.rows(run.summary.get("parameters", {}), inputs.fields_of(run.source))
    if "yield_value" not in run.summary.get("parameters", {}):
        mixes = run.summary.get("materials") or []
        names = [f"mix {k + 1}" for k in range(len(mixes))] if len(mixes) > 1 else ["mix"]
        rows += [(name, ", ".join(sentences.of_mix(mix))) for name, mix in zip(names, mixes, strict=False)]
    return rows


def accuracy_expected(run: Told) -> str:
    """What was measured of such runs, or that nothing was; for the slump cone the table of its model."""
    if not run.ended:
        return "<p>Said when the run has ended.</p>"
    summary, model = run.summary, run.summary.get("parameters", {}).get("model")
    found, here = accuracy.of_run(summary), accuracy.expected_of(summary)
    text = f"<p>{safe(sentences.certainty(summary) + OWN * bool(here))}</p>"
    if not found:
        return text
    mix, height = found
    sizes = sorted(
        {row.spacing for row in accuracy.measured() if row.model == model} | {here.spacing} if here else set()
    )
    rows = [accuracy.with_scatter(row) for size in reversed(sizes) if (row := accuracy.expected(model, size, mix))]
    if not rows:
        return text
    cells = [("particle size", "slump within", "diameter within", "volume within")]
    cells += [
        (
            f"{1e3 * height * row.spacing:.3g} mm",
            f"{1e3 * height * row.slump:.1f} mm",
            f"{2e3 * height * row.reach:.0f} mm",
            f"{row.volume:.1%}",
        )
        for row in rows
    ]
    lines = [
        f"<tr{' class=this' if k and rows[k - 1].spacing == here.spacing else ''}>"
        + "".join(f"<td>{safe(cell)}</td>" for cell in row)
        + "</tr>"
        for k, row in enumerate(cells)
    ]
    about = f"Of this mix, by the model {model}, are to be expected:"
    return f"{text}\n<p>{safe(about)}</p>\n<table>\n{chr(10).join(lines)}\n</table>"


def versions(run: Told) -> str:
    """What has computed it and what has made the page."""
    backend = run.summary.get("backend") or {}
    on = ", ".join(str(backend[key]) for key in ("arch", "precision") if key in backend)
    computed = f"Computed by taichi_mps {run.summary['version']}{f' ({on})' if on else ''}. " if run.ended else ""
    return f"{computed}Page made by taichi_mps {__version__} with plotly.js."
