"""Model and spacing for a wanted accuracy of slump and reach, from what benchmarks/models.py has measured."""

import json
from dataclasses import dataclass
from pathlib import Path

from ..units import SceneError

MEASURED = Path(__file__).parent / "accuracy.json"
COARSEST = 0.1  # [m]; what is asked for beyond is millimetres
MOST_VOLUME_ERROR = 0.02  # at any time [-], beyond which a result is doubted
MOST_VOLUME = 0.01  # largest volume error of what is chosen [-]: a coarse cone may have the right slump by luck
YIELD_VALUES, PLASTIC_VISCOSITY = (100.0, 1000.0), 50.0  # where the errors were measured [Pa, Pa s], standard cone
RANGE = "{:g} to {:g} Pa, {:g} Pa s, standard cone".format(*YIELD_VALUES, PLASTIC_VISCOSITY)


@dataclass(frozen=True)
class Choice:
    """What was chosen and what it was found to do."""

    model: str
    spacing: float  # [m]
    error: float  # largest error of the slump at any time, and of half of the spread at rest [m], over RANGE
    volume_error: float  # largest at any time [-], over RANGE
    cpu_seconds: float  # to rest, without compiling, mean over RANGE

    def __str__(self):
        return (
            f"model = {self.model}, spacing = {1e3 * self.spacing:g} mm, scheme = implicit: slump and reach within "
            f"{1e3 * self.error:.1f} mm in {self.cpu_seconds:.2g} CPU-seconds and some to compile, measured for {RANGE}"
        )


def measured() -> list[Choice]:
    """Every model and spacing that was measured, the cheapest first."""
    found = [Choice(**row) for row in json.loads(MEASURED.read_text(encoding="utf-8"))]
    return sorted(found, key=lambda choice: choice.cpu_seconds)


def choose(accuracy: float, model: str | None = None, spacing: float | None = None) -> Choice:
    """The cheapest whose slump and reach were never more than ``accuracy`` [m] from the reference, and whose volume was
    kept within 1 %; a model or a spacing [m] that is given stays as it is. SceneError where nothing measured is that
    good."""
    if not accuracy <= COARSEST:
        raise SceneError(f"accuracy = {accuracy:g} m: must be at most {COARSEST:g} m (0.005 or 5mm for 5 mm)")
    fitting = [
        c for c in measured() if model in (None, c.model) and (spacing is None or abs(c.spacing - spacing) < 1e-9)
    ]
    keeping = [choice for choice in fitting if choice.volume_error <= MOST_VOLUME]
    for choice in keeping:
        if choice.error <= accuracy:
            return choice
    given = ", ".join(
        f"{key} = {value}" for key, value in (("model", model), ("spacing", spacing)) if value is not None
    )
    best = min(keeping, key=lambda choice: choice.error, default=None)
    allowed = f"must be at least {best.error:g} m, which is {best}" if best else "nothing was measured there"
    if fitting and not keeping:
        allowed += f" that keeps the volume within {100.0 * MOST_VOLUME:g} %"
    raise SceneError(f"accuracy = {accuracy:g} m{' with ' * bool(given)}{given}: {allowed}")
