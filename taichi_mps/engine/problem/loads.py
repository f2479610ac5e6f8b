"""Force and torque of the fluid on a wall, in total and by particle. Plain NumPy."""

from dataclasses import dataclass

import numpy as np

AXES = {2: "xz", 3: "xyz"}  # names of the coordinates


@dataclass(frozen=True)
class Load:
    """Force and torque of the fluid on one wall, by particle: n particles, d dimensions. In two dimensions they are per
    metre of depth [N/m, N], for rings over the whole circle. They are nan before the first step."""

    point: np.ndarray  # point of the wall about which torques are taken [m], (d,)
    forces: np.ndarray  # [N], (n, d)
    torques: np.ndarray  # [N m], (n, 3), in two dimensions counter-clockwise (n, 1)
    axis: np.ndarray | None = None  # unit vector along the axis of a rotating wall, (3,) or (1,); else None

    @property
    def force(self) -> np.ndarray:
        """Force on the whole wall [N], (d,)."""
        return self.forces.sum(0)

    @property
    def torque(self) -> np.ndarray:
        """Torque on the whole wall about its point [N m], (3,) or (1,)."""
        return self.torques.sum(0)

    def mirrored(self, point, normal) -> "Load":
        """Load of the particles and of their images at the plane through ``point`` [m] with this unit normal."""
        normal, away = np.asarray(normal, float), self.point - np.asarray(point, float)
        images = self.forces - 2.0 * np.outer(self.forces @ normal, normal)
        arm = -2.0 * (away @ normal) * normal  # from the wall's point to its image
        flat, axes = 3 - len(normal), self.torques.shape[1]  # in two dimensions a torque is about the third axis
        arm, normal = (np.pad(vector, (0, flat)) for vector in (arm, normal))
        own = np.pad(self.torques, ((0, 0), (3 - axes, 0)))
        turned = np.cross(arm, np.pad(images, ((0, 0), (0, flat)))) - own + 2.0 * np.outer(own @ normal, normal)
        forces, torques = np.vstack([self.forces, images]), np.vstack([self.torques, turned[:, -axes:]])
        return Load(self.point, forces, torques, self.axis)

    def revolved(self, ring, around, across) -> "Load":
        """Load of rings (r, z), each shared by the particles around it, whose numbers of the ``ring`` (m,) and
        directions ``across`` (m, 2) are given; ``around`` (n,) particles share one."""
        per_particle = (self.forces / around[:, None])[ring]
        forces = np.column_stack([per_particle[:, :1] * across, per_particle[:, 1]])
        return Load(np.array([0.0, 0.0, self.point[1]]), forces, np.zeros_like(forces))


def load_results(s, mirrors, axisymmetric: bool) -> dict[str, float]:
    """Results of the loads of a whole body (a Snapshot), {name: value}: the components of each force, without those
    that cancel out between a wall and its image, and the torque of walls with an axis."""
    d = s.x.shape[1]
    crossed = [a for a in range(d) if any(abs(mirror.normal[a]) > 0.99 for mirror in mirrors)]
    axes = [d - 1] if axisymmetric else [a for a in range(d) if a not in crossed]
    per = "_per_m" if d == 2 and not axisymmetric else ""
    found = {}
    for name, load in s.loads.items():
        found |= {f"force_{name}_{AXES[d][a]}_N{per}": float(load.force[a]) for a in axes}
        if load.axis is not None and np.any(load.axis):
            found[f"torque_{name}_N_m{per}"] = float(load.torque @ load.axis)
    return found
