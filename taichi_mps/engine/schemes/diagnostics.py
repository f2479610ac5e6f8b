"""Sums over the fluid and the status of the last solve, for the report of a step and the stop rules.

All at once: to read a number from Python takes 7 microseconds, with all the others in one kernel next to nothing.
"""

import math

import numpy as np

from ..linear.pcg import FAILED, STATUS
from ..particles.particles import FLUID
from ..runtime.backend import ti
from ..runtime.stages import flush
from ..runtime.sums import sum_threads
from .step_report import StepReport

SPEED2_IF_NOT_FINITE = 1e12  # squared speed [m2/s2] that replaces one that is not finite
MAX_LOST_FRACTION = 0.2  # of the volume; impacts and thin films lose up to 0.05 (docs/stability.md)
# places of the sums over the fluid; v: the velocity in the frame, enclosed: particles with a full neighbourhood, many:
# those with many neighbours, for in pairs or clumps they have a large surface normal and would pass for a surface
NUMBER, MAX_U2, V, V_U2, V_V4, M_U2, UNYIELDED, PACKING, ENCLOSED, PACKING_MANY, MANY, V_A2, FLOWING, V_V2 = range(14)
SUMS, SOLVE, RESIDUALS = V_V2 + 1, 3, 3
PACKING_SUMS = [PACKING, ENCLOSED, PACKING_MANY, MANY]  # from which the volume error follows


