"""Result of a calibration: the constants of a mix with intervals, and their formatting as text."""

import math
from dataclasses import asdict, dataclass, field

import numpy as np

from ..problem.labels import in_words
from ..problem.materials import LAWS, numbers_of
from ..units import unit_of

CONTRADICTION = 9.0  # a misfit of three standard errors
NAMES = {"slump_m": "slump", "spread_m": "slump flow", "t500_s": "T500"}
NAMES |= {"mini_cone_m": "mini-cone flow", "v_funnel_s": "V-funnel time"}
RHEOMETER = "rheometer"  # who says a constant that is known
UNITS = {name: unit_of(field).strip("-") for law in LAWS for name, field in numbers_of(law).items()}  # of constants
UNITS["friction_angle"] = "degrees"
BINGHAM = "yield_value", "plastic_viscosity"  # the constants of a mix, in the order of the tables
FRICTIONAL = "yield_value", "friction_angle", "plastic_viscosity"  # those of one with internal friction
# [m] within which a mix of the model explains a measurement; Kantro's cone is a fifth of the standard one
NEAR = {"slump_m": 0.01, "spread_m": 0.02, "mini_cone_m": 0.004}
TOLD = 1.1  # factor by which a constant must be less certain without a measurement that is said to determine it


def is_time(name: str) -> bool:
    """Whether this is a measured time. It goes by its logarithm, a length as it is."""
    return name.endswith("_s")


def over(name: str, model, value):
    """By how much the model is above a measurement, in its unit: of times the measured one by the logarithm of their
    ratio, as they scatter."""
    return value * np.log(model / value) if is_time(name) else model - value


def short(value: float, figures: int = 3) -> str:
    """Format a number with so many figures, without an exponent."""
    return f"{float(f'{value:.{figures}g}'):.12g}"


def apart(name: str, by: float) -> str:
    """Format the difference of model and measurement with its unit, lengths [mm]."""
    return f"{by:+.2g} s" if is_time(name) else f"{1e3 * by:+.0f} mm"


@dataclass(frozen=True)
class Constant:
    """A constant of the mix, SI units: the best value and the ends of its 95 % interval.

    An end is None where the measurements do not bound the constant within the table, which reaches from ``low`` to
    ``high``. It is then not determined, and ``value`` is one of many that fit.
    """

    value: float
    lower: float | None
    upper: float | None
    low: float
    high: float
    unit: str

    @property
    def determined(self) -> bool:
        """Do the measurements bound the constant on both sides?"""
        return self.lower is not None and self.upper is not None

    @property
    def bounded(self) -> bool:
        """Do they bound it on one side at least?"""
        return self.lower is not None or self.upper is not None

    def bounds(self) -> str:
        """The value, or the bound where it has only one."""
        if self.determined:
            return f"{short(self.value)} {self.unit}"
        if not self.bounded:
            return "nothing"
        return f"at {'least' if self.lower else 'most'} {short(self.lower or self.upper)} {self.unit}"

    def told(self) -> str:
        """Format the constant with its interval in words."""
        if self.low == self.high:
            return f"{short(self.value)} {self.unit}, as given"
        if self.determined:
            return f"{self.bounds()}, 95 %: {short(self.lower)} to {short(self.upper)} {self.unit}"
        known = f"{self.bounds()} (95 %), not determined further" if self.bounded else "not determined"
        return f"{known} by these measurements (looked for from {self.ends()})"

    def ends(self) -> str:
        """The first and the last of the table."""
        return f"{short(self.low)} to {short(self.high)} {self.unit}"


@dataclass(frozen=True, kw_only=True)
class Found:
    """Constants that were fitted to measurements, and which measurement determines which of them."""

    constants: dict[str, Constant]
    # by measurement and constant: by which factor the constant's standard error would grow without it
    worth: dict[str, dict[str, float]]

    @property
    def values(self) -> dict[str, float]:
        """The best values by name, SI units, an angle in degrees."""
        return {name: it.value for name, it in self.constants.items()}

    def constant_lines(self) -> list[str]:
        """Lines of the constants in words."""
        return [f"{in_words(name):18} {it.told()}" for name, it in self.constants.items()]

    def determines(self, name: str) -> str:
        """Constants, of those that are bounded, that a measurement determines, in words."""
        needed = {it: by for it, by in self.worth[name].items() if by >= TOLD}
        told = []
        for constant in (it for it in needed if self.constants[it].bounded):
            others = [in_words(it) for it in needed if it != constant]
            once = f" once {f'the {others[0]} is' if len(others) == 1 else 'the others are'} bounded" * bool(others)
            told.append(f"the {in_words(constant)}{once} (without it {needed[constant]:.1f} times as uncertain)")
        return " and ".join(told) or "neither constant alone"

    def facts(self) -> dict:
        """All results, JSON-ready."""
        known = {name: asdict(it) | {"determined": it.determined} for name, it in self.constants.items()}
        return vars(self) | {"constants": known, "told": str(self)}


