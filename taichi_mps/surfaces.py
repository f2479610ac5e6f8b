"""Wall surfaces as a point sees them, as Taichi functions: distance, normal, motion and curvature at its foot.

``nearest(x)`` gives the signed distance z [m] of x, positive in the fluid; the unit normal n into the fluid; the
velocity [m/s] of the wall at the foot x - z n; and its curvature k [1/m], positive where the fluid is inside.
"""

import numpy as np

from .backend import real, ti

FAR = 1e9  # distance [m] from a wall that ends before the foot


@ti.data_oriented
class Flat:
    """A plane."""

    curved = turns = False
    cut_by = ()  # planes at right angles where its ghosts end

    def __init__(self, wall, dimension: int):
        vector = ti.types.vector(dimension, real())
        self.slip = wall.slip
        self.point = ti.types.vector(dimension, ti.f64)(wall.point)
        self.normal = vector(wall.normal)
        self.velocity = vector(wall.velocity or (0.0,) * dimension)

    @ti.func
    def nearest(self, x):
        z = ti.cast((x - self.point).dot(ti.cast(self.normal, ti.f64)), float)
        return z, self.normal, self.velocity, ti.cast(0.0, float)


@ti.data_oriented
class Round:
    """A circle (2-D), a cylinder or the mantle of a truncated cone; a point at the height s has the foot at the
    radius |x - point - s axis| + z n_r."""

    curved = True
    cut_by = ()

    def __init__(self, wall, dimension: int):
        position = ti.types.vector(dimension, ti.f64)
        self.slip, self.turns = wall.slip, wall.angular_velocity != 0.0
        self.point, self.radius = position(wall.point), wall.radius
        self.axis = position(wall.unit_axis)  # zero in 2-D
        self.side = 1.0 if wall.inside else -1.0
        self.slope, self.ends, self.length = wall.slope, wall.length is not None, wall.length
        self.cosine = 1.0 / (1.0 + wall.slope**2) ** 0.5
        self.velocity = wall.velocity  # along the axis [m/s]
        x, y, z = wall.unit_axis if dimension == 3 else (0.0, 0.0, 1.0)
        spin = wall.angular_velocity * np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])[:dimension, :dimension]
        self.spin = ti.types.matrix(dimension, dimension, ti.f64)(spin)  # gradient of the wall's velocity [1/s]

    @ti.func
    def nearest(self, x):
        offset = x - self.point
        s = offset.dot(self.axis)
        radial = offset - s * self.axis
        r = radial.norm()
        e = radial / ti.max(r, 1e-12)
        z = self.side * self.cosine * (self.radius + self.slope * s - r)
        n = self.side * self.cosine * (self.slope * self.axis - e)
        foot = r + self.side * self.cosine * z
        velocity = self.velocity * self.axis + foot * (self.spin @ e)
        if ti.static(self.ends):
            foot_s = s - z * n.dot(self.axis)
            if foot_s < 0.0 or foot_s > self.length:
                z = FAR
        curvature = ti.cast(self.side * self.cosine / foot, float)
        return ti.cast(z, float), ti.cast(n, float), ti.cast(velocity, float), curvature
