"""Materials: the constants of a mix, in SI units, and the law by which it flows.

A law is one class: its numbers, each declared here and nowhere else with unit, range and help, and the functions that a
scheme needs. A scene that takes ``material: Concrete`` has the numbers of all LAWS as options (``units.checked``).
"""

import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from types import NoneType
from typing import TYPE_CHECKING, Any, ClassVar, get_type_hints

import numpy as np
from pydantic import Field, model_validator

from ...units import (
    Angle,
    AnyDensity,
    Checked,
    CriticalStrainRate,
    Density,
    Duration,
    Ratio,
    Time,
    Viscosity,
    YieldValue,
    array,
    checked,
    instance,
    quote,
    real,
    require,
    unit_of,
    validated,
)

Rate = real("1/s", ge=0.0) | array("1/s", (None,))
FLOW_THRESHOLD = 0.05  # viscous part of the stress over the yield stress from which on a material counts as flowing [-]
TYPICAL_RATE = 5.0  # shear rate of a slump test [1/s]
HIGH_KNEE = 0.1  # excess of the knee stress over the yield stress, above which a warning is given; the paper's #1 [-]


class Material(Checked):
    """Base class of all materials: the properties that a scheme needs, whatever the law.

    Notes
    -----
    A material has a ``density``, a ``yield_value`` [Pa], the ``critical_strain_rate`` [1/s] of a bi-viscosity law or
    None, and:

    - ``shear_stress(rate, structure)`` [Pa], its flow curve at a shear rate [1/s], which Taichi can compile;
    - ``growth(rate, structure)`` [1/s], the rate of change of the structure, or None without thixotropy;
    - ``typical_slope`` [Pa s] of the flow curve, the scale of the time step, of the penalty, of the hourglass
      resistance and of the layer at a wall with friction. The answer converges where it is that of the curve.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> from taichi_mps.engine.problem.materials import Material
    >>> isinstance(mps.Newtonian(), Material), mps.Newtonian().yields
    (True, False)
    """

    options: ClassVar[dict] = {"density": Density}  # narrower than AnyDensity: scenes are under gravity
    from_fields: ClassVar[tuple] = ()  # numbers that kernels read from fields; all others are compiled in
    viscous: ClassVar[tuple] = ()  # options of its viscous constant, each of which chooses this law
    straight: ClassVar[bool] = False  # whether the flow curve of the fresh mix is Bingham's
    curved: ClassVar[bool] = True  # whether kernels call shear_stress, and know no closed form of it
    newtonian: ClassVar[bool] = False  # whether the stress is proportional to the shear rate
    friction_coefficient: ClassVar[float] = 0.0  # increase of the yield stress with the pressure [-]
    growth_at_rest: ClassVar[float] = 0.0  # growth rate of the yield stress at rest [Pa/s]
    initial_structure: ClassVar[float] = 0.0  # structure at the start, of what is poured when it enters [-]

    density: AnyDensity = Field(default=2300.0, description="density of the mix")

    @property
    def yields(self) -> bool:
        """Whether the yield stress is above 0."""
        return self.yield_value > 0.0

    @property
    def rests(self) -> bool:
        """Whether the material comes to rest as it is given, by a true yield stress; a scheme may soften it."""
        return self.yields and self.critical_strain_rate is None

    @property
    def ages(self) -> bool:
        """Whether the flow curve depends on a structure that changes with time (thixotropy)."""
        return self.growth is not None

    @property
    def functions(self) -> dict[str, Callable]:
        """The functions of the law that kernels compile, by their names."""
        return {"shear_stress": self.shear_stress} | ({"growth": self.growth} if self.ages else {})

    @property
    def own(self) -> bool:
        """Whether a function of the law is the user's, which may be anything."""
        return any(getattr(function, "__module__", None) != __name__ for function in self.functions.values())

    @validated
    def flows(self, rate: Rate) -> bool | np.ndarray:
        """Return where the material flows: where the viscous part of the stress is over 5 % of the yield stress.

        Parameters
        ----------
        rate : float or ndarray
            Shear rates [1/s].

        Returns
        -------
        bool or ndarray of bool
            True where it flows.
        """
        return self.typical_slope * rate > FLOW_THRESHOLD * self.yield_value

    @validated
    def within(self, time: Time) -> "Material":
        """Return the material with all its numbers, for a run of a given length.

        Parameters
        ----------
        time : float
            Length of the run [s].

        Returns
        -------
        Material
            Material with no number left to choose.
        """
        return self

    @classmethod
    def instead_of(cls, key: str) -> str:
        """Return what a message says after the name of an unknown number: the law that has it, or which is near.

        Parameters
        ----------
        key : str
            Name of the number.

        Returns
        -------
        str
            Text that follows the name, or ''.
        """
        if key in LAW_OF:
            return f": the law {LAW_OF[key].__name__} has it; must be left out here"
        return super().instead_of(key)

    def facts(self) -> dict:
        """Return the description of the material, JSON-ready.

        Returns
        -------
        dict
            The law by its name, numbers in SI units, functions by their names.
        """
        values = {name: getattr(self, name) for name in type(self).model_fields}
        return (
            {"law": type(self).__name__}
            | values
            | {name: getattr(value, "__qualname__", str(value)) for name, value in values.items() if callable(value)}
        )


