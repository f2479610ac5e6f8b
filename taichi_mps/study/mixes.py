"""A laboratory's list of measured mixes: one calibration each, a table of the results, and a page that opens from the
disk without a network."""

import re
from collections import Counter
from collections.abc import Callable
from concurrent.futures import BrokenExecutor
from contextlib import nullcontext, suppress
from functools import lru_cache
from itertools import zip_longest
from pathlib import Path

import numpy as np

from .. import __version__
from ..report.page import publish, safe, table
from ..spelling import in_unit, without_unit
from ..units import Count, File, Place, SceneError, Text, require, suggestion, unit_of, user_path, validated
from ..viz.plots import COLOURS
from . import tables
from .calibrate import CONE, TESTS, Measurements, calibrate
from .calibration import BINGHAM, FRICTIONAL, NAMES, UNITS, Calibration, Constant, is_time, short
from .sweep import executor_of
from .tables import SPELLINGS, WRONG, key_of, quantity

EXPLAINED, BOUNDED, WITH_FRICTION = "explained", "bounded", "explained with internal friction"
TWO_ANSWERS, FAR, REFUSED = "two answers", "not explained", "refused"
MEANING = {  # of a verdict
    EXPLAINED: "one mix comes within 10 mm of the slump, 20 mm of the slump flow and 4 mm of the mini-cone, its yield "
    "stress is found",
    BOUNDED: "the same, or no slump at all; the yield stress is bounded on one side",
    WITH_FRICTION: "no Bingham mix, but one whose yield stress grows with the pressure comes within 10 mm of the slump "
    "and 20 mm of the slump flow, and of T500 within its error; yield stress and friction angle are found or bounded",
    TWO_ANSWERS: "the tests contradict each other, slump and slump flow for example: what each says alone is given",
    FAR: "no mix comes so near, or the yield stress is not bounded",
    REFUSED: "the measurement cannot be used, for the reason given",
}
OTHER_TESTS = {  # names that are read as none of these, and of what they are
    "ausbreitmass": "of the flow table (EN 12350-5), no slump flow",
    "flowtable": "of the flow table (EN 12350-5), no slump flow",
}
FIELDS = {key_of(name): name for name in Measurements.model_fields}
FIELDS |= {key_of(word): field for field, words in SPELLINGS.items() for word in words.split()}
FIELDS |= {f"{key}error": f"{field}_error" for key, field in FIELDS.items() if field in TESTS.values()}


SECONDS = 0.05  # CPU time of a mix
OURS = re.compile(  # the columns that a table of results adds
    rf"(verdict|reason|({'|'.join(FRICTIONAL)})_(found|lower|upper|from|by_.+)|({'|'.join(NAMES)})_(model|missed))"
    r"( \(given\))*"
)
FOUND = ["yield stress", "by", "plastic viscosity", "by", "friction angle", "comes out as", "reason"]  # of the page
ABOUT = (
    "Intervals are of 95 %, by the errors of the measurements and of the model's tables. 'By' names the measurement "
    "without which the constant is least certain, 'usual' that it was not measured. The model: a Bingham mix, with "
    "internal friction where an angle stands, that sticks to floor and funnel; mould and flap gone at once. taichi-mps "
    "{version}, calibrate --table."
)


# ---- the list --------------------------------------------------------------------------------------------------
@lru_cache(maxsize=256)
def heading(column: str) -> tuple[str | None, str]:
    """Field of Measurements that a column holds, None for any other; and its unit, empty where the head names none.
    SceneError for a unit of another kind."""
    return quantity(column, FIELDS, lambda field: unit_of(Measurements.model_fields[field]))


def hint(column: str) -> str:
    """A column that is none of ours, and what may have been meant or what it is."""
    key = key_of(re.sub(r"[\[(].*", "", column))
    near = suggestion(key, FIELDS.keys() - {key}).removeprefix(", ")
    why = next((why for name, why in OTHER_TESTS.items() if key.startswith(name)), near)
    return f"'{column}'" + f" ({why})" * bool(why)


@validated
def read_list(path: File) -> list[dict[str, str]]:
    """The rows of a list as text: a CSV file whose columns are measurements, `slump [cm]` or `slump` in SI units, and
    any others, which are kept; one with a name of the results is kept as `... (given)`. SceneError for what is no such
    list."""
    rows, fields = tables.read_list(path), {}
    for column in (name for name in rows[0] if name):
        field, _ = heading(column)
        both = f"table = {path}: '{fields.get(field)}' and '{column}' are both {field}; must be one column"
        require(field is None or field not in fields, both)
        fields |= {field: column} if field else {}
    require(
        fields.keys() & set(TESTS.values()),
        f"table = {path}: has no column {', '.join(NAMES.values())}; must be a CSV file with a line for each mix "
        f"and the unit in the column's name: slump [cm]; {unused(rows)}",
    )
    return [
        {f"{name} (given)" if OURS.fullmatch(name or "") else name: cell for name, cell in row.items()} for row in rows
    ]


