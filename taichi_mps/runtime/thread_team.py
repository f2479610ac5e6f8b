"""Threads that go through one kernel side by side and wait for each other, where starting loops costs more.

To hand a loop over to the threads of the processor takes Taichi 15 to 70 microseconds, and an iteration of a solve has
a dozen of loops. In a team each thread does its part of every loop and then waits, looking at a number, until the
others are as far: a third of a microsecond. A thread that has not come yet is not waited for: it joins
at the next round.
"""

from .backend import started, ti
from .stages import alone, few

TURNS = 512  # of a loop that Taichi gives to one thread at least
ROWS = 1000  # that make a member worth its waiting
WELCOME = 20_000  # looks for the others before the first round: some 100 microseconds
PATIENCE = 100_000  # looks for the others that a wait may take
OFTEN = 3  # waits that took more, until one thread goes on alone
REST = 20  # times that it then works alone
CLOSED = -1


@ti.data_oriented
class OneThread:
    """No team: loops are whole, at the top of a kernel or inside of a loop of one thread."""

    together = False

    @ti.func
    def first(self, member, n):
        return 0

    @ti.func
    def last(self, member, n):
        return n

    @ti.func
    def has(self, member):
        return True

    @ti.func
    def wait(self):
        pass

    @ti.func
    def regroup(self):
        pass


ONE_THREAD = OneThread()


@ti.func
def look(number: ti.template()):
    """The number as it is now. LLVM would read it once and for all, but for an atomic operation."""
    return ti.atomic_max(number[None], CLOSED)


@ti.data_oriented
class Team:
    """A kernel that works in a team of threads calls

        team.open(rows)
        for turn in range(team.turns):
            member = team.join(turn)
            if member >= 0:
                while team.has(member) and [there is another round]: [the round]; team.regroup()
                team.close()

    A member does those turns of a loop over n that lie from ``first(member, n)`` to ``last(member, n)``, then it calls
    ``wait``. A loop over one turn is done by one of them. How many they are differs from round to round: results must
    not depend on it, and what a round needs from the one before must be in fields.
    """

    together = True

    def __init__(self, threads: int):
        self.threads, self.turns = threads, TURNS * threads
        numbers = [ti.field(ti.i32, ()) for _ in range(9)]
        self.most, self.joined, self.size = numbers[:3]  # threads wanted; those that have come; members of this round
        self.admitted = numbers[3]  # those who may begin; CLOSED after the last round
        self.here, self.met = numbers[4:6]  # members who wait, and how often all have met
        self.patience, self.late = numbers[6:8]  # looks that a wait should not exceed, and waits that did
        self.rest = numbers[8]  # times yet that one thread works alone

    @ti.func
    def open(self, rows):
        """For a system of so many rows."""
        self.rest[None] = ti.max(0, self.rest[None] - 1)
        self.most[None] = 1 if self.rest[None] > 0 else ti.max(1, ti.min(self.threads, rows // ROWS))
        self.joined[None], self.size[None], self.admitted[None] = 0, 1, 1
        self.here[None], self.met[None], self.late[None] = 0, 0, 0
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
                self.regroup()
            else:
                admitted = look(self.admitted)
                while admitted != CLOSED and admitted <= member and member < look(self.most):
                    admitted = look(self.admitted)
                if admitted <= member:
                    member = -1
        return member

    @ti.func
    def has(self, member):
        return member < self.size[None]

    @ti.func
    def first(self, member, n):
        size = self.size[None]
        return n // size * member + ti.min(member, n % size)

    @ti.func
    def last(self, member, n):
        return self.first(member + 1, n)

    @ti.func
    def wait(self):
        """Until all members are here."""
        met, looks = look(self.met), 0
        if ti.atomic_add(self.here[None], 1) == self.size[None] - 1:
            self.here[None] = 0
            ti.atomic_add(self.met[None], 1)
        while look(self.met) == met:
            looks += 1
        if looks > self.patience[None]:
            ti.atomic_add(self.late[None], 1)

    @ti.func
    def regroup(self):
        """Until all members are here; who has come meanwhile is one of them from now on. Where they had to wait for
        each other too often, because others use the processor, the first goes on alone, the next REST times, too."""
        met = look(self.met)
        if ti.atomic_add(self.here[None], 1) == self.size[None] - 1:
            if self.late[None] >= OFTEN:
                self.rest[None], self.most[None] = REST, 1
            size = ti.min(look(self.joined), self.most[None])
            self.size[None], self.here[None] = size, 0
            ti.atomic_add(self.met[None], 1)
            ti.atomic_max(self.admitted[None], size)
        while look(self.met) == met:
            pass

    @ti.func
    def close(self):
        ti.atomic_min(self.admitted[None], CLOSED)


def team(rows: int) -> Team | OneThread | None:
    """Who works on a system of at most so many rows: a team, or one thread where that is as fast; None on a GPU."""
    if alone() or few(rows):
        return ONE_THREAD
    return Team(started()["threads"]) if started()["arch"] == "cpu" else None