class Bingham(Material):
    """Fresh concrete: rigid below the yield stress, flowing with the plastic viscosity above it.

    The parameters are the fields below.

    Raises
    ------
    SceneError
        If a number is out of range, or friction is given with a critical strain rate.

    Warns
    -----
    UserWarning
        If the knee stress of a bi-viscosity law is more than 10 % above the yield stress.

    Notes
    -----
    The stress is tau_y + eta rate (eqs 1-3). With a ``friction_angle`` phi the yield stress is tau_y + p tan(phi), p >=
    0 (Drucker and Prager 1952, without dilation; scheme ``implicit``, a true yield stress).

    ``critical_strain_rate`` is the paper's pi_c of the bi-viscosity law: below a shear rate of 2 pi_c the material is a
    very viscous fluid. None means a true yield stress (scheme ``implicit`` only); the scheme ``semi-implicit`` then
    takes the paper's 0.1 1/s. ``"rational"`` is the largest rate that is as good as a true yield stress for the time of
    the scene (``rational_critical_strain_rate``). With ``yield_value = 0`` the fluid is Newtonian.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mix = mps.Bingham(density=2350.0, plastic_viscosity=50.0, yield_value="0.5 kPa")
    >>> mix.yield_value, mix.rests, mix.shear_stress(10.0, 0.0)
    (500.0, True, 1000.0)
    """

    from_fields: ClassVar[tuple] = ("density", "plastic_viscosity", "yield_value", "critical_strain_rate")
    viscous: ClassVar[tuple] = ("plastic_viscosity",)
    curved: ClassVar[bool] = False
    growth: ClassVar[None] = None

    plastic_viscosity: Viscosity = Field(default=50.0, description="plastic viscosity of the mix")
    yield_value: YieldValue = Field(default=300.0, description="yield stress of the mix")
    critical_strain_rate: CriticalStrainRate | None = Field(
        default=None, description="pi_c of the bi-viscosity law, by default a true yield stress"
    )
    friction_angle: Angle = Field(
        default=0.0, description="internal friction: its tangent times the pressure adds to the yield stress"
    )

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs):
        super().__pydantic_init_subclass__(**kwargs)
        if "shear_stress" in vars(cls):  # kernels never call shear_stress of a Bingham
            raise TypeError(f"class {cls.__name__}: a law with a flow curve of its own must derive from mps.Law")

    @property
    def yields(self) -> bool:
        """Whether there is a yield stress, by itself or by friction."""
        return self.yield_value > 0.0 or self.friction_angle > 0.0

    @property
    def newtonian(self) -> bool:
        """Whether there is no yield stress."""
        return not self.yields

    @property
    def friction_coefficient(self) -> float:
        """Tangent of the friction angle [-]: growth of the yield stress with the pressure."""
        return math.tan(math.radians(self.friction_angle))

    @property
    def straight(self) -> bool:
        """Whether the flow curve is tau_y + eta rate, whatever the pressure."""
        return self.friction_angle == 0.0

    @property
    def typical_slope(self) -> float:
        """Plastic viscosity [Pa s]."""
        return self.plastic_viscosity

    def shear_stress(self, rate, structure):
        """Return the shear stress.

        Parameters
        ----------
        rate : float
            Shear rate [1/s].
        structure : float
            Structure of a thixotropic law [-], here without influence.

        Returns
        -------
        float
            Shear stress [Pa].
        """
        return self.yield_value + self.plastic_viscosity * rate

    def shear_rate(self, stress: float | np.ndarray) -> np.ndarray:
        """Return the shear rate of a stress.

        Parameters
        ----------
        stress : float or ndarray
            Shear stress [Pa].

        Returns
        -------
        float or ndarray
            Shear rate [1/s]; below the yield stress 0, below the knee stress that of the very viscous fluid.
        """
        flowing = np.maximum(0.0, stress - self.yield_value) / self.plastic_viscosity
        if self.knee_stress == self.yield_value:
            return flowing
        return np.where(stress < self.knee_stress, 2.0 * self.critical_strain_rate * stress / self.knee_stress, flowing)

    @property
    def softened_rate(self) -> float:
        """Critical strain rate pi_c [1/s] of the scheme semi-implicit, the paper's 0.1 where none is given."""
        return 0.1 if self.critical_strain_rate is None else self.critical_strain_rate

    @property
    def unyielded_viscosity(self) -> float:
        """Apparent viscosity eta + tau_y/(2 pi_c) [Pa s] of unyielded material by that scheme (eqs 2, 3, 9)."""
        return self.plastic_viscosity + self.yield_value / (2.0 * self.softened_rate)

    @property
    def knee_stress(self) -> float:
        """Stress [Pa] at which a bi-viscosity material starts to flow: tau_y + 2 eta pi_c (R1)."""
        is_number = isinstance(self.critical_strain_rate, float)
        return self.yield_value + (2.0 * self.plastic_viscosity * self.critical_strain_rate if is_number else 0.0)

    @validated
    def within(self, time: Duration) -> "Bingham":
        """Return the material with all its numbers, for a run of a given length.

        Parameters
        ----------
        time : float
            Length of the run [s], from which a ``rational`` critical strain rate follows.

        Returns
        -------
        Bingham
            Material with no number left to choose.
        """
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
        if self.yields and self.knee_stress - self.yield_value > (HIGH_KNEE + 1e-9) * self.yield_value:
            largest = HIGH_KNEE * self.yield_value / (2.0 * self.plastic_viscosity)
            warnings.warn(
                f"critical_strain_rate = {self.critical_strain_rate:g} 1/s: the concrete yields at a knee stress of "
                f"{self.knee_stress:g} Pa instead of yield_value = {self.yield_value:g} Pa; "
                f"at most {largest:.3g} 1/s keeps that within {100.0 * HIGH_KNEE:g} %",
                stacklevel=1,  # by text: once in a process, however often the scene is built
            )
        return self


