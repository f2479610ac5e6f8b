"""The commands sweep, calibrate and chart of the command line."""

import json
import sys
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

from pydantic import Field

from ..io.run_folder import strict
from ..problem import catalogue
from ..problem.accuracy import choose
from ..study.measurements import Measurements
from ..study.sweep import ACCURACY, LOST, cases, sweep
from ..units import SceneError, plain
from .options import Parser, Workers, given, scene_of
from .run import DONE

NOT_ALL_DONE = 1  # what sweep returns where a case gave no result
MOST_SHOWN = 10  # cases without a result that are named


class Study(Workers):
    """Options of sweep."""

    out: str | None = Field(None, description="folder of the study, studies/<scene> by default")
    chart: bool = Field(False, description="draw chart.png into the folder")
    quiet: bool = Field(False, description="no table")


def sweep_command(argv) -> int:
    """compute a scene at many values of its parameters"""
    known = scene_of("sweep", argv, Study)
    function = catalogue.load(known.scene) if known.scene else None
    parser = Parser(
        "sweep",
        "SCENE",
        description="A scene at every combination of values: one value, a list 20,50,100, or first:last:number in "
        "equal ratios (:linear in equal steps). What the folder of the study holds is not computed again.",
    )
    parser.add_argument("scene", help=f"name ({', '.join(catalogue.names())}) or Python file")
    parser.add_argument("--json", action="store_true", help="print the rows as JSON")
    if function:
        parser.options(function.parameters)
    parser.options(Study, "study")
    arguments = parser.parse(argv)
    options = Study(**given(arguments, Study))
    varied = {name: getattr(arguments, name) for name in function.parameters.model_fields}
    varied = {name: text for name, text in varied.items() if text is not None}
    if options.chart and not find_spec("matplotlib"):
        raise SceneError("chart needs matplotlib: pip install 'taichi-mps[plots]'")
    folder = Path(options.out or Path("studies") / Path(arguments.scene).stem)
    from .study_console import differing, watching

    planned = cases(arguments.scene, **varied)
    if options.chart and not any(isinstance(planned[0].parameters[name], int | float) for name in differing(planned)):
        raise SceneError("chart: needs a parameter that is varied by numbers; must be a list or first:last:number")
    if "model" in planned[0].parameters and "model" not in varied:
        print(f"taichi-mps: accuracy = {1e3 * ACCURACY:g} mm: {choose(ACCURACY)}", file=sys.stderr)

    quiet = options.quiet or arguments.json
    with watching(differing(planned), quiet) as watch:
        rows = sweep(arguments.scene, folder, options.executor, options.workers, watch, **varied)
    if arguments.json:
        print(json.dumps(strict(rows)))
    elif not quiet:
        print(f"{tally(rows)}: {folder / 'results.csv'}")
    if options.chart:
        from ..study.chart import study_chart

        study_chart(rows, differing(planned), folder / "chart.png")
    for line in not_done(rows, differing(planned)):
        print(f"taichi-mps: {plain(line)}", file=sys.stderr)
    return DONE if all(row["status"] == "done" for row in rows) else NOT_ALL_DONE


def not_done(rows, differing) -> list[str]:
    """Which cases of a study gave no result, and why, a line each; of many the first ones."""
    left = [row for row in rows if row["status"] != "done"]
    names = [", ".join(f"{name} = {row.get(name)}" for name in differing) or row["key"] for row in left]
    lines = [f"{row['status']}: {name}: {row['reason']}" for row, name in zip(left[:MOST_SHOWN], names, strict=False)]
    return lines + [f"and {len(left) - MOST_SHOWN} more, see results.csv"] * (len(left) > MOST_SHOWN)


def tally(rows) -> str:
    """How many cases are done, failed and lost, in words."""
    count = Counter(row["status"] for row in rows)
    words = [f"{count['done']} cases done", *(f"{count[name]} {name}" for name in ("failed", LOST) if count[name])]
    return ", ".join(words) + " (the same command computes the lost ones again)" * bool(count[LOST])


