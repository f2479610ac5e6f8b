"""A signal that ends the program is an exception from its first moment on, so that nothing is left half made."""

import signal
import sys
import time

SIGNALS = signal.SIGINT, signal.SIGTERM
began: list[float] = []  # when the program did, where this process is it [s], by time.monotonic
came: list[int] = []  # numbers of those that came before a run listened itself


class Stopped(KeyboardInterrupt):
    """Ctrl-C (SIGINT) or SIGTERM; ``number`` of the signal."""

    def __init__(self, number: int):
        super().__init__(number)
        self.number = number


def listen() -> None:
    """Let both signals raise Stopped in the main thread."""

    def stop(number, frame):
        came.append(number)
        raise Stopped(number)

    began.append(time.monotonic())
    for number in SIGNALS:
        signal.signal(number, stop)
    told = sys.unraisablehook  # a callback of the import system swallows it and would say so; ``came`` knows
    sys.unraisablehook = lambda lost: None if isinstance(lost.exc_value, Stopped) else told(lost)
