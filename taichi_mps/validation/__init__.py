"""The validation table: cases with an exact or independent answer, run and judged by ``taichi-mps validate``.

``cases.py`` is the table: each row names its case, its reference and the function that runs it, with its settings. A
function gives what it measured, each number beside its target. They stand by subject in ``flows.py`` (plane flows),
``curved.py``, ``slumps.py``, ``standing.py``, ``fluids.py``, ``vortices.py`` and ``measured.py``, and run scenes by
``scheme.py``; ``table.py`` runs the rows, each in a process of its own. Some targets were changed when the engine's
numbers were known (those of the Bingham cavity), and on what some rows measure constants were chosen (``CHOSEN_ON``):
they are calibration. Read cases.py first.
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

REFERENCE = Path(__file__).parent / "reference"
L2_ERROR, SLUMP_ERROR = "L2 error of the velocity [-]", "largest error of the slump [mm]"


@dataclass(frozen=True)
class Measured:
    """Measured number of a row: name, value and bound (both in ``unit``)."""

    quantity: str
    value: float
    target: float
    unit: str = "-"

    @property
    def met(self) -> bool:
        return bool(abs(self.value) <= self.target)  # never true for a nan


@dataclass(frozen=True)
class Row:
    """Case of the validation table."""

    name: str
    case: str  # what flows
    reference: str  # where the right answer comes from
    function: Callable  # of the settings: gives Measured, and dicts, which are points of viz.plots.convergence
    settings: dict = field(default_factory=dict)
    quick: bool = False  # belongs to --quick and to the default test suite


def read_reference(name: str) -> list[dict[str, str]]:
    """Rows of a reference CSV by column name; comment lines start with #."""
    with open(REFERENCE / name, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def columns(name: str, **wanted) -> dict[str, np.ndarray]:
    """Columns of a reference CSV as arrays, of the rows with these texts or numbers in some columns."""
    rows = [r for r in read_reference(name) if all(type(value)(r[key]) == value for key, value in wanted.items())]
    return {key: as_array([r[key] for r in rows]) for key in rows[0]}


def as_array(texts: list[str]) -> np.ndarray:
    """Numbers, or texts where one of them is no number; nan where there is nothing."""
    try:
        return np.array([float(text or "nan") for text in texts])
    except ValueError:
        return np.array(texts)
