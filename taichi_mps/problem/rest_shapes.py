"""Shapes in which a yield-stress fluid comes to rest, without inertia: closed forms to judge test methods by. And how
far a column of it flows with inertia, by a model of one number, to make room for it."""

import math

import numpy as np

from ..units import finite, positive, require


def spread_at_rest(volume: float, density: float, yield_value: float, gravity: float = 9.81) -> float:
    """Diameter [m] of a thin round cake of this volume [m3]: R^5 = 225 rho g V^2/(128 pi^2 tau_y).

    Roussel and Coussot (2005), J. Rheol. 49, 705. It holds for bodies much wider than high: of the slump cone it is 10,
    12, 20 and 32 % too wide at 50, 100, 300 and 1000 Pa, by finite elements without inertia."""
    must_come_to_rest(yield_value, density, gravity)
    positive("volume", volume, "m3")
    return 2.0 * (225.0 * density * gravity * volume**2 / (128.0 * math.pi**2 * yield_value)) ** 0.2


def channel_at_rest(
    area, density, yield_value, width=None, length=math.inf, normal_stress=False, gravity=9.81, points=201
):
    """Depth at rest in a level channel that is closed at x = 0 and ``length`` [m]: x and h (k,) [m] of a fluid of this
    volume over the width, ``area`` [m2], from the back wall to the front or the far wall.

    With a = tau_y/(rho g), the yield stress on the floor and, with a ``width`` b [m], on both sides, a thin layer has

        h dh/dx = -a (1 + 2 h/b)

    Roussel (2007), Cem. Concr. Res. 37, 1298 (LCPC box); Nguyen, Roussel and Coussot (2006), Cem. Concr. Res. 36, 1789
    (L-box). With ``normal_stress`` the mean of the plastic normal stress over the depth is added:

        (h - pi a/2) dh/dx = -a (1 + 2 h/b),   h = pi a at the front

    Without side walls this is within 3 % of finite elements of blocks with tau_y/(rho g H) = 0.05 and 0.1, where
    the thin layer reaches 18 and 28 % too far. Inertia carries the front farther and levels the surface. Before a far
    wall the flow is pressed together, and the normal stress changes its sign: slow flows rest there up to pi a steeper
    than the thin layer, end to end."""
    must_come_to_rest(yield_value, density, gravity)
    positive("area", area, "m2")
    a = yield_value / (density * gravity)
    shift, lip = (0.5 * math.pi * a, math.pi * a) if normal_stress else (0.0, 0.0)

    def moments(h):
        """Integrals of 1, h and h^2 over 1 + 2 h/b from 0 to h."""
        if width is None:
            return h, h**2 / 2.0, h**3 / 3.0
        b, log = 0.5 * width, np.log1p(2.0 * h / width)
        return b * log, b * (h - b * log), b * (0.5 * h**2 - b * h + b**2 * log)

    def integral(h, power):
        """Of h^power (h - shift)/(a (1 + 2 h/b)) from the front, where the depth is ``lip``, to the depth h."""
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


def radius_of_flow(volume, height, density, yield_value, plastic_viscosity, time=5.0, gravity=9.81):
    """Radius [m] to which a round column of this volume [m3] and height [m] flows within a time [s], without spray.

    A cake of depth h = V/(pi R^2) with the radial velocity U r/R: its kinetic energy rho V U^2/4, its potential energy
    rho g V h/2 and what a sheared thin layer dissipates on the floor, tau_y and 3 eta u/h by u, give

        rho V/2 dU/dt = rho g V h/R - 2 pi/3 R^2 tau_y - 3 pi/2 R^2 eta U/h

    At rest this is Roussel's and Coussot's R within 3 %, slow and viscous Huppert's (1982), J. Fluid Mech. 121, 43."""
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


def must_come_to_rest(yield_value, density, gravity):
    """SceneError unless density [kg/m3], gravity [m/s2] and yield stress [Pa] are above 0."""
    positive("density", density, "kg/m3")
    positive("gravity", gravity, "m/s2")
    flows = finite("yield_value", yield_value, "Pa", shape=()) <= 0.0
    require(not flows, f"yield_value = {yield_value:g} Pa: without one nothing comes to rest; must be above 0 Pa")


def root(function, low):
    """Root of a growing function of a depth [m], above ``low``."""
    high = low + 1e-3
    while function(high) < 0.0:
        high *= 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if function(middle) > 0.0 else (middle, high)
    return 0.5 * (low + high)
