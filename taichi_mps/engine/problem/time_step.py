"""The rule of the time step of ``implicit``: how long a step may be (I14), plain Python."""

import math
from dataclasses import dataclass

# a slowly varying flow takes steps as long as this many of the scene's own; grains sink 1.5 % more slowly with 8
LONG, LONG_WITH_GRAINS = 2.0, 8.0
# A decaying flow may take steps of this fraction of its decay time, in which its speed falls to 1/e, and a flow that
# starts steps of this fraction of the time so far: backward Euler then resolves the diffusion from the walls
CREEP = 0.1
# a flow varies slowly where its change of velocity moves particles by less than this part of l0 in a step
QUIET = 0.005
# a body at rest takes steps of this fraction of the time for which it has been: a structure that grows to a limit is
# then within 1 % of its growth at all times (a growth that is constant is exact in steps of any length)
AT_REST = 0.05
STILL = 1e-5  # speed over sqrt(gH) below which steps are not longer: each one removes most of the remaining motion


@dataclass(frozen=True)
class Speeds:
    """Speeds of the fluid and the walls, from which the length of a step follows."""

    speed: float  # largest, walls and jets included [m/s]
    acceleration: float  # root mean square, of the last step [m/s2]; infinite before the first
    decay: float = 0.0  # time in which what moves last fell to 1/e of its speed [s]; 0 where it has not fallen
    since: float = math.inf  # time since the start [s]
    at_rest: float = 0.0  # time for which the body has been at rest [s], 0 or less where it is not


def longest_step(
    kinematic_viscosity: float, gravity: float, height: float, spacing: float, times: float = 1.0
) -> float:
    """Longest step [s] that resolves the fall of the body, 0.057 sqrt(H/g), or the viscous flow where that is slower; a
    fluid too thin to damp motion on the scale of a particle needs 0.06 sqrt(l0/g). ``times``: factor for a flow
    without either."""
    fall = 0.057 * (height / gravity) ** 0.5
    damping = kinematic_viscosity / (spacing * (gravity * spacing) ** 0.5)
    return max(
        times * min(fall, 0.06 * (spacing / gravity) ** 0.5 * (1.0 + damping)),
        0.5 * kinematic_viscosity / (gravity * height),
    )


class TimeStep:
    """Longest steps of a problem: ``longest`` of a flow that does not vary slowly, ``slow_step`` of one that
    does, ``natural`` a scale of the scene that does not depend on the steps taken [s]."""

    def __init__(self, problem):
        scene, materials, numerics = problem.scene.expected, problem.scene.materials, problem.numerics
        height, gravity, speed, spacing = problem.height, problem.gravity, problem.speed, scene.spacing
        self.yields = all(m.yields for m in materials)  # whether a decaying flow takes longer steps
        self.limit = numerics.max_time_step or math.inf  # of any step [s]
        longest, slow = (
            min(longest_step(m.typical_slope / m.density, gravity, height, spacing, times) for m in materials)
            for times in (1.0, LONG_WITH_GRAINS if scene.grains else LONG)
        )
        self.falls = (
            self.yields and slow > longest
        )  # whether a yielding fluid falls faster than its viscosity lets it flow
        self.longest = min(longest, self.limit)
        self.slow_step = min(slow if self.falls else longest, self.limit)
        # T [s], in which viscosity, the largest of the mixes, carries a motion through the body
        self.viscous_time = min(m.density / m.typical_slope for m in materials) * height**2
        # limits of a slowly varying flow and of one at rest: change of the velocity times the step [m], velocity [m/s]
        self.max_change, self.min_speed = QUIET * spacing, STILL * (gravity * height + speed**2) ** 0.5
        courant_number = type(numerics).model_fields["courant_number"].default
        self.natural = min(longest, courant_number * spacing / speed) if speed else longest

    def longest_at(self, speeds: Speeds) -> float:
        """Longest step [s] at these speeds: ``longest``, or in a slowly varying flow sqrt(QUIET l0/acceleration), at
        most ``longest_in(decay)``. A body at rest takes AT_REST times the time for which it has been, as long as no
        particle moves by more than QUIET l0 in a step. Until viscous_time at most CREEP times the time so far, or CREEP
        viscous_time where that is more; never above the given limit."""
        longest = self.longest
        if speeds.acceleration * longest**2 < self.max_change and speeds.speed > self.min_speed:
            most = self.longest_in(speeds.decay)
            longest = max(longest, min(most, math.sqrt(self.max_change / max(speeds.acceleration, 1e-30))))
        if speeds.at_rest > 0.0:
            longest = max(longest, min(AT_REST * speeds.at_rest, self.max_change / max(speeds.speed, 1e-30)))
        if speeds.since < self.viscous_time:
            longest = min(longest, CREEP * max(speeds.since, CREEP * self.viscous_time))
        return min(longest, self.limit)

    def longest_in(self, decay: float) -> float:
        """Longest step [s] of a slowly varying flow whose speed falls to 1/e in a ``decay`` [s]."""
        return min(max(self.slow_step, CREEP * decay * self.yields), self.limit)