def unused(rows: list[dict[str, str]]) -> str:
    """The columns of a list that are no measurements, in words; empty where all are."""
    others = [name for name in rows[0] if name and not heading(name)[0]]
    words = ", ".join(f"'{name}'" if OURS.fullmatch(name) else hint(name) for name in others)
    return f"not used, but kept: {words}" if others else ""


def measurements_of(row: dict[str, str]) -> dict[str, str]:
    """Measurements of a row, with the units of their columns, or their own."""
    found = {}
    for column, value in row.items():
        field, unit = heading(column)
        if field and value and value.strip():
            found[field] = f"{value} {unit * without_unit(value)}".strip()
    return found


def stands(measured: dict[str, str]) -> bool:
    """Whether the slump of a row of a list is zero."""
    with suppress(ValueError):
        return float(in_unit("m", measured.get("slump", ""))) == 0.0
    return False


def without_slump(measured: dict[str, str]) -> dict[str, str]:
    """Measurements of a mix that stands: a slump less than its own error, and no slump flow, which is the mould's."""
    error = Measurements(**measured | {"slump": "1"}).slump_error
    kept = {name: value for name, value in measured.items() if name in ("rho", "plastic_viscosity", "slump_error")}
    return kept | {"slump": str(error)}


# ---- the results -----------------------------------------------------------------------------------------------
def one(row: dict[str, str], study=None) -> dict:
    """A row with what was found of it; verdict and reason in words."""
    row, measured = dict(row), {}
    try:
        require(WRONG not in row, row.pop(WRONG, ""))
        measured = measurements_of(row)
        require(measured.keys() & set(TESTS.values()), f"has no measurement, none of {', '.join(NAMES.values())}")
        found = calibrate(**(without_slump(measured) if stands(measured) else measured), study=study, check=False)
    except (SceneError, ValueError) as error:
        return {**row, "verdict": REFUSED, "reason": " ".join(str(error).split())}
    if stands(measured):
        least = found.yield_value.lower
        known = {"yield_value_lower": least, "verdict": BOUNDED}
        return {**row, **known, "reason": f"it stands: its yield stress is more than {short(least)} Pa"}
    return {**row, **columns_of(found), **judged(found)}


def columns_of(found: Calibration) -> dict:
    """Columns of a result table from a calibration, SI units; empty where it has none. Where internal friction explains
    it, constants and model are those of that mix."""
    mix, kept = found.best, {}
    for name, constant in mix.constants.items():
        kept |= {
            f"{name}_found": constant.value if constant.determined else None,
            f"{name}_lower": constant.lower,
            f"{name}_upper": constant.upper,
            f"{name}_from": mix.source(name),
        }
    for name in (name for name in NAMES if name in found.measured or name in CONE):
        constant = "plastic_viscosity" if is_time(name) else "yield_value"
        said = found.alone.get(constant, {}).get(name, (None,))
        kept |= {
            f"{constant}_by_{name.rpartition('_')[0]}": said[0],
            f"{name}_model": mix.model.get(name),
            f"{name}_missed": mix.missed.get(name),
        }
    return kept


def judged(found: Calibration) -> dict[str, str]:
    """Outcome of a mix, and why no single Bingham mix explains it; no reason where one does."""
    friction = found.friction
    tried = f"; {friction.told()}" if friction else ""
    if found.fits and found.near and found.yield_value.bounded:
        verdict, reason = EXPLAINED if found.yield_value.determined else BOUNDED, ""
    elif found.explained_by_friction:
        verdict, reason = WITH_FRICTION, f"no Bingham mix does {friction.every}{tried}: {friction.command}"
    elif any(len(said) > 1 for said in found.alone.values()):
        verdict, reason = TWO_ANSWERS, found.contradiction() + tried
    else:
        verdict, reason = FAR, found.nearest() + tried
    return {"verdict": verdict, "reason": reason}


