"""Quantities that change in time: gravity, and the velocity of a wall. Plain NumPy."""

from functools import cached_property, partial
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from ...units import INSTANT, Size, Time, array_of, real, require, validated, vector

ROWS_PER_VIBRATION = 24  # of the table that ``vibration`` returns


def table_of_time(unit):
    """Annotate a table of time whose values have this unit, as ``table`` reads it."""
    return Annotated[Any, BeforeValidator(partial(table, unit))]


def table(unit, value):
    """Return a table of times [s] and values (k, 1 + d) as tuples; ValueError for anything else.

    Times must not fall; a time given twice is a jump. Values are linear between the rows, and constant before the first
    and after the last one.
    """
    rows = array_of(value)
    if rows.ndim != 2 or rows.shape[1] < 2 or not len(rows) or not np.all(np.isfinite(rows)):
        raise ValueError(f"must be rows of a time [s] and values [{unit}]")
    if np.any(np.diff(rows[:, 0]) < 0.0) or np.any(rows[2:, 0] == rows[:-2, 0]):
        raise ValueError("must have times [s] that grow, each twice at most, where the value jumps")
    return tuple(map(tuple, rows.tolist()))


class TimeDependent:
    """Quantity of ``d`` components given by a table of time; ``key`` and ``unit`` name it in messages."""

    def __init__(self, table, key: str, unit: str, d: int):
        rows = np.array(table)
        require(
            rows.shape[1] == 1 + d,
            f"{key}: rows of {rows.shape[1]} numbers: must have a time [s] and {d} values [{unit}]",
        )
        self.rows, self.values = rows, rows[:, 1:]
        self.times = tuple(np.unique(rows[:, 0]).tolist())  # where steps end [s]
        self.last = self.times[-1]  # time of the last change [s]

    @property
    def largest(self) -> np.ndarray:
        """Value (d,) of the largest norm."""
        return self.values[np.argmax((self.values**2).sum(1))]

    def at(self, time: float) -> np.ndarray:
        """Value (d,) at a time [s], where it does not jump."""
        return np.array([np.interp(time, self.rows[:, 0], column) for column in self.values.T])

    def changes(self, time: float) -> bool:
        """Whether the quantity jumps at a time [s] or changes from then on."""
        return bool(np.any(self.at(time - INSTANT) != self.at(time + INSTANT)))

    def integral(self, start: float, end: float) -> np.ndarray:
        """Integral (d,) from a time to a later one [s], exact."""
        knots = [start, *(time for time in self.times if start < time < end), end]
        return sum((b - a) * self.at(0.5 * (a + b)) for a, b in pairwise(knots))


class Moving:
    """Base class of walls whose ``velocity`` may change in time; ``travel`` is the largest velocity at which the wall
    changes its position."""

    @cached_property
    def in_time(self) -> TimeDependent | None:
        """Velocity as a function of time, of ``components`` components; None if it is constant."""
        return (
            TimeDependent(self.velocity, "velocity of a wall", "m/s", self.components)
            if np.ndim(self.velocity) == 2
            else None
        )

    @property
    def components(self) -> int:
        """Number of components of the velocity."""
        return len(self.point)

    @property
    def unit_axis(self) -> np.ndarray:
        """Unit vector along the axis, shape (d,); zero where there is none."""
        axis = np.zeros(len(self.point)) if self.axis is None else np.array(self.axis, float)
        return axis / (np.linalg.norm(axis) or 1.0)

    def _as_vector(self, velocity) -> np.ndarray:
        """Convert the given components of a velocity to a vector (d,) [m/s]; zero if none are given."""
        return np.zeros(len(self.point)) if velocity is None else np.array(velocity, float)

    @property
    def fastest(self) -> np.ndarray:
        """Largest velocity of translation in time [m/s], shape (d,)."""
        return self._as_vector(self.velocity if self.in_time is None else self.in_time.largest)

    def displacement(self, time) -> np.ndarray:
        """Displacement of the wall since 0 s [m], shape (d,)."""
        if self.in_time is None or not np.any(self.travel):
            return time * self.travel
        return self._as_vector(self.in_time.integral(0.0, time))

    def mean_velocity(self, start, end) -> np.ndarray:
        """Mean velocity of translation between two times [s], in m/s, shape (d,)."""
        return (
            self.fastest if self.in_time is None else self._as_vector(self.in_time.integral(start, end)) / (end - start)
        )

    def speed_at(self, time) -> float:
        """Largest speed of the wall from a time [s] on [m/s]; 0 after its velocity has become zero for good."""
        stopped = self.in_time is not None and time >= self.in_time.last and not np.any(self.in_time.values[-1])
        return 0.0 if stopped and not getattr(self, "angular_velocity", 0.0) else self.speed


@validated
def vibration(
    frequency: real("1/s", gt=0.0, le=1e4),
    amplitude: Size,
    direction: vector(""),
    end: Time,
    start: Time = 0.0,
    gravity: vector("m/s2") | None = None,
) -> tuple[tuple[float, ...], ...]:
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
    at_rest = np.array(gravity or (0.0,) * (len(along) - 1) + (-9.81,))
    vibrations = np.arange(ROWS_PER_VIBRATION * max(1, round((end - start) * frequency)) + 1) / ROWS_PER_VIBRATION
    times = [start, *(start + vibrations / frequency), start + vibrations[-1] / frequency]
    vibrating = at_rest - peak * np.cos(2.0 * np.pi * vibrations)[:, None] * along
    return tuple(map(tuple, np.column_stack([times, np.vstack([at_rest, vibrating, at_rest])]).tolist()))
