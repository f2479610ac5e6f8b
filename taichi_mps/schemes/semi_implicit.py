"""The paper's scheme (Tomiyama et al. 2009): explicit viscosity, semi-implicit pressure.

One step: at r^k the predictor u* with its direct iteration (eq 17) and r* = r^k + dt u* (eq 18); the simulation then
sorts the particles and makes the neighbour lists at r*; there P^{k+1} from the particle number density n*
(eq 19), and the correction of velocity and position (eqs 20, 21).
"""

from ..particles.gradient import Gradient
from ..runtime.backend import ti
from ..terms.explicit_viscosity import ExplicitViscosity
from ..terms.pressure_poisson import PressurePoisson


@ti.data_oriented
class SemiImplicit:
    """Semi-implicit scheme for Newtonian and bi-viscosity Bingham fluids in two or three dimensions."""

    REMEDY = "use source = mixed with gradient = conservative, or the scheme implicit"

    def __init__(self, scene, numerics, particles, neighbors, walls, lattice):
        self.particles, self.neighbors = particles, neighbors
        self.numerics = numerics
        self.spacing = scene.spacing
        self.mass_density = scene.material.density  # [kg/m3]
        self.gradient = Gradient(neighbors, walls, lattice, scene.spacing)
        self.viscosity = ExplicitViscosity(particles, self.gradient, scene.material, lattice, scene.gravity_vector)
        self.pressure = PressurePoisson(
            particles, self.gradient, scene.material.density, lattice, numerics.source, numerics.gradient
        )
        self.solver, self.iterations = self.pressure.solver, self.pressure.solver.iterations
        self.yielded = ti.field(ti.i32, particles.capacity)  # 1 where the material flows
        self.largest_viscosity = 0.0  # of the last step [Pa s]; 0 before the first one
        self.passes = 0  # of the direct iteration in the last step

    def state(self) -> dict:
        """Scalars the scheme carries from step to step, and from the predictor to the corrector."""
        return {"largest_viscosity": self.largest_viscosity, "passes": self.passes}

    def load(self, state: dict) -> None:
        self.largest_viscosity, self.passes = state["largest_viscosity"], state["passes"]

    def time_step_limits(self, max_speed: float, _acceleration: float = 0.0) -> dict[str, float]:
        """Largest allowed steps [s] by name. The first step of a body at rest, which has no viscous force yet, is the
        paper's 0.001 s; later the Courant and the diffusion number rule."""
        numerics, first = self.numerics, self.largest_viscosity == 0.0
        limits = {"first": numerics.first_time_step} if first else {"maximum": numerics.max_time_step}
        if max_speed > 0.0:
            limits["Courant"] = numerics.courant_number * self.spacing / max_speed
        if max_speed > 0.0 or not first:
            mu = self.viscosity.largest_possible if first else self.largest_viscosity
            limits["diffusion"] = self.viscosity.stable_step(numerics.diffusion_number, self.spacing, mu)
        return limits

    def predict(self, dt: float) -> None:
        """First half of a step, at r^k: u* (eq 17) and r* (eq 18)."""
        self.gradient.build()
        self.passes = self.viscosity.predict(dt, self.numerics.picard_tolerance, self.numerics.picard_limit)
        self.largest_viscosity = float(self.viscosity.largest[None])
        self.viscosity.move(dt)

    def step(self, dt: float) -> int:
        """Second half, at r*: n* (eq 13), P (eq 19), u^{k+1} and r^{k+1} (eqs 20, 21); returns the passes of the
        direct iteration."""
        self.gradient.build()
        self.pressure.solve(dt, self.numerics.tolerance)
        self.pressure.correct(dt)
        self.mark_yielded()
        return self.passes

    @ti.func
    def density(self, i):
        """Density of particle i [kg/m3]."""
        return ti.cast(self.mass_density, float)

    @ti.kernel
    def mark_yielded(self):
        """Flowing where sqrt(Pi) of the last pass reaches 2 pi_c (eqs 1-3)."""
        for i in range(self.particles.count[None]):
            self.yielded[i] = 1
            if ti.static(not self.viscosity.newtonian):
                self.yielded[i] = self.particles.shear_rate[i] >= 2.0 * self.viscosity.pi_c
