"""Problem: a scene and the numerics that are to solve it, checked once; what follows from both is decided here."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..geometry.solid import Solid
from .feasibility import RULES
from .numerics import Implicit, SemiImplicit
from .scene import Scene

WEIGHTLESS = 0.1  # of a scene without weight: its gravity over U^2/H, or [m/s2] where nothing moves


@dataclass(frozen=True, eq=False)
class Problem:
    """A scene with its numerics (``Implicit()`` by default): the one gate to a computation.

    There are two stages, each a list of small rules. A ``Scene`` checks itself when it is made (``scene_rules``), so
    that a wrong one is refused where it stands. A Problem adds what needs the scheme, and what wrong units or a wrong
    origin would show (``feasibility``). SceneError names the first rule that is broken, in one line with key, value and
    what is allowed, before anything is allocated. Behind it nothing is checked again.
    """

    scene: Scene
    numerics: Implicit | SemiImplicit | None = None

    def __post_init__(self):
        if self.numerics is None:
            object.__setattr__(self, "numerics", Implicit())
        for rule in RULES:
            rule(self)

    @property
    def scheme(self) -> str:
        """'implicit' or 'semi-implicit'."""
        return self.numerics.scheme

    @property
    def effective_radius(self) -> float:
        """r_e [m]: farther particles are no neighbours."""
        return self.numerics.effective_radius_ratio * self.scene.spacing

    @property
    def wall_particles(self) -> bool:
        """Are the walls computed as particles, as in the paper? Else as surfaces."""
        return self.numerics.walls == "particles" and self.scene.wall_particles is not None

    @cached_property
    def materials(self) -> tuple:
        """The mixes: that of the scene first, then others that inlets bring."""
        return self.scene.materials

    @cached_property
    def law(self) -> str:
        """'newtonian', 'bingham' (a true yield stress) or 'bi-viscosity' (a critical strain rate is given), of all
        mixes; a flow curve has a true yield stress."""
        yielding = [material for material in self.materials if not material.newtonian]
        if not yielding:
            return "newtonian"
        return "bingham" if yielding[0].critical_strain_rate is None else "bi-viscosity"

    @property
    def wall_loads(self) -> bool:
        """Are force and torque on the walls computed?"""
        return self.scene.wall_loads or getattr(self.numerics, "wall_loads", False)

    @property
    def rests(self) -> bool:
        """Does it come to rest? Only a true yield stress of every mix brings a body to rest."""
        return all(material.rests for material in self.materials)

    @cached_property
    def height(self) -> float:
        """Height of the fluid [m], as high as it will be."""
        return float(np.ptp(self.scene.expected.fluid[:, -1])) + self.scene.spacing

    @cached_property
    def speed(self) -> float:
        """Largest speed [m/s] that is given: of the fluid at first, or of a wall."""
        velocity = self.scene.expected.velocity
        fluid = [float((velocity**2).sum(1).max() ** 0.5)] if velocity is not None else []
        return max(fluid + [wall.speed for wall in self.scene.expected.walls] + [0.0])

    @cached_property
    def gravity(self) -> float:
        """Gravity [m/s2] of the scales of the scene; without weight by what moves."""
        weight = float((self.scene.expected.gravity_vector**2).sum() ** 0.5)
        return max(weight, WEIGHTLESS * self.speed**2 / self.height) or WEIGHTLESS

    @property
    def thin_solids(self) -> dict[str, float]:
        """Thickness [m] of the solids at rest, by their names or numbers among the walls, that are thinner than a
        particle; none where walls are particles."""
        if self.numerics.walls == "particles":
            return {}
        solids = zip(self.scene.wall_names, self.scene.walls, strict=True)
        thickness = {name: wall.thickness for name, wall in solids if isinstance(wall, Solid) and wall.speed == 0.0}
        return {name: thick for name, thick in thickness.items() if thick < self.scene.spacing}

    @property
    def fall_time(self) -> float:
        """sqrt(H/g) [s], in which the body would fall half of its height."""
        return (self.height / self.gravity) ** 0.5
