"""The default scheme: viscosity, pressure and yield stress in one implicit system per step (I1-I30).

The step is that of an augmented Lagrangian at the middle of the step: after half of the drift the neighbours are found
and a system for the velocity is assembled; Uzawa's iterations solve it in turn with the stress and the pressure, which
are its multipliers; then the particles are shifted and drift the other half.
"""

import inspect
import warnings

from ..particles.active_set import FULL_STEP_INTERVAL, MIN_EXCLUDED_FRACTION, ActiveSet
from ..particles.pair_sums import PairSums
from ..particles.particles import Carried
from ..runtime.field_io import FieldIO
from ..runtime.stages import ONE_THREAD_BELOW_ROWS, NoOp, repeat
from ..terms.constants import Constants
from ..terms.contact import Contacts
from ..terms.hourglass import DeferredCorrection, HourglassResistance
from ..terms.interface import Interface
from ..terms.momentum import MomentumOperator, MomentumSource, VelocitySolve
from ..terms.momentum_drift import MomentumDrift, free_directions
from ..terms.motion import Motion
from ..terms.pressure import FULL_STRAIN, Pressure, VolumeConstraint
from ..terms.residuals import Residuals
from ..terms.rigid import Rigid
from ..terms.shifting import RELAXATION_SHIFTS, Shifting, is_uneven
from ..terms.standstill import Standstill
from ..terms.strain_rate import SolvedRate, StrainRate
from ..terms.stress import Stress
from ..terms.wall_forces import WallFriction, WallLoads
from ..terms.wall_stress import WallStress, no_force
from .diagnostics import Diagnostics
from .scheme import Scheme

FIRST_ITERATIONS = 40  # of the first step, whose pressure and stress start from zero
# of the first step without a yield stress, with mu_r: the pressure comes first, or its strain stays as stress in a plug
VISCOUS_ITERATIONS = 10


