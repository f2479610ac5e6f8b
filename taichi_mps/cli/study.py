"""The commands sweep, require, calibrate, mortar and chart of the command line."""

import json
import os
import sys
import time
from collections import Counter
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from pydantic import Field

from ..engine import Problem
from ..forecast.accuracy import choose
from ..input import catalogue
from ..input.labels import in_words, title, written
from ..io.run_folder import strict, write_whole
from ..report.sentences import duration_text
from ..study import calibrate as one_mix
from ..study.calibrate import Measurements
from ..study.mortar import Suspension
from ..study.require import Wanted, find_borders, require_bingham, runs_to_expect
from ..study.sweep import ACCURACY, CHOOSES, LOST, cases, sweep, wall_time
from ..study.tables import measures
from ..units import Checked, Only, SceneError, plain, quote, require, require_package, user_path
from . import case_file
from .options import DONE, JSON, Workers, command, given, notify, parse_scene, read_back, tell

NOT_ALL_DONE = 1  # what sweep returns where a case gave no result, and calibrate --table where no mix did
PLOTS = "matplotlib", "chart needs", "plots"  # what a chart needs
MOST_SHOWN = 10  # cases without a result that are named
MIX = {"yield_value", "plastic_viscosity", "until"}  # of a form: what require looks for


class Study(Workers):
    """Options of every command that computes a study."""

    out: str | None = Field(None, description="folder of the study, by default studies/ and its name")
    quiet: bool = Field(False, description="no progress")


class Sweep(Study):
    """Options of sweep."""

    chart: bool = Field(False, description="draw chart.png into the folder")


class Curves(Study):
    """Options of calibrate with measured curves."""

    curve: str | None = Field(
        None, description="measured curves, CSV, commas between several: time [s] and what the scene measures"
    )
    free: str = Field(
        "yield_value,plastic_viscosity",
        description="constants that are sought, of any law, and time_offset where the curve's zero of time is unknown",
    )
    check: bool = Field(True, description="correct the runs, of twice the spacing, by some of the spacing itself")


class Lookup(Checked):
    """Options of calibrate, beside what was measured."""

    study: str | None = Field(
        None, description="a study of one of the tests to look the answer up in; the package's own by default"
    )
    check: bool = Field(True, description="compute the cones once more, finer; without it in a second")
    table: str | None = Field(
        None, description="a laboratory's list, CSV or Excel: one mix a line, columns as slump [cm], slump flow [cm]"
    )
    out: Annotated[str | None, Only("table")] = Field(
        None,
        description="of --table: the results, CSV, beside them a chart; mixes-calibrated.csv by default",
    )


def parsed(command, argv, what, options, leave_out=(), **models):
    """Arguments of a command that takes a scene, and the scene's function; ``models``: more options by their title."""
    _, function, parser = parse_scene(command, argv, next(iter(models.values()), options), "SCENE", what)
    parser.add_argument("--json", **JSON["--json"])
    for name, model in models.items():
        parser.options(model, name)
    parser.options(function.parameters, leave_out=leave_out)
    parser.options(options, "study")
    return parser.parse(argv), function


def watching(varied, quiet: bool, options, planned, runs=None):
    """``watch(rows, total)`` of a study of ``planned`` cases, or at most ``runs`` like them, in which the parameters of
    these names differ: the time in all before it begins, then a line for each case with its own and the time left.
    What the folder of the study holds takes no time."""
    if quiet:
        return None
    local, reported, start, count = options.executor == "local", set(), time.monotonic(), runs or len(planned)
    whole = there = None

    def tell(rows, total):
        nonlocal whole, there
        known = len(reported)
        if there is None and len(rows) < count:
            there = len(rows)
            workers = min(options.workers or os.cpu_count() or 1, count - there) if local else 1
            whole = wall_time(planned, workers, count - there)
            takes = (
                f"{workers} at a time, about {duration_text(whole)} in all"
                if local
                else f"{duration_text(whole)} of processor time"
            )
            text = f"{'at most ' if runs else ''}{count - there} runs" + (f", {there} more are there" if there else "")
            notify(f"{text}: {takes}")
        for row in (row for row in rows if row["key"] not in reported):
            reported.add(row["key"])
            words = [
                f"{len(reported)}/{max(total, runs or 0)}",
                *(f"{in_words(name)} {quote(row[name], '')}" for name in varied),
            ]
            spent = (row.get("cpu_seconds") or 0.0) + (row.get("compile_seconds") or 0.0)
            done, more = len(reported) - (there or 0), max(0, count - len(reported))
            left = whole * more / (done + more) if whole and more else 0.0
            if known and done > 0:
                left = (left * (time.monotonic() - start) / done * more) ** 0.5
            text = f"{', '.join(words)}: {outcome(row)}" + (f", in {duration_text(spent)}" if spent else "")
            print(plain(f"{text}; about {duration_text(left)} left" if left else text), file=sys.stderr, flush=True)

    return tell


