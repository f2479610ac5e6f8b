"""The constants of a mix from tests of it, with intervals from the errors of the measurements."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
from pydantic import Field

from ..problem.accuracy import GRAVITY
from ..problem.materials import Bingham
from ..units import (
    Checked,
    Density,
    Duration,
    Flag,
    Length,
    SceneError,
    Speed,
    Viscosity,
    YieldValue,
    checked,
    require,
    unit_of,
)
from .calibration import BINGHAM, FRICTIONAL, RHEOMETER, Calibration, FrictionalMix, is_time
from .case import REACHED, case, run
from .emulator import DENSITY, FRICTION, MEASURED, Emulator, emulator_of, scale
from .fit import fit

CHECKED = "slump", "mini_cone"  # tests that a finer run checks; a V-funnel at half the spacing takes too long
CONE = "slump_m", "spread_m"  # without which no mix with internal friction is sought
OTHERS = 20.0, 200.0  # other plastic viscosities [Pa s] at which such a mix is sought where it was not measured
LIFTED = {"model": "axisymmetric", "spacing": 0.01}  # of the two runs, lifted and gone at once, whose difference counts
BEYOND = 0.1  # of the logarithm of a plastic viscosity outside of its table, for which the end of the table does
LARGEST = 10.0  # spread of a cone over its height
TESTS = {  # what is measured of a mix, by its name in emulator.MEASURED
    "slump_m": "slump",
    "spread_m": "spread",
    "t500_s": "t500",
    "mini_cone_m": "mini_cone",
    "v_funnel_s": "v_funnel",
}


class Measurements(Checked):
    """Measurements of a mix, and their errors.

    The parameters are the fields below: lengths [m], times [s], density [kg/m3], constants in SI units.

    Raises
    ------
    SceneError
        If a number is out of range.

    Examples
    --------
    >>> from taichi_mps.study.calibrate import Measurements
    >>> Measurements(slump="18 cm", spread=0.32).measured()["slump_m"]
    (0.18, 0.005)
    """

    slump: Length | None = Field(None, description="slump")
    spread: Length | None = Field(None, description="slump flow, mean of two diameters")
    t500: Duration | None = Field(None, description="time to a slump flow of 50 cm")
    mini_cone: Length | None = Field(None, description="slump flow of the mini-cone (Kantro, 5.72 cm high)")
    v_funnel: Duration | None = Field(None, description="time in which the V-funnel runs empty")
    yield_value: YieldValue | None = Field(None, description="yield stress, if known, of a rheometer")
    plastic_viscosity: Viscosity | None = Field(None, description="plastic viscosity, if known, of a rheometer")
    rho: Density = Field(DENSITY, description="density")
    slump_error: Length = Field(0.005, description="standard error of the slump")
    spread_error: Length = Field(0.01, description="standard error of the slump flow")
    t500_error: Duration = Field(0.2, description="standard error of the time")
    mini_cone_error: Length = Field(0.002, description="standard error of the slump flow of the mini-cone")
    v_funnel_error: Duration | None = Field(None, description="standard error of the time, by default a tenth of it")

    def error(self, test: str) -> float:
        """Return the standard error of a measurement.

        Parameters
        ----------
        test : str
            Name of its field.

        Returns
        -------
        float
            Standard error, SI units.
        """
        given = getattr(self, f"{test}_error")
        return 0.1 * self.v_funnel if given is None else given

    def measured(self) -> dict[str, tuple[float, float]]:
        """Return value and standard error of each measurement.

        Returns
        -------
        dict of str to tuple
            Pairs in SI units, by the name of the result.

        Raises
        ------
        SceneError
            If nothing was measured.
        """
        found = {name: getattr(self, test) for name, test in TESTS.items()}
        found = {name: (value, self.error(TESTS[name])) for name, value in found.items() if value is not None}
        require(found, "calibrate: give at least one of --slump, --slump-flow, --t500, --mini-cone, --v-funnel")
        return found

    def known(self) -> dict[str, float]:
        """Return the constants of the mix that are given.

        Returns
        -------
        dict of str to float
            Constants, SI units.
        """
        return {name: getattr(self, name) for name in BINGHAM if getattr(self, name) is not None}


def emulators_of(measured: dict, study=None) -> dict[str, Emulator]:
    """Emulators of the tests that were measured, by scene; that of ``study`` in the place of the package's own."""
    scenes = [scene for scene, columns in MEASURED.items() if columns.keys() & measured.keys()]
    own = emulator_of(study) if study else None
    if own and own.scene not in scenes:
        raise SceneError(f"study = {study}: is one of {own.scene}, which was not measured; must be of {scenes[0]}")
    return {scene: own if own and own.scene == scene else emulator_of(test=scene) for scene in scenes}


