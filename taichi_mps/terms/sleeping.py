"""Sleep: particles that have come to rest, with all their neighbours, are left out of the solve.

A particle is at rest while it is slower than SLOW spacings per window (0.2 s, or eta/tau_y if longer). Once it and all
its neighbours have been so for that long they sleep: their velocity is zero, not an unknown. Those that touch an awake
one still carry stress and follow the yield law; if they yield, they wake. Every EVERY-th step all are awake, and what
then moves stays so. Only a true yield value brings particles to rest.
"""

from ..particles.particles import FLUID
from ..runtime.backend import ti
from ..runtime.stages import stage

SLOW = 0.02  # spacings per window: what would wake was moving by less than this
EVERY = 10  # steps from one in which all are awake to the next
ASLEEP, BORDER, AWAKE = 0, 1, 2


@ti.data_oriented
class Sleeping:
    """Which particles sleep in the present step."""

    def __init__(self, particles, neighbors, spacing: float, window: float):
        self.particles, self.neighbors = particles, neighbors
        self.window = window  # [s]
        self.slow = SLOW * spacing / window  # [m/s]
        self.state = ti.field(ti.i32, particles.capacity)  # ASLEEP, BORDER (has an awake neighbour) or AWAKE
        self.steps = 0

    def begin(self) -> bool:
        """Begin a step: whether all are awake in it."""
        self.steps += 1
        return self.steps % EVERY == 0

    @ti.func
    def rests(self, i):
        return self.particles.kind[i] != FLUID or self.particles.still[i] >= self.window

    @stage
    def rouse(self, everybody: ti.i32):
        """Find who sleeps in this step: nobody if ``everybody`` is to be awake."""
        for i in range(self.particles.count[None]):
            state = ti.select(self.rests(i) and everybody == 0, ASLEEP, AWAKE)
            for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                if not self.rests(self.neighbors.column[k]):
                    state = AWAKE
            self.state[i] = state
        for i in range(self.particles.count[None]):
            if self.state[i] == ASLEEP:
                for k in range(self.neighbors.row_start[i], self.neighbors.row_start[i + 1]):
                    if self.state[self.neighbors.column[k]] == AWAKE:
                        self.state[i] = BORDER

    @ti.func
    def count_rest(self, i, dt, speed, yields):
        """Time at rest of particle i [s] after a step of dt [s]."""
        awake = yields and self.state[i] == BORDER
        self.particles.still[i] = ti.select(speed < self.slow and not awake, self.particles.still[i] + dt, 0.0)