def outcome(row) -> str:
    """The measures of a row in a few words, or why there are none."""
    if row["status"] != "done":
        return f"{row['status']}: {row['reason']}"
    found = ", ".join(f"{title(name)} {written(name, row[name])}" for name in measures([row]) if row[name] is not None)
    return f"{found} ({row['reason']})" if row["reason"] else found


# ---- sweep -----------------------------------------------------------------------------------------------------
def sweep_command(argv) -> int:
    """compute a scene at many values of its parameters"""
    arguments, function = parsed(
        "sweep",
        argv,
        "A scene at every combination of values: one value, a list 20,50,100, or first:last:number in "
        "equal ratios (:linear in equal steps). What the folder of the study holds is not computed again.",
        Sweep,
    )
    options, varied = Sweep(**given(arguments, Sweep)), given(arguments, function.parameters)
    if options.chart:
        require_package(*PLOTS)
    folder = user_path(options.out or Path("studies") / Path(arguments.scene).stem)
    planned = cases(arguments.scene, **varied)
    differing = varied_parameters(planned, function)
    require(
        not options.chart or any(isinstance(planned[0].parameters[name], int | float) for name in differing),
        "chart: needs a parameter that is varied by numbers; must be a list or first:last:number",
    )
    if "accuracy" in planned[0].parameters and not varied.keys() & CHOOSES:
        notify(f"accuracy = {1e3 * ACCURACY:g} mm: {choose(ACCURACY)}")
    watch = watching(differing, options.quiet or arguments.json, options, planned)
    rows = sweep(arguments.scene, folder, options.executor, options.workers, watch, **varied)
    if arguments.json or not options.quiet:
        tell(arguments, rows, f"{tally(rows)}: {folder / 'results.csv'}")
    if options.chart:
        from ..study.chart import study_chart

        study_chart(rows, differing, folder / "chart.png")
    for line in not_done(rows, differing):
        notify(line)
    return DONE if all(row["status"] == "done" for row in rows) else NOT_ALL_DONE


def varied_parameters(planned, function) -> list[str]:
    """Names of the parameters in which the cases of a study differ; prints the values of each."""
    values = {
        name: {str(case.parameters[name]): case.parameters[name] for case in planned} for name in planned[0].parameters
    }
    differing = [name for name in values if len(values[name]) > 1]
    for name in differing:
        read_back(name, values[name].values(), function.parameters.model_fields[name])
    return differing


def not_done(rows, differing) -> list[str]:
    """Cases of a study without a result, and why, a line each; of many the first ones."""
    left = [row for row in rows if row["status"] != "done"]
    names = [", ".join(f"{name} = {row.get(name)}" for name in differing) or row["key"] for row in left]
    lines = [f"{row['status']}: {name}: {row['reason']}" for row, name in zip(left, names, strict=True)]
    return some(lines, "results.csv")


def some(lines: list[str], table) -> list[str]:
    """The first of many lines, and where the others are."""
    return lines[:MOST_SHOWN] + (
        [f"and {len(lines) - MOST_SHOWN} more, see {table}"] if len(lines) > MOST_SHOWN else []
    )


