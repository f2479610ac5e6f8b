"""python -m taichi_mps and the program taichi-mps: the command line, with the commands of all rooms."""

import os
import sys
from collections.abc import Sequence

from .cli.stopped import listen, received

CLOSED_PIPE = 141  # exit status that a shell gives a program ended by SIGPIPE


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line, as the program ``taichi-mps`` does.

    Parameters
    ----------
    argv : sequence of str, optional
        Command and its options, by default those of this process.

    Returns
    -------
    int
        Exit code: 0 done, 2 bad input, 3 diverged, 130 interrupted; see ``cli.main.main``.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.main(["scenery"])  # on stderr: unknown command 'scenery', did you mean 'scenes'?
    2
    """
    from .app.command import app
    from .cli.main import main as run_command

    return run_command(argv, {"app": app})


def entry() -> None:
    """Run the program, listening to signals before anything else is imported, which takes the longest of a start."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # NumPy's threads spin between the small products of pictures
    try:
        listen()
        code = main()
        sys.stdout.flush()
    except BrokenPipeError:  # whoever reads has gone; with a stdout Python would say so at the end
        code, sys.stdout = CLOSED_PIPE, None
    except OSError as error:  # what was printed cannot be written, as on a full disk
        print(f"taichi-mps: stdout: cannot be written ({error.strerror})", file=sys.stderr)
        code, sys.stdout = 2, None
    except BaseException:  # what is being imported makes an error of its own of a signal
        if not received:
            raise
        code = 128 + received[0]
    sys.exit(code)


if __name__ == "__main__":
    entry()
