"""Team of threads that execute one kernel together with barriers, cheaper than starting each loop on all threads.

To hand a loop over to the threads of the processor takes Taichi 15 to 70 microseconds, and an iteration of a solve has
a dozen of loops. In a team each thread does its part of every loop and then waits at a barrier, polling a number, until
the others are as far: a third of a microsecond. The barrier does not wait for threads that have not arrived yet: they
join at the next round.

Loops of a team stage run from ``first(n)`` to ``last(n)`` instead of from 0 to n, and are followed by ``wait()``; code
for one member alone stands under ``if leads()``. Outside a team ``first(n)`` is 0, ``last(n)`` is n, and ``wait()``
does nothing. So an algorithm is written once for one thread and for a team."""

from types import SimpleNamespace

from .backend import compiled_now, for_kernels, ti

ITERATIONS_PER_THREAD = 512  # least number of iterations of a loop that Taichi gives to one thread
ROWS_PER_MEMBER = 1000  # rows for which another member costs less than its waits
JOIN_POLLS = 20_000  # polls for other members before the first round: some 100 microseconds
MAX_POLLS = 100_000  # polls of a wait, beyond which it is late
MAX_LATE_WAITS = 3  # late waits after which one thread continues alone
SOLO_KERNELS = 60  # kernels in which it then works alone: some three steps
CLOSED = -1  # value of ``admitted`` after the last round


@ti.func
def poll(number: ti.template()):
    """Read a field that other threads write, by an atomic operation: LLVM would otherwise read it only once."""
    return ti.atomic_max(number[None], CLOSED)


