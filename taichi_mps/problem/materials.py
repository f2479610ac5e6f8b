"""Materials: what a technologist knows of the mix, in SI units."""

import warnings
from collections.abc import Callable

from pydantic import model_validator

from ..units import (
    AnyDensity,
    Checked,
    Consistency,
    Duration,
    FlowIndex,
    Ratio,
    SceneError,
    StrainRate,
    Viscosity,
    YieldValue,
    checked,
)

TYPICAL_RATE = 5.0  # shear rate of a slump test [1/s]
HIGH_KNEE = 0.1  # share of the yield value by which the knee stress may exceed it without a warning; the paper's #1


class Mix(Checked):
    """What all materials have in common."""

    @property
    def yields(self) -> bool:
        """Has it a yield stress above 0?"""
        return self.yield_value > 0.0

    @property
    def newtonian(self) -> bool:
        """Is the plastic viscosity all of its law?"""
        return False

    @property
    def rests(self) -> bool:
        """Does it come to rest? Only what has a true yield stress does."""
        return self.yields and self.critical_strain_rate is None


class Bingham(Mix):
    """Fresh concrete: rigid below the yield value, flowing with the plastic viscosity above it (eqs 1-3).

    ``critical_strain_rate`` is the paper's pi_c [1/s] of the bi-viscosity law: below a shear rate of 2 pi_c the
    material is a very viscous fluid. ``None`` means a true yield value (scheme ``implicit`` only); the scheme
    ``semi-implicit`` then takes the paper's 0.1 1/s. With ``yield_value = 0`` the fluid is Newtonian and no
    yield code is compiled. Warns if the knee stress is more than HIGH_KNEE above the yield value.
    """

    density: AnyDensity = 2300.0
    plastic_viscosity: Viscosity = 50.0
    yield_value: YieldValue = 300.0
    critical_strain_rate: StrainRate | None = None

    @property
    def newtonian(self) -> bool:
        return not self.yields

    @property
    def knee_stress(self) -> float:
        """Stress [Pa] at which a bi-viscosity material starts to flow: tau_y + 2 eta pi_c (R1)."""
        return self.yield_value + 2.0 * self.plastic_viscosity * (self.critical_strain_rate or 0.0)

    @model_validator(mode="after")
    def _warn_of_a_high_knee(self):
        excess = self.knee_stress - self.yield_value
        if not self.newtonian and excess > (HIGH_KNEE + 1e-9) * self.yield_value:
            largest = HIGH_KNEE * self.yield_value / (2.0 * self.plastic_viscosity)
            warnings.warn(
                f"critical_strain_rate = {self.critical_strain_rate:g} 1/s: the concrete yields at a knee stress of "
                f"{self.knee_stress:g} Pa instead of yield_value = {self.yield_value:g} Pa; "
                f"at most {largest:.3g} 1/s keeps that within {100.0 * HIGH_KNEE:g} %",
                stacklevel=1,  # by text: once in a process, however often the scene is built
            )
        return self


class FlowCurve(Mix):
    """A fluid by its own flow curve: rigid below the yield value, shear stress ``shear_stress`` above it.

    ``shear_stress(rate, structure)`` is a short function that Taichi can compile: the stress [Pa] at a shear rate
    [1/s], not falling with it, and equal to the yield value at rate 0. ``growth(rate, structure)``, if given, is the
    rate of change [1/s] of ``structure``, a number that every particle carries and that is zero at the start:
    thixotropy. ``plastic_viscosity`` [Pa s] is a typical slope of the curve; it sets the length of the steps and the
    penalty of the iteration, not the answer. Scheme ``implicit`` only.
    """

    density: AnyDensity = 2300.0
    yield_value: YieldValue = 0.0
    plastic_viscosity: Viscosity = 50.0
    shear_stress: Callable
    growth: Callable | None = None
    critical_strain_rate: None = None


class HerschelBulkley(Mix):
    """tau = tau_y + k rate^n: thickens (n > 1) or thins (n < 1) with the shear rate; rigid below the yield value."""

    density: AnyDensity = 2300.0
    yield_value: YieldValue = 300.0
    consistency: Consistency = 50.0
    flow_index: FlowIndex = 1.0
    critical_strain_rate: None = None

    @property
    def plastic_viscosity(self) -> float:
        """Slope [Pa s] of the chord of the curve up to TYPICAL_RATE: scale of the steps and of the penalty."""
        return self.consistency * TYPICAL_RATE ** (self.flow_index - 1.0)


def Newtonian(density: float = 1000.0, viscosity: float = 1e-3) -> Bingham:  # noqa: N802
    """A fluid without yield value."""
    return Bingham(density=density, plastic_viscosity=viscosity, yield_value=0.0)


@checked
def rational_critical_strain_rate(
    plastic_viscosity: Viscosity, yield_value: YieldValue, time: Duration = 5.0, error: Ratio = 0.01
) -> float:
    """pi_c [1/s] of a bi-viscosity law that is as good as a true yield value: min(e tau_y/(2 eta), e/T) (R3).

    The largest with which the knee stress is at most 1 + ``error`` times the yield value (R1), and creep displaces a
    body by at most ``error`` times its height within ``time`` [s] (R2). Neither the height nor gravity matters, since a
    body that has come to rest is at its yield value whatever they are. Keywords only; SceneError for a fluid without
    yield value.
    """
    if yield_value == 0.0:
        raise SceneError("yield_value = 0 Pa: a fluid without yield value has no critical strain rate")
    return error * min(yield_value / (2.0 * plastic_viscosity), 1.0 / time)
