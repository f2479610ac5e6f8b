"""Result of a calibration: the constants of a mix with intervals, and their formatting as text."""

from dataclasses import asdict, dataclass, field

import numpy as np

from ..input.labels import CONSTANT_UNITS, in_words

MAX_MISFIT = 9.0  # chi squared of three standard errors
NAMES = {
    "slump_m": "slump",
    "spread_m": "slump flow",
    "t500_s": "T500",
    "mini_cone_m": "mini-cone flow",
    "v_funnel_s": "V-funnel time",
}
RHEOMETER = "rheometer"  # source of a constant that is known
BINGHAM = "yield_value", "plastic_viscosity"  # the constants of a mix, in the order of the tables
FRICTIONAL = "yield_value", "friction_angle", "plastic_viscosity"  # constants of a mix with internal friction
# [m] within which a mix of the model explains a measurement; Kantro's cone is a fifth of the standard one
EXPLAINED_WITHIN = {"slump_m": 0.01, "spread_m": 0.02, "mini_cone_m": 0.004}
MIN_GAIN_TO_MENTION = 1.1  # growth of a constant's error without a measurement that is said to determine it


def is_time(name: str) -> bool:
    """Whether this is a measured time, which is fitted by its logarithm; a length is fitted as it is."""
    return name.endswith("_s")


def deviation(name: str, model, value):
    """Return the difference of model and measurement, in its unit; of times the measured one times the logarithm of
    the ratio."""
    return value * np.log(model / value) if is_time(name) else model - value


def rounded(value: float, figures: int = 3) -> str:
    """Format a number rounded to significant figures, without an exponent."""
    return f"{float(f'{value:.{figures}g}'):.12g}"


def signed(name: str, difference: float) -> str:
    """Format a difference of model and measurement with its sign and unit, lengths in mm."""
    return f"{difference:+.2g} s" if is_time(name) else f"{1e3 * difference:+.0f} mm"


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
        """Whether the measurements bound the constant on both sides."""
        return self.lower is not None and self.upper is not None

    @property
    def bounded(self) -> bool:
        """Whether the measurements bound the constant on at least one side."""
        return self.lower is not None or self.upper is not None

    def value_or_bound(self) -> str:
        """Format the value, or the bound where it has only one."""
        if self.determined:
            return f"{rounded(self.value)} {self.unit}"
        if not self.bounded:
            return "nothing"
        return f"at {'least' if self.lower else 'most'} {rounded(self.lower or self.upper)} {self.unit}"

    def describe(self) -> str:
        """Format the constant with its interval."""
        if self.low == self.high:
            return f"{rounded(self.value)} {self.unit}, as given"
        if self.determined:
            return f"{self.value_or_bound()}, 95 %: {rounded(self.lower)} to {rounded(self.upper)} {self.unit}"
        text = f"{self.value_or_bound()} (95 %), not determined further" if self.bounded else "not determined"
        return f"{text} by these measurements (looked for from {self.table_range()})"

    def table_range(self) -> str:
        """Format the range of the constant that the table covers."""
        return f"{rounded(self.low)} to {rounded(self.high)} {self.unit}"


@dataclass(frozen=True, kw_only=True)
class FittedConstants:
    """Constants that were fitted to measurements, and which measurement determines which of them."""

    constants: dict[str, Constant]
    # by measurement and constant: factor by which the constant's standard error would grow without the measurement
    worth: dict[str, dict[str, float]]

    @property
    def values(self) -> dict[str, float]:
        """The best values by name, SI units, an angle in degrees."""
        return {name: it.value for name, it in self.constants.items()}

    def constant_lines(self) -> list[str]:
        """Format the constants, a line each."""
        return [f"{in_words(name):18} {it.describe()}" for name, it in self.constants.items()]

    def determines(self, name: str) -> str:
        """Format which of the bounded constants a measurement determines."""
        gains = {constant: gain for constant, gain in self.worth[name].items() if gain >= MIN_GAIN_TO_MENTION}
        texts = []
        for constant in (it for it in gains if self.constants[it].bounded):
            others = [in_words(it) for it in gains if it != constant]
            once = f" if the {' and the '.join(others)} {'is' if len(others) == 1 else 'are'} known" if others else ""
            texts.append(f"the {in_words(constant)}{once} (without it {gains[constant]:.1f} times as uncertain)")
        return " and ".join(texts) or "neither constant alone"

    def facts(self) -> dict:
        """Return all results, JSON-ready."""
        return vars(self) | {
            "constants": {name: asdict(it) | {"determined": it.determined} for name, it in self.constants.items()},
            "told": str(self),
        }


