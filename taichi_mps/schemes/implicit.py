"""The default scheme: viscosity, pressure and yield stress in one implicit system per step (I1-I30).

The step is that of an augmented Lagrangian at the middle of the step: after half of the drift the neighbours are found
and a system for the velocity is assembled; Uzawa's iterations solve it in turn with the stress and the pressure, which
are its multipliers; then the particles are shifted and drift the other half.
"""

import warnings

from ..particles.active_set import EVERY, ActiveSet, NoActiveSet
from ..particles.pair_sums import PairSums
from ..runtime.field_io import FieldIO
from ..runtime.stages import FEW, nothing, repeat
from ..terms.constants import Constants
from ..terms.deferred_correction import DeferredCorrection
from ..terms.hourglass import HourglassResistance
from ..terms.initial_relaxation import SHIFTS, InitialRelaxation
from ..terms.interface import Interface, NoInterface
from ..terms.momentum import MomentumOperator, MomentumSource
from ..terms.momentum_drift import MomentumDrift, NoMomentumDrift, free_directions
from ..terms.motion import Motion
from ..terms.pressure_smoothing import PressureSmoothing
from ..terms.shifting import Shifting
from ..terms.standstill import Standstill
from ..terms.strain_rate import SolvedRate, StrainRate
from ..terms.stress import Stress
from ..terms.volume_constraint import STRAIN, VolumeConstraint
from ..terms.wall_friction import NoWallFriction, WallFriction
from ..terms.wall_loads import NoWallLoads, WallLoads
from ..terms.wall_stress import NoWallStress, WallStress
from .diagnostics import Diagnostics
from .scheme import Discretisation
from .velocity_solve import VelocitySolve

FIRST_ITERATIONS = 40  # the pressure and the stress of the first step are found from zero
# of these, with mu_r and no yield stress: the pressure comes first, or its strain stays as stress in a plug
VISCOUS_ITERATIONS = 10