@dataclass(frozen=True, kw_only=True)
class Mix(Found):
    """A mix whose constants were looked up in the tables of tests."""

    yield_value = property(lambda self: self.constants["yield_value"], doc="Yield stress, a Constant.")
    plastic_viscosity = property(lambda self: self.constants["plastic_viscosity"], doc="Plastic viscosity, a Constant.")
    density: float  # [kg/m3]
    measured: dict[str, tuple[float, float]]  # value and standard error, SI units
    errors: dict[str, float]  # standard errors, with those of the table
    model: dict[str, float]
    misfit: float  # chi squared
    by_viscosity: dict[float, object]  # what fits at other plastic viscosities [Pa s]
    usual: bool = False  # is the plastic viscosity a usual one, neither given nor found?

    def facts(self) -> dict:
        """All results, JSON-ready."""
        facts = super().facts()
        return facts | facts.pop("constants")

    @property
    def keywords(self) -> dict[str, float]:
        """Keywords of a scene that is to have this mix."""
        return self.values | {"density": self.density}

    @property
    def missed(self) -> dict[str, float]:
        """Differences of the model from the measurements, SI units."""
        return {name: self.model[name] - value for name, (value, _) in self.measured.items()}

    @property
    def near(self) -> bool:
        """Whether the model is within NEAR of each length."""
        return all(abs(by) <= NEAR[name] for name, by in self.missed.items() if name in NEAR)

    def source(self, constant: str) -> str:
        """Main source of a constant: the measurement without which it would be the least certain, a rheometer where
        it is known, 'usual' where it is taken as of a usual mix, and '' where it has no bound."""
        it = self.constants[constant]
        if it.low == it.high:
            return "usual" if self.usual and constant == "plastic_viscosity" else RHEOMETER
        return NAMES[max(self.worth, key=lambda name: self.worth[name][constant])] if it.bounded else ""

    def measurement_lines(self) -> list[str]:
        """Lines on each measurement: its value beside the model, and what it determines."""
        lines = []
        for name, (value, error) in self.measured.items():
            factor, unit = (1.0, "s") if is_time(name) else (100.0, "cm")
            of_table = factor * math.sqrt(max(self.errors[name] ** 2 - error**2, 0.0))
            found = f"{factor * value:.2f} +- {factor * error:.2f} {unit}"
            found += f", of the model {factor * self.model[name]:.2f} +- {of_table:.2f}"
            found += f"; determines {self.determines(name)}" * bool(self.worth[name])
            lines.append(f"{NAMES[name]:18} {found}")
        return lines


@dataclass(frozen=True, kw_only=True)
class FrictionalMix(Mix):
    """The mix with internal friction, yield stress c + p tan(phi), that is nearest to slump, slump flow and, where it
    was measured, T500. The yield stress is c; ``by_viscosity`` holds c [Pa] and phi [degrees] of other mixes."""

    friction_angle = property(lambda self: self.constants["friction_angle"], doc="phi [degrees], a Constant.")

    @property
    def near(self) -> bool:
        """Whether the mix is within NEAR of both lengths, and within three standard errors of T500."""
        late = {
            name: over(name, self.model[name], self.measured[name][0]) for name in self.measured.keys() - NEAR.keys()
        }
        return super().near and all((by / self.errors[name]) ** 2 <= CONTRADICTION for name, by in late.items())

    @property
    def explains(self) -> bool:
        """Whether the mix is near, and the measurements bound yield stress and angle."""
        return self.near and self.yield_value.bounded and self.friction_angle.bounded

    @property
    def command(self) -> str:
        """Command that computes the slump of the mix."""
        words = [f"--{name.replace('_', '-')} {short(value)}" for name, value in self.keywords.items()]
        return f"taichi-mps run slump {' '.join(words)}"

    @property
    def every(self) -> str:
        """Name of all measurements together, in a word or two."""
        return "both" if len(self.measured) == 2 else "all three"

    def told(self) -> str:
        """One sentence: whether the mix explains the measurements, and how far from them it is."""
        c, phi, eta = map(short, self.values.values())
        mix = f"{c} Pa and {phi} degrees at {eta} Pa s"
        if self.explains:
            return f"with internal friction one mix does {self.every}: {mix}"
        if self.near:
            return f"with internal friction {mix} does {self.every}, but its constants are not bounded"
        missed = " and ".join(f"the {NAMES[name]} by {apart(name, by)}" for name, by in self.missed.items())
        return f"with internal friction not {self.every}: the nearest, {mix}, misses {missed}"

    def __str__(self):
        if not self.explains:
            return self.told()
        lines = self.constant_lines()
        if self.usual:
            lines[-1] = lines[-1].replace("as given", "a usual value, not measured")
        others = [f"{short(c)} Pa and {short(phi)} degrees at {eta:g}" for eta, (c, phi) in self.by_viscosity.items()]
        lines += [f"  by plastic viscosity: {', '.join(others)} Pa s"] * bool(others)
        lines += [*self.measurement_lines(), f"{'to run it':18} {self.command}"]
        return "\n".join([f"{self.told()}:", *(f"  {line}" for line in lines)])


