"""python -m taichi_mps and the program taichi-mps: the command line."""

import sys

from .stopped import came, listen


def entry() -> None:
    """The program. Signals are listened to before anything else is imported, which takes the longest of a start."""
    try:
        listen()
        from .cli.main import main

        code = main()
        sys.stdout.flush()
    except BrokenPipeError:  # whoever reads has gone; Python would say so at the end
        code = CLOSED_PIPE
    except BaseException:  # what is being imported makes an error of its own of a signal
        if not came:
            raise
        code = 128 + came[0]
    if code == CLOSED_PIPE:
        sys.stdout = None
    sys.exit(code)


CLOSED_PIPE = 141  # as a shell has it of a program that SIGPIPE ended

if __name__ == "__main__":
    entry()