@checked
def calibrate(
    test: Measurements, study: str | None = None, check: Flag = True, lift_speed: Speed | None = None
) -> Calibration:
    """Find yield stress and plastic viscosity of a mix from what was measured of it.

    Parameters
    ----------
    test : Measurements
        Measurements in any combination; the keywords are the fields of ``Measurements``.
    study : path-like, optional
        Study of a test to look the answer up in, by default the package's own of each: of the standard cone with the
        mould gone at once, of Kantro's mini-cone, and of the V-funnel.
    check : bool, optional
        Whether the cones are computed once more at half the spacing with the constants found, and corrected by the
        difference.
    lift_speed : float, optional
        Speed [m/s] at which the mould of the slump cone was lifted; the constants are corrected by what that changes,
        by two runs in rings with them.

    Returns
    -------
    Calibration
        Constants with their intervals; its text is what the command line prints.

    Raises
    ------
    SceneError
        For measurements that no mix has.

    Notes
    -----
    Where no Bingham mix is near, one with internal friction is sought by slump, slump flow and T500, in a table of the
    standard cone.

    Examples
    --------
    >>> from taichi_mps.study.calibrate import calibrate
    >>> found = calibrate(slump="18 cm", spread="32 cm", check=False)
    >>> 400.0 < found.yield_value.value < 600.0  # [Pa]
    True
    """
    measured, known = test.measured(), test.known()
    emulators = emulators_of(measured, study)
    check_tests(test, emulators)
    tables = list(emulators.values())
    require(lift_speed is None or "slump" in emulators, "lift_speed: needs slump, slump_flow or t500 of the slump cone")
    found = fit(tables, measured, test.rho, known=known)
    finer, lifted = difference(emulators, found) if check else {}, lift_effect(found, lift_speed) if lift_speed else {}
    if finer or lifted:
        found = replace(fit(tables, measured, test.rho, (finer, lifted), known), finer=finer, lifted=lifted)
    if study is None and not (found.fits and found.near):
        found = replace(found, friction=frictional_mix(measured, test.rho, known))
    return found if found.fits else with_each_alone(emulators, found, known)


def with_each_alone(emulators: dict[str, Emulator], found: Calibration, known: dict) -> Calibration:
    """Add to a contradictory result what each measurement says alone, and the rheometer.

    A length at rest tells the yield stress, a time the plastic viscosity, with the other constant as found, or a usual
    plastic viscosity where none is determined: what fits a contradiction least badly is at any end of the table.
    """
    others = found.values
    if not found.plastic_viscosity.determined and "plastic_viscosity" not in known:
        others["plastic_viscosity"] = Bingham().plastic_viscosity
    alone = {name: {RHEOMETER: (known[name],) * 3} if name in known else {} for name in BINGHAM}
    for name, pair in found.measured.items():
        asked, other = reversed(BINGHAM) if is_time(name) else BINGHAM
        emulator = next(emulators[scene] for scene in emulators if name in MEASURED[scene])
        with suppress(SceneError):  # no T500 at all with that yield stress
            it = getattr(
                fit([emulator], {name: pair}, found.density, (found.finer, found.lifted), {other: others[other]}), asked
            )
            alone[asked][name] = it.value, it.lower, it.upper
    return replace(found, alone={name: it for name, it in alone.items() if it.keys() - {RHEOMETER}}, others=others)


def computed(scene: str, what: str, **settings) -> dict:
    """Return what a run of a test measures, nan what it does not; ``what`` it is, where it fails."""
    row = run(case(scene, **settings))
    require(row["status"] == "done", f"the {what} failed: {row['reason']}")
    return {name: np.array(row.get(column), float) for name, column in MEASURED[scene].items()}


