"""The paper's scheme (Tomiyama et al. 2009): explicit viscosity, semi-implicit pressure.

One step: at r^k the predictor u* with its direct (Picard) iteration (eq 17) and r* = r^k + dt u* (eq 18); there, with
neighbours found anew, P^{k+1} from the particle number density n* (eqs 13, 19), and the correction of velocity and
position (eqs 20, 21). Taken literally that breaks down where particles meet; the default has what the practice of MPS
adds, each piece with its source: gradient, sign and source of the pressure, collisions, and a shift (S1 to S5).
"""

from ..runtime.field_io import FieldIO
from ..runtime.stages import NoOp
from ..terms.explicit_viscosity import ExplicitViscosity
from ..terms.pressure_poisson import PressurePoisson
from ..terms.shifting import Collisions, Shifting
from .diagnostics import Diagnostics
from .scheme import Scheme

FULL_STRAIN = 0.005  # in a step, from which on the shift acts fully


class SemiImplicitScheme(Scheme):
    """Semi-implicit scheme for Newtonian and bi-viscosity Bingham fluids in two or three dimensions."""

    REMEDY = "shorten courant_number and diffusion_number, leave out literal, or use the scheme implicit"

    def __init__(self, problem, to_come: int, pairs_per_particle: float):
        super().__init__(problem, {}, to_come, pairs_per_particle)
        material, literal = problem.scene.material, self.numerics.literal
        self.viscosity = ExplicitViscosity(self.fluid, material)
        self.pressure = PressurePoisson(self.fluid, material.density, literal)
        self.collisions = NoOp("collide") if literal else Collisions(self.fluid)
        self.shifting = NoOp("compute", "shift_particles") if literal else Shifting(self.fluid, shifts_in_tension=False)
        self.largest_viscosity = 0.0  # of the last step [Pa s]; 0 before the first one
        yielded, solver = self.viscosity.yielded, self.pressure.solver
        self.field_io = FieldIO({"yielded": yielded}, self.fluid.particles.capacity)
        self.diagnostics = Diagnostics(self.fluid, self.viscosity, yielded, solver, solver.iterations)

    def step(self, dt: float, is_read: bool = False):
        """Advance by one step of dt [s]."""
        self.fluid.neighbors.search()
        self.fluid.gradient.build()
        iterations = self.viscosity.predict(dt, self.numerics.picard_tolerance, self.numerics.picard_limit)
        self.collisions.collide(self.viscosity.u_star)
        self.viscosity.move(dt)
        self.fluid.neighbors.search()
        self.fluid.gradient.weigh()
        self.pressure.solve(dt, self.numerics.tolerance)
        self.pressure.correct(dt)
        self.shifting.compute(dt, FULL_STRAIN, 0.0)
        self.shifting.shift_particles()
        self.viscosity.mark_yielded()
        self.largest_viscosity = float(self.viscosity.largest[None])
        return self.diagnostics.report(dt, iterations)

    def time_step_limits(self, speeds) -> dict[str, float]:
        """Largest allowed steps [s] by name. The first step of a body at rest, which has no viscous force yet, is the
        paper's 0.001 s; later the Courant and the diffusion number rule, by default from the first step on: fine
        particles of a stiff mix do not survive 0.001 s."""
        numerics, first = self.numerics, self.largest_viscosity == 0.0
        limits = {"first": numerics.first_time_step} if first else {"maximum": numerics.max_time_step}
        limits |= super().time_step_limits(speeds)
        if speeds.speed > 0.0 or not first or not numerics.literal:
            mu = self.viscosity.largest_possible if first else self.largest_viscosity
            limits["diffusion"] = self.viscosity.stable_step(numerics.diffusion_number, self.spacing, mu)
        return limits

    def state(self) -> dict:
        """Scalars the scheme carries from step to step."""
        return {"largest_viscosity": self.largest_viscosity}

    def load(self, state: dict) -> None:
        """Load the scalars of a saved state."""
        self.largest_viscosity = state["largest_viscosity"]
