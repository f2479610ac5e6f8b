"""Threads that go through one kernel side by side and wait for each other, where starting loops costs more.

To hand a loop over to the threads of the processor takes Taichi 15 to 70 microseconds, and an iteration of a solve has
a dozen of loops. In a team each thread does its part of every loop and then waits, looking at a number, until the
others are as far: a third of a microsecond. A thread that has not come yet is not waited for: it joins
at the next round.

Loops of what a team may go through run from ``first(n)`` to ``last(n)`` instead of from 0 to n, and are followed by
``wait()``; what one member does alone stands under ``if leads()``. Outside a team ``first(n)`` is 0, ``last(n)`` is n,
and nobody waits. So an algorithm is written once, and does not know who carries it out.
"""

from types import SimpleNamespace

from .backend import compiled_now, for_kernels, ti

TURNS = 512  # of a loop that Taichi gives to one thread at least
ROWS = 1000  # that make a member worth its waiting
WELCOME = 20_000  # looks for the others before the first round: some 100 microseconds
PATIENCE = 100_000  # looks for the others that a wait may take
OFTEN = 3  # waits that took more, until one thread goes on alone
REST = 60  # kernels in which it then works alone: some three steps
CLOSED = -1


@ti.func
def look(number: ti.template()):
    """Present value of a field that other threads write, read by an atomic operation: LLVM would read it only once."""
    return ti.atomic_max(number[None], CLOSED)


@ti.data_oriented
class ThreadTeam:
    """A kernel that works in a team of threads calls

        team.open(rows)
        for turn in range(team.turns):
            member = team.join(turn)
            if member >= 0:
                enter(team, member); [the work: rounds, each ended by regroup()]
                team.close()

    A member does those turns of a loop over n that lie from ``first`` to ``last``, then it waits. How many they are
    differs from round to round: results must not depend on it, and what a round needs from the one before must be in
    fields.
    """

    def __init__(self, threads: int):
        self.threads, self.turns = threads, TURNS * threads
        (
            self.most,  # threads wanted
            self.joined,  # those that have come
            self.size,  # members of this round
            self.admitted,  # those who may begin; CLOSED after the last round
            self.here,  # members who wait
            self.met,  # how often all have met
            self.patience,  # looks that a wait should not exceed
            self.late,  # waits that did
            self.rest,  # kernels yet in which one thread works alone
            self.founders,  # members of the first round, 0 before
        ) = (ti.field(ti.i32, ()) for _ in range(10))

    @ti.func
    def open(self, rows):
        """Prepare the team for a system of so many rows."""
        self.rest[None] = ti.max(0, self.rest[None] - 1)
        self.most[None] = 1 if self.rest[None] > 0 else ti.max(1, ti.min(self.threads, rows // ROWS))
        self.joined[None], self.size[None], self.admitted[None] = 0, 1, 1
        self.here[None], self.met[None], self.founders[None], self.late[None] = 0, 0, 0, 0
        self.patience[None] = PATIENCE + 10 * rows  # a loop takes some 100 nanoseconds a row, a look 5 or more

    @ti.func
    def join(self, turn):
        """Number of the member that the thread of this turn is, or -1."""
        member = -1
        if turn % TURNS == 0:
            member = ti.atomic_add(self.joined[None], 1)
            if member == 0:
                looks = 0
                while looks < WELCOME and look(self.joined) < self.most[None]:
                    looks += 1
                self.meet(member, True)
            else:
                admitted = look(self.admitted)
                while admitted != CLOSED and admitted <= member and member < look(self.most):
                    admitted = look(self.admitted)
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
    def founded_by(self, member):
        return member < self.founders[None]

    @ti.func
    def first_turn(self, member, n):
        size = self.size[None]
        return n // size * member + ti.min(member, n % size)

    @ti.func
    def last_turn(self, member, n):
        return self.first_turn(member + 1, n)

    @ti.func
    def meet(self, _member, ends_round: ti.template()):
        """Wait until all members are here. At the end of a round who has come meanwhile is one of them from now on;
        where they had to wait for each other too often, because others use the processor, the first goes on alone, in
        REST more kernels, too."""
        met, looks = look(self.met), 0
        if ti.atomic_add(self.here[None], 1) == self.size[None] - 1:
            if ti.static(ends_round):
                if self.late[None] >= OFTEN:
                    self.rest[None], self.most[None], self.late[None] = REST, 1, 0
                self.size[None] = ti.min(look(self.joined), self.most[None])
                if self.founders[None] == 0:
                    self.founders[None] = self.size[None]
            self.here[None] = 0
            ti.atomic_add(self.met[None], 1)
            if ti.static(ends_round):
                ti.atomic_max(self.admitted[None], self.size[None])
        while look(self.met) == met:
            looks += 1
        if looks > self.patience[None]:
            ti.atomic_add(self.late[None], 1)

    @ti.func
    def close(self):
        ti.atomic_min(self.admitted[None], CLOSED)


# ---- who goes through the code that is being compiled ---------------------------------------------------------------
_here = SimpleNamespace(kernel=None, team=None, member=None)


@for_kernels
def enter(team, member):
    """From here on the kernel that is being compiled is gone through by the members of a team."""
    _here.kernel, _here.team, _here.member = compiled_now(), team, member


def _of_member(method, alone, *more):
    """Function for kernels: the team's method with the member that continues there, or the single thread's
    counterpart."""

    @for_kernels
    def call(*arguments):
        kernel = compiled_now()
        if kernel is None or kernel is not _here.kernel:
            return alone(*arguments)
        return getattr(_here.team, method)(_here.member, *more, *arguments)

    return call


first = _of_member("first_turn", lambda n: 0)  # of n turns that are done here
last = _of_member("last_turn", lambda n: n)  # the turn after the last one that is done here
leads = _of_member("is_led_by", lambda: True)  # whether the thread does what one alone has to do
begins = _of_member("founded_by", lambda: True)  # whether the thread is here from the beginning, or joined late
takes_part = _of_member("has_member", lambda: True)  # whether the thread is of the team in this round
wait = _of_member("meet", lambda: None, False)  # until the whole team has done its part
regroup = _of_member(
    "meet", lambda: None, True
)  # the end of a round: who has come meanwhile takes part in the next one