@ti.data_oriented
class ThreadTeam:
    """Team of threads of one kernel, which calls

        team.open(rows)
        for iteration in range(team.iterations):
            member = team.join(iteration)
            if member >= 0:
                enter(team, member); [the work: rounds, each ended by barrier()]
                team.close()

    A member does the iterations of a loop over n from ``first`` to ``last``, then it waits. The number of members
    differs from round to round: results must not depend on it, and data that a round needs from the one before must be
    in fields.
    """

    def __init__(self, threads: int):
        self.threads, self.iterations = threads, ITERATIONS_PER_THREAD * threads
        (
            self.wanted,  # threads wanted
            self.joined,  # threads that have joined
            self.size,  # members of this round
            self.admitted,  # members that may begin; CLOSED after the last round
            self.arrived,  # members that wait at the barrier
            self.barriers_passed,  # number of barriers passed
            self.max_polls,  # polls beyond which a wait is late
            self.late_waits,  # number of late waits
            self.solo_kernels,  # remaining kernels in which one thread works alone
            self.founder_count,  # members of the first round, 0 before
        ) = (ti.field(ti.i32, ()) for _ in range(10))

    @ti.func
    def open(self, rows):
        """Prepare the team for a system of ``rows`` rows."""
        self.solo_kernels[None] = ti.max(0, self.solo_kernels[None] - 1)
        self.wanted[None] = (
            1 if self.solo_kernels[None] > 0 else ti.max(1, ti.min(self.threads, rows // ROWS_PER_MEMBER))
        )
        self.joined[None], self.size[None], self.admitted[None] = 0, 1, 1
        self.arrived[None], self.barriers_passed[None], self.founder_count[None], self.late_waits[None] = 0, 0, 0, 0
        self.max_polls[None] = MAX_POLLS + 10 * rows  # a loop takes some 100 nanoseconds a row, a poll 5 or more

    @ti.func
    def join(self, iteration):
        """Join the team: number of the member that the thread of this iteration becomes, or -1."""
        member = -1
        if iteration % ITERATIONS_PER_THREAD == 0:
            member = ti.atomic_add(self.joined[None], 1)
            if member == 0:
                looks = 0
                while looks < JOIN_POLLS and poll(self.joined) < self.wanted[None]:
                    looks += 1
                self.barrier(member, True)
            else:
                admitted = poll(self.admitted)
                while admitted != CLOSED and admitted <= member and member < poll(self.wanted):
                    admitted = poll(self.admitted)
                if admitted <= member:
                    member = -1
        return member

    @ti.func
    def has_member(self, member):
        return member < self.size[None]

    @ti.func
    def is_led_by(self, member):
        return member == 0

    @ti.func
    def is_founder(self, member):
        return member < self.founder_count[None]

    @ti.func
    def first_iteration(self, member, n):
        size = self.size[None]
        return n // size * member + ti.min(member, n % size)

    @ti.func
    def last_iteration(self, member, n):
        return self.first_iteration(member + 1, n)

    @ti.func
    def barrier(self, _member, ends_round: ti.template()):
        """Wait until all members have arrived. At the end of a round the threads that have joined meanwhile become
        members; after too many late waits, because other processes use the processor, the first member continues alone,
        also in the next SOLO_KERNELS kernels."""
        met, looks = poll(self.barriers_passed), 0
        if ti.atomic_add(self.arrived[None], 1) == self.size[None] - 1:
            if ti.static(ends_round):
                if self.late_waits[None] >= MAX_LATE_WAITS:
                    self.solo_kernels[None], self.wanted[None], self.late_waits[None] = SOLO_KERNELS, 1, 0
                self.size[None] = ti.min(poll(self.joined), self.wanted[None])
                if self.founder_count[None] == 0:
                    self.founder_count[None] = self.size[None]
            self.arrived[None] = 0
            ti.atomic_add(self.barriers_passed[None], 1)
            if ti.static(ends_round):
                ti.atomic_max(self.admitted[None], self.size[None])
        while poll(self.barriers_passed) == met:
            looks += 1
        if looks > self.max_polls[None]:
            ti.atomic_add(self.late_waits[None], 1)

    @ti.func
    def close(self):
        ti.atomic_min(self.admitted[None], CLOSED)


@ti.data_oriented
class GPUThreads:
    """Threads of a GPU that divide each loop among them: the members of a team of ``size``."""

    in_a_block = 128

    def __init__(self, size: int):
        self.size = size

    @ti.func
    def first_iteration(self, thread, n):
        return ti.min(n, thread * ((n + self.size - 1) // self.size))

    @ti.func
    def last_iteration(self, thread, n):
        return self.first_iteration(thread + 1, n)

    @ti.func
    def barrier(self, _thread, _ends_round: ti.template()):
        """No-op: the next loop is started after this one."""


@ti.data_oriented
class Block(GPUThreads):
    """One block of threads of a GPU, which wait for each other."""

    in_a_block = 1024

    def __init__(self):
        super().__init__(self.in_a_block)

    @ti.func
    def barrier(self, _thread, _ends_round: ti.template()):
        ti.simt.block.sync()


# ---- the member whose code is being compiled ------------------------------------------------------------------------
_compiling = SimpleNamespace(kernel=None, team=None, member=None)


@for_kernels
def enter(team, member):
    """Compile the rest of the present kernel for a member of a team, or of none."""
    _compiling.kernel, _compiling.team, _compiling.member = team and compiled_now(), team, member


def _of_member(method, alone, *more):
    """Make a function for kernels: the team's ``method`` for the present member, or ``alone`` outside a team."""

    @for_kernels
    def call(*arguments):
        kernel = compiled_now()
        if kernel is None or kernel is not _compiling.kernel:
            return alone(*arguments)
        return getattr(_compiling.team, method)(_compiling.member, *more, *arguments)

    return call


first = _of_member("first_iteration", lambda n: 0)  # first of n iterations of this member
last = _of_member("last_iteration", lambda n: n)  # iteration after the last one of this member
leads = _of_member("is_led_by", lambda: True)  # whether the member executes the code for one thread
begins = _of_member("is_founder", lambda: True)  # whether the member has been there from the first round
takes_part = _of_member("has_member", lambda: True)  # whether the thread is a member in this round
wait = _of_member("barrier", lambda: None, False)  # barrier within a round
barrier = _of_member("barrier", lambda: None, True)  # barrier at the end of a round, at which members may change