class Law(Material):
    """Base class of a law whose flow curve is compiled: derive from it for a law of your own.

    Notes
    -----
    A law declares its numbers as fields, ``yield_value`` [Pa] among them, and has the method ``shear_stress(self, rate,
    structure)`` [Pa]: plain arithmetic of a shear rate [1/s] and of a structure [-]; equal to the yield stress at rate
    0 and not falling with the rate. A method ``growth(self, rate, structure)``, the rate of change of the structure
    [1/s], makes it thixotropic; its property ``initial_structure`` [-] is zero where it has none of its own. Scheme
    ``implicit`` only.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> class Thinning(mps.Law):
    ...     yield_value: float = 40.0  # [Pa]
    ...     consistency: float = 30.0
    ...
    ...     def shear_stress(self, rate, structure):
    ...         return self.yield_value + self.consistency * rate**0.5
    >>> round(Thinning().typical_slope, 3)  # [Pa s]
    13.416
    """

    growth: ClassVar[Callable | None] = None

    critical_strain_rate: None = None
    yield_value: YieldValue = Field(description="yield stress of the mix")

    @property
    def from_fields(self) -> tuple[str, ...]:
        """Numbers that kernels read from fields: all, but none of a law of the user's, which may be of any kind."""
        return () if self.own else tuple(numbers_of(type(self)))

    @abstractmethod
    def shear_stress(self, rate, structure):
        """Return the shear stress.

        Parameters
        ----------
        rate : float
            Shear rate [1/s].
        structure : float
            Structure of a thixotropic law [-].

        Returns
        -------
        float
            Shear stress [Pa].
        """

    @property
    def typical_slope(self) -> float:
        """Slope of the chord of the fresh flow curve up to a shear rate of 5 1/s [Pa s]."""
        return (self.shear_stress(TYPICAL_RATE, 0.0) - self.shear_stress(0.0, 0.0)) / TYPICAL_RATE


