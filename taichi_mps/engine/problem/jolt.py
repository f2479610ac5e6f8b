"""Jolt: the sudden stop of the support of the concrete, such as a flow table. Plain NumPy."""

from dataclasses import dataclass

import numpy as np

from ...units import INSTANT, Time, points, real, require, validated, vector
from ..geometry.walls import spin


@validated
@dataclass(frozen=True)
class Jolt:
    """Instantaneous jump of the velocity of all fluid relative to the walls.

    Parameters
    ----------
    time : float
        Time of the jump [s].
    velocity : tuple of float, length d
        Jump of the velocity [m/s]; with a rotation, that of the pivot.
    angular_velocity : float, optional
        Jump of the angular velocity about the axis through ``pivot`` [rad/s], in two dimensions counter-clockwise.
    pivot : tuple of float, length d, optional
        Point of the axis [m], the origin by default.
    axis : tuple of float, length 3, optional
        Direction of the axis [-]; None in two dimensions.

    Raises
    ------
    SceneError
        If the vectors differ in length, or a rotation has no axis in three dimensions or one in two.

    Notes
    -----
    A jolt is computed in the frame of the walls, as a gravity that acts during one step: the first step after it gives
    the fluid its velocity after the shock, before anything has moved (eq I13).

    Examples
    --------
    >>> import taichi_mps as mps
    >>> fall = mps.Jolt(time=1.0, velocity=(0.0, 0.0), angular_velocity=-2.0)  # of a table hinged at the origin
    >>> fall.jump([[0.35, 0.1]]).round(3).tolist()
    [[0.2, -0.7]]
    """

    time: Time
    velocity: vector("m/s")
    angular_velocity: real("rad/s", ge=-1e3, le=1e3) = 0.0
    pivot: vector("m") | None = None
    axis: vector("") | None = None

    def __post_init__(self):
        d = len(self.velocity)
        require(d == 3 or self.axis is None, f"jolt: axis = {self.axis}: must be left out in two dimensions")
        for key, value in {"pivot": self.pivot, "axis": self.axis}.items():
            require(value is None or len(value) == d, f"jolt: {key} = {value}: must have {d} numbers, as velocity has")
        has_axis = d == 2 or (self.axis is not None and np.any(self.axis))
        require(
            has_axis or not self.angular_velocity,
            f"jolt: angular_velocity = {self.angular_velocity:g} rad/s: needs an axis in three dimensions",
        )

    @property
    def spin(self) -> np.ndarray:
        """Gradient of the jump [1/s], shape (d, d)."""
        axis = np.array(self.axis or (0.0, 0.0, 0.0))
        return spin(self.angular_velocity, axis / (np.linalg.norm(axis) or 1.0), len(self.velocity))

    @property
    def at_origin(self) -> np.ndarray:
        """Jump at the origin [m/s], shape (d,)."""
        return np.array(self.velocity) - self.spin @ np.array(self.pivot or (0.0,) * len(self.velocity))

    @validated
    def jump(self, x: points("m")) -> np.ndarray:
        """Return the jump of the velocity at given positions.

        Parameters
        ----------
        x : array_like, shape (n, d)
            Positions [m].

        Returns
        -------
        ndarray, shape (n, d)
            Velocity [m/s].
        """
        return self.at_origin + x @ self.spin.T

    @property
    def times(self) -> tuple[float]:
        """Times at which a step must end [s]: that of the jolt."""
        return (self.time,)

    @property
    def last(self) -> float:
        """Time of the last change [s]."""
        return self.time

    def changes(self, time: float) -> bool:
        """Return whether the jolt happens at a time.

        Parameters
        ----------
        time : float
            Time [s].

        Returns
        -------
        bool
            True if it does.
        """
        return abs(time - self.time) < INSTANT
