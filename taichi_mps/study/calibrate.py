"""The constants of a mix from tests of it, with intervals from the errors of the measurements."""

from dataclasses import replace

import numpy as np

from ..problem.materials import Bingham
from ..units import SceneError, checked
from .calibration import BINGHAM, FRICTIONAL, RHEOMETER, Calibration, FrictionalMix, is_time
from .case import case, run
from .emulator import FRICTION, MEASURED, Emulator, emulator_of, scale
from .fit import fit
from .measurements import Measurements, check_known, check_tests

CHECKED = "slump", "mini_cone"  # tests that a finer run checks; a V-funnel at half the spacing takes too long
CONE = "slump_m", "spread_m"  # without which no mix with internal friction is sought
OTHERS = 20.0, 200.0  # other plastic viscosities [Pa s] at which such a mix is sought where it was not measured
BEYOND = 0.1  # of the logarithm of a plastic viscosity outside of its table, for which the end of the table does


def emulators_of(measured: dict, study=None) -> dict[str, Emulator]:
    """Those of the tests that were measured, by scene; that of ``study`` in the place of the package's own."""
    scenes = [scene for scene, columns in MEASURED.items() if columns.keys() & measured.keys()]
    own = emulator_of(study) if study else None
    if own and own.scene not in scenes:
        raise SceneError(f"study = {study}: is one of {own.scene}, which was not measured; must be of {scenes[0]}")
    return {scene: own if own and own.scene == scene else emulator_of(test=scene) for scene in scenes}


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
    tables = list(emulators.values())
    check_known(known, tables, test.rho)
    found = fit(tables, measured, test.rho, known=known)
    if check and (apart := difference(emulators, found)):
        found = replace(fit(tables, measured, test.rho, apart, known), finer=apart)
    if study is None and (found.contradictory or not found.near):
        found = replace(found, friction=frictional_mix(measured, test.rho, known))
    return with_each_alone(emulators, found, known) if found.contradictory else found


def with_each_alone(emulators: dict[str, Emulator], found: Calibration, known: dict) -> Calibration:
    """A contradictory one with what each measurement says alone, and the rheometer: a length at rest of the yield
    stress, a time of the plastic viscosity, the other constant as found, or a usual plastic viscosity where none is
    determined: what fits a contradiction least badly is at any end of the table."""
    others = found.constants
    if not found.plastic_viscosity.determined and "plastic_viscosity" not in known:
        others["plastic_viscosity"] = Bingham().plastic_viscosity
    alone = {name: {RHEOMETER: (known[name],) * 3} if name in known else {} for name in BINGHAM}
    for name, pair in found.measured.items():
        asked, other = reversed(BINGHAM) if is_time(name) else BINGHAM
        emulator = next(emulators[scene] for scene in emulators if name in MEASURED[scene])
        try:
            it = fit([emulator], {name: pair}, found.density, found.finer, {other: others[other]})
        except SceneError:  # no T500 at all with that yield stress
            continue
        constant = getattr(it, asked)
        alone[asked][name] = constant.value, constant.lower, constant.upper
    alone = {name: said for name, said in alone.items() if said.keys() - {RHEOMETER}}
    return replace(found, alone=alone, others=others)


def difference(emulators: dict[str, Emulator], found: Calibration) -> dict:
    """What finer runs of the cones at the constants found measure beyond their emulators: lengths [m], of times the
    ratio."""
    mix, apart = found.constants | {"density": found.density}, {}
    for scene in (scene for scene in CHECKED if scene in emulators):
        emulator = emulators[scene]
        row = run(case(scene, **emulator.settings | mix | {"spacing": 0.5 * emulator.spacing}))
        if row["status"] == "failed":
            raise SceneError(f"the finer run failed: {row['reason']}")
        table = emulator.at(*np.log(np.array(list(found.constants.values())) / found.density))
        for name, column in MEASURED[scene].items():
            value = float(table[name])
            if not is_time(name):
                apart[name] = row[column] - value
            elif row[column] and np.isfinite(value):
                apart[name] = row[column] / value
    return apart


def frictional_mix(measured: dict, density: float, known: dict) -> FrictionalMix | None:
    """The mix with internal friction that is nearest to slump, slump flow and T500, {name: (value, standard error)}. A
    plastic viscosity that is not ``known`` is found with the other constants from T500. Where that was not measured, it
    is the usual one of the scene or, where no mix is near with that, the first of OTHERS with which one is. None where
    slump or flow was not measured, the table does not reach what is known, or no such mix spreads to 500 mm and T500
    was measured."""
    if not set(CONE) <= measured.keys():
        return None
    table = emulator_of(test=FRICTION)
    measured = {name: measured[name] for name in MEASURED["slump"] if name in measured}
    usual = table.usual["plastic_viscosity"]
    for name, value in ({"plastic_viscosity": usual} | known).items():
        k, room = FRICTIONAL.index(name), BEYOND if name == "plastic_viscosity" else 0.0
        if not table.low[k] - room <= np.log(value / scale(name, density)) <= table.high[k] + room:
            return None
    if "t500_s" in measured or "plastic_viscosity" in known:
        try:
            return fit([table], measured, density, known=known)
        except SceneError:
            return None
    mixes = {eta: fit([table], measured, density, known=known | {"plastic_viscosity": eta}) for eta in (usual, *OTHERS)}
    near = {eta: mix for eta, mix in mixes.items() if mix.near}
    best = next(iter(near), usual)
    others = {eta: (mix.yield_value.value, mix.friction_angle.value) for eta, mix in near.items() if eta != best}
    return replace(mixes[best], usual=True, by_viscosity=others)
