"""Materials: what a technologist knows of the mix, in SI units. A number of the mix is declared here and nowhere else:
its unit, its range and its help. A scene that takes a ``material`` has all of them as options (``units.checked``)."""

import math
import warnings
from collections.abc import Callable
from typing import ClassVar

from pydantic import Field, model_validator

from ..units import (
    Angle,
    AnyDensity,
    Checked,
    Consistency,
    CriticalStrainRate,
    Density,
    Destructuration,
    Duration,
    FlowIndex,
    Ratio,
    Structuration,
    Viscosity,
    YieldValue,
    checked,
    require,
    said,
    unit_of,
)

LAWS = "Bingham, Newtonian, HerschelBulkley or FlowCurve"
FLOWS = 0.05  # viscous part of the stress over the yield stress from which a material is said to flow [-]
TYPICAL_RATE = 5.0  # shear rate of a slump test [1/s]
HIGH_KNEE = 0.1  # fraction of the yield stress by which the knee stress may exceed it without a warning; the paper's #1


class Material(Checked):
    """What all materials have in common: a density, and, each in its own way, a yield stress ``yield_value`` [Pa], a
    ``plastic_viscosity`` [Pa s] and a ``critical_strain_rate`` [1/s]. A number that is declared here is one of all."""

    options: ClassVar[dict] = {"density": Density}  # scenes are under gravity: there is no fluid of 1 kg/m3

    density: AnyDensity = Field(2300.0, description="density of the mix")

    @property
    def yields(self) -> bool:
        """Has it a yield stress above 0?"""
        return self.yield_value > 0.0

    @property
    def newtonian(self) -> bool:
        """Is the plastic viscosity all of its law? So it is of Bingham's without a yield stress."""
        return isinstance(self, Bingham) and not self.yields

    @property
    def rests(self) -> bool:
        """Does it come to rest? Only what has a true yield stress does."""
        return self.yields and self.critical_strain_rate is None

    @property
    def ages(self) -> bool:
        """Does its yield stress grow with time? That of a thixotropic one may."""
        return getattr(self, "growth", None) is not None

    def flows(self, rate):
        """Is the viscous part of the stress at shear rates [1/s] more than FLOWS of the yield stress?"""
        return self.plastic_viscosity * rate > FLOWS * self.yield_value

    def within(self, time: float) -> "Material":
        """The material with all its numbers, for a run of this time [s]."""
        return self

    def facts(self) -> dict:
        """All of it, JSON-ready: the law by its name, numbers in SI units, functions by their names."""
        values = {name: getattr(self, name) for name in type(self).model_fields}
        named = {name: getattr(value, "__qualname__", str(value)) for name, value in values.items() if callable(value)}
        return {"law": type(self).__name__} | values | named