class HerschelBulkley(Law):
    """Concrete that thickens or thins with the shear rate, and may be thixotropic.

    The parameters are the fields below.

    Raises
    ------
    SceneError
        If a number is out of range, or a thixotropic mix has no yield stress.

    Notes
    -----
    The stress is (1 + lambda) tau_y + k rate^n: n > 1 thickens, n < 1 thins; rigid below the yield stress. Without
    ``structuration`` lambda is 0. Otherwise d lambda/dt = A/tau_y - alpha rate lambda (Roussel 2006, Cem. Concr. Res.
    36, 1797): at rest the yield stress grows by A = ``structuration`` [Pa/s], and flow undoes it within a strain of
    1/alpha, alpha the ``destructuration`` [-]. At the start, or where it is poured, the mix has rested for its ``age``:
    lambda = A age/tau_y.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> thickens = mps.HerschelBulkley(yield_value=60.0, consistency=20.0, flow_index=1.5)
    >>> thickens.shear_stress(4.0, 0.0)
    220.0
    """

    viscous: ClassVar[tuple] = ("consistency", "plastic_viscosity")

    yield_value: YieldValue = Field(default=300.0, description="yield stress of the mix")
    consistency: real("Pa s^n", gt=0.0, le=1e6) = Field(
        default=50.0, description="k of tau_y + k rate^n, by default the number of the plastic viscosity"
    )
    flow_index: real("", ge=0.1, le=4.0) = Field(default=1.0, description="n: exponent of the shear rate")
    structuration: real("Pa/s", "0.1 to 1.7 of concrete", ge=0.0, le=1e3) = Field(
        default=0.0, description="growth of the yield stress at rest (thixotropy)"
    )
    destructuration: real("", ge=0.0, le=10.0) = Field(
        default=0.005, description="part of that growth undone by a strain of 1"
    )
    age: Time = Field(default=0.0, description="rest before the start, during which the yield stress has grown")

    @model_validator(mode="after")
    def _has_what_grows(self):
        require(
            self.structuration == 0.0 or self.yields,
            f"structuration = {self.structuration:g} Pa/s: needs a yield stress to grow; yield_value must be above "
            "0 Pa",
        )
        require(
            self.ages or self.age == 0.0,
            f"age = {self.age:g} s: needs a yield stress that grows at rest; structuration must be given",
        )
        require(
            "structuration" in self.model_fields_set or not chooses_law("destructuration", self.destructuration),
            f"destructuration = {self.destructuration:g}: undoes structuration, which must be given",
        )
        return self

    @property
    def ages(self) -> bool:
        """Whether the yield stress grows at rest."""
        return self.structuration > 0.0

    @property
    def straight(self) -> bool:
        """Whether n is 1."""
        return self.flow_index == 1.0

    @property
    def growth_at_rest(self) -> float:
        """Growth A of the yield stress at rest [Pa/s]."""
        return self.structuration

    @property
    def initial_structure(self) -> float:
        """Structure lambda at the start [-], grown during the ``age``."""
        return self.age * self.structuration / self.yield_value if self.ages else 0.0

    @property
    def typical_slope(self) -> float:
        """Slope of the chord of the curve up to a shear rate of 5 1/s [Pa s]."""
        return self.consistency * TYPICAL_RATE ** (self.flow_index - 1.0)

    def shear_stress(self, rate, structure):
        """Return the shear stress.

        Parameters
        ----------
        rate : float
            Shear rate [1/s].
        structure : float
            Structure lambda [-].

        Returns
        -------
        float
            Shear stress [Pa].
        """
        return (1.0 + structure) * self.yield_value + self.consistency * max(rate, 1e-12) ** self.flow_index

    def growth(self, rate, structure):
        """Return the rate of change of the structure.

        Parameters
        ----------
        rate : float
            Shear rate [1/s].
        structure : float
            Structure lambda [-].

        Returns
        -------
        float
            d lambda/dt [1/s].
        """
        return self.structuration / self.yield_value - self.destructuration * rate * structure

    def shear_rate(self, stress: float | np.ndarray) -> np.ndarray:
        """Return the shear rate of a stress, of the fresh mix.

        Parameters
        ----------
        stress : float or ndarray
            Shear stress [Pa].

        Returns
        -------
        float or ndarray
            Shear rate [1/s], 0 below the yield stress.
        """
        return (np.maximum(0.0, stress - self.yield_value) / self.consistency) ** (1.0 / self.flow_index)


