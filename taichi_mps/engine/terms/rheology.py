"""Constitutive laws: apparent viscosity of the bi-viscosity Bingham law and flow curves (eqs 1-3, 5, 9), beside the
true yield law of stress.py; before a run and after its steps, a law of the user's own is checked."""

from inspect import unwrap
from types import FunctionType, MethodType

import numpy as np

from ...units import SceneError, require
from ..particles.particles import FLUID
from ..runtime.backend import is_for_kernels, ti
from ..runtime.field_io import FieldIO

RATES = np.concatenate([[0.0], np.geomspace(1e-6, 1e3, 91)])  # [1/s], of the look before a run
READ = "kind", "shear_rate", "structure", "mix"  # carried fields that are read after each step
FALL = 1e-3  # of the largest stress: by so much rounding may make a curve fall
DIFFERENCE = 1e-3, 1e-6  # of a value and of the largest one: by so much compiling may change a law


@ti.func
def magnitude(T):
    """|T| = sqrt(T:T/2) of a deviatoric tensor: the shear stress [Pa] that is compared with the yield stress."""
    return ti.sqrt(0.5 * (T * T).sum())


@ti.func
def shear_rate(G):
    """sqrt(2 D:D) [1/s] of the deviatoric part of D = (G + G^T)/2."""
    return 2.0 * magnitude(deviator(G))


@ti.func
def deviator(G):
    """D - tr(D)/d I [1/s] of a velocity gradient G; d its size (plane strain in 2-D)."""
    return 0.5 * (G + G.transpose()) - (G.trace() / G.n) * ti.Matrix.identity(float, G.n)


@ti.func
def bi_viscosity(rate, plastic_viscosity, yield_stress, critical_strain_rate):
    """mu = eta + tau_y / max(shear rate, 2 pi_c) [Pa s] (eqs 5, 9 with Pi_c = (2 pi_c)^2, eq 3); below 2 pi_c the
    material counts as unyielded. A Newtonian mix at rest has neither a yield stress nor a rate."""
    return plastic_viscosity + yield_stress / ti.max(rate, 2.0 * critical_strain_rate, 1e-12)


def compiled(function, numbers=None):
    """A plain Python function made a Taichi function, a method with its object compiled in, or with ``numbers``, a
    struct field of what the method reads of it; what is one already, as it is."""
    if not isinstance(function, MethodType):
        return function if is_for_kernels(function) else ti.func(function)
    law, method = function.__self__, function.__func__
    plain = FunctionType(method.__code__, method.__globals__, method.__name__, None, method.__closure__)
    plain.__annotations__ = {"self": ti.template()}
    inner = ti.func(plain)

    @ti.func
    def bound(rate, structure):
        return inner(law, rate, structure)

    @ti.func
    def read(rate, structure):
        return inner(numbers[None], rate, structure)

    return read if numbers else bound


@ti.func
def illinois(excess: ti.template(), law: ti.template(), i, numbers, high, below):
    """Rate [1/s] at which excess(law, i, rate, numbers), which is ``below`` 0 at rest and grows with the rate, is zero:
    a root between 0 and ``high``, by the Illinois method."""
    low, rate, above, last_side = ti.cast(0.0, float), high, ti.cast(0.0, float), 0
    for iteration in range(31):
        if iteration == 0 or (ti.abs(high - low) > 1e-6 * high and above > below):
            if iteration > 0:
                rate = (low * above - high * below) / (above - below)
            value = excess(law, i, rate, numbers)
            if iteration == 0:
                above = value
            elif value > 0.0:
                high, above = rate, value
                below = ti.select(last_side == 1, 0.5 * below, below)
                last_side = 1
            else:
                low, below = rate, value
                above = ti.select(last_side == -1, 0.5 * above, above)
                last_side = -1
    return rate


@ti.func
def curve_excess(law: ti.template(), i, rate, numbers):
    """tau(rate) + mu_r rate - |trial| [Pa]; ``numbers``: |trial|, mu_r."""
    return law.shear_stress(i, rate) + numbers[1] * rate - numbers[0]


