"""Closed forms of a yield-stress fluid at rest, for comparison with test methods.

They neglect inertia; ``radius_of_flow`` estimates by a model of one unknown how far a column flows with inertia.
"""

import math
from collections.abc import Callable

import numpy as np

from ..units import Count, Duration, Flag, Size, Viscosity, YieldValue, numbers_from, quote, real, require, validated

Volume, Area = real("m3", gt=0.0, le=1e6), real("m2", gt=0.0, le=1e6)
Gravity, Weight = real("m/s2", ge=1e-6, le=1e6), real("kg/m3", ge=1e-3, le=30000.0)
YieldStress = real("Pa", ge=1e-9, le=1e6)  # above 0, or the fluid would not come to rest


@validated
def spread_at_rest(volume: Volume, density: Weight, yield_value: YieldStress, gravity: Gravity = 9.81) -> float:
    """Return the slump flow of a thin round cake at rest.

    Parameters
    ----------
    volume : float
        Volume [m3].
    density : float
        Density [kg/m3].
    yield_value : float
        Yield stress [Pa].
    gravity : float, optional
        Gravity [m/s2].

    Returns
    -------
    float
        Diameter [m].

    Raises
    ------
    SceneError
        If a number is not positive.

    Notes
    -----
    R^5 = 225 rho g V^2/(128 pi^2 tau_y), Roussel and Coussot (2005), J. Rheol. 49, 705. It holds for bodies much wider
    than high: of the slump cone it is 10, 12, 20 and 32 % too wide at 50, 100, 300 and 1000 Pa, by finite elements
    without inertia.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> round(mps.rest_shapes.spread_at_rest(volume=0.0055, density=2300.0, yield_value=50.0), 3)
    0.6
    """
    return 2.0 * (225.0 * density * gravity * volume**2 / (128.0 * math.pi**2 * yield_value)) ** 0.2


