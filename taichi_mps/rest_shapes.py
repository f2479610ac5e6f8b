"""Shapes in which a yield-stress fluid comes to rest, without inertia: closed forms to judge test methods by."""

import math

import numpy as np

from .quantity import SceneError


def spread_at_rest(volume: float, density: float, yield_value: float, gravity: float = 9.81) -> float:
    """Diameter [m] of a thin round cake of this volume [m3]: R^5 = 225 rho g V^2/(128 pi^2 tau_y).

    Roussel and Coussot (2005), J. Rheol. 49, 705. It holds for bodies much wider than high."""
    if not yield_value > 0.0:
        raise SceneError(f"yield_value = {yield_value:g} Pa: without one nothing comes to rest; must be above 0 Pa")
    return 2.0 * (225.0 * density * gravity * volume**2 / (128.0 * math.pi**2 * yield_value)) ** 0.2


def channel_at_rest(area, density, yield_value, width=None, length=math.inf, gravity=9.81, points=201):
    """Depth at rest in a level channel that is closed at x = 0 and ``length`` [m]: x and h (k,) [m] of a fluid of this
    volume over the width, ``area`` [m2], from the back wall to the front or the far wall.

    The yield value acts on the floor and, with a ``width`` b [m], on both sides: rho g h dh/dx = -tau_y (1 + 2 h/b).
    Without inertia: Roussel (2007), Cem. Concr. Res. 37, 1298 (LCPC box); Nguyen, Roussel and Coussot (2006), Cem.
    Concr. Res. 36, 1789 (L-box). Inertia carries the front farther and levels the surface."""
    if not yield_value > 0.0:
        raise SceneError(f"yield_value = {yield_value:g} Pa: without one nothing comes to rest; must be above 0 Pa")
    scale = density * gravity / yield_value

    def reach(h):
        """How far from the back wall a channel of depth h there would end [m]."""
        if width is None:
            return 0.5 * scale * h**2
        return 0.5 * scale * width * (h - 0.5 * width * np.log1p(2.0 * h / width))

    def depth(x):
        """The inverse: depth [m] at the distance x [m] from where it would end."""
        return bisect(
            lambda h: reach(h) - x, 0.0, 10.0 * (math.sqrt(2.0 * x / scale) + 2.0 * x / (scale * (width or 1e9)))
        )

    def filled(h):
        """Volume over the width [m2] in front of a back wall where the depth is h [m]."""
        if width is None:
            return scale * h**3 / 3.0
        return 0.5 * scale * width * (0.5 * h**2 - 0.5 * width * h + 0.25 * width**2 * np.log1p(2.0 * h / width))

    highest = 10.0 * (3.0 * area / scale) ** (1.0 / 3.0) + 10.0 * math.sqrt(area / scale / (width or 1e9))
    front, end = bisect(lambda h: filled(h) - area, 0.0, highest), 0.0
    if reach(front) > length:
        end = bisect(lambda h: filled(depth(reach(h) + length)) - filled(h) - area, 0.0, area / length)
        front = depth(reach(end) + length)
    h = np.linspace(front, end, points)
    return reach(front) - reach(h), h


def bisect(function, low, high):
    """Root of a growing function between two numbers."""
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if function(middle) > 0.0 else (middle, high)
    return 0.5 * (low + high)
