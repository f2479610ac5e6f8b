"""A laboratory's list of measured mixes: one calibration each, and a table."""

import csv
from collections import Counter
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from itertools import zip_longest
from pathlib import Path

from ..units import SceneError, suggestion
from .calibrate import calibrate
from .calibration import CONE, CONSTANTS, FRICTIONAL, NAMES, Calibration, apart, short
from .emulator import is_time
from .executors import named
from .measurements import Measurements

TESTS = "slump", "spread", "t500", "mini_cone", "v_funnel"  # columns, of which a list has one at least
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


def read_list(path) -> list[dict[str, str]]:
    """The rows of a list as text: a CSV file whose columns are measurements, `slump [cm]` or `slump` in SI units, and
    any others, which are kept. SceneError for what is no such list."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise SceneError(f"table = {path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    rows = list(csv.DictReader(lines, strict=True))
    columns = [heading(name)[0] for name in (rows[0] if rows else {}) if name]
    if not set(TESTS) & set(columns):
        near = next((hint for name in columns if (hint := suggestion(name, Measurements.model_fields))), "")
        raise SceneError(
            f"table = {path}: has no column {', '.join(TESTS)}{near}; must be a CSV file with a line for each mix, "
            "and the unit in the column's name: slump [cm]"
        )
    return rows


def heading(column) -> tuple[str, str]:
    """Name and unit of a column, of ``Mini-cone [cm]`` mini_cone and cm."""
    name, _, unit = str(column or "").partition("[")
    return name.strip().lower().replace("-", "_").replace(" ", "_"), unit.strip().rstrip("]")


def measurements_of(row: dict[str, str]) -> dict[str, str]:
    """Those of a row, with the units of their columns."""
    found = {}
    for column, value in row.items():
        name, unit = heading(column)
        if name in Measurements.model_fields and value and value.strip():
            found[name] = f"{value.strip()} {unit}".strip()
    return found


def without_slump(measured: dict[str, str]) -> dict[str, str]:
    """Of a mix that stands only that it does: its slump is less than its own error, and its spread is the mould's."""
    error = Measurements(**measured | {"slump": "1"}).slump_error
    return {name: value for name, value in measured.items() if name in ("rho", "plastic_viscosity", "slump_error")} | {
        "slump": str(error)
    }


def is_zero(measured: str) -> bool:
    """Is this measurement a zero, with its unit or without?"""
    with suppress(ValueError):
        return float(measured.partition(" ")[0]) == 0.0
    return False


def one(row: dict[str, str], study=None) -> dict:
    """A row with what was found of it; verdict and reason in words."""
    measured = measurements_of(row)
    try:
        stands = is_zero(measured.get("slump", ""))
        found = calibrate(**(without_slump(measured) if stands else measured), study=study, check=False)
    except (SceneError, ValueError) as error:
        return {**row, "verdict": REFUSED, "reason": " ".join(str(error).split())}
    if stands:
        least = found.yield_value.lower
        known = {"yield_value_lower": least, "verdict": BOUNDED}
        return {**row, **known, "reason": f"it stands: its yield stress is more than {short(least)} Pa"}
    return {**row, **columns_of(found), "verdict": verdict(found), "reason": reason(found)}


def columns_of(found: Calibration) -> dict:
    """What a result table keeps of a calibration, SI units; empty where it has none. Where internal friction explains
    it, constants and model are those of that mix."""
    mix, names = (found.friction, FRICTIONAL) if found.explained_by_friction else (found, CONSTANTS)
    kept = {}
    for name in names:
        constant = getattr(mix, name)
        kept |= {f"{name}_found": constant.value if constant.determined or constant.low == constant.high else None}
        kept |= {f"{name}_lower": constant.lower, f"{name}_upper": constant.upper}
        kept[f"{name}_from"] = mix.source(name)
    for name in NAMES:
        if name not in found.measured and name not in CONE:
            continue
        constant = "plastic_viscosity" if is_time(name) else "yield_value"
        said = found.alone.get(constant, {}).get(name, (None,))
        kept[f"{constant}_by_{name.rpartition('_')[0]}"] = said[0]
        kept |= {f"{name}_model": mix.model.get(name), f"{name}_missed": mix.missed.get(name)}
    return kept


def verdict(found: Calibration) -> str:
    """How a mix came out."""
    if found.near and found.yield_value.bounded and not found.contradictory:
        return EXPLAINED if found.yield_value.determined else BOUNDED
    if found.explained_by_friction:
        return WITH_FRICTION
    return TWO_ANSWERS if two_answers(found) else FAR


def two_answers(found: Calibration) -> bool:
    """Does each of several measurements, or a rheometer, say another value of the same constant?"""
    return any(len(said) > 1 for said in found.alone.values())


def reason(found: Calibration) -> str:
    """Why no single mix explains it; empty where one does."""
    if verdict(found) in (EXPLAINED, BOUNDED):
        return ""
    if found.explained_by_friction:
        both = "both" if len(found.measured) == 2 else "all three"
        return f"no Bingham mix does {both}; {found.friction.told()}: {found.friction.command}"
    tried = f"; {found.friction.told()}" if found.friction else ""
    if two_answers(found):
        return found.contradiction() + tried
    far = [f"{NAMES[name]} {apart(name, by)}" for name, by in found.missed.items()]
    return f"the nearest mix misses: {', '.join(far)}{tried}"


def calibrate_list(rows: list[dict[str, str]], study=None, watch=None, executor=None, workers=None) -> list[dict]:
    """Every row with what was found of it, in their order; ``watch(row, number)`` is told of each. Some 0.05
    CPU-seconds a row: they are computed in this process, unless an ``executor`` is named, as of ``of_workers``."""
    found = []
    here = (one(row, study) for row in rows)
    for number, row in enumerate(of_workers(rows, study, executor, workers) if executor else here, 1):
        found.append(row)
        if watch:
            watch(row, number)
    return found


def of_workers(rows, study, executor: str, workers: int | None):
    """Each row with what was found of it, by 'local' (processes of this machine, as many as ``workers``, the number of
    CPUs by default) or 'dask://HOST:PORT'. What a worker does not bring to an end is computed here."""
    if executor.startswith("slurm:"):
        raise SceneError(f"executor = {executor}: a mix takes a tenth of a second; must be local or dask://HOST:PORT")
    if workers and executor != "local":
        raise SceneError(f"workers = {workers}: are processes of this machine; must be left out with {executor}")
    opened, _ = named(executor, workers, None)
    with opened() as pool:
        futures = []
        with suppress(BrokenExecutor):
            for row in rows:
                futures.append(pool.submit(one, row, study))
        for row, future in zip_longest(rows, futures):
            try:
                yield future.result() if future else one(row, study)
            except Exception:  # of the executor; what is wrong with a mix is in its row
                yield one(row, study)


def tally(rows: list[dict]) -> str:
    """How many mixes came out how, a line each with what that means."""
    count = Counter(row["verdict"] for row in rows)
    return "\n".join(f"{count[name]:4d} {name}: {MEANING[name]}" for name in MEANING if count[name])


def write(rows: list[dict], path) -> Path:
    """The table of results, CSV."""
    names = list(dict.fromkeys(name for row in rows for name in row if name))
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, names, restval="", extrasaction="ignore")
        table.writeheader()
        for row in rows:
            table.writerow({name: f"{v:.5g}" if isinstance(v, float) else v for name, v in row.items()})
    return Path(path)