@dataclass(frozen=True, kw_only=True)
class Calibration(Mix):
    """Bingham mix found from its tests. ``by_viscosity`` holds the best yield stresses [Pa]."""

    # where no mix is near: of a constant what each measurement alone says, value and ends; with which other constant
    alone: dict[str, dict[str, tuple[float, float | None, float | None]]] = field(default_factory=dict)
    others: dict[str, float] = field(default_factory=dict)
    finer: dict[str, float] = field(default_factory=dict)  # the run that checked: finer minus table, ratio of times
    friction: FrictionalMix | None = None  # of slump, slump flow and T500, where it was sought
    lifted: dict[str, float] = field(default_factory=dict)  # what a lifted mould changes: likewise

    @property
    def explained_by_friction(self) -> bool:
        """Whether a mix with internal friction explains all that was measured."""
        return bool(self.friction and self.friction.explains and self.measured.keys() == self.friction.measured.keys())

    @property
    def at_the_edge(self) -> list[str]:
        """The constants that are bounded on one side only, with the best value at an end of the table: what lies beyond
        was not looked at."""
        open_ones = {name: it for name, it in self.constants.items() if not it.determined}
        return [name for name, it in open_ones.items() if it.bounded and not 1.01 * it.low < it.value < 0.99 * it.high]

    @property
    def fits(self) -> bool:
        """Whether the mix is within three standard errors of the measurements."""
        return self.misfit <= CONTRADICTION

    @property
    def contradictory(self) -> bool:
        """Whether no mix is near several measurements, or one and a rheometer's constant of which it speaks."""
        several = len(self.measured) > 1 or any(len(said) > 1 for said in self.alone.values())
        return several and not self.fits

    def nearest(self) -> str:
        """Sentence on the differences of the nearest mix from each measurement."""
        far = ", ".join(f"{NAMES[name]} {apart(name, by)}" for name, by in self.missed.items())
        return f"the nearest mix misses: {far}"

    @property
    def best(self) -> Mix:
        """The mix that explains the measurements, or comes nearest to them."""
        return self.friction if self.explained_by_friction else self

    def facts(self) -> dict:
        """All results, JSON-ready."""
        facts = super().facts() | {"contradictory": self.contradictory, "at_the_edge": self.at_the_edge}
        return facts | {"friction": self.friction and self.friction.facts(), "mix": self.best.values}

    def contradiction(self) -> str:
        """Sentence that no mix is near the measurements, with what each of them says alone and what to trust it for."""
        text = "no Bingham mix comes within three standard errors: the measurements contradict each other or the model"
        for constant, other in zip(BINGHAM, reversed(BINGHAM), strict=True):
            said = [
                f"the {NAMES.get(name, name)}{' alone' * (name in NAMES)} "
                f"says {Constant(*it, 0.0, 0.0, UNITS[constant]).bounds()}"
                for name, it in self.alone.get(constant, {}).items()
            ]
            text += f"; at {short(self.others[other])} {UNITS[other]} {', '.join(said)}" if said else ""
        if not {"slump_m", "spread_m"} <= self.alone.get("yield_value", {}).keys():
            return text
        return (
            f"{text}. Trust that of the slump for how high the concrete stands, that of "
            "the slump flow for how far it runs; no single Bingham mix does both"
        )

    def __str__(self):
        lines, pairs = self.constant_lines(), [f"{short(tau)} Pa at {eta:g}" for eta, tau in self.by_viscosity.items()]
        if pairs and not self.plastic_viscosity.determined:
            lines.append(f"  yield stress by plastic viscosity: {', '.join(pairs)} Pa s")
        lines += self.measurement_lines()
        for what, beside in (("the finer run     ", self.finer), ("the lifted mould  ", self.lifted)):
            apart = ", ".join(
                f"{NAMES[name]} " + (f"{100.0 * (by - 1.0):+.1f} %" if is_time(name) else f"{1e3 * by:+.1f} mm")
                for name, by in beside.items()
            )
            lines += [f"{what} {apart} beside the table; the constants are corrected by it"] * bool(beside)
        ends = ", ".join(f"{in_words(name)} {self.constants[name].ends()}" for name in self.at_the_edge)
        edge = f"the best fit lies at the edge of the table ({ends}): what is bounded is so within it only"
        lines = [edge] * bool(ends) + lines
        if self.friction:
            *first, last = [NAMES[name] for name in self.friction.measured]
            unused = [NAMES[name] for name in self.measured if name not in self.friction.measured]
            block = [str(self.friction)]
            block += [f"  of {', '.join(first)} and {last} alone, not of {' and '.join(unused)}"] * bool(unused)
            lines = [*block, "the nearest Bingham mix:", *lines] if self.contradictory else [*lines, *block]
        if not self.fits:
            lines.insert(
                0, self.contradiction() if self.contradictory else f"no mix of the table fits; {self.nearest()}"
            )
        return "\n".join(lines)