@validated
def channel_at_rest(
    area: Area,
    density: Weight,
    yield_value: YieldStress,
    width: Size | None = None,
    length: Size = math.inf,
    normal_stress: Flag = False,
    gravity: Gravity = 9.81,
    points: Count = 201,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the profile of a fluid at rest in a level channel that is closed at x = 0.

    Parameters
    ----------
    area : float
        Volume over the width of the channel [m2].
    density : float
        Density [kg/m3].
    yield_value : float
        Yield stress [Pa].
    width : float, optional
        Width b between side walls to which the fluid sticks [m]; no side walls by default.
    length : float, optional
        Length of the channel, closed at its far end [m]; endless by default.
    normal_stress : bool, optional
        Add the mean of the plastic normal stress over the depth.
    gravity : float, optional
        Gravity [m/s2].
    points : int, optional
        Number k of points of the profile.

    Returns
    -------
    x, h : ndarray, shape (k,)
        Distance from the back wall and depth [m], from the back wall to the front or the far wall.

    Raises
    ------
    SceneError
        If a number is not positive.

    Notes
    -----
    With a = tau_y/(rho g), the yield stress on the floor and on both sides, a thin layer has

        h dh/dx = -a (1 + 2 h/b)

    Roussel (2007), Mater. Struct., doi:10.1617/s11527-007-9230-4 (LCPC box); Nguyen, Roussel and Coussot (2006), Cem.
    Concr. Res. 36, 1789 (L-box). With ``normal_stress``

        (h - pi a/2) dh/dx = -a (1 + 2 h/b),   h = pi a at the front

    Without side walls this is within 3 % of finite elements of blocks with tau_y/(rho g H) = 0.05 and 0.1, where the
    thin layer reaches 18 and 28 % too far. Inertia carries the front farther and levels the surface. Before a far wall
    the normal stress changes its sign: slow flows rest there up to pi a steeper than the thin layer, end to end.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> x, h = mps.rest_shapes.channel_at_rest(area=0.04, density=2300.0, yield_value=100.0)
    >>> round(float(x[-1]), 2), round(float(h[0]), 3)  # front, depth at the back wall
    (0.74, 0.081)
    """
    a = yield_value / (density * gravity)
    shift, lip = (0.5 * math.pi * a, math.pi * a) if normal_stress else (0.0, 0.0)

    def moments(h):
        """Integrals of 1, h and h^2 over 1 + 2 h/b from 0 to h."""
        if width is None:
            return h, h**2 / 2.0, h**3 / 3.0
        b, log = 0.5 * width, np.log1p(2.0 * h / width)
        return b * log, b * (h - b * log), b * (0.5 * h**2 - b * h + b**2 * log)

    def integral(h, power):
        """Integral of h^power (h - shift)/(a (1 + 2 h/b)) from the front, of the depth ``lip``, to the depth h."""
        ends = [moments(h)[power + 1] - shift * moments(h)[power] for h in (h, lip)]
        return (ends[0] - ends[1]) / a

    def depth(x):
        """Depth [m] at x [m] from the front."""
        return root(lambda h: integral(h, 0) - x, lip)

    front, end = root(lambda h: integral(h, 1) - area, lip), lip
    if integral(front, 0) > length:
        end = root(lambda h: integral(depth(integral(h, 0) + length), 1) - integral(h, 1) - area, lip)
        front = depth(integral(end, 0) + length)
    h = np.linspace(front, end, points)
    return integral(front, 0) - integral(h, 0), h


@validated
def radius_of_flow(
    volume: Volume,
    height: Size,
    density: Weight,
    yield_value: YieldValue,
    plastic_viscosity: Viscosity,
    time: Duration = 5.0,
    gravity: Gravity = 9.81,
) -> float:
    """Return the radius to which a round column flows within a time, without spray.

    Parameters
    ----------
    volume : float
        Volume [m3].
    height : float
        Height of the column [m].
    density : float
        Density [kg/m3].
    yield_value : float
        Yield stress [Pa].
    plastic_viscosity : float
        Plastic viscosity [Pa s].
    time : float, optional
        Time [s].
    gravity : float, optional
        Gravity [m/s2].

    Returns
    -------
    float
        Radius [m].

    Notes
    -----
    A cake of depth h = V/(pi R^2) with the radial velocity U r/R: its kinetic energy rho V U^2/4, its potential energy
    rho g V h/2 and the dissipation of a sheared thin layer on the floor give

        rho V/2 dU/dt = rho g V h/R - 2 pi/3 R^2 tau_y - 3 pi/2 R^2 eta U/h

    At rest this is Roussel's and Coussot's radius within 3 %, slow and viscous Huppert's (1982), J. Fluid Mech. 121,
    43.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> column = dict(volume=0.0055, height=0.3, density=2300.0, plastic_viscosity=50.0)
    >>> 0.2 < mps.rest_shapes.radius_of_flow(yield_value=100.0, **column) < 0.35
    True
    """
    radius, speed, now = math.sqrt(volume / (math.pi * height)), 0.0, 0.0
    while now < time:
        depth = volume / (math.pi * radius**2)
        step = 0.01 * radius / max(speed, math.sqrt(gravity * depth))
        push = density * gravity * volume * depth / radius - 2.0 / 3.0 * math.pi * radius**2 * yield_value
        drag = 1.5 * math.pi * radius**2 * plastic_viscosity / depth
        inertia = 0.5 * density * volume / step
        speed = (inertia * speed + push) / (inertia + drag)
        if speed <= 0.0:
            break
        radius, now = radius + step * speed, now + step
    return radius


@validated
def root(function: Callable, low: real("m", ge=0.0, le=1e9)) -> float:
    """Find the root of a growing function of a depth by bisection.

    Parameters
    ----------
    function : callable
        Function of a depth [m].
    low : float
        Lower bound [m].

    Returns
    -------
    float
        Depth [m].

    Examples
    --------
    >>> import taichi_mps as mps
    >>> round(mps.rest_shapes.root(lambda h: h**2 - 0.25, 0.0), 6)
    0.5
    """
    high = low + 1e-3
    while (value := numbers_from("function", function, high)) < 0.0 and high < 1e100:
        high *= 2.0
    require(value >= 0.0, f"function = {quote(function, '')}: must be a number above 0 somewhere above low = {low:g} m")
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if function(middle) > 0.0 else (middle, high)
    return 0.5 * (low + high)
