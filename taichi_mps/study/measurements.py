"""What a laboratory measures of a mix, and what of it cannot be."""

import numpy as np
from pydantic import Field

from ..problem.accuracy import GRAVITY
from ..units import Checked, Density, Duration, Length, SceneError, Viscosity, YieldValue
from .calibration import CONSTANTS, short
from .case import REACHED
from .emulator import DENSITY, MEASURED, Emulator, Together

LARGEST = 10.0  # spread of a cone over its height


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

    def measured(self) -> dict[str, tuple[float, float]]:
        """Value and standard error of each measurement, by its name in MEASURED. SceneError where there is none."""
        late = self.v_funnel_error or 0.1 * (self.v_funnel or 0.0)
        given = {
            "slump_m": (self.slump, self.slump_error),
            "spread_m": (self.spread, self.spread_error),
            "t500_s": (self.t500, self.t500_error),
            "mini_cone_m": (self.mini_cone, self.mini_cone_error),
            "v_funnel_s": (self.v_funnel, late),
        }
        found = {name: pair for name, pair in given.items() if pair[0] is not None}
        if not found:
            raise SceneError("calibrate: give at least one of --slump, --spread, --t500, --mini-cone, --v-funnel")
        return found

    def known(self) -> dict[str, float]:
        """The constants of the mix that are given, SI units."""
        return {name: getattr(self, name) for name in CONSTANTS if getattr(self, name) is not None}


def scenes_of(measured: dict) -> list[str]:
    """The tests that these measurements are of."""
    return [scene for scene, columns in MEASURED.items() if columns.keys() & measured.keys()]


def check_tests(test: Measurements, emulators: dict[str, Emulator]) -> None:
    """SceneError for measurements that no mix has, by the sizes of the cones that the tables, by scene, are of."""
    slump, spread, t500 = test.slump, test.spread, test.t500
    if t500 and spread and spread + 3.0 * test.spread_error < REACHED:
        raise SceneError(
            f"t500 = {t500:g} s: with spread = {spread:g} m it never spread to 0.5 m; leave one of them out"
        )
    if "slump" in emulators:
        height, base, _ = sizes(emulators["slump"])
        if slump and slump >= height:
            raise SceneError(
                f"slump = {slump:g} m: must be less than {height:g} m, the height of the cone; 21cm is a length, too"
            )
        check_lengths({"spread": (spread or 0.0, LARGEST * height)})
        check_lengths({"slump_error": (test.slump_error, height), "spread_error": (test.spread_error, height)})
        check_base("spread", spread, test.spread_error, base)
        if slump and spread:
            check_room(
                emulators["slump"], slump - 3.0 * test.slump_error, spread + 3.0 * test.spread_error, slump, spread
            )
    if "mini_cone" in emulators:
        height, base, _ = sizes(emulators["mini_cone"])
        most = {"mini_cone": (test.mini_cone, LARGEST * height), "mini_cone_error": (test.mini_cone_error, height)}
        check_lengths(most)
        check_base("mini_cone", test.mini_cone, test.mini_cone_error, base)
    if "v_funnel" in emulators and test.v_funnel:
        least, (value, error) = shortest(emulators["v_funnel"]), test.measured()["v_funnel_s"]
        if value + 3.0 * error < least:
            raise SceneError(
                f"v_funnel = {value:g} s: must be more than {least:.1g} s, in which the funnel would run empty at the "
                "speed of a free fall through its height"
            )


def shortest(funnel: Emulator) -> float:
    """Time [s] in which no fluid can leave the tapered part of the funnel that a table is of, by its energy."""
    names = "top", "outlet", "taper", "spout"
    top, outlet, taper, spout = (funnel.settings.get(key, funnel.usual[key]) for key in names)
    fastest = np.sqrt(2.0 * GRAVITY * (taper + spout))
    return 0.5 * (top + outlet) * taper / (outlet * fastest)


def sizes(cone: Emulator) -> tuple[float, float, float]:
    """Height and diameters at the base and the top [m] of the cone that a table is of."""
    return tuple(cone.settings.get(key, cone.usual[key]) for key in ("height", "base_diameter", "top_diameter"))


def check_lengths(most: dict[str, tuple[float, float]]) -> None:
    """SceneError where a length [m] is not less than the most that it can be, {key: (length, most)}."""
    for key, (value, limit) in most.items():
        if value >= limit:
            raise SceneError(f"{key} = {value:g} m: must be less than {limit:g} m; 21cm and 5mm are lengths, too")


def check_base(key: str, spread: float | None, error: float, base: float) -> None:
    """SceneError for a spread [m] that is less than the base of its cone, by more than three standard errors."""
    if spread and spread + 3.0 * error < base:
        raise SceneError(f"{key} = {spread:g} m: must be more than {base:g} m, the base of the cone")


def check_room(cone: Emulator, least: float, widest: float, slump: float, spread: float) -> None:
    """SceneError where even with three standard errors, ``least`` slump and ``widest`` spread [m], a cylinder around
    the body holds less than the mould."""
    height, base, top = sizes(cone)
    mould = np.pi / 12.0 * height * (base**2 + base * top + top**2)
    room = np.pi / 4.0 * widest**2 * (height - max(0.0, least))
    if room < mould:
        raise SceneError(
            f"slump = {slump:g} m with spread = {spread:g} m: leaves room for {1e3 * room:.1f} l at most, and the "
            f"mould holds {1e3 * mould:.1f} l; one of them must be misread"
        )


def check_known(known: dict[str, float], tables: Together, density: float) -> None:
    """SceneError for a known constant that the tables do not reach."""
    for k, (name, (_, unit)) in enumerate(CONSTANTS.items()):
        low, high = density * np.exp([tables.low[k], tables.high[k]])
        if name in known and not low <= known[name] <= high:
            raise SceneError(
                f"{name} = {known[name]:g} {unit}: must be {short(low)} to {short(high)} {unit}, what the table covers"
            )
