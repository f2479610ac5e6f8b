"""A laboratory's list of measured mixes: one calibration each, and a table of the results."""

import re
from collections import Counter
from contextlib import suppress
from functools import lru_cache

from ..spelling import in_unit, without_unit
from ..units import File, Place, SceneError, require, suggestion, unit_of, validated
from . import tables
from .calibrate import CONE_RESULTS, FIELD_OF_RESULT, Measurements, calibrate, dimensions
from .calibration import FRICTIONAL, NAMES, Calibration, is_time, rounded
from .emulator import emulator_of
from .tables import COLUMN_NAMES, ROW_ERROR, key_of, match_column

EXPLAINED, BOUNDED, WITH_FRICTION = "fitted", "limit only", "fitted with internal friction"
TWO_ANSWERS, FAR, REFUSED = "two answers", "not fitted", "refused"
VERDICTS = {  # {verdict: its meaning}
    EXPLAINED: "one mix comes within 10 mm of the slump, 20 mm of the slump flow and 4 mm of the mini-cone, its yield "
    "stress is found",
    BOUNDED: "a mix comes as near, or there was no slump; only a lower or an upper limit of the yield stress is found",
    WITH_FRICTION: "no Bingham mix, but one whose yield stress grows with the pressure comes within 10 mm of the slump "
    "and 20 mm of the slump flow, and of T500 within its error; both constants are found, or limits of them",
    TWO_ANSWERS: "the tests contradict each other, slump and slump flow for example: what each says alone is given",
    FAR: "no mix comes so near, or nothing limits the yield stress",
    REFUSED: "the measurement cannot be used, for the reason given",
}
OTHER_TESTS = {  # {beginning of a column's key: what this unused measurement is}
    "ausbreitmass": "of the flow table (EN 12350-5), no slump flow",
    "flowtable": "of the flow table (EN 12350-5), no slump flow",
}
# {key_of(name of a column): field of Measurements}
FIELDS = {
    **{key_of(name): name for name in Measurements.model_fields},
    **{key_of(word): field for field, words in COLUMN_NAMES.items() for word in words.split()},
}
FIELDS |= {f"{key}error": f"{field}_error" for key, field in FIELDS.items() if field in FIELD_OF_RESULT.values()}
NOT_MEASURED = {
    "",
    "-",
    "–",
    "—",
    "/",
    "n/a",
    "#n/a",
    "n.a.",
    "na",
    "n.d.",
    "nd",
    "k.a.",
}  # cells without a measurement
SECONDS_PER_MIX = 0.05  # CPU time of a calibration [s]
RESULT_COLUMN = re.compile(  # name of a column that a table of results adds
    rf"(verdict|reason|({'|'.join(FRICTIONAL)})_(found|lower|upper|from|by_.+)|({'|'.join(NAMES)})_(model|missed))"
    r"( \(given\))*"
)


# ---- the list --------------------------------------------------------------------------------------------------
@lru_cache(maxsize=256)
def field_and_unit(column: str) -> tuple[str | None, str]:
    """Return the field of Measurements that a column holds, else None, and the unit in its name, else ''.

    SceneError for a unit of another kind.
    """
    return match_column(column, FIELDS, lambda field: unit_of(Measurements.model_fields[field]))


def hint(column: str) -> str:
    """Format the name of a column that is no measurement, with what it is or with a similar name that is one."""
    key = key_of(re.sub(r"[\[(].*", "", column))
    reason = next(
        (reason for name, reason in OTHER_TESTS.items() if key.startswith(name)),
        suggestion(key, FIELDS.keys() - {key}).removeprefix(", "),
    )
    return f"'{column}'" + (f" ({reason})" if reason else "")


@validated
def read_list(path: File) -> list[dict[str, str]]:
    """Read the rows of a list as text: a CSV file or an Excel sheet whose columns are measurements, `slump [cm]` or
    `slump` in SI units, and any others, which are kept; one with a name of the results is kept as `... (given)`.
    SceneError for any other file."""
    rows, fields = with_units_of_first_row(tables.read_list(path)), {}
    for column in (name for name in rows[0] if name):
        try:
            field, _ = field_and_unit(column)
        except SceneError as error:
            raise SceneError(f"table = {path}: {error}") from None
        require(
            field is None or field not in fields,
            f"table = {path}: '{fields.get(field)}' and '{column}' are both {field}; must be one column",
        )
        fields |= {field: column} if field else {}
    require(
        fields.keys() & set(FIELD_OF_RESULT.values()),
        f"table = {path}: has no column {', '.join(NAMES.values())}; must be a CSV file or an Excel sheet with a "
        f"line for each mix and the unit in the column's name: slump [cm]; {unused(rows)}",
    )
    names = {name: f"{name} (given)" if RESULT_COLUMN.fullmatch(name or "") else name for row in rows for name in row}
    return [{names[name]: cell for name, cell in row.items()} for row in rows]


