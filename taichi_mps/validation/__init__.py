"""The validation table: cases with an exact or independent answer, run and judged by ``taichi-mps validate``.

A row is a function that runs one case and yields what it measured, each beside its target. Rows stand in ``flows.py``,
``curved.py``, ``slumps.py``, ``standing.py``, ``fluids.py``, ``vortices.py`` and ``rational.py``, and make their
simulations by ``scheme.simulate``. ``table.py`` runs them, each in a process of its own. No target is set here that
was taken from what the engine does. Read flows.py first.
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

REFERENCE = Path(__file__).parent / "reference"
ROWS: dict[str, "Row"] = {}
L2_ERROR, SLUMP_ERROR = "L2 error of the velocity [-]", "largest error of the slump [mm]"


@dataclass(frozen=True)
class Measured:
    """One number of a row: what it is, its value, and what it must not exceed (both in ``unit``)."""

    quantity: str
    value: float
    target: float
    unit: str = "-"

    @property
    def met(self) -> bool:
        return bool(abs(self.value) <= self.target)  # never true for a nan


@dataclass(frozen=True)
class Series:
    """Points of a curve of the convergence chart, at one spacing or more: L2_ERROR against particles across, or
    SLUMP_ERROR against the spacing [mm]."""

    quantity: str
    curve: str
    x: tuple[float, ...]
    y: tuple[float, ...]


@dataclass(frozen=True)
class Row:
    """One case of the table."""

    name: str
    case: str  # what flows
    reference: str  # where the right answer comes from
    quick: bool  # belongs to --quick and to the test suite
    run: Callable  # yields Measured, and Series


def row(case: str, reference: str, quick: bool = False, name: str | None = None):
    """Register a generator of Measured and Series as a row named like the function, or ``name``."""

    def register(function):
        known = name or function.__name__
        ROWS[known] = Row(known, case, reference, quick, function)
        return function

    return register


def read_reference(name: str) -> list[dict[str, str]]:
    """Rows of a reference CSV by column name; comment lines start with #."""
    with open(REFERENCE / name, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))