class Bingham(Material):
    """Fresh concrete: rigid below the yield stress, flowing with the plastic viscosity above it (eqs 1-3).

    With a ``friction_angle`` phi the yield stress is yield_value + p tan(phi), p >= 0 (Drucker and Prager 1952, without
    dilation; scheme ``implicit``, a true yield stress).

    ``critical_strain_rate`` is the paper's pi_c [1/s] of the bi-viscosity law: below a shear rate of 2 pi_c the
    material is a very viscous fluid. ``None`` means a true yield stress (scheme ``implicit`` only); the scheme
    ``semi-implicit`` then takes the paper's 0.1 1/s. ``"rational"`` is the largest rate that is as good as a true yield
    stress for the time of the scene (``rational_critical_strain_rate``). With ``yield_value = 0`` the fluid is
    Newtonian and no code of a yield stress is compiled. Warns if the knee stress is more than HIGH_KNEE above the yield
    stress.
    """

    plastic_viscosity: Viscosity = Field(50.0, description="plastic viscosity of the mix")
    yield_value: YieldValue = Field(300.0, description="yield stress of the mix")
    critical_strain_rate: CriticalStrainRate | None = Field(
        None, description="pi_c of the bi-viscosity law, by default a true yield stress"
    )
    friction_angle: Angle = Field(
        0.0, description="internal friction: its tangent times the pressure adds to the yield stress"
    )

    @property
    def yields(self) -> bool:
        """Has it a yield stress above 0, by itself or by friction?"""
        return self.yield_value > 0.0 or self.friction_angle > 0.0

    @property
    def friction_coefficient(self) -> float:
        """tan(friction_angle) [-]: yield stress by pressure."""
        return math.tan(math.radians(self.friction_angle))

    @property
    def knee_stress(self) -> float:
        """Stress [Pa] at which a bi-viscosity material starts to flow: tau_y + 2 eta pi_c (R1)."""
        known = isinstance(self.critical_strain_rate, float)
        return self.yield_value + (2.0 * self.plastic_viscosity * self.critical_strain_rate if known else 0.0)

    def within(self, time: float) -> "Bingham":
        """The material with all its numbers: ``rational`` is the rate for a run of this time [s]."""
        if self.critical_strain_rate != "rational":
            return self
        mix = {"plastic_viscosity": self.plastic_viscosity, "yield_value": self.yield_value}
        return self.model_copy(update={"critical_strain_rate": rational_critical_strain_rate(**mix, time=time)})

    @model_validator(mode="after")
    def _has_one_kind_of_yield_stress_and_a_low_knee(self):
        require(
            self.friction_angle == 0.0 or self.critical_strain_rate is None,
            f"friction_angle = {self.friction_angle:g} deg: needs a true yield stress; critical_strain_rate must "
            "be left out",
        )
        excess = self.knee_stress - self.yield_value
        if self.yields and excess > (HIGH_KNEE + 1e-9) * self.yield_value:
            largest = HIGH_KNEE * self.yield_value / (2.0 * self.plastic_viscosity)
            warnings.warn(
                f"critical_strain_rate = {self.critical_strain_rate:g} 1/s: the concrete yields at a knee stress of "
                f"{self.knee_stress:g} Pa instead of yield_value = {self.yield_value:g} Pa; "
                f"at most {largest:.3g} 1/s keeps that within {100.0 * HIGH_KNEE:g} %",
                stacklevel=1,  # by text: once in a process, however often the scene is built
            )
        return self


class FlowCurve(Material):
    """A fluid by its own flow curve: rigid below the yield stress, shear stress ``shear_stress`` above it.

    ``shear_stress(rate, structure)`` is a short function that Taichi can compile: the stress [Pa] at a shear rate
    [1/s], not falling with it, and equal to the yield stress at rate 0. ``growth(rate, structure)``, if given, is the
    rate of change [1/s] of ``structure``, a number that every particle carries and that is zero at the start:
    thixotropy. ``plastic_viscosity`` [Pa s] is a typical slope of the curve; it sets the length of the steps and the
    penalty of the iteration, not the answer. Scheme ``implicit`` only.
    """

    yield_value: YieldValue = Field(0.0, description="yield stress of the mix")
    plastic_viscosity: Viscosity = Field(50.0, description="typical slope of the flow curve")
    shear_stress: Callable
    growth: Callable | None = None
    critical_strain_rate: None = None


