"""Inlet: a hose or chute from which concrete enters, layer of particles by layer. Plain NumPy."""

from dataclasses import dataclass, replace

import numpy as np

from ...units import Size, Time, array, real, require, validated, vector
from .materials import AnyMaterial

MAX_RADIUS_IN_SPACINGS = 1000  # three million particles in a layer
MAX_JET_SPEED = 100.0  # in a hose, three times the speed of sprayed concrete [m/s]
MIN_GAP = 0.6  # distance of a new layer from other particles, in spacings, below which it cannot enter


@validated
@dataclass(frozen=True)
class Inlet:
    """Mouth of a hose or chute from which concrete enters, layer by layer.

    Parameters
    ----------
    centre : tuple of float, length d
        Centre of the mouth at the time 0 of the path [m].
    direction : tuple of float, length d
        Direction of the jet [-], of any length.
    radius : float
        Radius of the mouth, half of its width in two dimensions [m].
    rate : float
        Flow rate [m3/s], in two dimensions per metre of depth [m2/s].
    volume : float
        Volume that enters [m3], in two dimensions [m2].
    start : float, optional
        Time at which it opens [s].
    material : Material, optional
        Mix, that of the scene by default.
    path : sequence of tuple, length 1 + d, optional
        Rows of a time [s] and the displacement of the mouth from ``centre`` then [m]; linear in between, at rest before
        the first and after the last row.
    height : float, optional
        Height of a rectangular mouth, 2 ``radius`` wide, in three dimensions [m]; round by default.

    Raises
    ------
    SceneError
        If a number is out of range, or the times of the path do not grow.

    Notes
    -----
    Particles enter in lattice layers across the mouth, a spacing apart. The speed follows from the rate and the area of
    a layer, so the rate is met whatever the spacing. A mouth that is buried holds the next layer back until there is
    room.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> hose = mps.Inlet((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), radius=0.05, rate=0.002, volume=0.1)
    >>> round(hose.speed(0.01), 3), hose.layers(0.01)  # m/s, -
    (0.25, 1250)
    """

    centre: vector("m")
    direction: vector("")
    radius: Size
    rate: real("m3/s", gt=0.0, le=1e9)
    volume: real("m3", gt=0.0, le=1e9)
    start: Time = 0.0
    material: AnyMaterial | None = None
    path: array("s and m", (None, None)) | None = None
    height: Size | None = None

    def __post_init__(self):
        d = len(self.centre)
        require(
            len(self.direction) == d and np.any(self.direction),
            f"inlet: direction = {self.direction}: must have {d} numbers, as centre has, not all zero",
        )
        require(d == 3 or self.height is None, f"inlet: height = {self.height} m: must be left out in 2-D")
        if (path := self.path) is not None:
            require(
                path.shape[1] == 1 + d and len(path) >= 2 and np.all(np.diff(path[:, 0]) > 0.0),
                f"inlet: path of shape {path.shape}: must be two rows or more of a time [s], which grows, and {d} "
                "displacements [m]",
            )
            object.__setattr__(self, "path", tuple(map(tuple, path.tolist())))

    @validated
    def within(self, time: Time) -> "Inlet":
        """Return the inlet with all numbers of its mix, for a run of a given length.

        Parameters
        ----------
        time : float
            Length of the run [s].

        Returns
        -------
        Inlet
            Inlet whose mix has no number left to choose.
        """
        return self if self.material is None else replace(self, material=self.material.within(time))

    @property
    def frame(self) -> np.ndarray:
        """Rows are unit vectors across the mouth, and along the jet, shape (d, d)."""
        along, across = self.unit_direction, []
        # axes most nearly perpendicular to the hose
        axes = np.eye(len(along))[np.argsort(np.abs(along), kind="stable")[:-1]]
        if self.height is not None and np.hypot(along[0], along[1]) > 1e-9:  # level, and upright
            axes = np.stack([np.cross(along, (0.0, 0.0, 1.0)), (0.0, 0.0, 1.0)])
        for axis in axes:
            for other in (along, *across):
                axis = axis - (axis @ other) * other
            across.append(axis / np.linalg.norm(axis))
        return np.array([*across, along])

    @property
    def unit_direction(self) -> np.ndarray:
        """Unit vector along the jet, shape (d,)."""
        return np.array(self.direction, float) / np.linalg.norm(self.direction)

    @validated
    def layer(self, spacing: Size) -> np.ndarray:
        """Return the positions of a layer of particles that begins to leave the mouth.

        Parameters
        ----------
        spacing : float
            Particle size [m].

        Returns
        -------
        ndarray, shape (m, d)
            Positions [m].

        Raises
        ------
        SceneError
            If the mouth is narrower than three spacings or wider than 2000.
        """
        radius = f"inlet: radius = {self.radius:g} m"
        least = spacing * (1.0 - 1e-9)
        require(self.radius >= 1.5 * least, f"{radius}: must be at least 1.5 times spacing = {spacing:g} m")
        most = MAX_RADIUS_IN_SPACINGS * spacing
        require(
            self.radius <= most, f"{radius}: must be at most {MAX_RADIUS_IN_SPACINGS} times spacing = {spacing:g} m"
        )
        require(
            self.height is None or least <= self.height <= most,
            f"inlet: height = {self.height} m: must be 1 to {MAX_RADIUS_IN_SPACINGS} times spacing = {spacing:g} m",
        )
        *across, along = self.frame
        count = int(np.ceil(self.radius / spacing))
        ticks = [spacing * (np.arange(-count, count) + 0.5)] * len(across)
        if self.height is not None:
            rows = max(1, round(self.height / spacing))
            ticks = [ticks[0][np.abs(ticks[0]) < self.radius], spacing * (np.arange(rows) - 0.5 * (rows - 1))]
        offset = np.stack(np.meshgrid(*ticks, indexing="ij"), -1).reshape(-1, len(across))
        if self.height is None:
            offset = offset[np.linalg.norm(offset, axis=1) < self.radius]
        return np.array(self.centre, float) - 0.5 * spacing * along + offset @ np.array(across)

    @validated
    def layer_volume(self, spacing: Size) -> float:
        """Return the volume of one layer.

        Parameters
        ----------
        spacing : float
            Particle size [m].

        Returns
        -------
        float
            Volume [m3], in two dimensions [m2].
        """
        return len(self.layer(spacing)) * spacing ** len(self.centre)

    @validated
    def speed(self, spacing: Size) -> float:
        """Return the speed of the jet relative to the nozzle.

        Parameters
        ----------
        spacing : float
            Particle size [m].

        Returns
        -------
        float
            Speed [m/s]: a spacing in the time in which the rate fills a layer.
        """
        return spacing * self.rate / self.layer_volume(spacing)

    @property
    def turns(self) -> np.ndarray:
        """Rows of a time [s] and the displacement of the nozzle then [m], shape (k, 1 + d)."""
        return np.zeros((1, 1 + len(self.centre))) if self.path is None else np.array(self.path, float)

    @validated
    def velocity(self, spacing: Size, time: Time = 0.0) -> np.ndarray:
        """Return the velocity of the jet, including the motion of the nozzle.

        Parameters
        ----------
        spacing : float
            Particle size [m].
        time : float, optional
            Time [s].

        Returns
        -------
        ndarray, shape (d,)
            Velocity [m/s].
        """
        rows, jet = self.turns, self.speed(spacing) * self.unit_direction
        k = np.searchsorted(rows[:, 0], time, side="right")
        if k in (0, len(rows)):  # before the first turn, or after the last
            return jet
        return jet + (rows[k, 1:] - rows[k - 1, 1:]) / (rows[k, 0] - rows[k - 1, 0])

    @validated
    def displacement(self, time: Time) -> np.ndarray:
        """Return the displacement of the nozzle from its centre.

        Parameters
        ----------
        time : float
            Time [s].

        Returns
        -------
        ndarray, shape (d,)
            Displacement [m].
        """
        at, *along = self.turns.T
        return np.array([np.interp(time, at, values) for values in along])

    @validated
    def fastest(self, spacing: Size) -> np.ndarray:
        """Return the largest velocity of the jet in time.

        Parameters
        ----------
        spacing : float
            Particle size [m].

        Returns
        -------
        ndarray, shape (d,)
            Velocity [m/s].
        """
        velocities = np.array([self.velocity(spacing, time) for time in self.turns[:, 0]])  # at rest after the last
        return velocities[np.linalg.norm(velocities, axis=1).argmax()]

    @validated
    def layers(self, spacing: Size) -> int:
        """Return the number of layers.

        Parameters
        ----------
        spacing : float
            Particle size [m].

        Returns
        -------
        int
            Number nearest to the volume, at least 1.
        """
        return max(1, round(self.volume / self.layer_volume(spacing)))


def buried(layer: np.ndarray, x: np.ndarray, spacing: float) -> bool:
    """Return whether a layer of particles has no room among the present particles.

    Parameters
    ----------
    layer : ndarray, shape (m, d)
        Positions of the layer [m].
    x : ndarray, shape (n, d)
        Positions of the present particles [m].
    spacing : float
        Particle size [m].

    Returns
    -------
    bool
        True where two are nearer than 0.6 spacings.
    """
    gap = MIN_GAP * spacing
    near = x[np.all((x > layer.min(0) - gap) & (x < layer.max(0) + gap), axis=1)]
    return bool(np.any(((near[:, None, :] - layer[None]) ** 2).sum(-1) < gap**2))