@dataclass(frozen=True, kw_only=True)
class Mix(FittedConstants):
    """A mix whose constants were looked up in the tables of tests."""

    yield_value = property(lambda self: self.constants["yield_value"], doc="Yield stress, a Constant.")
    plastic_viscosity = property(lambda self: self.constants["plastic_viscosity"], doc="Plastic viscosity, a Constant.")
    density: float  # [kg/m3]
    measured: dict[str, tuple[float, float]]  # value and standard error, SI units
    errors: dict[str, float]  # standard errors, with those of the table
    model: dict[str, float]
    misfit: float  # chi squared
    by_viscosity: dict[float, object]  # other constants that fit, by plastic viscosity [Pa s]
    usual: bool = False  # whether the plastic viscosity is a default, neither given nor found

    def facts(self) -> dict:
        """Return all results, JSON-ready."""
        facts = super().facts()
        return facts | facts.pop("constants")

    @property
    def keywords(self) -> dict[str, float]:
        """Keywords of a scene with this mix."""
        return self.values | {"density": self.density}

    @property
    def missed(self) -> dict[str, float]:
        """Differences of the model from the measurements, SI units."""
        return {name: self.model[name] - value for name, (value, _) in self.measured.items()}

    @property
    def within_tolerance(self) -> bool:
        """Whether the model is within EXPLAINED_WITHIN of each length."""
        return all(abs(by) <= EXPLAINED_WITHIN[name] for name, by in self.missed.items() if name in EXPLAINED_WITHIN)

    def source(self, constant: str) -> str:
        """Return the main source of a constant: the measurement without which its error would grow most, RHEOMETER for
        a known constant, 'usual' for a default, '' for one without a bound."""
        value = self.constants[constant]
        if value.low == value.high:
            return "usual" if self.usual and constant == "plastic_viscosity" else RHEOMETER
        return NAMES[max(self.worth, key=lambda name: self.worth[name][constant])] if value.bounded else ""

    def measurement_lines(self) -> list[str]:
        """Format the measurements, a line each: value, model and what it determines."""
        lines = []
        for name, (value, error) in self.measured.items():
            factor, unit = (1.0, "s") if is_time(name) else (100.0, "cm")
            table_error = factor * np.sqrt(max(self.errors[name] ** 2 - error**2, 0.0))
            text = f"{NAMES[name]:18} {factor * value:.2f} +- {factor * error:.2f} {unit}"
            text += f", of the model {factor * self.model[name]:.2f} +- {table_error:.2f}"
            lines.append(text + (f"; determines {self.determines(name)}" if self.worth[name] else ""))
        return lines