@validated
def calibrate_list(
    rows: list[dict],
    study: Place | None = None,
    watch: Callable | None = None,
    executor: Text | None = None,
    workers: Count | None = None,
) -> list[dict]:
    """Every row with what was found of it, in their order; ``watch(row, number)`` is told of each. Some SECONDS a row:
    they are computed in this process, unless ``executor`` is 'local' (processes of this machine, as
    many as ``workers``, the number of CPUs by default) or 'dask://HOST:PORT'. What a worker does not bring to an end is
    computed here."""
    slow = f"executor = {executor}: a mix takes a tenth of a second; must be local or dask://HOST:PORT"
    require(not (executor or "").startswith("slurm:"), slow)
    elsewhere = f"workers = {workers}: are processes of this machine; must be left out with {executor}"
    require(not workers or executor in (None, "local"), elsewhere)
    opened = executor_of(executor, workers, None)[0] if executor else nullcontext
    found, futures = [], []
    with opened() as pool:
        with suppress(BrokenExecutor):
            for row in rows if pool else ():
                futures.append(pool.submit(one, row, study))
        for row, future in zip_longest(rows, futures):
            try:
                found.append(future.result() if future else one(row, study))
            except Exception:  # of the executor; what is wrong with a mix is in its row
                found.append(one(row, study))
            if watch:
                watch(found[-1], len(found))
    return found


def counted(rows: list[dict]) -> list[tuple[int, str, str]]:
    """Number of mixes for each outcome, and its meaning."""
    count = Counter(row["verdict"] for row in rows)
    return [(count[name], name, MEANING[name]) for name in MEANING if count[name]]


def tally(rows: list[dict]) -> str:
    """Number of mixes for each outcome, a line each with its meaning."""
    return "\n".join(f"{count:4d} {name}: {meaning}" for count, name, meaning in counted(rows))


def write(rows: list[dict], path) -> None:
    """The table of results, CSV, numbers with five figures."""
    rounded = [{name: f"{v:.5g}" if isinstance(v, float) else v for name, v in row.items()} for row in rows]
    tables.write(rounded, path)


# ---- the page --------------------------------------------------------------------------------------------------
def write_page(rows: list[dict], columns: list[str], out, source) -> Path:
    """Page of the rows that ``calibrate_list`` found of a list, a file ``source`` of these ``columns``; its path."""
    found = [[*(row[name] or "" for name in columns), *cells(row)] for row in rows]
    return publish(
        Path(__file__).with_name("mixes.html"),
        user_path(out),
        groups(rows, columns),
        title=safe(f"{Path(source).name}: mixes calibrated"),
        lead=f"{len(rows)} mixes",
        tally=table(counted(rows), ["mixes", "come out as", ""]),
        mixes=table(found, [*columns, *FOUND]),
        about=safe(ABOUT.format(version=__version__)),
    )


def cells(row: dict) -> list[str]:
    """Cells of a row's result, in the words of FOUND."""
    if row["verdict"] in (TWO_ANSWERS, REFUSED):  # the nearest mix of a contradiction is nobody's
        return [*[""] * 5, row["verdict"], row["reason"]]
    constants = [text for name in BINGHAM for text in (interval(row, name), row.get(f"{name}_from", ""))]
    angle = interval(row, "friction_angle") if row["verdict"] == WITH_FRICTION else ""
    return [*constants, angle, row["verdict"], row["reason"]]


def interval(row: dict, name: str) -> str:
    """A constant of a row with its interval or its bound."""
    value, lower, upper = (row.get(f"{name}_{end}") for end in ("found", "lower", "upper"))
    it = Constant(value, lower, upper, 0.0, 0.0, UNITS[name])
    told = it.bounds() if it.bounded else "not determined"
    return f"{told} ({short(lower)} to {short(upper)})" if it.determined and lower != upper else told


def groups(rows: list[dict], columns=()) -> list[dict]:
    """Groups of a chart: of the mixes of a verdict its name and colour, their names by some columns, and slump and
    slump flow [cm], as measured and of the nearest mix, (n, 2) each."""
    compared, found = [row for row in rows if all(row.get(f"{name}_missed") is not None for name in CONE)], []
    for kind, colour in zip(MEANING, COLOURS, strict=False):
        here = [row for row in compared if row["verdict"] == kind]
        model, missed = (
            100.0 * np.reshape([[row[f"{name}_{what}"] for name in CONE] for row in here], (-1, 2))
            for what in ("model", "missed")
        )
        names = [", ".join(str(row[name]) for name in columns if row[name]) for row in here]
        lengths = {"measured": (model - missed).tolist(), "model": model.tolist()}
        found += [{"verdict": kind, "colour": colour, "names": names} | lengths] * bool(here)
    return found
