"""What measured curves say of a law: its constants with intervals, its flow curve, and what is determined."""

from dataclasses import dataclass

import numpy as np

from ..problem.labels import in_words, title
from ..problem.materials import Material
from ..units import unit_of
from .calibration import TOLD, Constant, short

RATES = np.geomspace(0.1, 1000.0, 81)  # of a flow curve [1/s]


@dataclass(frozen=True, kw_only=True)
class CurveFit:
    """What measured curves say of a law: constants with intervals, and the curves of the model beside them."""

    scene: str
    material: Material  # with the constants found
    constants: dict[str, Constant]
    offsets: dict[str, tuple[float, float]]  # time of the scene at the zero of a curve, half of its 95 % interval [s]
    spread: np.ndarray  # covariance of the logarithms of the constants, times the square of a 95 % quantile
    curves: list[dict]  # name, settings, measure, times [s], measured and model, SI units
    worth: dict[str, dict[str, float]]  # by which factor a constant would be less certain without a curve
    runs: int
    cpu_seconds: float

    @property
    def missed(self) -> dict[str, float]:
        """Root mean square of model less measured over the largest measured value, by measure [-]."""
        found = {}
        for name in {each["measure"]: None for each in self.curves}:
            pairs = [(each["model"], each["measured"]) for each in self.curves if each["measure"] == name]
            model, measured = (np.concatenate(values) for values in zip(*pairs, strict=True))
            found[name] = float(np.sqrt(np.nanmean((model - measured) ** 2)) / (np.nanmax(np.abs(measured)) or 1.0))
        return found

    def flow_curve(self, rates=RATES) -> tuple[np.ndarray, np.ndarray]:
        """Shear stresses [Pa] at shear rates [1/s], and by which factor they may be off, 95 %."""

        def stress(**changed):
            law = self.material.model_copy(update=changed)
            return np.array([law.shear_stress(float(rate), 0.0) for rate in rates])

        slopes = []
        for name, it in self.constants.items():
            up, down = (np.log(stress(**{name: it.value * np.exp(by)})) for by in (0.01, -0.01))
            slopes.append((up - down) / 0.02)
        return stress(), np.exp(np.sqrt(np.einsum("ik,ij,jk->k", slopes, self.spread, slopes)))

    def determined(self) -> str:
        """What the curves determine and what not, in sentences."""
        wide = {name: float(np.sqrt(self.spread[k, k])) for k, name in enumerate(self.constants)}
        known = [f"{in_words(name)} to {percent(wide[name])}" for name, it in self.constants.items() if it.determined]
        others = [in_words(name) for name, it in self.constants.items() if not it.determined]
        stress, factor = self.flow_curve()
        best = int(np.argmin(factor))
        told = [f"The curves determine the {' and the '.join(known)}."] * bool(known)
        told += [f"They do not determine the {' and the '.join(others)}."] * bool(others)
        at, error = f"{RATES[best]:.2g} 1/s, {short(stress[best])} Pa", percent(np.log(factor[best]))
        return " ".join([*told, f"The shear stress is known best at {at}, to {error}."])

    def facts(self) -> dict:
        """Everything, JSON-ready."""
        stress, factor = self.flow_curve()
        facts = vars(self) | {"material": self.material.facts(), "missed": self.missed, "told": str(self)}
        facts["constants"] = {name: vars(it) | {"determined": it.determined} for name, it in self.constants.items()}
        facts["spread"] = self.spread.tolist()
        flow = {"shear_rate_1_s": RATES, "shear_stress_Pa": stress, "factor": factor}
        return facts | {"flow_curve": {name: values.tolist() for name, values in flow.items()}}

    def __str__(self):
        fields, found = type(self.material).model_fields, self.offsets.items()
        lines = [f"{in_words(name):18} {it.told(unit_of(fields[name]))}" for name, it in self.constants.items()]
        lines += [f"{'time offset':18} {1e3 * at:+.0f} +- {1e3 * by:.0f} ms: {name}" for name, (at, by) in found]
        lines += [f"{title(name):18} missed by {by:.2%} (root mean square)" for name, by in self.missed.items()]
        for name, of in self.worth.items():
            needed = [f"the {in_words(it)} {by:.1f} times" for it, by in of.items() if by > TOLD]
            lines += [f"without {name}: {', '.join(needed)} as uncertain"] * bool(needed)
        return "\n".join([*lines, self.determined(), f"{self.runs} runs, {self.cpu_seconds:.0f} s of processor time"])


def percent(logarithm: float) -> str:
    """By how much a constant is uncertain: in percent, or as a factor."""
    return f"{100.0 * np.expm1(logarithm):.2g} %" if logarithm < 0.6 else f"a factor of {np.exp(logarithm):.2g}"
