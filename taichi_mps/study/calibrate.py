"""The constants of a mix from tests of it, with intervals from the errors of the measurements."""

from contextlib import suppress
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from ..engine import Bingham
from ..forecast.accuracy import GRAVITY
from ..units import (
    Checked,
    Density,
    Duration,
    Flag,
    Length,
    Only,
    Place,
    SceneError,
    Viscosity,
    YieldValue,
    checked,
    in_smaller_unit,
    require,
    unit_of,
)
from .calibration import BINGHAM, FRICTIONAL, RHEOMETER, Calibration, FrictionalMix, is_time
from .case import T500_SLUMP_FLOW, case_of, run_case
from .emulator import DENSITY, FRICTION_TABLE, RESULT_COLUMNS, Emulator, emulator_of, scale
from .fit import Tables, fit

REFINED_TESTS = "slump", "mini_cone"  # tests that a finer run checks; a V-funnel at half the spacing takes too long
CONE_RESULTS = "slump_m", "spread_m"  # without which no mix with internal friction is sought
OTHER_VISCOSITIES = 20.0, 200.0  # [Pa s], tried for a mix with internal friction whose viscosity was not measured
EXTRAPOLATION = 0.1  # of the logarithm of the plastic viscosity beyond its table; there its end is used
MAX_SLUMP_FLOW = 10.0  # largest slump flow of a cone over its height
FIELD_OF_RESULT = {  # field of Measurements, by the name of the result in emulator.RESULT_COLUMNS
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
    slump_error: Annotated[Length, Only("slump")] = Field(0.005, description="standard error of the slump")
    spread_error: Annotated[Length, Only("spread")] = Field(0.01, description="standard error of the slump flow")
    t500_error: Annotated[Duration, Only("t500")] = Field(0.2, description="standard error of the time")
    mini_cone_error: Annotated[Length, Only("mini_cone")] = Field(
        0.002, description="standard error of the slump flow of the mini-cone"
    )
    v_funnel_error: Annotated[Duration | None, Only("v_funnel")] = Field(
        None, description="standard error of the time, by default a tenth of it"
    )

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
        error = getattr(self, f"{test}_error")
        return 0.1 * self.v_funnel if error is None else error

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
        known = {name: test for name, test in FIELD_OF_RESULT.items() if getattr(self, test) is not None}
        found = {name: (getattr(self, test), self.error(test)) for name, test in known.items()}
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
    """Return the emulators of the measured tests, by scene; ``study`` replaces the package's own table of its scene."""
    scenes = [scene for scene, columns in RESULT_COLUMNS.items() if columns.keys() & measured.keys()]
    given = emulator_of(study) if study else None
    if given and given.scene not in scenes:
        raise SceneError(f"study = {study}: is one of {given.scene}, which was not measured; must be of {scenes[0]}")
    return {scene: given if given and given.scene == scene else emulator_of(test=scene) for scene in scenes}


@checked
def calibrate(test: Measurements, study: Place | None = None, check: Flag = True) -> Calibration:
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
    check_measurements(test, emulators)
    tables = list(emulators.values())
    found = fit(tables, measured, test.rho, known=known)
    if check and (finer := refinement(emulators, found)):
        found = replace(fit(tables, measured, test.rho, finer, known), finer=finer)
    if study is None and not (found.fits and found.within_tolerance):
        found = replace(found, friction=frictional_mix(measured, test.rho, known))
    return found if found.fits else add_separate_fits(emulators, found, known)


def add_separate_fits(emulators: dict[str, Emulator], found: Calibration, known: dict) -> Calibration:
    """Add to a contradictory result the fits to each measurement alone and what each would be beside the others.

    A length at rest gives the yield stress, a time the plastic viscosity; a rheometer's constant stands beside them.
    The other constant is the one found, or the default plastic viscosity where it is not determined: the best fit of a
    contradiction lies anywhere in the table.
    """
    others = found.values
    if not found.plastic_viscosity.determined and "plastic_viscosity" not in known:
        others["plastic_viscosity"] = Bingham().plastic_viscosity
    alone = {name: {RHEOMETER: (known[name],) * 3} if name in known else {} for name in BINGHAM}
    for name, pair in found.measured.items():
        constant, other = reversed(BINGHAM) if is_time(name) else BINGHAM
        emulator = next(emulators[scene] for scene in emulators if name in RESULT_COLUMNS[scene])
        with suppress(SceneError):  # no T500 at all with that yield stress
            it = fit([emulator], {name: pair}, found.density, found.finer, {other: others[other]}).constants[constant]
            alone[constant][name] = it.value, it.lower, it.upper
    possible = Tables(list(emulators.values()), found.measured, found.density, found.finer, known).beside_the_others()
    alone = {it: fits for it, fits in alone.items() if fits.keys() - {RHEOMETER}}
    return replace(found, alone=alone, others=others, possible=possible)


def refinement(emulators: dict[str, Emulator], found: Calibration) -> dict[str, float]:
    """Return the change from the emulators to finer runs with the constants found: lengths [m], ratios of times."""
    ratios, effect = np.log(np.array(list(found.values.values())) / found.density), {}
    for scene in (scene for scene in REFINED_TESTS if scene in emulators):
        emulator = emulators[scene]
        finer = {"spacing": 0.5 * emulator.spacing_at(*ratios)}
        row = run_case(case_of(scene, **emulator.settings | found.keywords | finer))
        require(row["status"] == "done", f"the finer run failed: {row['reason']}")
        for name, before in emulator.at(*ratios).items():
            after = np.array(row.get(RESULT_COLUMNS[scene][name]), float)  # nan where it was not measured
            change = float(after / before if is_time(name) else after - before)
            effect |= {name: change} if np.isfinite(change) else {}
    return effect


def frictional_mix(measured: dict, density: float, known: dict) -> FrictionalMix | None:
    """Return the mix with internal friction that is nearest to slump, slump flow and T500.

    ``measured`` is {name: (value, standard error)}. A plastic viscosity that is not ``known`` is fitted with the other
    constants where T500 was measured; else it is the scene's default or, where no mix is near with that, the first of
    OTHER_VISCOSITIES with which one is. None where slump or slump flow was not measured, the table does not cover the
    known constants, or T500 was measured and no such mix spreads to 500 mm.
    """
    table, viscosity = emulator_of(test=FRICTION_TABLE), "plastic_viscosity"
    default = table.defaults[viscosity]
    given = {name: np.log(value / scale(name, density)) for name, value in ({viscosity: default} | known).items()}
    margin = {name: EXTRAPOLATION * (name == viscosity) for name in given}
    ends = zip(FRICTIONAL, table.low, table.high, strict=True)
    inside = all(low - margin[name] <= given[name] <= high + margin[name] for name, low, high in ends if name in given)
    if not set(CONE_RESULTS) <= measured.keys() or not inside:
        return None
    measured = {name: measured[name] for name in RESULT_COLUMNS["slump"] if name in measured}
    if "t500_s" in measured or viscosity in known:
        with suppress(SceneError):
            return fit([table], measured, density, known=known)
        return None
    mixes = {
        eta: fit([table], measured, density, known=known | {viscosity: eta}) for eta in (default, *OTHER_VISCOSITIES)
    }
    near = {eta: mix for eta, mix in mixes.items() if mix.within_tolerance}
    best = next(iter(near), default)
    others = {eta: (mix.yield_value.value, mix.friction_angle.value) for eta, mix in near.items() if eta != best}
    return replace(mixes[best], usual=True, by_viscosity=others)


# ---- impossible measurements ------------------------------------------------------------------------------------
def check_measurements(test: Measurements, emulators: dict[str, Emulator]) -> None:
    """Raise SceneError for measurements that no mix can have, given the dimensions of the cones and the funnel.

    Lower limits are exceeded by more than three standard errors.
    """
    if test.t500 and test.spread and test.spread + 3.0 * test.spread_error < T500_SLUMP_FLOW:
        raise SceneError(
            f"t500 = {test.t500:g} s: with slump flow = {test.spread:g} m it never came to 50 cm; leave one of them out"
        )
    scenes = {"slump": "slump", "spread": "slump", "mini_cone": "mini_cone"}
    cones = {key: dimensions(emulators[scene]) for key, scene in scenes.items() if scene in emulators}
    limits = [  # (field, least, most, reason)
        *((f"{key}_error", 0.0, height, "") for key, (height, *_) in cones.items()),
        *(
            (key, 0.0, height, "") if key == "slump" else (key, base, MAX_SLUMP_FLOW * height, "the base of the cone")
            for key, (height, base, _) in cones.items()
        ),
    ]
    if "v_funnel" in emulators:
        why = "in which the funnel would run empty at the speed of a free fall through its height"
        limits += [("v_funnel", min_funnel_time(emulators["v_funnel"]), np.inf, why)]
    for key, least, largest, why in limits:
        value, unit = getattr(test, key), unit_of(Measurements.model_fields[key])
        if value is not None and value >= largest:
            raise SceneError(
                f"{key} = {value:g} {unit}: must be less than {largest:g} {unit}{in_smaller_unit(value, largest)}"
            )
        if value and least and value + 3.0 * test.error(key) < least:
            raise SceneError(f"{key} = {value:g} {unit}: must be more than {least:.3g} {unit}, {why}")
    if "slump" in emulators and test.slump and test.spread:
        check_volume(emulators["slump"], test)


def min_funnel_time(funnel: Emulator) -> float:
    """Return a time [s] below which no fluid can leave the tapered part of a table's funnel, by its energy."""
    top, outlet, taper, spout = dimensions(funnel, ("top", "outlet", "taper", "spout"))
    return 0.5 * (top + outlet) * taper / (outlet * np.sqrt(2.0 * GRAVITY * (taper + spout)))


def dimensions(test: Emulator, names=("height", "base_diameter", "top_diameter")) -> tuple[float, ...]:
    """Return dimensions [m] of the cone or the funnel of a table."""
    return tuple(test.settings.get(key, test.defaults[key]) for key in names)


def check_volume(cone: Emulator, test: Measurements) -> None:
    """Raise SceneError where the cylinder around the slumped body holds less than the mould, within three errors."""
    height, base, top = dimensions(cone)
    mould = np.pi / 12.0 * height * (base**2 + base * top + top**2)
    widest, lowest = test.spread + 3.0 * test.spread_error, max(0.0, test.slump - 3.0 * test.slump_error)
    cylinder = np.pi / 4.0 * widest**2 * (height - lowest)
    require(
        cylinder >= mould,
        f"slump = {test.slump:g} m with slump flow = {test.spread:g} m: leaves room for {1e3 * cylinder:.1f} l at "
        f"most, and the mould holds {1e3 * mould:.1f} l; one of them must be misread",
    )