class ImplicitScheme(Scheme):
    """Implicit coupled scheme for fluids by any flow curve, several at once, in two or three dimensions."""

    REMEDY = "lower max_time_step or courant_number, or use precision f64"

    def __init__(self, problem, to_come: int, pairs_per_particle: float):
        super().__init__(problem, carried(problem), to_come, pairs_per_particle)
        scene, fluid, walls = problem.scene, self.fluid, self.fluid.walls
        self.constants = Constants(
            fluid.particles, problem, fluid.gradient, fluid.gravity, fluid.twist, problem.may_be_full(to_come)
        )
        self.sums = PairSums(fluid.particles, fluid.gradient, walls)
        # which terms the scene needs: the stages of the others do nothing
        several, holds = len(problem.scene.materials) > 1, any(not wall.slip for wall in walls.surfaces)
        directions = free_directions(scene, problem.numerics.walls)
        drifts = directions.any()
        # in a step the matrix changes with a viscosity that depends on the velocity, and with the friction of walls
        self.assembles_again = problem.law == "bi-viscosity"
        continues = not (self.assembles_again or walls.have_friction)

        self.rigid = NoOp("drift", "find", "project", "keep", "enter")
        self.contacts = NoOp(
            "find", "check", "load", "update", "change_residual", "end_step", "add_loads", "load_state", state=dict
        )
        if scene.grains:
            self.rigid = self.term(Rigid, problem=problem)
            self.contacts = self.term(Contacts, grains=scene.grains)
        self.pressure = self.term(Pressure)
        self.strain_rate = self.term(StrainRate)
        self.solved_rate = self.term(SolvedRate)
        self.interface = self.term(Interface) if several else NoOp("find_normals", "gather")
        self.stress = self.term(Stress, problem=problem)
        self.resistance = self.term(HourglassResistance)
        self.correction = self.term(DeferredCorrection, averages=self.stress.averages)
        self.wall_stress = (
            self.term(WallStress) if holds else NoOp("set_driving_force", "update_weight", force=no_force)
        )
        self.shifting = self.term(Shifting, shifts_in_tension=problem.law == "newtonian")
        self.constraint = self.term(VolumeConstraint, pours=bool(scene.inlets))
        self.residuals = self.term(Residuals)
        self.operator = self.term(MomentumOperator)
        self.source = self.term(MomentumSource)
        self.velocity = self.term(VelocitySolve, continues=continues)
        self.friction = self.term(WallFriction) if walls.have_friction else NoOp("set_initial_slip", "update_slip")
        self.wall_loads = NoOp("evaluate", read=lambda _count: {}, numbers=())
        if problem.wall_loads:
            first = len(walls.surfaces) - len(scene.walls)  # the axis of rings comes before the walls of the scene
            self.wall_loads = self.term(WallLoads, measured=[first + k for k in scene.measured_walls.values()])
        self.momentum_drift = NoOp("restore")
        if drifts:
            turns = not (scene.walls or scene.jolts or any(scene.periodic or ()) or scene.grains)
            self.momentum_drift = self.term(MomentumDrift, directions=directions, turns=turns)
        self.motion = self.term(Motion)
        self.active_set = NoOp(  # all particles take part in every step
            "end_step",
            "reactivate",
            "load",
            search=lambda is_read: fluid.neighbors.search(),
            state=dict,
            is_full_step=True,
            left_out=0,
            mean_part_left_out=0.0,
            rest_fraction=0.0,
        )
        if may_stand(problem, fluid.particles, walls) and not drifts:
            ahead = FULL_STEP_INTERVAL * self.numerics.courant_number * scene.spacing
            self.active_set = ActiveSet(fluid.neighbors, self.term(Standstill, problem=problem, ahead=ahead))
        # friction is found together with the stress
        self.viscous_iterations = 0 if walls.have_friction else VISCOUS_ITERATIONS
        self.first = True  # whether the next step is the first one, or that of a jolt
        self.field_io = FieldIO({"yielded": self.stress.yielded, "p": self.pressure.p}, fluid.particles.capacity)
        self.diagnostics = Diagnostics(
            fluid, self.constants, self.stress.yielded, self.velocity.solver, self.velocity.iterations, self.residuals
        )

    def term(self, kind, **numbers):
        """Make a term of a kind from what its constructor names: the ``numbers``, the fluid, the constants, and the
        terms made before it."""
        known = vars(self) | numbers
        return kind(**{name: known[name] for name in inspect.signature(kind).parameters})

    def step(self, dt: float, is_read: bool = False):
        """Take a step of dt [s], whose result is read or not (``is_read``)."""
        u, first = self.velocity.velocity, int(self.first)
        iterations, viscous = max(first * FIRST_ITERATIONS, self.numerics.passes), first * self.viscous_iterations
        self.constants.set_time_step(dt)
        self.fluid.walls.move_to_middle(dt)
        self.motion.drift(dt)
        self.rigid.drift(0.5 * dt)
        self.active_set.search(is_read)
        self.fluid.gradient.build()
        self.rigid.find()
        self.contacts.find(dt)
        self.predict(dt, first)
        self.constrain_volume(dt)
        self.assemble(dt)
        self.motion.guess(dt, u)
        self.rigid.project(u)
        if self.numerics.outer_tolerance:
            iterations = self.iterate_until_met(iterations, dt, viscous, u)
        else:
            for k in repeat(iterations):
                self.iterate(k, iterations, dt, viscous, u)
            self.residuals.measure()
        self.wall_loads.evaluate(u)
        self.contacts.add_loads(self.wall_loads)
        self.shifting.compute(dt, FULL_STRAIN, 0.0)
        if self.shifting.shifts_in_tension:
            self.shifting.remove_mean_shift(dt, FULL_STRAIN)
        self.momentum_drift.restore(dt, u)
        self.fluid.walls.move_to_end(dt)
        self.stress.advance(dt, u)
        self.pressure.keep()
        self.motion.advance(dt, u, first)
        self.contacts.end_step()
        self.rigid.keep(u)
        self.rigid.drift(0.5 * dt)
        self.first = False
        report = self.diagnostics.report(dt, iterations, self.active_set.left_out)
        self.contacts.check()
        self.active_set.end_step(dt)
        return report

    # ---- its parts, stages in their order --------------------------------------------------------------------------
    def predict(self, dt, first):
        """Set pressure, viscosity and resistances from the last velocity, and the correction of the resistances."""
        self.pressure.find_surface(int(self.active_set.is_full_step and self.constants.may_be_full), first)
        self.pressure.smooth(dt)
        self.friction.set_initial_slip(dt)
        self.wall_stress.set_driving_force()
        self.strain_rate.evaluate(dt)
        self.stress.set_viscosity()
        self.interface.find_normals()
        self.interface.gather(self.stress.fluidity)
        self.resistance.set(dt, first)
        self.correction.gather(self.constants.deferred_fraction(dt))

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

    def iterate(self, k, iterations, dt, viscous, u):
        """Iteration k of the augmented Lagrangian (Uzawa), of so many."""
        self.source.evaluate(self.velocity.solver)
        self.contacts.load(self.velocity.solver.b)
        self.velocity.solve(k, iterations, self.numerics.tolerance, self.constants.early)
        self.update_multipliers(k, viscous, u)
        if self.assembles_again:
            self.assemble(dt)

    def iterate_until_met(self, max_iterations, dt, viscous, u) -> int:
        """Iterate until the residuals are below ``outer_tolerance`` after a solve down to its own tolerance, which
        comes as soon as they are after one of the others; return how often, at most ``max_iterations``."""
        k, met, last = 0, False, False
        while k < max_iterations and not (met and last):
            last = k + 1 == max_iterations or (met and k > viscous)
            self.iterate(k, k + 1 if last else max_iterations, dt, viscous, u)
            self.residuals.measure()
            met = max(self.residuals.read()) <= self.numerics.outer_tolerance
            k += 1
        self.unmet += not met
        return k

    def update_multipliers(self, k, viscous, u):
        """Stress, pressure and friction from the velocity u."""
        self.solved_rate.evaluate(u)
        self.stress.map_to_yield_surface(k, viscous)
        self.interface.gather(self.stress.fluidity)
        self.pressure.update_multiplier(self.solved_rate, self.constraint)
        self.friction.update_slip(u)
        self.wall_stress.update_weight()
        self.contacts.update(u)
        solver = self.velocity.solver
        self.contacts.change_residual(solver.first_x, solver.first_r)
        self.contacts.change_residual(u, solver.r)

    # ---- around the step ------------------------------------------------------------------------------------
    def relax(self) -> None:
        """Relax an unevenly filled body before the first step, with a warning."""
        self.fluid.neighbors.search()
        if is_uneven(self.fluid):
            warnings.warn(
                f"fluid: unevenly filled, so it is relaxed before the first step ({RELAXATION_SHIFTS} shifts)",
                stacklevel=3,
            )
            for _ in range(RELAXATION_SHIFTS):
                self.fluid.gradient.build()
                self.shifting.compute(0.0, 1.0, 1.0)
                self.shifting.shift_particles()
                self.fluid.neighbors.search()

    def set_forces(self, scene, start: float, dt: float) -> None:
        """Set gravity and the velocities of walls for a step of dt [s] from a time [s]; where they change, particles at
        rest become active."""
        super().set_forces(scene, start, dt)
        if any(part.changes(start) for part in scene.in_time):
            self.active_set.reactivate()
        if scene.jolts_at(start):  # pressure and stress are found anew, as in the first step
            self.first = True

    def set_problem(self, problem) -> None:
        """Set the materials of another problem of the same law and geometry, without compiling anew."""
        self.constants.set_problem(problem)

    def time_step_limits(self, speeds) -> dict[str, float]:
        """Largest allowed steps [s] by name: what resolves the flow, and the Courant number."""
        return {"maximum": self.constants.time_step.longest_at(speeds)} | super().time_step_limits(speeds)

    def complete_fields(self) -> None:
        """Complete the fields before they are read, after a step in which not all particles took part."""
        if not self.all_active:
            self.active_set.restore_all()
            self.fluid.neighbors.search()
            self.fluid.gradient.build()
            self.stress.find_yielded()
            self.wall_loads.up_to_date, self.active_set.is_full_step = False, True

    @property
    def all_active(self) -> bool:
        """Whether all particles took part in the last step."""
        return self.active_set.is_full_step

    @property
    def may_leave_out(self) -> bool:
        """Whether the next step may leave out particles at rest."""
        return self.active_set.rest_fraction >= MIN_EXCLUDED_FRACTION

    @property
    def left_out(self) -> float:
        """Fraction of the particles that stood still and were left out, mean of all steps [-]."""
        return self.active_set.mean_part_left_out

    def fields_to_read(self, count: int) -> dict:
        """Fields of a step, of the first ``count`` rows, that are read besides those that the particles carry."""
        self.pressure.smooth_for_output()
        return super().fields_to_read(count) | self.wall_loads.read(count)

    def state(self) -> dict:
        """Scalars the scheme carries from step to step."""
        return {
            "first": self.first,
            "unmet": self.unmet,
            "full": self.pressure.full[None],
            **self.active_set.state(),
            **self.contacts.state(),
        }

    def load(self, state: dict) -> None:
        """Load the scalars of a saved state."""
        self.wall_loads.up_to_date = False
        self.first, self.unmet = state["first"], state.get("unmet", 0)
        self.pressure.full[None] = state.get("full", 0)
        self.active_set.load(state)
        self.contacts.load_state(state)