def tell_chart(name: str, *found) -> None:
    """Draw the chart of this name of study/chart.py, and print its path; nothing without matplotlib."""
    if find_spec("matplotlib"):
        from ..study import chart

        print(f"Chart: {plain(getattr(chart, name)(*found))}", file=sys.stderr)


def tally(rows) -> str:
    """Numbers of cases done, failed and lost, in words."""
    count = Counter(row["status"] for row in rows)
    words = [f"{count['done']} cases done", *(f"{count[name]} {name}" for name in ("failed", LOST) if count[name])]
    return ", ".join(words) + (" (the same command computes the lost ones again)" if count[LOST] else "")


# ---- require ---------------------------------------------------------------------------------------------------
def require_command(argv) -> int:
    """which slump to order so that a form fills"""
    arguments, function = parsed(
        "require",
        argv,
        "The mixes that fill a form, such as wall, in time, by yield stress and plastic viscosity, and the slump to "
        "order. What the folder of the study holds is not computed again.",
        Study,
        MIX,
        wanted=Wanted,
    )
    given_wanted, options = given(arguments, Wanted), Study(**given(arguments, Study))
    wanted = Wanted(**given_wanted)
    folder = user_path(options.out or Path("studies") / f"require-{Path(arguments.scene).stem}")
    parameters = given(arguments, function.parameters, leave_out=MIX)
    if "plastic_viscosity" in given_wanted:
        varied_parameters(cases(arguments.scene, plastic_viscosity=wanted.plastic_viscosity), function)
    require_bingham(catalogue.build(arguments.scene, **parameters), parameters)
    like = cases(arguments.scene, until=wanted.time, plastic_viscosity=wanted.plastic_viscosity, **parameters)
    watch = watching(
        ["yield_value", "plastic_viscosity"],
        options.quiet or arguments.json,
        options,
        like,
        runs_to_expect(wanted, len(like)),
    )
    borders, rows = find_borders(
        arguments.scene, wanted, folder, options.executor, options.workers, watch, **parameters
    )
    facts = [vars(border) | {"slumps_m": border.slumps_m} for border in borders]
    tell(arguments, facts, "\n".join([*map(str, borders), f"{len(rows)} run{'s' if len(rows) > 1 else ''}: {folder}"]))
    tell_chart("borders_chart", borders, rows, wanted, folder / "require.png")
    return DONE


# ---- calibrate -------------------------------------------------------------------------------------------------
@command(
    "Yield stress and plastic viscosity of a mix from its slump test (standard cone, 30 cm), mini-cone, V-funnel or "
    "rheometer, in any combination, with 95 % intervals by the errors of the measurements; cones are checked by one "
    "finer run. 'taichi-mps calibrate SCENE --curve FILE.csv' finds constants of any law from what was measured over "
    "time.",
    JSON,
    {Measurements: ("measurements",), Lookup: ("answer",)},
)
def calibrate(arguments) -> int:
    """find the constants of a mix from its tests, or from measured curves"""
    measurements, options = given(arguments, Measurements), Lookup(**given(arguments, Lookup))
    if options.table:
        return calibrate_table(arguments, options, measurements)
    result = one_mix.calibrate(**measurements, study=options.study, check=options.check)
    return tell(arguments, result.facts(), result)


def calibrate_command(argv) -> int:
    """find the constants of a mix from its tests, or from measured curves"""
    curves = argv and not argv[0].startswith("-") or any(word.split("=")[0] == "--curve" for word in argv)
    return calibrate_scene(argv) if curves else calibrate(argv)