def calibrate_command(argv) -> int:
    """find the Bingham constants of a mix from its tests"""
    parser = Parser(
        "calibrate",
        description="Yield stress and plastic viscosity of a mix from its slump test (standard cone, 300 mm), "
        "mini-cone, V-funnel or rheometer, in any combination, with 95 % intervals by the errors of the measurements; "
        "cones are checked by one finer run.",
    )
    parser.options(Measurements, "measurements")
    parser.add_argument("--table", help="a laboratory's list, CSV: one mix a line, columns as slump [cm], spread [cm]")
    parser.add_argument(
        "--out", help="of --table: the results, CSV, beside them a chart and a page; mixes-calibrated.csv by default"
    )
    parser.add_argument(
        "--executor", help="of --table: local or dask://HOST:PORT, by default here, one after the other"
    )
    parser.add_argument(
        "--workers", help="of --table: processes of this machine, one for each CPU with --executor local"
    )
    parser.add_argument(
        "--study", help="a study of one of the tests to look the answer up in; the package's own by default"
    )
    parser.add_argument("--no-check", action="store_true", help="without the finer run, in a second")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    arguments = parser.parse(argv)
    told = given(arguments, Measurements)
    if arguments.table:
        return calibrate_table(arguments, told)
    for name in ("out", *Workers.model_fields):
        if value := getattr(arguments, name):
            raise SceneError(f"{name} = {value}: belongs to --table; must be left out")
    from ..study.calibrate import calibrate

    result = calibrate(**told, study=arguments.study, check=not arguments.no_check)
    print(json.dumps(strict(result.facts())) if arguments.json else result)
    return 0


def calibrate_table(arguments, told) -> int:
    """One calibration for each line of a laboratory's list."""
    from ..study import mixes

    path = Path(arguments.table)
    if path.is_dir():
        raise SceneError(f"table = {path}: is a folder; a study is named by --study, a list of mixes is a CSV file")
    if told:
        raise SceneError(f"{next(iter(told))}: stands in the table's own columns; must be left out")
    out = Path(arguments.out or path.with_name(f"{path.stem}-calibrated.csv"))
    if out.exists():
        raise SceneError(f"out = {out}: is there already; must be a new file, it is not overwritten")
    rows, workers = mixes.read_list(path), given(arguments, Workers)
    workers = Workers(**workers).model_dump() if workers else {}

    def watch(row, number):
        if sys.stderr.isatty():
            print(f"\r{number} of {len(rows)} mixes", end="\n" * (number == len(rows)), file=sys.stderr, flush=True)

    found = mixes.calibrate_list(rows, arguments.study, watch, **workers)
    mixes.write(found, out)
    if arguments.json:
        print(json.dumps(strict(found)))
    else:
        print(mixes.tally(found))
        print(f"Every mix with its constants and reasons: {plain(out)}")
    if find_spec("matplotlib"):
        from ..study.chart import mixes_chart

        chart = mixes_chart(found, out.with_suffix(".png"))
        print(f"Chart: {plain(chart)}", file=sys.stderr)
    from ..study import mixes_page

    try:
        page = mixes_page.write(found, [name for name in rows[0] if name], out.with_suffix(".html"), path)
        print(f"Report: {plain(page)}", file=sys.stderr)
    except SceneError as error:  # without plotly: the table is there
        print(f"taichi-mps: {error}", file=sys.stderr)
    return 0


def chart_command(argv) -> int:
    """draw slump and spread against yield stress"""
    parser = Parser(
        "chart", description="Slump and spread against yield stress for the wall, with formulas and finite elements."
    )
    parser.add_argument("study", nargs="?", help="folder of a sweep of the slump; the package's own study by default")
    parser.add_argument("--out", default="slump_chart.png", help="picture, slump_chart.png by default")
    parser.add_argument("--json", action="store_true", help="print the name of the picture as JSON")
    arguments = parser.parse(argv)
    try:
        from ..study.chart import slump_chart

        made = slump_chart(arguments.out, arguments.study)
    except ImportError:
        raise SceneError("chart needs matplotlib: pip install 'taichi-mps[plots]'") from None
    print(json.dumps({"picture": str(made)}) if arguments.json else made, file=sys.stdout)
    return 0


COMMANDS = {"sweep": sweep_command, "calibrate": calibrate_command, "chart": chart_command}