@ti.func
def curve_mapping(law: ti.template(), i, trial, mu_r):
    """``return_mapping`` for any flow curve tau of a particle i: the rate with tau(rate) + mu_r rate = |trial|.

    Rigid where |trial| <= tau(0). The root is unique, since tau does not fall, and below (|trial| - tau(0))/mu_r.
    """
    trial_magnitude, rate = magnitude(trial), ti.cast(0.0, float)
    yield_stress = law.shear_stress(i, 0.0)
    if trial_magnitude > yield_stress:
        rate = illinois(
            curve_excess,
            law,
            i,
            ti.Vector([trial_magnitude, mu_r]),
            (trial_magnitude - yield_stress) / mu_r,
            yield_stress - trial_magnitude,
        )
    factor = (trial_magnitude - mu_r * rate) / ti.max(trial_magnitude, 1e-12) if rate > 0.0 else 1.0
    stress = trial * factor
    return stress, (trial - stress) / (2.0 * mu_r), rate


@ti.func
def parts_in_series(law: ti.template(), i, rate, numbers):
    """Shear stress [Pa] of the mix of particle i at a rate, and over their trial the stresses along and across an
    interface [-]; ``numbers`` as of series_excess."""
    tau = law.shear_stress(i, rate)
    phi = rate / ti.max(tau, 1e-12)
    return tau, 1.0 + numbers[2] * phi, 1.0 + numbers[2] * ((1.0 - numbers[3]) * phi + numbers[4])


@ti.func
def series_excess(law: ti.template(), i, rate, numbers):
    """tau(rate) - |T| [Pa]; ``numbers``: trial stress along the interface and across it, mu_r, fraction and fluidity of
    the other mixes."""
    tau, along, across = parts_in_series(law, i, rate, numbers)
    return tau - ti.sqrt((numbers[0] / along) ** 2 + (numbers[1] / across) ** 2)


@ti.func
def series_mapping(law: ti.template(), i, trial, across, mu_r, other_fraction, other_fluidity):
    """``return_mapping`` of particle i next to another mix (I27), for any flow curves: the rate g of its own mix with
    tau(g) = |T|, where T is the trial over 1 + mu_r phi, its shear ``across`` over 1 + mu_r [(1 - c) phi + psi].

    phi = g/tau(g), c is the fraction ``other_fraction`` of the other mixes, psi their fluidity ``other_fluidity``
    [1/(Pa s)]. |T| - tau(g) falls with g, below 0 at (|trial| - tau(0))/((1 - c) mu_r): the root is unique.
    """
    numbers = ti.Vector([magnitude(trial - across), magnitude(across), mu_r, other_fraction, other_fluidity])
    yield_stress, rate = law.shear_stress(i, 0.0), ti.cast(0.0, float)
    trial_magnitude = ti.sqrt(numbers[0] ** 2 + (numbers[1] / (1.0 + mu_r * other_fluidity)) ** 2)
    if trial_magnitude > yield_stress:
        high = ti.max(0.0, (magnitude(trial) - yield_stress) / ((1.0 - other_fraction) * mu_r))
        rate = illinois(series_excess, law, i, numbers, high, yield_stress - trial_magnitude)
    _tau, along_over, across_over = parts_in_series(law, i, rate, numbers)
    along_factor, across_factor = 1.0 / along_over, 1.0 / across_over
    stress = trial * along_factor + across * (across_factor - along_factor)
    return stress, (trial - stress) / (2.0 * mu_r), rate