class Casson(Law):
    """Concrete by Casson's law: steep where it begins to flow.

    The parameters are the fields below.

    Raises
    ------
    SceneError
        If a number is out of range.

    Notes
    -----
    sqrt(tau) = sqrt(tau_y) + sqrt(eta_c rate) with the ``casson_viscosity`` eta_c, the slope far above the yield stress
    (Casson 1959, of printing inks).

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.Casson(yield_value=100.0, casson_viscosity=25.0).shear_stress(4.0, 0.0)
    400.0
    """

    viscous: ClassVar[tuple] = ("casson_viscosity",)

    yield_value: YieldValue = Field(default=300.0, description="yield stress of the mix")
    casson_viscosity: Viscosity = Field(
        default=20.0, description="eta of sqrt(tau) = sqrt(tau_y) + sqrt(eta rate), at high shear rates"
    )

    def shear_stress(self, rate, structure):
        """Return the shear stress.

        Parameters
        ----------
        rate : float
            Shear rate [1/s].
        structure : float
            Structure of a thixotropic law [-], here without influence.

        Returns
        -------
        float
            Shear stress [Pa].
        """
        return (self.yield_value**0.5 + (self.casson_viscosity * rate) ** 0.5) ** 2

    def shear_rate(self, stress: float | np.ndarray) -> np.ndarray:
        """Return the shear rate of a stress.

        Parameters
        ----------
        stress : float or ndarray
            Shear stress [Pa].

        Returns
        -------
        float or ndarray
            Shear rate [1/s], 0 below the yield stress.
        """
        return np.maximum(0.0, np.sqrt(stress) - self.yield_value**0.5) ** 2 / self.casson_viscosity