@dataclass(frozen=True, kw_only=True)
class FrictionalMix(Mix):
    """The mix with internal friction, yield stress c + p tan(phi), that is nearest to slump, slump flow and, where it
    was measured, T500. The yield stress is c; ``by_viscosity`` holds c [Pa] and phi [degrees] of other mixes."""

    friction_angle = property(lambda self: self.constants["friction_angle"], doc="phi [degrees], a Constant.")

    @property
    def within_tolerance(self) -> bool:
        """Whether the mix is within EXPLAINED_WITHIN of both lengths, and within three standard errors of T500."""
        return super().within_tolerance and all(
            (deviation(name, self.model[name], value) / self.errors[name]) ** 2 <= MAX_MISFIT
            for name, (value, _) in self.measured.items()
            if name not in EXPLAINED_WITHIN
        )

    @property
    def explains(self) -> bool:
        """Whether the mix is within the tolerances and the measurements bound yield stress and angle."""
        return self.within_tolerance and self.yield_value.bounded and self.friction_angle.bounded

    @property
    def command(self) -> str:
        """Shell command that computes the slump of the mix."""
        words = [f"--{name.replace('_', '-')} {rounded(value)}" for name, value in self.keywords.items()]
        return f"taichi-mps run slump {' '.join(words)}"

    @property
    def all_measurements(self) -> str:
        """Words for all measurements together."""
        return "both" if len(self.measured) == 2 else "all three"

    def describe(self) -> str:
        """Format in one sentence whether the mix explains the measurements, and how far from them it is."""
        c, phi, eta = map(rounded, self.values.values())
        mix = f"{c} Pa and {phi} degrees at {eta} Pa s"
        if self.explains:
            return f"with internal friction one mix does {self.all_measurements}: {mix}"
        if self.within_tolerance:
            return f"with internal friction {mix} does {self.all_measurements}, but its constants have no limits"
        missed = " and ".join(f"the {NAMES[name]} by {signed(name, by)}" for name, by in self.missed.items())
        return f"with internal friction not {self.all_measurements}: the nearest, {mix}, misses {missed}"

    def __str__(self):
        if not self.explains:
            return self.describe()
        lines = self.constant_lines()
        if self.usual:
            lines[-1] = lines[-1].replace("as given", "a usual value, not measured")
        others = [f"{rounded(c)} Pa and {rounded(a)} degrees at {eta:g}" for eta, (c, a) in self.by_viscosity.items()]
        lines += [f"  by plastic viscosity: {', '.join(others)} Pa s"] if others else []
        lines += [*self.measurement_lines(), f"{'to run it':18} {self.command}"]
        return "\n".join([f"{self.describe()}:", *(f"  {line}" for line in lines)])


