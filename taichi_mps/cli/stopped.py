"""Signals that end the program, turned into an exception from its start on, so that no file is left incomplete."""

import signal
import sys
import time

SIGNALS = signal.SIGINT, signal.SIGTERM
program_start: list[float] = []  # start of the program, if this process is it, by time.monotonic [s]
received: list[int] = []  # signals received before a run handled them itself


class Stopped(KeyboardInterrupt):
    """Exception for Ctrl-C (SIGINT) or SIGTERM, with the ``number`` of the signal."""

    def __init__(self, number: int):
        super().__init__(number)
        self.number = number


def listen() -> None:
    """Let both signals raise Stopped in the main thread."""

    def stop(number, frame):
        received.append(number)
        raise Stopped(number)

    program_start.append(time.monotonic())
    for number in SIGNALS:
        signal.signal(number, stop)
    hook = sys.unraisablehook  # a callback of the import system may swallow Stopped and print it; ``received`` keeps it
    sys.unraisablehook = lambda lost: None if isinstance(lost.exc_value, Stopped) else hook(lost)
