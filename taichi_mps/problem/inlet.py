"""Inlet: a hose or chute from which concrete enters, layer of particles by layer. Plain NumPy."""

from dataclasses import dataclass, replace

import numpy as np

from ..units import check_vectors, finite, given, positive, require, said
from .materials import LAWS, Material

MOST_ACROSS = 1000  # spacings of a radius: three million particles a layer
FASTEST = 100.0  # speed [m/s] in a hose, three times that of sprayed concrete
ROOM = 0.6  # distance from what is there in spacings below which a layer cannot enter


@dataclass(frozen=True)
class Inlet:
    """Mouth of a round hose (a slot in 2-D) around ``centre``, from which concrete comes along ``direction`` at a
    ``rate`` from the time ``start`` on until the ``volume`` is in; in 2-D both are per metre of depth. With
    a ``height`` the mouth is a rectangle, 2 ``radius`` wide and as high along the most upright direction across.

    Particles enter in layers of a lattice across the hose, a spacing apart: a layer begins to leave when its front is
    on the mouth. The speed follows from the rate and the area of a layer, so the rate is met whatever the spacing.
    Below the mouth they move as the fluid does. A mouth that is buried holds the next layer back until there is room.

    A nozzle that moves has a ``path``: rows of a time [s] and the displacement of the mouth from ``centre`` [m] then,
    straight and steady in between, at rest before the first and after the last. What leaves it moves with it, too.
    """

    centre: tuple[float, ...]  # [m]
    direction: tuple[float, ...]
    radius: float  # half of the width in 2-D [m]
    rate: float  # [m3/s]
    volume: float  # [m3]
    start: float = 0.0  # [s]
    material: Material | None = None  # the mix; that of the scene by default
    path: tuple[tuple[float, ...], ...] | None = None  # (time [s], displacement [m] ...), (k, 1 + d)
    height: float | None = None  # of a rectangular mouth, in 3-D [m]

    def __post_init__(self):
        check_vectors(self, "an inlet", {"centre": "m", "direction": ""})
        material = self.material is None or isinstance(self.material, Material)
        require(material, f"inlet: material = {said(self.material, '')}: must be {LAWS}")
        for key, unit, value in given(self, {"radius": "m", "rate": "m3/s", "volume": "m3", "height": "m"}):
            positive(f"inlet: {key}", value, unit)
        d = len(self.centre)
        require(np.any(self.direction), f"inlet: direction = {self.direction}: must have {d} numbers, not all zero")
        require(d == 3 or self.height is None, f"inlet: height = {self.height} m: must be left out in 2-D")
        require(
            finite("inlet: start", self.start, "s", ()) >= 0.0, f"inlet: start = {self.start} s: must be at least 0 s"
        )
        if self.path is not None:
            path = finite("inlet: path", self.path, "s and m", dimensions=2)
            sound = path.shape[1] == 1 + d and len(path) >= 2 and np.all(np.diff(path[:, 0]) > 0.0)
            require(
                sound,
                f"inlet: path of shape {path.shape}: must be two rows or more of a time [s], which grows, and {d} "
                "displacements [m]",
            )
            object.__setattr__(self, "path", tuple(map(tuple, path.tolist())))

    def within(self, time: float) -> "Inlet":
        """The inlet with all numbers of its mix, for a run of this time [s]."""
        return self if self.material is None else replace(self, material=self.material.within(time))

    @property
    def unit_direction(self) -> np.ndarray:
        """Direction (d,) of the hose, of length 1."""
        return np.array(self.direction, float) / np.linalg.norm(self.direction)

    def layer(self, spacing: float) -> np.ndarray:
        """Places (m, d) [m] of a layer of particles that begins to leave; an edge of their lattice is on the axis."""
        radius, height = f"inlet: radius = {self.radius:g} m", f"inlet: height = {self.height} m"
        least = spacing * (1.0 - 1e-9)
        require(self.radius >= 1.5 * least, f"{radius}: must be at least 1.5 spacings, {1.5 * spacing:g} m")
        most = MOST_ACROSS * spacing
        require(self.radius <= most, f"{radius}: must be at most {MOST_ACROSS} spacings of {spacing:g} m")
        across_its_height = self.height is None or least <= self.height <= most
        require(across_its_height, f"{height}: must be 1 to {MOST_ACROSS} spacings of {spacing:g} m")
        along, across = self.unit_direction, []
        axes = np.eye(len(along))[np.argsort(np.abs(along), kind="stable")[:-1]]  # those most square to the hose
        if self.height is not None and np.hypot(along[0], along[1]) > 1e-9:  # level, and upright
            axes = np.stack([np.cross(along, (0.0, 0.0, 1.0)), (0.0, 0.0, 1.0)])
        for axis in axes:
            for other in (along, *across):
                axis = axis - (axis @ other) * other
            across.append(axis / np.linalg.norm(axis))
        count = int(np.ceil(self.radius / spacing))
        ticks = [spacing * (np.arange(-count, count) + 0.5)] * len(across)
        if self.height is not None:
            rows = max(1, round(self.height / spacing))
            ticks = [ticks[0][np.abs(ticks[0]) < self.radius], spacing * (np.arange(rows) - 0.5 * (rows - 1))]
        offset = np.stack(np.meshgrid(*ticks, indexing="ij"), -1).reshape(-1, len(across))
        if self.height is None:
            offset = offset[np.linalg.norm(offset, axis=1) < self.radius]
        return np.array(self.centre, float) - 0.5 * spacing * along + offset @ np.array(across)

    def layer_volume(self, spacing: float) -> float:
        """Volume [m3] of one layer."""
        return len(self.layer(spacing)) * spacing ** len(self.centre)

    def speed(self, spacing: float) -> float:
        """Speed [m/s] in the hose: a spacing in the time in which the rate fills a layer."""
        return spacing * self.rate / self.layer_volume(spacing)

    @property
    def turns(self) -> np.ndarray:
        """Rows of a time [s] and the displacement of the nozzle from its centre then [m], (k, 1 + d)."""
        return np.zeros((1, 1 + len(self.centre))) if self.path is None else np.array(self.path, float)

    def velocity(self, spacing: float, time: float = 0.0) -> np.ndarray:
        """Velocity (d,) [m/s] in the hose at a time [s], with that of the nozzle."""
        rows, jet = self.turns, self.speed(spacing) * self.unit_direction
        k = np.searchsorted(rows[:, 0], time, side="right")
        if k in (0, len(rows)):  # before the first turn, or after the last
            return jet
        return jet + (rows[k, 1:] - rows[k - 1, 1:]) / (rows[k, 0] - rows[k - 1, 0])

    def displacement(self, time: float) -> np.ndarray:
        """Of the nozzle from its centre at a time [s], (d,) [m]."""
        at, *along = self.turns.T
        return np.array([np.interp(time, at, values) for values in along])

    def fastest(self, spacing: float) -> np.ndarray:
        """The velocity (d,) [m/s] in the hose when it is largest."""
        velocities = np.array([self.velocity(spacing, time) for time in self.turns[:, 0]])  # at rest after the last
        return velocities[np.linalg.norm(velocities, axis=1).argmax()]

    def layers(self, spacing: float) -> int:
        """Number of layers, the nearest to the volume and one at least."""
        return max(1, round(self.volume / self.layer_volume(spacing)))


def buried(layer: np.ndarray, x: np.ndarray, spacing: float) -> bool:
    """Whether a layer (m, d) [m] of particles has no room among those that are there, x (n, d) [m]."""
    reach = ROOM * spacing
    near = x[np.all((x > layer.min(0) - reach) & (x < layer.max(0) + reach), axis=1)]
    return bool(np.any(((near[:, None, :] - layer[None]) ** 2).sum(-1) < reach**2))
