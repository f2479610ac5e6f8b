"""Quantities that change in time: gravity, and the velocity of a wall. Plain NumPy."""

from functools import cached_property, partial
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from ..units import INSTANT, Size, Time, answer, array_of, real, require, said, validated, vector

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
PANEL = 0.01  # of a function's integral [s]: 8 nodes are exact to 1e-6 up to 150 Hz
# Where the largest value of a function is sought: as many times, none a multiple of another, in the first seconds
ROWS = 24  # of a vibration
SOUGHT, FIRST, GOLDEN = 10_000, 100.0, 0.5 * (5.0**0.5 - 1.0)


def in_time(unit):
    """Annotate a table or a function of time whose values have this unit, as ``table_or_function`` reads it."""
    return Annotated[Any, BeforeValidator(partial(table_or_function, unit))]


def table_or_function(unit, value):
    """Table (k, 1 + d) of times [s], which do not fall, and values in a unit, as tuples, or a function of the time;
    ValueError for anything else.

    A time that is there twice is a jump. Values are linear between the rows, and stay before the first and after the
    last one.
    """
    if callable(value):
        return value
    rows = array_of(value)
    if rows.ndim != 2 or rows.shape[1] < 2 or not len(rows) or not np.all(np.isfinite(rows)):
        raise ValueError(f"must be rows of a time [s] and values [{unit}], or a function of the time")
    if np.any(np.diff(rows[:, 0]) < 0.0) or np.any(rows[2:, 0] == rows[:-2, 0]):
        raise ValueError("must have times [s] that grow, each twice at most, where the value jumps")
    return tuple(map(tuple, rows.tolist()))


class InTime:
    """A quantity of ``d`` components that changes in time, as ``in_time`` reads it; ``key`` and ``unit`` name it in
    messages."""

    def __init__(self, given, key: str, unit: str, d: int):
        self.key, self.wanted = key, f"must give {d} finite numbers [{unit}]"
        self.function, self.rows = (given, None) if callable(given) else (None, np.array(given))
        self.d, self.until_panel = d, [np.zeros(d)]  # integrals of a function from 0 s to the end of each panel
        columns = 1 + d if self.rows is None else self.rows.shape[1]
        require(columns == 1 + d, f"{key}: rows of {columns} numbers: must have a time [s] and {d} values [{unit}]")
        self.times = () if self.rows is None else tuple(np.unique(self.rows[:, 0]).tolist())  # where steps end [s]
        self.last = self.times[-1] if self.times else np.inf  # time of the last change [s]
        sought = FIRST * (GOLDEN * np.arange(SOUGHT) % 1.0)
        self.values = self.rows[:, 1:] if self.function is None else np.array([self.at(time) for time in sought])

    @property
    def largest(self) -> np.ndarray:
        """Value (d,) of the largest norm; of a function, among 10,000 times in the first 100 s."""
        return self.values[np.argmax((self.values**2).sum(1))]

    def at(self, time: float) -> np.ndarray:
        """Value (d,) at a time [s], where it does not jump."""
        if self.function is None:
            return np.array([np.interp(time, self.rows[:, 0], column) for column in self.rows[:, 1:].T])
        value = answer(self.key, self.function, time)
        require(
            value.shape == (self.d,) and np.all(np.isfinite(value)),
            f"{self.key} = {said(self.function, '')}: gives {said(value, '')} at {time:g} s; {self.wanted}",
        )
        return value

    def changes(self, time: float) -> bool:
        """Whether the quantity jumps at a time [s] or changes from then on; a function always does."""
        return self.function is not None or bool(np.any(self.at(time - INSTANT) != self.at(time + INSTANT)))

    def integral(self, start: float, end: float) -> np.ndarray:
        """Integral (d,) from a time to a later one [s]: exact of a table."""
        if self.function is None:
            knots = [start, *(time for time in self.times if start < time < end), end]
            return sum((b - a) * self.at(0.5 * (a + b)) for a, b in pairwise(knots))
        if end - start > 1.001 * PANEL:
            return self.since_0(end) - self.since_0(start)
        middle, half = 0.5 * (start + end), 0.5 * (end - start)
        return half * sum(w * self.at(middle + half * node) for node, w in zip(NODES, WEIGHTS, strict=True))

    def since_0(self, time: float) -> np.ndarray:
        """Integral (d,) of a function from 0 s, panel by panel."""
        panels = int(time / PANEL)
        for k in range(len(self.until_panel) - 1, panels):
            self.until_panel.append(self.until_panel[-1] + self.integral(k * PANEL, (k + 1) * PANEL))
        return self.until_panel[panels] + self.integral(panels * PANEL, time)