def changes(before: dict, after: dict) -> dict[str, float]:
    """Return by what measurements change that are known of both: lengths by a difference [m], times by a ratio."""
    by = {name: after[name] / value if is_time(name) else after[name] - value for name, value in before.items()}
    return {name: float(change) for name, change in by.items() if np.isfinite(change)}


def difference(emulators: dict[str, Emulator], found: Calibration) -> dict:
    """Return what finer runs at the constants found measure beyond their emulators: lengths [m], ratios of times."""
    mix, finer = np.log(np.array(list(found.values.values())) / found.density), {}
    for scene in (scene for scene in CHECKED if scene in emulators):
        each = emulators[scene]
        settings = each.settings | found.keywords | {"spacing": 0.5 * each.spacing}
        finer |= changes(each.at(*mix), computed(scene, "finer run", **settings))
    return finer


def lift_effect(found: Calibration, speed: float) -> dict:
    """Return what a mould that is lifted at a speed [m/s] changes of the cone found: lengths [m], ratios of times."""
    settings = found.keywords | LIFTED
    each = [settings, settings | {"lift_speed": speed}]
    return changes(*(computed("slump", "run with the mould lifted", **keywords) for keywords in each))


def frictional_mix(measured: dict, density: float, known: dict) -> FrictionalMix | None:
    """Return the mix with internal friction that is nearest to slump, slump flow and T500.

    It is {name: (value, standard error)}. A plastic viscosity that is not ``known`` is found with the other constants
    from T500. Where that was not measured, it is the usual one of the scene or, where no mix is near with that, the
    first of OTHERS with which one is. None where slump or flow was not measured, the table does not reach what is
    known, or no such mix spreads to 500 mm and T500 was measured.
    """
    table, eta = emulator_of(test=FRICTION), "plastic_viscosity"
    usual = table.usual[eta]
    taken = {name: np.log(value / scale(name, density)) for name, value in ({eta: usual} | known).items()}
    room = {name: BEYOND * (name == eta) for name in taken}
    ends = zip(FRICTIONAL, table.low, table.high, strict=True)
    inside = all(low - room[name] <= taken[name] <= high + room[name] for name, low, high in ends if name in taken)
    if not set(CONE) <= measured.keys() or not inside:
        return None
    measured = {name: measured[name] for name in MEASURED["slump"] if name in measured}
    if "t500_s" in measured or eta in known:
        with suppress(SceneError):
            return fit([table], measured, density, known=known)
        return None
    mixes = {each: fit([table], measured, density, known=known | {eta: each}) for each in (usual, *OTHERS)}
    near = {each: mix for each, mix in mixes.items() if mix.near}
    best = next(iter(near), usual)
    others = {each: (mix.yield_value.value, mix.friction_angle.value) for each, mix in near.items() if each != best}
    return replace(mixes[best], usual=True, by_viscosity=others)


# ---- what cannot be ---------------------------------------------------------------------------------------------
def check_tests(test: Measurements, emulators: dict[str, Emulator]) -> None:
    """Raise SceneError for measurements that no mix has, by the sizes of cones and funnel of the tables.

    By more than three standard errors, where an error may be the reason.
    """
    if test.t500 and test.spread and test.spread + 3.0 * test.spread_error < REACHED:
        raise SceneError(
            f"t500 = {test.t500:g} s: with slump flow = {test.spread:g} m it never came to 50 cm; leave one of them out"
        )
    cones = {"slump": "slump", "spread": "slump", "mini_cone": "mini_cone"}
    cones = {key: sizes(emulators[scene]) for key, scene in cones.items() if scene in emulators}
    limits = [(f"{key}_error", 0.0, height, "") for key, (height, *_) in cones.items()]  # the least and most it can be
    limits += [
        (key, 0.0, height, "") if key == "slump" else (key, base, LARGEST * height, "the base of the cone")
        for key, (height, base, _) in cones.items()
    ]
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
    require(
        room >= mould,
        f"slump = {test.slump:g} m with slump flow = {test.spread:g} m: leaves room for {1e3 * room:.1f} l at most, "
        f"and the mould holds {1e3 * mould:.1f} l; one of them must be misread",
    )