class FlowCurve(Material):
    """Fluid by a flow curve given as a function: rigid below the yield stress.

    Notes
    -----
    ``shear_stress(rate, structure)`` is a short function that Taichi can compile: the stress [Pa] at a shear rate
    [1/s], not falling with it, and equal to the yield stress at rate 0. ``growth(rate, structure)``, if given, is the
    rate of change [1/s] of ``structure``, a number that every particle carries and that is zero at the start:
    thixotropy. ``typical_slope`` [Pa s] of the curve sets the length of the steps and the penalty of the iteration:
    that of the chord to 5 1/s, for one far from it makes the answer wrong. Scheme ``implicit`` only.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> def stress(rate, structure):
    ...     return 40.0 + 30.0 * rate**0.5
    >>> mps.FlowCurve(yield_value=40.0, typical_slope=20.0, shear_stress=stress).shear_stress(4.0, 0.0)
    100.0
    """

    yield_value: YieldValue = Field(default=0.0, description="yield stress of the mix")
    typical_slope: Viscosity = Field(default=50.0, description="typical slope of the flow curve")
    shear_stress: Callable = Field(description="stress at a shear rate [1/s] and a structure [-]")
    growth: Callable | None = Field(
        default=None, description="rate of change of the structure, by default not thixotropic"
    )
    critical_strain_rate: None = None


# ---- choice of the law by the numbers that are given -----------------------------------------------------------------
def numbers_of(law: type[Material]) -> dict:
    """Return the numbers of a law, {name: pydantic field}."""
    return {name: field for name, field in law.model_fields.items() if field.annotation is not NoneType}


# laws whose numbers are options of every scene; the first is the default
LAWS = (Bingham, HerschelBulkley, Casson)
COMMON_NUMBERS = set.intersection(*(set(numbers_of(law)) for law in LAWS))
# other numbers of a mix, {name: the first law that has it}
LAW_OF = {name: law for law in reversed(LAWS) for name in numbers_of(law) if name not in COMMON_NUMBERS}
MATERIALS = f"{', '.join(law.__name__ for law in LAWS)}, Newtonian, FlowCurve or another Law"
if TYPE_CHECKING:
    AnyMaterial = Material
else:
    AnyMaterial = instance(Material, MATERIALS)


def numbers_of_all_laws() -> tuple[dict, dict]:
    """Return the numbers of all LAWS as pydantic declares fields, {name: annotation} and {name: field}.

    A viscous constant has no default, since it chooses the law.
    """
    options, fields = {}, {}
    for law in LAWS:
        hints, whose = get_type_hints(law, include_extras=True), f" ({law.__name__})" if law is not LAWS[0] else ""
        for name, field in numbers_of(law).items():
            default = Field(None if name in law.viscous else field.default, description=f"{field.description}{whose}")
            options.setdefault(name, hints[name] if name in COMMON_NUMBERS else hints[name] | None)
            fields.setdefault(name, default)
    return options | Material.options, fields