class Moving:
    """A wall whose ``velocity`` may change in time; ``travel`` is its largest velocity of a change of place."""

    @cached_property
    def in_time(self) -> InTime | None:
        """Velocity in time, of as many components as are given at once; None of a constant one."""
        constant = self.velocity is None or not (callable(self.velocity) or np.ndim(self.velocity) == 2)
        return None if constant else InTime(self.velocity, "velocity of a wall", "m/s", self.components)

    @property
    def components(self) -> int:
        """Number of components of the velocity."""
        return len(self.point)

    @property
    def unit_axis(self) -> np.ndarray:
        """Unit vector along the axis, shape (d,); zero where there is none."""
        axis = np.zeros(len(self.point)) if self.axis is None else np.array(self.axis, float)
        return axis / (np.linalg.norm(axis) or 1.0)

    def _directed(self, velocity) -> np.ndarray:
        """Velocity (d,) [m/s] in the scene of the given components; zero where none are given."""
        return np.zeros(len(self.point)) if velocity is None else np.array(velocity, float)

    @property
    def fastest(self) -> np.ndarray:
        """Velocity [m/s], shape (d,), without rotation; of one that changes in time the largest."""
        return self._directed(self.velocity if self.in_time is None else self.in_time.largest)

    def displacement(self, time) -> np.ndarray:
        """Displacement of the wall since 0 s [m], shape (d,)."""
        if self.in_time is None or not np.any(self.travel):
            return time * self.travel
        return self._directed(self.in_time.integral(0.0, time))

    def mean_velocity(self, start, end) -> np.ndarray:
        """Velocity [m/s] between two times [s], shape (d,), without rotation."""
        return (
            self.fastest if self.in_time is None else self._directed(self.in_time.integral(start, end)) / (end - start)
        )

    def speed_at(self, time) -> float:
        """Largest speed of the wall from a time [s] on [m/s]; 0 once it has stopped for good."""
        stopped = self.in_time is not None and time >= self.in_time.last and not np.any(self.in_time.values[-1])
        return 0.0 if stopped and not getattr(self, "angular_velocity", 0.0) else self.speed

    def travels_at(self, time) -> bool:
        """Whether the wall changes its place at a time [s] or later."""
        return bool(np.any(self.travel)) and self.speed_at(time) > 0.0


@validated
def vibration(
    frequency: real("1/s", gt=0.0, le=1e4),
    amplitude: Size,
    direction: vector(""),
    end: Time,
    start: Time = 0.0,
    gravity: vector("m/s2") | None = None,
):
    """Return gravity in the frame of a form or a table that vibrates.

    Parameters
    ----------
    frequency : float
        Vibrations per second [1/s].
    amplitude : float
        Half of the way between the ends [m].
    direction : tuple of float, length d
        Direction [-], of any length.
    end : float
        Time until which it vibrates [s], to whole vibrations.
    start : float, optional
        Time from which on it does [s].
    gravity : tuple of float, length d, optional
        Gravity otherwise [m/s2], 9.81 down the last axis by default.

    Returns
    -------
    tuple of tuple, length 1 + d
        Rows of a time [s] and a gravity [m/s2] for ``Scene.gravity``.

    Notes
    -----
    The form moves as A (1 - cos(w t)) from rest to rest, so in its frame gravity is g - A w^2 cos(w t). There are 24
    rows to a vibration, at each of which a step ends: a frequency of 50 1/s takes 1,200 steps a second.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> rows = mps.vibration(5.0, 0.002, (1.0, 0.0, 0.0), end=1.0)
    >>> len(rows), rows[0][1]
    (123, 0.0)
    """
    require(
        np.any(direction) and start < end,
        f"vibration: direction = {direction}, start = {start:g} s, end = {end:g} s: "
        "must have a direction, and end later than it starts",
    )
    along, peak = np.array(direction) / np.linalg.norm(direction), amplitude * (2.0 * np.pi * frequency) ** 2
    usual = np.array(gravity or (0.0,) * (len(along) - 1) + (-9.81,))
    turns = np.arange(ROWS * max(1, round((end - start) * frequency)) + 1) / ROWS
    times = [start, *(start + turns / frequency), start + turns[-1] / frequency]
    shaken = usual - peak * np.cos(2.0 * np.pi * turns)[:, None] * along
    return tuple(map(tuple, np.column_stack([times, np.vstack([usual, shaken, usual])]).tolist()))
