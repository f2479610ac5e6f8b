"""python -m taichi_mps and the program taichi-mps: the command line, with the commands of all rooms."""

import sys

from .cli.stopped import came, listen

CLOSED_PIPE = 141  # as a shell has it of a program that SIGPIPE ended


def main(argv=None) -> int:
    """Run a command line and return its exit code, see ``cli.main.main``."""
    from .app.command import app
    from .cli.main import main as answer

    return answer(argv, {"app": app})


def entry() -> None:
    """The program. Signals are listened to before anything else is imported, which takes the longest of a start."""
    try:
        listen()
        code = main()
        sys.stdout.flush()
    except BrokenPipeError:  # whoever reads has gone; with a stdout Python would say so at the end
        code, sys.stdout = CLOSED_PIPE, None
    except BaseException:  # what is being imported makes an error of its own of a signal
        if not came:
            raise
        code = 128 + came[0]
    sys.exit(code)


if __name__ == "__main__":
    entry()