@dataclass(frozen=True, kw_only=True)
class Calibration(Mix):
    """Bingham mix found from its tests. ``by_viscosity`` holds the best yield stresses [Pa]."""

    # where no mix fits: by constant and measurement, value and interval by that alone; the other constants used then
    alone: dict[str, dict[str, tuple[float, float | None, float | None]]] = field(default_factory=dict)
    others: dict[str, float] = field(default_factory=dict)
    possible: dict[str, tuple[float, float]] = field(default_factory=dict)  # of each measurement, beside all others
    finer: dict[str, float] = field(default_factory=dict)  # finer run beside the table: differences, ratios of times
    friction: FrictionalMix | None = None  # by slump, slump flow and T500, where it was sought

    @property
    def explained_by_friction(self) -> bool:
        """Whether a mix with internal friction explains all that was measured."""
        return bool(self.friction and self.friction.explains and self.measured.keys() == self.friction.measured.keys())

    @property
    def at_the_edge(self) -> list[str]:
        """Names of constants bounded on one side only whose best value is at an end of the table, which hides better
        ones."""
        one_sided = {name: it for name, it in self.constants.items() if it.bounded and not it.determined}
        return [name for name, it in one_sided.items() if not 1.01 * it.low < it.value < 0.99 * it.high]

    @property
    def fits(self) -> bool:
        """Whether the mix is within three standard errors of the measurements."""
        return self.misfit <= MAX_MISFIT

    @property
    def contradictory(self) -> bool:
        """Whether no mix fits several measurements, or one measurement and a rheometer's constant."""
        return (len(self.measured) > 1 or any(len(fits) > 1 for fits in self.alone.values())) and not self.fits

    def nearest(self) -> str:
        """Format the differences of the nearest mix from each measurement."""
        return "the nearest mix misses: " + ", ".join(
            f"{NAMES[name]} {signed(name, by)}" for name, by in self.missed.items()
        )

    @property
    def best(self) -> Mix:
        """The mix that explains the measurements, or comes nearest to them."""
        return self.friction if self.explained_by_friction else self

    def facts(self) -> dict:
        """Return all results, JSON-ready."""
        facts = super().facts() | {"contradictory": self.contradictory, "at_the_edge": self.at_the_edge}
        return facts | {"friction": self.friction and self.friction.facts(), "mix": self.best.values}

    def contradiction(self) -> str:
        """Format that no mix fits the measurements, with what each alone says and what to trust it for."""
        text = "no Bingham mix comes within three standard errors: the measurements contradict each other or the model"
        text += ", or lie beyond the table" if self.at_the_edge else ""
        for name, ends in self.possible.items() if len(self.measured) > 1 else ():
            by = self.measured[name][0] - float(np.clip(self.measured[name][0], *ends))
            low, high = (f"{(1.0 if is_time(name) else 100.0) * end:.3g}" for end in ends)
            text += (
                f"; beside {'the other' if len(self.measured) == 2 else 'the others'} the {NAMES[name]} of a mix "
                f"is {low} to {high} {'s' if is_time(name) else 'cm'}, that measured is off by {signed(name, by)}"
            )
        for constant, other in zip(BINGHAM, reversed(BINGHAM), strict=True):
            readings = [
                f"the {NAMES.get(name, name)}{' alone' if name in NAMES else ''} "
                f"says {Constant(*it, 0.0, 0.0, CONSTANT_UNITS[constant]).value_or_bound()}"
                for name, it in self.alone.get(constant, {}).items()
            ]
            text += (
                f"; at {rounded(self.others[other])} {CONSTANT_UNITS[other]} {', '.join(readings)}" if readings else ""
            )
        trust = (
            ". Trust that of the slump for how high the concrete stands, that of the slump flow for how far it runs; "
            "no single Bingham mix does both"
        )
        return text + trust * ({"slump_m", "spread_m"} <= self.alone.get("yield_value", {}).keys())

    def __str__(self):
        lines = self.constant_lines()
        pairs = [f"{rounded(tau)} Pa at {eta:g}" for eta, tau in self.by_viscosity.items()]
        if pairs and not self.plastic_viscosity.determined:
            lines.append(f"  yield stress by plastic viscosity: {', '.join(pairs)} Pa s")
        lines += self.measurement_lines()
        differences = ", ".join(
            f"{NAMES[name]} " + (f"{100.0 * (by - 1.0):+.1f} %" if is_time(name) else f"{1e3 * by:+.1f} mm")
            for name, by in self.finer.items()
        )
        if self.fits:
            lines.append("with grains        'taichi-mps mortar' tells the constants of the mortar between them")
        if self.finer:
            lines.append(f"the finer run      {differences} beside the table; the constants are corrected by it")
        ends = ", ".join(f"{in_words(name)} {self.constants[name].table_range()}" for name in self.at_the_edge)
        edge = f"the best fit lies at the edge of the table ({ends}): limits hold within it only"
        lines = ([edge] if ends else []) + lines
        if self.friction:
            *first, last = [NAMES[name] for name in self.friction.measured]
            unused = [NAMES[name] for name in self.measured if name not in self.friction.measured]
            alone = f"  of {', '.join(first)} and {last} alone, not of {' and '.join(unused)}"
            block = [str(self.friction), alone] if unused else [str(self.friction)]
            lines = [*block, "the nearest Bingham mix:", *lines] if self.contradictory else [*lines, *block]
        if not self.fits:
            lines.insert(
                0, self.contradiction() if self.contradictory else f"no mix of the table fits; {self.nearest()}"
            )
        return "\n".join(lines)