class Implicit:
    """Implicit coupled scheme for fluids by any flow curve, several at once, in two or three dimensions."""

    REMEDY = "lower max_time_step or courant_number, or use precision f64"

    def __init__(self, problem, to_come: int, pairs_per_particle: float):
        scene, g = problem.scene, problem.scene.gravity_vector
        carried = Motion.carried(problem) | Constants.carried(problem) | Stress.carried(problem)
        self.base = Discretisation(problem, carried, to_come, pairs_per_particle)
        self.particles, self.neighbors, self.walls = self.base.particles, self.base.neighbors, self.base.walls
        self.gradient, walls = self.base.gradient, self.base.walls
        self.numerics, self.spacing = problem.numerics, scene.spacing

        fluid = self.particles, self.gradient
        self.constants = Constants(self.particles, problem)
        sums = PairSums(*fluid, walls)
        self.strain_rate, self.solved_rate = StrainRate(*fluid, sums), SolvedRate(*fluid, sums)
        self.pressure = PressureSmoothing(*fluid, self.constants, g)
        several = len(problem.materials) > 1
        self.interface = Interface(*fluid, self.constants) if several else NoInterface()
        self.stress = Stress(
            *fluid, self.constants, self.interface, self.strain_rate, self.solved_rate, self.pressure, problem
        )
        of_motion = self.constants, self.strain_rate, self.pressure
        self.resistance = HourglassResistance(*fluid, *of_motion, self.stress)
        self.shifting = Shifting(*fluid, walls, tears=problem.law == "newtonian")
        self.constraint = VolumeConstraint(*fluid, *of_motion, self.shifting)
        self.correction = DeferredCorrection(*fluid, sums, self.strain_rate, self.resistance, self.stress.averages)
        self.motion = Motion(self.particles, walls, self.shifting, g)
        self.relaxation = InitialRelaxation(*fluid, walls, self.shifting, self.base.lattice.neighbours)

        self.friction, self.wall_stress, self.momentum_drift = NoWallFriction(), NoWallStress(), NoMomentumDrift()
        if walls.have_friction:
            solved = self.constants, self.pressure, self.stress, self.resistance, self.solved_rate
            self.friction = WallFriction(*fluid, walls, *solved, g)
        if any(not wall.slip for wall in walls.surfaces):
            self.wall_stress = WallStress(*fluid, walls, *of_motion, self.stress, g)
        self.wall_loads = NoWallLoads()
        if problem.wall_loads:
            of_stress = self.pressure, self.stress, self.resistance, self.solved_rate
            known = self.correction, self.wall_stress
            axis = len(walls.surfaces) - len(scene.walls)
            measured = [axis + k for k in scene.measured_walls.values()]
            self.wall_loads = WallLoads(*fluid, walls, self.constants, *of_stress, known, measured, g)
        directions = free_directions(scene, problem.numerics.walls)
        if directions.any():
            self.momentum_drift = MomentumDrift(self.particles, self.constants, directions, g)

        self.active_set = NoActiveSet(self.neighbors)
        if may_stand(problem, self.particles, walls) and isinstance(self.momentum_drift, NoMomentumDrift):
            ahead = EVERY * self.numerics.courant_number * scene.spacing
            of_stress = self.constants, self.stress, self.pressure
            self.active_set = ActiveSet(self.neighbors, Standstill(self.particles, walls, *of_stress, problem, ahead))

        self.operator = MomentumOperator(*fluid, sums, walls, self.constants, self.stress, self.resistance)
        known = self.pressure, self.constraint, self.correction, self.wall_stress
        self.source = MomentumSource(self.operator, *known, g)
        # in a step the matrix changes with a viscosity that depends on the velocity, and with the friction of walls
        bi_viscosity = problem.law == "bi-viscosity"
        self.assemble_again = self.assemble if bi_viscosity else nothing
        continues = not (bi_viscosity or walls.have_friction)
        self.velocity = VelocitySolve(self.operator, self.neighbors.bins, self.constants, continues)
        # friction is found together with the stress
        self.viscous_iterations = 0 if walls.have_friction else VISCOUS_ITERATIONS
        self.first = True  # whether the next step is the first one

        yielded, solve = self.stress.yielded, self.velocity
        self._to_read = FieldIO({"yielded": yielded, "p": self.pressure.p}, self.particles.capacity)
        ends = solve.solver, solve.iterations
        self.diagnostics = Diagnostics(*fluid, self.constants, yielded, *ends, self.base.lattice)

    def step(self, dt: float, is_read: bool = False):
        """One step of dt [s], whose result is ``is_read`` or not."""
        u, first = self.velocity.velocity, int(self.first)
        iterations = FIRST_ITERATIONS if first else self.numerics.passes
        self.constants.set_time_step(dt)
        self.drift(dt)
        self.active_set.search(is_read)
        self.gradient.build()
        self.predict(dt, first)
        self.constrain_volume(dt)
        self.assemble(dt)
        self.guess(dt, u)
        for k in repeat(iterations):  # augmented Lagrangian (Uzawa)
            self.source.evaluate(self.velocity.solver)
            self.velocity.solve(k, iterations, self.numerics.tolerance)
            self.update_multipliers(k, first * self.viscous_iterations, u)
            self.assemble_again(dt)
        self.wall_loads.find(u)
        self.momentum_drift.restore(dt, u)
        self.shift(dt)
        self.advance(dt, u, first)
        report = self.diagnostics.report(dt, iterations, self.active_set.left_out)
        self.active_set.end_step(dt)
        return report

    # ---- the stages -----------------------------------------------------------------------------------------
    def drift(self, dt):
        """Walls and particles go to the middle of the step."""
        self.walls.move_to_middle(dt)
        self.motion.drift(dt)

    def predict(self, dt, first):
        """What follows from the last velocity: pressure, viscosity, resistances, and what is taken back of them."""
        self.pressure.smooth(dt)
        self.friction.start(dt)
        self.pressure.find_closed_box(int(self.active_set.whole))
        self.wall_stress.start()
        self.strain_rate.evaluate()
        self.stress.set_viscosity()
        self.interface.find()
        self.interface.gather(self.stress.fluidity)
        self.resistance.set(dt, first)
        self.correction.gather(self.constants.part_taken_back(dt))

    def constrain_volume(self, dt):
        """The divergence that is wanted, from the packing."""
        self.shifting.set_tension(dt, self.resistance, self.pressure, self.stress)
        self.constraint.set(dt)
        self.constraint.balance()
        self.pressure.compress()

    def assemble(self, dt):
        """The matrix, its preconditioner, and what its residual is compared with."""
        self.operator.assemble(dt)
        self.velocity.prepare()

    def guess(self, dt, u):
        """Where the first solve starts."""
        self.motion.guess(dt, u)
        self.velocity.take_guess()

    def update_multipliers(self, k, viscous, u):
        """Stress, pressure and friction from the velocity u."""
        self.solved_rate.update(u)
        self.stress.update(k, viscous)
        self.interface.gather(self.stress.fluidity)
        self.pressure.update(self.solved_rate, self.constraint)
        self.friction.update(u)
        self.wall_stress.update()

    def shift(self, dt):
        """The displacement that keeps the particles evenly spread."""
        self.shifting.compute(dt, STRAIN, 0.0)
        if self.shifting.tears:
            self.shifting.keep_at_rest(dt, STRAIN)

    def advance(self, dt, u, first):
        """The particles take what was found, pressure, stress and velocity, and go with the walls to the end of the
        step."""
        self.walls.move_to_end(dt)
        self.stress.advance(dt, u)
        self.pressure.keep()
        self.motion.advance(dt, u, first)
        self.first = False

    # ---- around the step ------------------------------------------------------------------------------------
    def relax(self) -> None:
        """Before the first step: an unevenly filled body is relaxed, with a warning."""
        self.neighbors.search()
        if self.relaxation.needed():
            warnings.warn(
                f"fluid: unevenly filled, so it is relaxed before the first step ({SHIFTS} shifts)", stacklevel=3
            )
            for _ in range(SHIFTS):
                self.relaxation.move()
                self.neighbors.search()

    def set_problem(self, problem) -> None:
        """Go on with the materials of another problem of the same law and geometry; what is compiled stays."""
        self.constants.set_problem(problem)

    def time_step_limits(self, speeds) -> dict[str, float]:
        """Largest allowed steps [s] by name: what resolves the flow, and the Courant number."""
        limits = {"maximum": self.constants.longest_at(speeds)}
        if speeds.speed > 0.0:
            limits["Courant"] = self.numerics.courant_number * self.spacing / speeds.speed
        return limits

    def look(self) -> None:
        """Before it is read: after a step that was not taken by all, what they carry is made that of all."""
        if not self.taken_by_all:
            self.active_set.recall()
            self.neighbors.search()
            self.gradient.build()
            self.stress.find_yielded()
            self.wall_loads.known, self.active_set.whole = False, True

    @property
    def taken_by_all(self) -> bool:
        """Whether all particles took part in the last step."""
        return self.active_set.whole

    @property
    def left_out(self) -> float:
        """Part of the particles that stood still and were left out, mean of all steps [-]."""
        return self.active_set.mean_part_left_out

    def fields_to_read(self, count: int) -> dict:
        """What of the first ``count`` rows is read of a step, besides what the particles carry."""
        self.pressure.read()
        return self._to_read.read(count) | self.wall_loads.read(count)

    def state(self) -> dict:
        """Scalars the scheme carries from step to step."""
        return {"first": self.first} | self.active_set.state()

    def load(self, state: dict) -> None:
        """Go on from a state."""
        self.wall_loads.known = False
        self.first = state["first"]
        self.active_set.load(state)


def may_stand(problem, particles, walls) -> bool:
    """Whether a part of the fluid may stand still while the rest flows, and it pays to leave that out: of true yield
    stress, in rows enough, in front of walls that hold all that touches them."""
    if problem.numerics.sleep == "off" or (problem.numerics.sleep == "auto" and particles.capacity < FEW):
        return False
    loose = any(wall.unilateral for wall in walls.surfaces)
    stands = problem.law == "bingham" and problem.rests and not particles.has_walls and not particles.axisymmetric
    return stands and not loose
