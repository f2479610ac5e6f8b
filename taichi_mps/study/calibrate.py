"""The Bingham constants of a mix from tests of it, with intervals from the errors of the measurements."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..problem.materials import Bingham
from ..units import SceneError, checked
from .calibration import CONSTANTS, RHEOMETER, Calibration
from .emulator import MEASURED, Emulator, Together, is_time
from .fit import fit
from .internal_friction import frictional_mix
from .measurements import Measurements, check_known, check_tests, scenes_of
from .results import read

HERE = Path(__file__).parent
"""Holds a sweep of each test as a table, slump.csv and so on; docs/howto/calibrate.md."""
CHECKED = "slump", "mini_cone"  # tests that a finer run checks; a V-funnel at half the spacing takes too long


def emulator_of(table=None, scene: str = "slump") -> Emulator:
    """That of a study's folder or table, by default the package's own of a test; made once, and again when the table
    changes."""
    path = Path(table) if table else HERE / f"{scene}.csv"
    file = path / "results.csv" if path.is_dir() else path
    return _emulator(path, file.stat().st_mtime_ns if file.is_file() else 0)


@lru_cache(maxsize=8)
def _emulator(path: Path, changed: int) -> Emulator:
    return Emulator(read(path))


def emulators_of(measured: dict, study=None) -> dict[str, Emulator]:
    """Those of the tests that were measured, by scene; that of ``study`` in the place of the package's own."""
    scenes = scenes_of(measured)
    own = emulator_of(study) if study else None
    if own and own.scene not in scenes:
        raise SceneError(f"study = {study}: is one of {own.scene}, which was not measured; must be of {scenes[0]}")
    return {scene: own if own and own.scene == scene else emulator_of(scene=scene) for scene in scenes}


@checked
def calibrate(test: Measurements, study: str | None = None, check: bool = True) -> Calibration:
    """Yield stress and plastic viscosity of a mix from what was measured of it, in any combination: the keywords are
    those of ``Measurements``.

    ``study`` is one of a test to look the answer up in, by default the package's own of each: of the standard cone
    with the mould gone at once, of Kantro's mini-cone, and of the V-funnel. With ``check`` the cones are computed once
    more at half the spacing with the constants found, and they are corrected by the difference. Where no Bingham mix is
    near, one with internal friction is sought by slump, slump flow and T500, in a table of the standard cone.
    """
    measured, known = test.measured(), test.known()
    emulators = emulators_of(measured, study)
    check_tests(test, emulators)
    tables = Together(list(emulators.values()))
    check_known(known, tables, test.rho)
    found = fit(tables, measured, test.rho, known=known)
    if check and (apart := difference(emulators, found, test.rho)):
        found = replace(fit(tables, measured, test.rho, apart, known), finer=apart)
    if study is None and (found.contradictory or not found.near):
        found = replace(found, friction=frictional_mix(measured, test.rho, known))
    return with_each_alone(emulators, found, test.rho, known)


def with_each_alone(emulators: dict[str, Emulator], found: Calibration, density: float, known: dict) -> Calibration:
    """A contradictory one with what each measurement says alone, and the rheometer: a length at rest of the yield
    stress, a time of the plastic viscosity, the other constant as found, or a usual plastic viscosity where none is
    determined: what fits a contradiction least badly is at any end of the table."""
    if not found.contradictory:
        return found
    others = {name: getattr(found, name).value for name in CONSTANTS}
    if not found.plastic_viscosity.determined and "plastic_viscosity" not in known:
        others["plastic_viscosity"] = Bingham().plastic_viscosity
    alone = {name: {RHEOMETER: (known[name],) * 3} if name in known else {} for name in CONSTANTS}
    for name, pair in found.measured.items():
        asked, other = reversed(CONSTANTS) if is_time(name) else CONSTANTS
        emulator = next(emulators[scene] for scene in emulators if name in MEASURED[scene])
        try:
            it = fit(emulator, {name: pair}, density, found.finer, {other: others[other]})
        except SceneError:  # no T500 at all with that yield stress
            continue
        constant = getattr(it, asked)
        alone[asked][name] = constant.value, constant.lower, constant.upper
    alone = {name: said for name, said in alone.items() if said.keys() - {RHEOMETER}}
    return replace(found, alone=alone, others=others)


def difference(emulators: dict[str, Emulator], found: Calibration, density: float) -> dict:
    """What finer runs of the cones at the constants found measure beyond their emulators: lengths [m], of times the
    ratio."""
    from .case import case, run

    mix, apart = {name: getattr(found, name).value for name in CONSTANTS}, {}
    for scene in (scene for scene in CHECKED if scene in emulators):
        emulator = emulators[scene]
        settings = emulator.settings | mix | {"density": density, "spacing": 0.5 * emulator.spacing}
        row = run(case(scene, **settings))
        if row["status"] == "failed":
            raise SceneError(f"the finer run failed: {row['reason']}")
        table = emulator.at(*np.log(np.array(list(mix.values())) / density))
        for name, column in MEASURED[scene].items():
            value = float(table[name])
            if not is_time(name):
                apart[name] = row[column] - value
            elif row[column] and np.isfinite(value):
                apart[name] = row[column] / value
    return apart