def calibrate_scene(argv) -> int:
    """Constants of a law from curves that were measured of a scene."""
    arguments, function = parsed(
        "calibrate",
        argv,
        "The constants of a law, with 95 % intervals, by runs of the scene that come nearest to measured curves.",
        Curves,
    )
    options, settings = Curves(**given(arguments, Curves)), given(arguments, function.parameters)
    require(options.curve, "curve: is missing; must be a CSV file of what was measured of the scene")
    require_package("scipy", "calibrate needs", "calibrate")
    from ..study.calibrate_curves import calibrate_curves

    report = None if options.quiet or arguments.json else lambda text: print(plain(text), file=sys.stderr, flush=True)
    name, execution = arguments.scene, (options.executor, options.workers, options.check)
    folder = user_path(options.out or Path("studies") / f"calibrate-{Path(name).stem}")
    found = calibrate_curves(name, options.curve, options.free, folder, *execution, report, **settings)
    case = catalogue.build(name, **settings | found.curves[0]["settings"] | found.values)
    write_whole(folder / "case.toml", case_file.case_text(catalogue.source(name), Problem(case), {}))
    write_whole(folder / "calibration.json", json.dumps(strict(found.facts()), indent=1))
    tell(arguments, found.facts(), f"{found}\nTo run it: taichi-mps run {folder / 'case.toml'}")
    tell_chart("curves_chart", found, folder / "chart.png")
    return DONE


def calibrate_table(arguments, options: Lookup, measurements: dict) -> int:
    """Calibrate each mix of a laboratory's list."""
    from ..study import measured_mixes

    path = user_path(options.table)
    require(
        not path.is_dir(),
        f"table = {path}: is a folder; a study is named by --study, a list of mixes is a CSV file",
    )
    out = user_path(options.out or path.with_name(f"{path.stem}-calibrated.csv"))
    results = {out, out.with_suffix(".png")}
    is_text = len(results) == 2 and out.suffix.lower() in ("", ".csv", ".txt")  # not xlsx
    require(
        is_text and out.parent.is_dir() and os.access(out.parent, os.W_OK),
        f"out = {out}: must be a CSV file in a folder that is there and can be written",
    )
    require(not measurements, f"{next(iter(measurements), '')}: stands in the table's own columns; must be left out")
    for there in sorted(filter(Path.exists, results)):
        raise SceneError(f"out = {out}: {there.name} is there already; must be a new file, nothing is overwritten")
    rows = measured_mixes.read_list(path)
    if others := measured_mixes.unused(rows):
        notify(f"table = {path}: {others}")
    notify(f"{len(rows)} mixes: about {duration_text(measured_mixes.SECONDS_PER_MIX * len(rows))} in all")

    found = measured_mixes.calibrate_list(rows, options.study)
    measured_mixes.write(found, out)
    tell(arguments, found, f"{measured_mixes.tally(found)}\nEvery mix with its constants and reasons: {out}")
    tell_chart("mixes_chart", found, out.with_suffix(".png"))
    refused = [
        f"{measured_mixes.REFUSED}: {next(iter(row.values()))}: {row['reason']}"
        for row in found
        if row["verdict"] == measured_mixes.REFUSED
    ]
    for line in some(refused, out):
        notify(line)
    return NOT_ALL_DONE if len(refused) == len(found) else DONE


# ---- mortar ----------------------------------------------------------------------------------------------------
@command(
    "Constants of the mortar in a concrete of this yield stress and plastic viscosity, as a run with grains needs it, "
    "and of the concrete that such a mortar makes.",
    JSON,
    {Suspension: ()},
)
def mortar(arguments) -> int:
    """constants of mortar and concrete from each other"""
    mix = Suspension(**given(arguments, Suspension))
    return tell(arguments, mix.facts(), mix)


# ---- chart -----------------------------------------------------------------------------------------------------
@command(
    "Slump and slump flow against yield stress for the wall, with formulas and finite elements.",
    {
        "study": {"nargs": "?", "help": "folder of a sweep of the slump; the package's own study by default"},
        "--out": {"default": "slump_chart.png", "help": "picture, slump_chart.png by default"},
        **JSON,
    },
)
def chart(arguments) -> int:
    """draw slump and slump flow against yield stress"""
    require_package(*PLOTS)
    from ..study.chart import slump_chart

    made = slump_chart(arguments.out, arguments.study)
    return tell(arguments, {"picture": str(made)}, made)


COMMANDS = {
    "sweep": sweep_command,
    "calibrate": calibrate_command,
    "chart": chart,
    "require": require_command,
    "mortar": mortar,
}
