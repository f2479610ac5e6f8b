"""What a run folder tells."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..problem.scene import Scene


@dataclass(frozen=True)
class Told:
    """A run as its folder has it."""

    path: Path  # of the folder
    scene: Scene
    source: str  # name or file of the scene's function
    every: float | None  # interval of the outputs [s], at which steps end, too; None of an earlier version
    summary: dict  # of a run that has not ended: scene, mixes, time and measures of its last row
    ended: bool
    history: dict[str, np.ndarray]  # columns of history.csv
