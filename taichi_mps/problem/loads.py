"""What the fluid does to a wall: force and torque, as a whole and by particle. Plain NumPy."""

from dataclasses import dataclass

import numpy as np

AXES = {2: "xz", 3: "xyz"}  # names of the coordinates


@dataclass(frozen=True)
class Load:
    """Force and torque of the fluid on one wall, by particle: n particles, d dimensions. In two dimensions per metre of
    depth [N/m, N]; of rings, all around. nan before a step has been computed."""

    point: np.ndarray  # of the wall, about which torques are [m], (d,)
    forces: np.ndarray  # [N], (n, d)
    torques: np.ndarray  # [N m], (n, 3), in two dimensions counter-clockwise (n, 1)
    axis: np.ndarray | None = None  # unit vector about which it may turn, (3,) or (1,); None of other walls

    @property
    def force(self) -> np.ndarray:
        """On the whole wall [N], (d,)."""
        return self.forces.sum(0)

    @property
    def torque(self) -> np.ndarray:
        """On the whole wall, about its point [N m], (3,) or (1,)."""
        return self.torques.sum(0)

    def mirrored(self, point, normal) -> "Load":
        """With that of the images at the plane through ``point`` [m] with this unit normal."""
        normal, away = np.asarray(normal, float), self.point - np.asarray(point, float)
        images = self.forces - 2.0 * np.outer(self.forces @ normal, normal)
        arm = -2.0 * (away @ normal) * normal  # from the wall's point to its image
        turned = cross(np.broadcast_to(arm, images.shape), images)
        turned -= self.torques if self.torques.shape[1] == 1 else reflected_axial(self.torques, normal)
        forces, torques = np.vstack([self.forces, images]), np.vstack([self.torques, turned])
        return Load(self.point, forces, torques, self.axis)

    def revolved(self, ring, around, across) -> "Load":
        """Of rings (r, z): each shared by the particles around it, whose numbers of the ``ring`` (m,) and directions
        ``across`` (m, 2) are given; ``around`` (n,) particles share one."""
        share = (self.forces / around[:, None])[ring]
        forces = np.column_stack([share[:, :1] * across, share[:, 1]])
        return Load(np.array([0.0, 0.0, self.point[1]]), forces, np.zeros_like(forces))

    def facts(self, name: str, axes) -> dict[str, float]:
        """As results: the components of the force along the coordinates ``axes``, and the torque where there is an axis
        to turn about."""
        d = self.forces.shape[1]
        per = "_per_m" if d == 2 else ""
        found = {f"force_{name}_{AXES[d][a]}_N{per}": float(self.force[a]) for a in axes}
        turns = self.axis is not None and np.any(self.axis)
        return found | ({f"torque_{name}_N_m{per}": float(self.torque @ self.axis)} if turns else {})


def measured(s, mirrors, axisymmetric: bool) -> dict[str, float]:
    """The loads of a whole body (a Snapshot) as results: without what cancels out between a wall and its image."""
    d = s.x.shape[1]
    crossed = [a for a in range(d) if any(abs(mirror.normal[a]) > 0.99 for mirror in mirrors)]
    axes = [d - 1] if axisymmetric else [a for a in range(d) if a not in crossed]
    found = {}
    for name, load in s.loads.items():
        found |= load.facts(name, axes)
    return found


def cross(a, b):
    """a x b, (n, 3), in two dimensions (n, 1)."""
    if a.shape[1] == 3:
        return np.cross(a, b)
    return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])[:, None]


def reflected_axial(torques, normal):
    """Minus what a reflection makes of axial vectors (n, 3)."""
    return torques - 2.0 * np.outer(torques @ normal, normal)