class Concrete(ABC):  # noqa: B024  (what is registered below is complete)
    """Abstract base class of all materials, which makes one from the numbers of any law.

    Parameters
    ----------
    **numbers : float or str
        Numbers of ``Bingham``, ``HerschelBulkley`` or ``Casson``, in SI units or text with a unit.

    Raises
    ------
    SceneError
        For a number out of range, or one that the law has not.

    Notes
    -----
    ``Concrete(...)`` makes the law that has the numbers given, ``Bingham`` where these are of several. A scene that
    takes ``material: Concrete`` has all the numbers as options and is given that law. Materials are registered, not
    derived: Python would initialise a derived one again, with the numbers given.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> type(mps.Concrete(yield_value=60.0)).__name__
    'Bingham'
    >>> thickens = mps.Concrete(yield_value=60.0, consistency=20.0, flow_index=1.5)
    >>> type(thickens).__name__, isinstance(thickens, mps.Concrete)
    ('HerschelBulkley', True)
    """

    options, model_fields = numbers_of_all_laws()

    def __new__(cls, **numbers: Any):
        """Make the law of these numbers."""
        return cls.from_values(numbers, Bingham())

    @classmethod
    def from_values(cls, values: dict, default: Any) -> Material:
        """Make the material of these values, by the law that has most of them.

        The law of the default is preferred.

        Parameters
        ----------
        values : dict
            Numbers by name, None where not given.
        default : Material or None
            Material whose numbers stand for those that are not given.

        Returns
        -------
        Material
            Law that has the numbers given.

        Raises
        ------
        SceneError
            For a number that the law does not have.
        """
        usual = default if isinstance(default, Material) else Bingham()
        given = {name: value for name, value in values.items() if value is not None}
        for name, value in given.items():
            require(not isinstance(value, np.ndarray | bool), f"{name} = {quote(value, '')}: must be a number")
        choosing = [name for name, value in given.items() if chooses_law(name, value)]
        law = max(
            (type(usual), *LAWS), key=lambda law: sum(name in (*numbers_of(law), *law.viscous) for name in choosing)
        )
        known = numbers_of(law)
        by = " and ".join(name for name in choosing if name in known and name not in COMMON_NUMBERS)
        for name in (name for name in choosing if name in LAW_OF and name not in known):
            key = f"{name} = {quote(given[name], unit_of(LAW_OF[name].model_fields[name]))}"
            require(
                name in law.viscous, f"{key}: the law {law.__name__}, by {by}, has no such number; must be left out"
            )
            require(
                law.viscous[0] not in given, f"{key}: stands for {law.viscous[0]}, which is given; must be left out"
            )
        numbers = dict(usual) | given
        for name in law.viscous[1:]:
            if name in given or (law.viscous[0] not in numbers and name in numbers):
                numbers[law.viscous[0]] = numbers[name]
        unknown = given.keys() - cls.model_fields.keys()  # refused by the law
        return law(**{name: value for name, value in numbers.items() if name in known or name in unknown})


Concrete.register(Material)


def chooses_law(name: str, value) -> bool:
    """Return whether a number chooses a law.

    A viscous constant always does; another number unless it has the default that its law declares.
    """
    return name not in Concrete.model_fields or value != Concrete.model_fields[name].default


@validated
def Newtonian(density: AnyDensity = 1000.0, viscosity: Viscosity = 1e-3) -> Bingham:  # noqa: N802
    """Make a fluid without yield stress.

    Parameters
    ----------
    density : float, optional
        Density [kg/m3].
    viscosity : float, optional
        Viscosity [Pa s].

    Returns
    -------
    Bingham
        Material with a yield stress of 0 Pa.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> water = mps.Newtonian()
    >>> water.density, water.plastic_viscosity
    (1000.0, 0.001)
    """
    return Bingham(density=density, plastic_viscosity=viscosity, yield_value=0.0)


@checked
def rational_critical_strain_rate(
    plastic_viscosity: Viscosity, yield_value: YieldValue, time: Duration = 5.0, error: Ratio = 0.01
) -> float:
    """Return the critical strain rate of a bi-viscosity law that is as good as a true yield stress.

    Parameters
    ----------
    plastic_viscosity : float
        Plastic viscosity eta [Pa s].
    yield_value : float
        Yield stress tau_y [Pa].
    time : float, optional
        Length T of the run [s].
    error : float, optional
        Relative error e of the knee stress and of the creep [-].

    Returns
    -------
    float
        pi_c [1/s].

    Raises
    ------
    SceneError
        For a fluid without yield stress.

    Notes
    -----
    pi_c = min(e tau_y/(2 eta), e/T) (R3): the largest with which the knee stress is at most 1 + e times the yield
    stress (R1), and creep displaces a body by at most e times its height within T (R2). Neither the height nor gravity
    matters, since a body that has come to rest is at its yield stress whatever they are. Keywords only.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.rational_critical_strain_rate(plastic_viscosity=50.0, yield_value=300.0, time=5.0)
    0.002
    """
    require(yield_value > 0.0, "yield_value = 0 Pa: a fluid without yield stress has no critical strain rate")
    return error * min(yield_value / (2.0 * plastic_viscosity), 1.0 / time)
