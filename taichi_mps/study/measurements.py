"""What a laboratory measures of a mix, one mix or a list of them, and what of it cannot be."""

import csv
from contextlib import suppress
from pathlib import Path

import numpy as np
from pydantic import Field

from ..problem.accuracy import GRAVITY
from ..units import Checked, Density, Duration, Length, SceneError, Viscosity, YieldValue, suggestion, unit_of
from .calibration import BINGHAM, WORDS, short
from .case import REACHED
from .emulator import DENSITY, Emulator

LARGEST = 10.0  # spread of a cone over its height
TESTS = {  # what is measured of a mix, by its name in emulator.MEASURED
    "slump_m": "slump",
    "spread_m": "spread",
    "t500_s": "t500",
    "mini_cone_m": "mini_cone",
    "v_funnel_s": "v_funnel",
}


class Measurements(Checked):
    """What was measured of a mix, and how well: lengths [m], times [s], density [kg/m3], constants in SI units."""

    slump: Length | None = Field(None, description="slump")
    spread: Length | None = Field(None, description="diameter of the spread, mean of two")
    t500: Duration | None = Field(None, description="time to a spread of 500 mm")
    mini_cone: Length | None = Field(None, description="spread of the mini-cone (Kantro, 57.2 mm high)")
    v_funnel: Duration | None = Field(None, description="time in which the V-funnel runs empty")
    yield_value: YieldValue | None = Field(None, description="yield stress, if known, of a rheometer")
    plastic_viscosity: Viscosity | None = Field(None, description="plastic viscosity, if known, of a rheometer")
    rho: Density = Field(DENSITY, description="density")
    slump_error: Length = Field(0.005, description="standard error of the slump")
    spread_error: Length = Field(0.01, description="standard error of the spread")
    t500_error: Duration = Field(0.2, description="standard error of the time")
    mini_cone_error: Length = Field(0.002, description="standard error of the spread of the mini-cone")
    v_funnel_error: Duration | None = Field(None, description="standard error of the time, by default a tenth of it")

    def error(self, test: str) -> float:
        """Standard error of a measurement, SI units."""
        given = getattr(self, f"{test}_error")
        return 0.1 * self.v_funnel if given is None else given

    def measured(self) -> dict[str, tuple[float, float]]:
        """Value and standard error of each measurement, by its name in TESTS. SceneError where there is none."""
        found = {name: getattr(self, test) for name, test in TESTS.items()}
        found = {name: (value, self.error(TESTS[name])) for name, value in found.items() if value is not None}
        if not found:
            raise SceneError("calibrate: give at least one of --slump, --spread, --t500, --mini-cone, --v-funnel")
        return found

    def known(self) -> dict[str, float]:
        """The constants of the mix that are given, SI units."""
        return {name: getattr(self, name) for name in BINGHAM if getattr(self, name) is not None}


def check_tests(test: Measurements, emulators: dict[str, Emulator]) -> None:
    """SceneError for measurements that no mix has, by the sizes of cones and funnel that the tables, by scene, are of;
    by more than three standard errors, where an error may be the reason."""
    if test.t500 and test.spread and test.spread + 3.0 * test.spread_error < REACHED:
        raise SceneError(
            f"t500 = {test.t500:g} s: with spread = {test.spread:g} m it never spread to 0.5 m; leave one of them out"
        )
    limits = []  # key, least and most that it can be, and what the least is
    for scene, keys in {"slump": ("slump", "spread"), "mini_cone": ("mini_cone",)}.items():
        for key in keys if scene in emulators else ():
            height, base, _ = sizes(emulators[scene])
            ends = (0.0, height) if key == "slump" else (base, LARGEST * height)
            limits += [(key, *ends, "the base of the cone"), (f"{key}_error", 0.0, height, "")]
    if "v_funnel" in emulators:
        why = "in which the funnel would run empty at the speed of a free fall through its height"
        limits += [("v_funnel", shortest(emulators["v_funnel"]), np.inf, why)]
    for key, least, most, why in limits:
        value, unit = getattr(test, key), unit_of(Measurements.model_fields[key])
        if value is not None and value >= most:
            raise SceneError(
                f"{key} = {value:g} {unit}: must be less than {most:g} {unit}; 21cm and 5mm are lengths, too"
            )
        if value and least and value + 3.0 * test.error(key) < least:
            raise SceneError(f"{key} = {value:g} {unit}: must be more than {least:.3g} {unit}, {why}")
    if "slump" in emulators and test.slump and test.spread:
        check_room(emulators["slump"], test)


def shortest(funnel: Emulator) -> float:
    """Time [s] in which no fluid can leave the tapered part of the funnel that a table is of, by its energy."""
    top, outlet, taper, spout = sizes(funnel, ("top", "outlet", "taper", "spout"))
    fastest = np.sqrt(2.0 * GRAVITY * (taper + spout))
    return 0.5 * (top + outlet) * taper / (outlet * fastest)


def sizes(test: Emulator, names=("height", "base_diameter", "top_diameter")) -> tuple[float, ...]:
    """Lengths [m] of the cone or the funnel that a table is of."""
    return tuple(test.settings.get(key, test.usual[key]) for key in names)


def check_room(cone: Emulator, test: Measurements) -> None:
    """SceneError where even with three standard errors a cylinder around the body holds less than the mould."""
    height, base, top = sizes(cone)
    mould = np.pi / 12.0 * height * (base**2 + base * top + top**2)
    widest, least = test.spread + 3.0 * test.spread_error, max(0.0, test.slump - 3.0 * test.slump_error)
    room = np.pi / 4.0 * widest**2 * (height - least)
    if room < mould:
        raise SceneError(
            f"slump = {test.slump:g} m with spread = {test.spread:g} m: leaves room for {1e3 * room:.1f} l at most, "
            f"and the mould holds {1e3 * mould:.1f} l; one of them must be misread"
        )


def check_known(known: dict[str, float], emulators: list[Emulator], density: float) -> None:
    """SceneError for a known constant that the tables do not reach."""
    for k, name in enumerate(BINGHAM):
        ends = max(each.low[k] for each in emulators), min(each.high[k] for each in emulators)
        (low, high), unit = density * np.exp(ends), WORDS[name][1]
        if name in known and not low <= known[name] <= high:
            raise SceneError(
                f"{name} = {known[name]:g} {unit}: must be {short(low)} to {short(high)} {unit}, what the table covers"
            )


# ---- a list of mixes -------------------------------------------------------------------------------------------
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
    if not set(TESTS.values()) & set(columns):
        near = next((hint for name in columns if (hint := suggestion(name, Measurements.model_fields))), "")
        raise SceneError(
            f"table = {path}: has no column {', '.join(TESTS.values())}{near}; must be a CSV file with a line for each "
            "mix, and the unit in the column's name: slump [cm]"
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


def stands(measured: dict[str, str]) -> bool:
    """Is the slump of a row of a list zero, with its unit or without?"""
    with suppress(ValueError):
        return float(measured.get("slump", "").partition(" ")[0]) == 0.0
    return False


def without_slump(measured: dict[str, str]) -> dict[str, str]:
    """Of a mix that stands only that it does: its slump is less than its own error, and its spread is the mould's."""
    error = Measurements(**measured | {"slump": "1"}).slump_error
    kept = {name: value for name, value in measured.items() if name in ("rho", "plastic_viscosity", "slump_error")}
    return kept | {"slump": str(error)}