class HerschelBulkley(Material):
    """tau = (1 + lambda) tau_y + k rate^n: thickens (n > 1) or thins (n < 1) with the shear rate; rigid below the yield
    stress; thixotropic where ``structuration`` is above 0, else lambda = 0.

    Roussel (2006): d lambda/dt = A/tau_y - alpha rate lambda, lambda = 0 at the start. At rest the yield stress grows
    by A = ``structuration`` [Pa/s]; flow undoes it within a strain of 1/alpha, alpha the ``destructuration`` [-].
    """

    yield_value: YieldValue = Field(300.0, description="yield stress of the mix")
    consistency: Consistency = Field(50.0, description="k: stress over the yield stress at a shear rate of 1 1/s")
    flow_index: FlowIndex = Field(1.0, description="n: exponent of the shear rate")
    structuration: Structuration = Field(0.0, description="growth of the yield stress at rest (thixotropy)")
    destructuration: Destructuration = Field(0.005, description="part of that growth undone by a strain of 1")
    critical_strain_rate: None = None

    @model_validator(mode="after")
    def _has_what_grows(self):
        require(
            self.structuration == 0.0 or self.yields,
            f"structuration = {self.structuration:g} Pa/s: needs a yield stress to grow; yield_value must be above "
            "0 Pa",
        )
        return self

    @property
    def plastic_viscosity(self) -> float:
        """Slope [Pa s] of the chord of the curve up to TYPICAL_RATE: scale of the steps and of the penalty."""
        return self.consistency * TYPICAL_RATE ** (self.flow_index - 1.0)

    @property
    def growth(self) -> Callable | None:
        """d lambda/dt [1/s] at (rate [1/s], lambda [-]); None without thixotropy."""
        if self.structuration == 0.0:
            return None
        at_rest, undone = self.structuration / self.yield_value, self.destructuration

        def growth(rate, structure):
            return at_rest - undone * rate * structure

        return growth


class Concrete(Bingham):
    """A mix as a scene is told of it: all numbers of Bingham's law, and those with which it is Herschel and Bulkley's,
    or thixotropic. ``Concrete(...)`` makes the simplest law of these numbers, ``Bingham`` or ``HerschelBulkley``: a
    scene that takes ``material: Concrete`` has all of them as options and is given that law."""

    consistency: Consistency | None = Field(
        None, description="k of tau_y + k rate^n, by default the number of the plastic viscosity"
    )
    flow_index: FlowIndex = Field(1.0, description="n: exponent of the shear rate (Herschel-Bulkley)")
    structuration: Structuration = HerschelBulkley.model_fields["structuration"]
    destructuration: Destructuration = HerschelBulkley.model_fields["destructuration"]

    def __new__(cls, **numbers):
        """The law of these numbers."""
        usual = {name: field.default for name, field in cls.model_fields.items()}
        told = usual | numbers
        others = [key for key in ("consistency", "flow_index", "structuration") if told[key] != usual[key]]
        HerschelBulkley(destructuration=told["destructuration"])  # in its range, also where it plays no part
        law = HerschelBulkley if others else Bingham
        for key in ("friction_angle", "critical_strain_rate"):
            value = said(told[key], unit_of(cls.model_fields[key]))
            only = f"is of Bingham's law alone; must not be given with {' and '.join(others)}"
            require(not others or told[key] == usual[key], f"{key} = {value}: {only}")
        if told["consistency"] is None:
            told["consistency"] = told["plastic_viscosity"]
        return law(**{key: value for key, value in told.items() if key in law.model_fields or key not in usual})


def Newtonian(density: float = 1000.0, viscosity: float = 1e-3) -> Bingham:  # noqa: N802
    """A fluid without yield stress: density [kg/m3], viscosity [Pa s]."""
    return Bingham(density=density, plastic_viscosity=viscosity, yield_value=0.0)


@checked
def rational_critical_strain_rate(
    plastic_viscosity: Viscosity, yield_value: YieldValue, time: Duration = 5.0, error: Ratio = 0.01
) -> float:
    """pi_c [1/s] of a bi-viscosity law that is as good as a true yield stress: min(e tau_y/(2 eta), e/T) (R3).

    The largest with which the knee stress is at most 1 + ``error`` times the yield stress (R1), and creep displaces a
    body by at most ``error`` times its height within ``time`` [s] (R2). Neither the height nor gravity matters, since a
    body that has come to rest is at its yield stress whatever they are. Keywords only; SceneError for a fluid without
    yield stress.
    """
    require(yield_value > 0.0, "yield_value = 0 Pa: a fluid without yield stress has no critical strain rate")
    return error * min(yield_value / (2.0 * plastic_viscosity), 1.0 / time)