def with_units_of_first_row(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """Return the rows with the units of a row of its own, below the header, in the names of the columns."""
    cells = {name: cell.strip("[]() ") for name, cell in rows[0].items() if name and cell}
    with suppress(SceneError):  # for a cell that is no unit
        names = {
            name: f"{name} [{cell}]"
            for name, cell in cells.items()
            for field, unit in [field_and_unit(name)]
            if field and not unit
        }
        are_units = names and all(field_and_unit(name)[1] for name in names.values())
        if len(rows) > 1 and are_units and rows[0].keys().isdisjoint(names.values()):
            return [{names.get(name, name): cell for name, cell in row.items()} for row in rows[1:]]
    return rows


def unused(rows: list[dict[str, str]]) -> str:
    """Format the columns of a list that are no measurements; '' where all are."""
    others = [name for name in rows[0] if name and not field_and_unit(name)[0]]
    words = ", ".join(f"'{name}'" if RESULT_COLUMN.fullmatch(name) else hint(name) for name in others)
    return f"not used, but kept: {words}" if others else ""


def measurements_of(row: dict[str, str]) -> dict[str, str]:
    """Return the measurements of a row as text, with their own unit or that of their column."""
    found = {
        field: f"{value} {unit * without_unit(value)}".strip()
        for column, value in row.items()
        for field, unit in [field_and_unit(column)]
        if field and value and value.strip().casefold() not in NOT_MEASURED
    }
    return {name: value for name, value in found.items() if name.removesuffix("_error") in found}


def has_zero_slump(measured: dict[str, str]) -> bool:
    """Whether the slump of a row of a list is zero."""
    with suppress(ValueError):
        return float(in_unit("m", measured.get("slump", ""))) == 0.0
    return False


def without_slump(measured: dict[str, str]) -> dict[str, str]:
    """Return the measurements of a mix without slump: a slump as large as its error, and no slump flow. SceneError for
    results of a mix that flows."""
    test, (_, base, _) = Measurements(**measured | {"slump": "1"}), dimensions(emulator_of())
    flows = [name for name in ("t500", "mini_cone", "v_funnel") if name in measured]
    flows += ["slump flow"] if test.spread and test.spread - 3.0 * test.spread_error > base else []
    require(
        not flows,
        f"slump = 0 m: such a mix has no {' and no '.join(flows)}; must be an empty cell if it was not measured",
    )
    kept = {name: value for name, value in measured.items() if name in ("rho", "plastic_viscosity", "slump_error")}
    return kept | {"slump": str(test.slump_error)}


# ---- the results -----------------------------------------------------------------------------------------------
def calibrate_row(row: dict[str, str], study=None) -> dict:
    """Calibrate a row of a list; return it with the results, the verdict and the reason."""
    row, measured = dict(row), {}
    try:
        require(ROW_ERROR not in row, row.pop(ROW_ERROR, ""))
        measured = measurements_of(row)
        require(
            measured.keys() & set(FIELD_OF_RESULT.values()),
            f"has no measurement, none of {', '.join(NAMES.values())}",
        )
        used = without_slump(measured) if has_zero_slump(measured) else measured
        found = calibrate(**used, study=study, check=False)
        require(
            used is measured or found.yield_value.lower is not None,
            "slump = 0 m: with its error it limits no yield stress; slump_error must be smaller",
        )
    except (SceneError, ValueError) as error:
        return {**row, "verdict": REFUSED, "reason": " ".join(str(error).split())}
    if has_zero_slump(measured):
        bound = found.yield_value.lower
        return {
            **row,
            "yield_value_lower": bound,
            "verdict": BOUNDED,
            "reason": f"it stands: its yield stress is more than {rounded(bound)} Pa",
        }
    return {**row, **columns_of(found), **verdict_of(found)}


def columns_of(found: Calibration) -> dict:
    """Return the result columns of a calibration in SI units, None without a value. Constants and model are those of
    the mix with internal friction where that explains the measurements."""
    mix, columns = found.best, {}
    for name, constant in mix.constants.items():
        columns |= {
            f"{name}_found": constant.value if constant.determined else None,
            f"{name}_lower": constant.lower,
            f"{name}_upper": constant.upper,
            f"{name}_from": mix.source(name),
        }
    for name in (name for name in NAMES if name in found.measured or name in CONE_RESULTS):
        constant = "plastic_viscosity" if is_time(name) else "yield_value"
        columns |= {
            f"{constant}_by_{name.rpartition('_')[0]}": found.alone.get(constant, {}).get(name, (None,))[0],
            f"{name}_model": mix.model.get(name),
            f"{name}_missed": mix.missed.get(name),
        }
    return columns


def verdict_of(found: Calibration) -> dict[str, str]:
    """Return the verdict on a mix and the reason why no single Bingham mix explains it, '' where one does."""
    friction = found.friction
    tried = f"; {friction.describe()}" if friction else ""
    if found.fits and found.within_tolerance and found.yield_value.bounded:
        verdict, reason = EXPLAINED if found.yield_value.determined else BOUNDED, ""
    elif found.explained_by_friction:
        verdict, reason = WITH_FRICTION, f"no Bingham mix does {friction.all_measurements}{tried}: {friction.command}"
    elif any(len(readings) > 1 for readings in found.alone.values()):
        verdict, reason = TWO_ANSWERS, found.contradiction() + tried
    else:
        verdict, reason = FAR, found.nearest() + tried
    return {"verdict": verdict, "reason": reason}


@validated
def calibrate_list(rows: list[dict], study: Place | None = None) -> list[dict]:
    """Calibrate all rows and return them with the results, in order."""
    emulator_of(study)  # refused once, not for each row
    return [calibrate_row(row, study) for row in rows]


def tally(rows: list[dict]) -> str:
    """Format the number of mixes for each verdict that occurs, a line each with its meaning."""
    count = Counter(row["verdict"] for row in rows)
    return "\n".join(f"{count[name]:4d} {name}: {meaning}" for name, meaning in VERDICTS.items() if count[name])


def write(rows: list[dict], path) -> None:
    """Write the table of results, CSV, numbers with five figures."""
    tables.write([{name: f"{v:.5g}" if isinstance(v, float) else v for name, v in row.items()} for row in rows], path)