# ---- a law of the user's own --------------------------------------------------------------------------------
@ti.data_oriented
class OwnLaw:
    """Flow curve and growth of a material, number ``mix`` of its scene, outside of any scheme.

    SceneError when made, before anything is allocated, for a function that Taichi cannot compile, or that gives over
    RATES another value than in Python, or for an untouched structure one that is not finite, a negative stress, or one
    that falls.
    """

    def __init__(self, material, mix: int = 0):
        names = {key: f"{key} = {name_of(function)}" for key, function in material.functions.items()}
        self.mix, self.has_growth, self._named = mix, material.ages, f"material: {names['shear_stress']}"
        self._growth_named = names.get("growth")
        self._functions = material.functions.values()
        self.curve, self.growth = compiled(material.shear_stress), compiled(material.growth) if material.ages else None
        self._rows = None  # what is read of the particles, from the first step on
        try:
            stress, rise = self.evaluate(RATES, np.zeros_like(RATES))
        except Exception as error:  # whatever compiling or calling a function of somebody else raises
            lines = [line for line in str(error).splitlines() if line.strip()] or [""]
            raise SceneError(
                f"{self._named}{f', {self._growth_named}' if self.has_growth else ''}: cannot be compiled "
                f"({type(error).__name__}: {lines[-1].strip()}); must be plain arithmetic of (rate, structure)"
            ) from None
        broken = self._broken(RATES, np.zeros_like(RATES), stress, rise)
        broken = broken or self._difference(0.0) or self._difference(1.0)
        falls = np.flatnonzero(np.diff(stress) < -FALL * stress.max()) if not broken else []
        if len(falls):
            rates, stresses = (f"{a[falls[0]]:.3g} to {a[falls[0] + 1]:.3g}" for a in (RATES, stress))
            broken = f"{self._named}: falls from {stresses} Pa from {rates} 1/s; must not fall with the rate"
        elif not broken and abs(stress[0] - material.yield_value) > 1e-3 * max(material.yield_value, 1.0):
            broken = f"{self._named}: gives {stress[0]:g} Pa at rest; must be yield_value = {material.yield_value:g} Pa"
        require(not broken, broken)

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
            # as an element of a vector, which only a number can be: compiling two as one would end the process
            stress[k] = ti.cast(ti.Vector([self.curve(at, of)])[0], ti.f64)
            if ti.static(self.has_growth):
                growth[k] = ti.cast(ti.Vector([self.growth(at, of)])[0], ti.f64)

    def failure(self, particles) -> str | None:
        """Value of the law that is no valid stress, at rest or at the rate of a fluid particle, after a step."""
        if self._rows is None:
            self._rows = FieldIO({name: f for name, f in particles.carried.items() if name in READ}, particles.capacity)
        rows = self._rows.read(particles.count[None])
        fluid = (rows["kind"] == FLUID) & (rows.get("mix", self.mix) == self.mix)
        rate, structure = rows["shear_rate"][fluid], rows.get("structure", np.zeros(len(fluid)))[fluid]
        rate, structure = np.concatenate([0.0 * rate, rate]), np.concatenate([structure, structure])
        return self._broken(rate, structure, *self.evaluate(rate, structure))

    def _difference(self, structure) -> str | None:
        """Value of the law at one of RATES and a structure [-] that differs in Python, where Python can tell it."""
        found = self.evaluate(RATES, np.full_like(RATES, structure))
        for name, unit, function, values in zip(
            (self._named, f"material: {self._growth_named}"), ("Pa", "1/s"), self._functions, found, strict=False
        ):
            exact = python_values(function, structure, values)
            known = np.isfinite(exact)
            most = DIFFERENCE[0] * np.abs(exact) + DIFFERENCE[1] * np.abs(exact[known]).max(initial=0.0)
            apart = np.flatnonzero(~(np.abs(values - exact) <= most) & (known | (structure == 0.0)))
            if len(apart):
                k = apart[(np.abs(values - exact) / (most + 1e-300))[apart].argmax()]
                return (
                    f"{name}: is {values[k]:.4g} {unit} compiled and {exact[k]:.4g} {unit} in Python, at a shear rate "
                    f"of {RATES[k]:.3g} 1/s and a structure of {structure:g}; must be the same (x = 0 makes an "
                    "integer, which stays one: x = 0.0)"
                )
        return None

    def _broken(self, rate, structure, stress, growth) -> str | None:
        wrong = np.flatnonzero(~(np.isfinite(stress) & (stress >= 0.0) & np.isfinite(growth)))
        if not len(wrong):
            return None
        k = wrong[0]
        where = f"at a shear rate of {rate[k]:.3g} 1/s and a structure of {structure[k]:.3g}"
        if np.isfinite(stress[k]) and stress[k] >= 0.0:
            return f"material: {self._growth_named}: is {growth[k]:g} 1/s {where}; must be finite"
        return f"{self._named}: is {stress[k]:g} Pa {where}; must be finite and at least 0 Pa"


def python_values(function, structure, otherwise) -> np.ndarray:
    """Values at RATES of a law as the Python function that it is; ``otherwise`` where Python cannot call it, as with
    parts that only kernels may call."""
    try:
        with np.errstate(all="ignore"):
            return np.array([unwrap(function)(rate, np.float64(structure)) for rate in RATES], float)
    except Exception:  # whatever a function of somebody else raises
        return otherwise


def name_of(function) -> str:
    """The name by which a user knows a function."""
    return getattr(function, "__qualname__", type(function).__name__).split("<locals>.")[-1]
