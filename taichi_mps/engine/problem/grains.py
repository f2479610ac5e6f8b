"""Grains: coarse aggregate, rigid bodies in the flowing mortar. Plain NumPy."""

from dataclasses import dataclass

import numpy as np

from ...units import AnyDensity, Count, Size, array, points, real, require, validated
from ..geometry.clumps import clump_rows, scaled
from ..geometry.packing import pack, place

LEAST_ACROSS, GOOD_ACROSS = 3.0, 4.0  # diameter over the spacing, below which a grain is refused, or warned of
MOST = 0.35  # volume fraction that is placed


@validated
@dataclass(frozen=True, eq=False)
class Grains:
    """Coarse aggregate in a body of mortar: rigid spheres, discs in two dimensions, or clumps of them.

    Parameters
    ----------
    diameter : float or sequence of tuple (float, float)
        Diameter [m], of a sphere of the same volume; or a grading, rows of a diameter [m] and its fraction of the
        volume of all grains.
    volume_fraction : float, optional
        Volume of the grains over that of the body at 0 s and of what enters [-], 0.35 at most; they are placed at
        random, without overlap.
    centres : ndarray, shape (g, d), optional
        Centres instead of a volume fraction [m]; each is moved to the nearest place of the lattice of particles, by at
        most half a spacing along an axis.
    density : float, optional
        Density of the stone [kg/m3].
    friction : float, optional
        Coefficient of friction between grains, and with walls that are not slip [-].
    seed : int, optional
        Number from which random places follow.
    shape : str or ndarray, shape (k, d + 1), optional
        'sphere'; 'ellipsoid 2:1:1', with the ratios of its axes, or 'ellipse 2:1' in two dimensions; or of crushed
        stone the offset and the radius of each sphere of a clump. Only proportions count: the volume is that of the
        diameter. At random places in twelve rotations, at given ``centres`` as it stands.

    Raises
    ------
    SceneError
        If a number is out of range, or not exactly one of ``volume_fraction`` and ``centres`` is given.

    Notes
    -----
    The ``material`` of the scene is then that of the mortar, not of the concrete. Needs the scheme ``implicit``, no
    mirror plane and no rings; a diameter of three spacings or more, better four, six between bars; of a clump that of
    its largest sphere. What an inlet brings has the same ``volume_fraction``, none with ``centres``; a grain enters
    whole, with the first layer that it is in. An ellipsoid is a clump of the largest spheres in it. A sphere that is
    the nearest of no particle of its clump has no contacts.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.Grains(diameter=[(0.008, 0.4), (0.016, 0.6)], volume_fraction=0.3).diameters.tolist()
    [0.008, 0.016]
    """

    diameter: Size | array("m and -", (None, 2))
    volume_fraction: real("-", gt=0.0, le=MOST) | None = None
    centres: points("m") | None = None
    density: AnyDensity = 2650.0
    friction: real("-", ge=0.0, le=10.0) = 0.4
    seed: Count = 1
    shape: str | array("-", (None, 3), (None, 4)) = "sphere"

    def __post_init__(self):
        object.__setattr__(self, "rows", clump_rows(self.shape))
        fitting = (d for d in (2, 3) if self.rows.shape[1] in (0, d + 1))
        object.__setattr__(self, "_known", {d: scaled(self.rows, d) for d in fitting})  # clumps; places by the body
        require(
            (self.volume_fraction is None) != (self.centres is None),
            "grains: must have either volume_fraction or centres",
        )
        require(self.centres is None or len(self.centres), "grains: centres = []: must be one or more")
        if np.ndim(self.diameter):
            require(
                len(self.diameter) and np.all(self.diameter > 0.0) and abs(self.diameter[:, 1].sum() - 1.0) < 1e-6,
                f"grains: diameter = {self.diameter.tolist()}: must be diameters and fractions above 0, sum 1",
            )
            require(self.centres is None, "grains: a grading has no centres; diameter must be one number")

    @property
    def grading(self) -> np.ndarray:
        """Rows of a diameter [m] and its fraction of the volume [-], shape (k, 2)."""
        return self.diameter if np.ndim(self.diameter) else np.array([[self.diameter, 1.0]])

    @property
    def diameters(self) -> np.ndarray:
        """Diameters [m], shape (k,)."""
        return self.grading[:, 0]

    @property
    def width(self) -> float:
        """Diameter of the largest sphere of the smallest grain [m]."""
        return float(self.diameters.min() * 2.0 * self.clump(max(2, self.rows.shape[1] - 1))[0][:, -1].max())

    def clump(self, d: int) -> tuple[np.ndarray, np.ndarray]:
        """Spheres and inertia of a grain.

        Parameters
        ----------
        d : int
            Dimension.

        Returns
        -------
        spheres : ndarray, shape (k, d + 1)
            Offset from the centre and radius of each, over the diameter.
        inertia : ndarray, shape (3, 3)
            Moment of inertia over the mass and the square of half of the diameter [-].
        """
        return self._known[d]

    def places(
        self, x: np.ndarray, spacing: float, domain: tuple, periodic: tuple
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Place the grains in a body.

        Parameters
        ----------
        x : ndarray, shape (n, d)
            Particles of the body, on a lattice [m].
        spacing : float
            Particle size [m].
        domain : tuple
            Lowest and highest corner of the scene [m].
        periodic : tuple of bool
            Whether each axis is periodic.

        Returns
        -------
        number : ndarray of int, shape (n,)
            Number of the grain of each particle, from 1; 0 of mortar.
        centres : ndarray, shape (g, d)
            Centres [m].
        radii : ndarray, shape (g,)
            Radii of spheres of their volume [m].
        rotations : ndarray, shape (g, d, d)
            Rotations of their shapes [-].

        Raises
        ------
        SceneError
            If they do not fit.
        """
        body = x, spacing, domain, periodic, self.clump(x.shape[1])[0]
        key = x.tobytes(), repr(body[1:4])
        if key not in self._known:
            if self.centres is not None:
                self._known[key] = place(*body, self.centres, np.full(len(self.centres), self.diameters[0]))
            else:
                self._known[key] = pack(*body, self.diameters, self.volume_fraction * self.grading[:, 1], self.seed)
        return self._known[key]

    def facts(self, placed: tuple, d: int) -> dict:
        """Describe grains that are placed.

        Parameters
        ----------
        placed : tuple of ndarray
            What ``places`` returned.
        d : int
            Dimension.

        Returns
        -------
        dict
            JSON-ready.
        """
        number, _, radii, _ = placed
        counts, disc = np.bincount(number)[1:], "disc" if d == 2 else "sphere"
        shape = self.shape if isinstance(self.shape, str) else f"clump of {disc}s"
        return {
            "diameters_m": self.diameters.tolist(),
            "number": int(number.max(initial=0)),
            "shape": shape if len(self.rows) else disc,
            "volume_fraction": float((number > 0).mean()),
            "density": self.density,
            "friction": self.friction,
            "particles_of_each": [round(counts[radii == 0.5 * size].mean()) for size in self.diameters],
        }
