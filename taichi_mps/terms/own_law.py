"""A flow curve of the user's own, looked at before a run and after each of its steps: what is no stress is named."""

import numpy as np

from ..particles.particles import FLUID
from ..runtime.backend import ti
from ..runtime.field_io import FieldIO
from ..units import SceneError
from . import rheology

RATES = np.concatenate([[0.0], np.geomspace(1e-6, 1e3, 91)])  # [1/s], of the look before a run
READ = "kind", "shear_rate", "structure", "mix"  # of what the particles carry, after each step
FALL = 1e-3  # of the largest stress: by so much rounding may make a curve fall


@ti.data_oriented
class OwnLaw:
    """The functions ``shear_stress`` and ``growth`` of a material, number ``mix`` of its scene, outside of any scheme.

    SceneError when made, before anything is allocated, for a function that Taichi cannot compile, or that gives over
    RATES and an untouched structure what is not finite, a negative stress, or one that falls.
    """

    def __init__(self, material, mix: int = 0):
        self.material, self.mix = material, mix
        self.curve, self.growth = rheology.compiled(material.shear_stress), rheology.growth(material)
        self.has_growth = self.growth is not None
        self._rows = None  # what is read of the particles, from the first step on
        try:
            stress, growth = self.evaluate(RATES, np.zeros_like(RATES))
        except Exception as error:  # whatever compiling or calling a function of somebody else raises
            said = [line for line in str(error).splitlines() if line.strip()] or [""]
            raise SceneError(
                f"material: shear_stress = {name_of(material.shear_stress)}"
                f"{f', growth = {name_of(material.growth)}' if self.has_growth else ''}: cannot be compiled "
                f"({type(error).__name__}: {said[-1].strip()}); must be plain arithmetic of (rate, structure)"
            ) from None
        broken = self._broken(RATES, np.zeros_like(RATES), stress, growth)
        falls = np.flatnonzero(np.diff(stress) < -FALL * stress.max()) if not broken else []
        if len(falls):
            rates, stresses = (f"{a[falls[0]]:.3g} to {a[falls[0] + 1]:.3g}" for a in (RATES, stress))
            broken = f"{self._named()} falls from {stresses} Pa from {rates} 1/s; must not fall with the rate"
        if broken:
            raise SceneError(broken)

    def evaluate(self, rate, structure):
        """Stress [Pa] and growth [1/s], (n,), at rates [1/s] and structures [-], (n,)."""
        stress, growth = np.full(len(rate), np.nan), np.zeros(len(rate))
        self._evaluate(*(np.ascontiguousarray(a, float) for a in (rate, structure)), stress, growth)
        return stress, growth

    @ti.kernel
    def _evaluate(
        self,
        rate: ti.types.ndarray(ti.f64, 1),
        structure: ti.types.ndarray(ti.f64, 1),
        stress: ti.types.ndarray(ti.f64, 1),
        growth: ti.types.ndarray(ti.f64, 1),
    ):
        for k in range(rate.shape[0]):
            at, of = ti.cast(rate[k], float), ti.cast(structure[k], float)
            stress[k] = ti.cast(self.curve(at, of), ti.f64)
            if ti.static(self.has_growth):
                growth[k] = ti.cast(self.growth(at, of), ti.f64)

    def failure(self, particles) -> str | None:
        """What the law gives that is no stress, at rest or at the rate of one of the fluid particles, after a step."""
        if self._rows is None:
            read = {name: particles.carried[name] for name in READ if name in particles.carried}
            self._rows = FieldIO(read, particles.capacity)
        rows = self._rows.read(particles.count[None])
        fluid = (rows["kind"] == FLUID) & (rows.get("mix", self.mix) == self.mix)
        rate, structure = rows["shear_rate"][fluid], rows.get("structure", np.zeros(len(fluid)))[fluid]
        rate, structure = np.concatenate([0.0 * rate, rate]), np.concatenate([structure, structure])
        return self._broken(rate, structure, *self.evaluate(rate, structure))

    def _broken(self, rate, structure, stress, growth) -> str | None:
        wrong = np.flatnonzero(~(np.isfinite(stress) & (stress >= 0.0) & np.isfinite(growth)))
        if not len(wrong):
            return None
        k = wrong[0]
        where = f"at a shear rate of {rate[k]:.3g} 1/s and a structure of {structure[k]:.3g}"
        if np.isfinite(stress[k]) and stress[k] >= 0.0:
            return f"material: growth = {name_of(self.material.growth)}: is {growth[k]:g} 1/s {where}; must be finite"
        return f"{self._named()} is {stress[k]:g} Pa {where}; must be finite and at least 0 Pa"

    def _named(self):
        return f"material: shear_stress = {name_of(self.material.shear_stress)}:"


def name_of(function) -> str:
    """The name by which a user knows a function."""
    return getattr(function, "__name__", type(function).__name__)