@ti.data_oriented
class Diagnostics:
    """Sums over the fluid particles of one scheme, and its solve."""

    def __init__(self, fluid, material, yielded, solver, iterations, residuals=None):
        """``material`` has density_of(i) and flows(i, rate); ``iterations``: a field with all those of a step;
        ``residuals``: those of the outer iterations, of a scheme that has them (terms/residuals.py)."""
        self.particles, self.gradient, self.material = fluid.particles, fluid.gradient, material
        self.yielded, self.solver, self.iterations, self.residuals = yielded, solver, iterations, residuals
        self.frame = fluid.frame  # (problem.py) [m/s]
        self.accelerates, self.threads = "a" in fluid.particles.carried, sum_threads()
        self.nearly_all = 0.9 * fluid.lattice.neighbours
        # sums, iterations of the step, of the last solve (r, z) over its reference and its status, residuals
        self.numbers = np.zeros(SUMS + SOLVE + RESIDUALS)
        self.packing = np.zeros(len(PACKING_SUMS))  # of the last step of all
        self.enclosed = 0.0  # part of the volume that has a full neighbourhood, from which the volume error is read [-]
        self.lost_volume = 0.0  # [m3]: negative where the fluid has become looser
        self.solve_status = ""  # of the last solve

    def report(self, dt: float, iterations: int, left_out: int = 0) -> StepReport:
        """Report of a step of dt [s] with a given number of outer iterations; the caller sets its number and time.
        Particles that were ``left_out`` count as standing still, and the packing as it was with them."""
        flush()
        self.numbers[:] = 0.0
        self._add(self.numbers)
        if left_out:
            self.numbers[[NUMBER, UNYIELDED]] += left_out
            self.numbers[V] += left_out * self.particles.usual_volume
            self.numbers[PACKING_SUMS] = self.packing
        else:
            self.packing = self.numbers[PACKING_SUMS]
        numbers = self.numbers.tolist()
        volume, enclosed, many = numbers[V], numbers[ENCLOSED], numbers[MANY]
        solves, ratio, status = numbers[SUMS:-RESIDUALS]
        self.enclosed = enclosed / volume if volume else 0.0
        self.lost_volume = many - many**2 / numbers[PACKING_MANY] if many else 0.0
        self.solve_status = STATUS[int(status)]
        residuals = self.residuals.of(numbers[-RESIDUALS:]) if self.residuals else (math.nan, math.nan)
        return StepReport(
            step=0,
            time=0.0,
            dt=dt,
            dt_limit="",
            max_speed=math.sqrt(numbers[MAX_U2]),
            mean_speed=math.sqrt(numbers[V_U2] / volume) if volume else 0.0,
            moving_speed=math.sqrt(numbers[V_V4] / numbers[V_V2]) if numbers[V_V2] else 0.0,
            acceleration=math.sqrt(numbers[V_A2] / volume) if volume else 0.0,
            kinetic_energy=0.5 * numbers[M_U2],
            unyielded_fraction=numbers[UNYIELDED] / numbers[NUMBER],
            flowing_fraction=numbers[FLOWING] / volume if volume else 0.0,
            outer_iterations=iterations,
            solver_iterations=int(solves),
            residual=abs(ratio) ** 0.5,
            strain_rate_residual=residuals[0],
            divergence_residual=residuals[1],
            volume_error=enclosed / numbers[PACKING] - 1.0 if enclosed else 0.0,
        )

    def failure(self, report: StepReport, runaway_speed: float, volume: float) -> str | None:
        """Limit that a step has crossed, beyond which its numbers mean nothing: a velocity that is no number, a speed
        over ``runaway_speed`` [m/s], a fifth of the ``volume`` [m3] lost, a matrix that is not positive definite."""
        if report.max_speed >= math.sqrt(SPEED2_IF_NOT_FINITE):
            return "a velocity is not a finite number"
        if report.max_speed > runaway_speed:
            return f"a speed of {report.max_speed:.4g} m/s, over {runaway_speed:.4g} m/s, is a runaway"
        if self.lost_volume > MAX_LOST_FRACTION * volume:
            lost = self.lost_volume / volume
            return f"{lost:.0%} of the volume is lost, over {MAX_LOST_FRACTION:.0%}: particles overlap"
        if self.solve_status in FAILED:
            return f"the matrix of the linear solve is {self.solve_status}"
        return None

    @ti.kernel
    def _add(self, sums: ti.types.ndarray(ti.f64, 1)):
        ti.loop_config(serialize=self.threads == 1)
        for thread in range(self.threads):
            lane_sums = ti.Vector.zero(ti.f64, SUMS)
            for k in range((self.particles.count[None] - thread + self.threads - 1) // self.threads):
                i = thread + k * self.threads
                if self.particles.kind[i] == FLUID:
                    volume = ti.cast(self.particles.volume(i), ti.f64)
                    u2 = ti.cast(self.particles.u[i].norm_sqr(), ti.f64)
                    if not (u2 < SPEED2_IF_NOT_FINITE):
                        u2 = SPEED2_IF_NOT_FINITE
                    lane_sums[NUMBER] += 1
                    lane_sums[MAX_U2] = ti.max(lane_sums[MAX_U2], u2)
                    lane_sums[V] += volume
                    lane_sums[V_U2] += volume * u2
                    v2 = ti.cast((self.particles.u[i] - ti.Vector(self.frame, dt=float)).norm_sqr(), ti.f64)
                    if not (v2 < SPEED2_IF_NOT_FINITE):
                        v2 = SPEED2_IF_NOT_FINITE
                    lane_sums[V_V4] += volume * v2 * v2
                    lane_sums[V_V2] += volume * v2
                    lane_sums[M_U2] += volume * u2 * self.material.density_of(i)
                    lane_sums[UNYIELDED] += 1 - self.yielded[i]
                    if self.gradient.enclosed(i):
                        lane_sums[PACKING] += volume * self.gradient.packing[i]
                        lane_sums[ENCLOSED] += volume
                    if self.gradient.neighbour_count[i] >= self.nearly_all:
                        lane_sums[PACKING_MANY] += volume * self.gradient.packing[i]
                        lane_sums[MANY] += volume
                    if ti.static(self.accelerates):
                        lane_sums[V_A2] += volume * ti.cast(self.particles.a[i].norm_sqr(), ti.f64)
                    if self.material.flows(i, self.particles.shear_rate[i]):
                        lane_sums[FLOWING] += volume
            for n in ti.static(range(SUMS)):
                if ti.static(n == MAX_U2):
                    ti.atomic_max(sums[n], lane_sums[n])
                else:
                    sums[n] += lane_sums[n]
        sums[SUMS] = self.iterations[None]
        if self.solver.reference[None] != 0.0:
            sums[SUMS + 1] = self.solver.rz[None] / self.solver.reference[None]
        sums[SUMS + 2] = self.solver.status[None]
        if ti.static(bool(self.residuals)):
            for n in ti.static(range(RESIDUALS)):
                sums[SUMS + SOLVE + n] = self.residuals.sums[None][n]
