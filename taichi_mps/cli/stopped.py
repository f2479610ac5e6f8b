"""Signals that end the program, turned into an exception from its start on, so that no file is left incomplete."""

import os
import signal
import stat
import sys
import time
from contextlib import suppress

HANG_UP = getattr(signal, "SIGHUP", None)  # of a terminal that is closed; Windows has none
BREAK = getattr(signal, "SIGBREAK", None)  # Ctrl-Break, which Windows alone has, and by which its page stops a run
SIGNALS = [number for number in (signal.SIGINT, signal.SIGTERM, HANG_UP, BREAK) if number is not None]
program_start: list[float] = []  # start of the program, if this process is it, by time.monotonic [s]
received: list[int] = []  # signals received before a run handled them itself


class Stopped(KeyboardInterrupt):
    """Exception for Ctrl-C (SIGINT), Ctrl-Break, SIGTERM or SIGHUP, with the ``number`` of the signal."""

    def __init__(self, number: int):
        super().__init__(number)
        self.number = number


def handle(stop) -> dict:
    """Set a handler of SIGNALS, and return those before by signal; under nohup SIGHUP stays ignored."""
    return {
        number: signal.signal(number, stop)
        for number in SIGNALS
        if number != HANG_UP or signal.getsignal(number) != signal.SIG_IGN
    }


def leave_terminal() -> None:
    """Ignore further SIGHUP, which the shell sends beside the system, and let nothing print on a terminal that is
    gone, which would be an error."""
    signal.signal(HANG_UP, signal.SIG_IGN)
    for stream in (1, 2):
        with suppress(OSError):  # it was closed from the start
            if stat.S_ISCHR(os.fstat(stream).st_mode) and not os.isatty(stream):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream)


def listen() -> None:
    """Let the signals raise Stopped in the main thread."""

    def stop(number, frame):
        if number == HANG_UP:
            leave_terminal()
        received.append(number)
        raise Stopped(number)

    program_start.append(time.monotonic())
    handle(stop)
    hook = sys.unraisablehook  # a callback of the import system may swallow Stopped and print it; ``received`` keeps it
    sys.unraisablehook = lambda lost: None if isinstance(lost.exc_value, Stopped) else hook(lost)
