"""The forecast of a run, found in a process of its own, since it builds the scene, which may be large, and imports
Taichi."""

import io
import warnings
from contextlib import redirect_stderr

from ..cli.main import planned
from ..cli.run import forecast as lines_of
from ..units import SceneError, plain


def forecast(words: list[str]) -> tuple[float, list[str], str]:
    """The time limit [s] of a run by its words on the command line, and what is known of it, in lines; what cannot be
    computed has none but, in one line, why."""
    try:
        with warnings.catch_warnings(record=True) as warned, redirect_stderr(io.StringIO()):
            warnings.simplefilter("always")
            _, options, problem = planned("run", words)
            lines = lines_of(problem, options.precision)
            from ..simulation.forecast import pairs_of, require_memory

            require_memory(problem, pairs_of(problem.scene), options.precision)
    except (SceneError, ImportError) as error:  # ImportError: pint, which numbers with a unit need
        return 0.0, [], plain(" ".join(str(error).split()))
    return problem.scene.until, lines + list(dict.fromkeys(str(item.message) for item in warned)), ""