def carried(problem) -> dict[str, Carried]:
    """Fields that particles carry from step to step, by the law and the mixes of a problem."""
    fields = {"a": Carried("acceleration of the last step", "m/s2", "vector")}
    several = len(problem.scene.materials) > 1
    if problem.scene.grains:
        fields["slot"] = Carried("place among the particles of grains, from 1; 0 of mortar", "-", "integer")
    if several:
        fields["mix"] = Carried("number of the mix", "-", "integer")
    if problem.law == "yield-stress":
        fields["stress"] = Carried("deviatoric stress, at most tau_y where rigid", "Pa", "tensor")
        fields["plastic_rate"] = Carried("deviatoric rate q of the yield law", "1/s", "tensor")
        if several:
            fields["fluidity"] = Carried("shear rate of the particle's own mix over its stress", "1/(Pa s)")
    if any(material.ages for material in problem.scene.materials):
        fields["structure"] = Carried("structure of a thixotropic material", "-")
    return fields


def may_stand(problem, particles, walls) -> bool:
    """Whether a part of the fluid may stand still while the rest flows and be left out of a step: with a true yield
    stress, with enough particles, and without unilateral walls."""
    if (
        problem.numerics.sleep == "off"
        or problem.scene.grains
        or (problem.numerics.sleep == "auto" and particles.capacity < ONE_THREAD_BELOW_ROWS)
    ):
        return False
    return (
        problem.law == "yield-stress"
        and problem.rests
        and not particles.has_walls
        and not particles.axisymmetric
        and not any(wall.unilateral for wall in walls.surfaces)
    )
