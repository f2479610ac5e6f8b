"""The command require of the command line."""

import json
import sys
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path

from pydantic import Field

from ..io.run_folder import strict
from ..problem import catalogue
from ..study.require import Wanted, density_of, require
from ..units import plain
from .options import Parser, Workers, given, scene_of
from .run import DONE

MIX = {"yield_value", "plastic_viscosity", "until"}  # of the scene: what is looked for


class Requirement(Workers):
    """Options of require, beside what is wanted."""

    out: str | None = Field(None, description="folder of the study, studies/require-<scene> by default")
    quiet: bool = Field(False, description="no progress")


def require_command(argv) -> int:
    """which slump to order so that a form fills"""
    name = scene_of("require", argv, Wanted).scene
    function = catalogue.load(name) if name else None
    parser = Parser(
        "require",
        "SCENE",
        description="The mixes that fill a form in time, by yield stress and plastic viscosity, and the slump to "
        "order. What the folder of the study holds is not computed again.",
    )
    parser.add_argument("scene", help=f"a form: wall, or a Python file ({', '.join(catalogue.names())})")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.options(Wanted, "wanted")
    if function:
        parser.options(function.parameters, leave_out=MIX)
    parser.options(Requirement, "study")
    arguments = parser.parse(argv)
    wanted, options = Wanted(**given(arguments, Wanted)), Requirement(**given(arguments, Requirement))
    folder = Path(options.out or Path("studies") / f"require-{Path(arguments.scene).stem}")
    parameters = given(arguments, function.parameters, leave_out=MIX)
    from .study_console import watching

    with watching(["yield_value", "plastic_viscosity"], options.quiet or arguments.json) as watch:
        borders, rows = require(arguments.scene, wanted, folder, options.executor, options.workers, watch, **parameters)
    density = density_of(rows)
    if arguments.json:
        print(json.dumps(strict([asdict(b) | {"slumps_m": b.slumps(density)} for b in borders])))
    else:
        print("\n".join(border.told(density) for border in borders))
        print(f"{len(rows)} run{'s' * (len(rows) > 1)}: {plain(folder)}")
    if find_spec("matplotlib"):
        from ..study.chart import require_chart

        print(f"Chart: {plain(require_chart(borders, rows, wanted, folder / 'require.png'))}", file=sys.stderr)
    return DONE


COMMANDS = {"require": require_command}
