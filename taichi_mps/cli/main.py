"""The command line: one function a command, see COMMANDS. Taichi is imported when a run starts."""

import argparse
import json
import os
import platform
import signal
import sys
import warnings
from dataclasses import replace
from importlib import metadata
from pathlib import Path

from .. import __version__
from ..io import lock
from ..problem import catalogue
from ..problem.numerics import NUMERICS
from ..problem.problem import Problem
from ..units import SceneError, plain, suggestion
from .app import COMMANDS as APP
from .case_file import expanded
from .case_file import text as case_text
from .console import curves, redraw
from .options import Parser, Pictures, Run, Table, given, scene_of
from .require import COMMANDS as REQUIRE
from .run import BAD_INPUT, DONE, carry_out, forecast, start
from .study import COMMANDS as STUDY

WITHOUT_REST = (
    5.0  # time limit [s] of a scene without one, by the scheme in which a body does not come to rest by itself
)
MISSED = 1  # what validate returns where not all is as it should be
SCENE_FILE = "the Python file of the scene, where it is not a built-in one"


# ---- commands ---------------------------------------------------------------------------------------------------
def planned(command, argv):
    """What a command line asks to be computed: arguments, options of the run, scene and numerics."""
    argv = expanded(argv)
    known = scene_of(command, argv, Run)
    scheme = known.scheme or "implicit"
    numerics = NUMERICS.get(scheme) or NUMERICS["implicit"]
    function = catalogue.load(known.scene) if known.scene else None

    told = (function.__doc__ or "").strip() if function else COMMANDS[command].__doc__
    parser = Parser(command, "SCENE|CASE.toml", description=told)
    parser.add_argument("scene", help=f"name ({', '.join(catalogue.names())}), Python file or case file")
    if function:
        parser.options(function.parameters)
    parser.options(numerics)
    own_until = function and "until" in function.parameters.model_fields
    parser.options(Run, leave_out=["until"] if own_until else [])
    if command == "run":
        parser.json("print the result as JSON")
        what = "tell size, memory and processor time of the run, and end"
        parser.groups["accuracy and cost"].add_argument("--forecast", action="store_true", help=what)
    arguments = parser.parse(argv)

    options = Run(**given(arguments, Run))
    method = numerics(**given(arguments, numerics))
    keywords = given(arguments, function.parameters)
    if scheme == "semi-implicit" and own_until and function.parameters.model_fields["until"].default is None:
        keywords.setdefault("until", WITHOUT_REST)
    scene = catalogue.build(arguments.scene, **keywords)
    if options.until:
        scene = replace(scene, until=options.until)
    return arguments, options, scene, method


def run(argv) -> int:
    """compute a scene or a case"""
    arguments, options, scene, method = planned("run", argv)
    if arguments.forecast:
        lines = forecast(Problem(scene, method), options.precision)
        tell({"forecast": lines}, arguments.json, "\n".join(lines))
        return DONE
    from ..io.run_folder import RunFolder, next_free

    usual = Path("renders") / scene.name
    folder = RunFolder(options.out or (usual if options.overwrite else next_free(usual)))
    if not options.out and folder.path != usual:
        print(f"taichi-mps: {plain(usual)} is taken; this run goes to {plain(folder.path)}", file=sys.stderr)
    folder.check(options.overwrite)
    problem = Problem(scene, method)
    with lock.held(folder.path):
        start(options)
        from ..simulation.simulation import Simulation

        sim = Simulation(problem, profile=options.profile)
        if not (arguments.json or options.quiet):
            print(plain("\n".join(forecast(problem, options.precision))), flush=True)
        return carry_out(sim, folder, options, catalogue.source(arguments.scene), arguments.json)


def new(argv) -> int:
    """print a case file, to be changed and run"""
    arguments, options, scene, method = planned("new", argv)
    Problem(scene, method)
    print(case_text(catalogue.source(arguments.scene), scene, method, options.model_dump()), end="")
    return DONE


def resume(argv) -> int:
    """continue an interrupted run"""
    kept = ["scheme", "precision", "out", "overwrite"]
    parser = Parser("resume", "RUN", description="Continue a run from its checkpoint.")
    parser.add_argument("run", help="run folder, or the checkpoint file in it")
    parser.options(Run, leave_out=kept)
    parser.add_argument("--scene", help=SCENE_FILE)
    parser.json("print the result as JSON")
    arguments = parser.parse(argv)
    from ..io import checkpoint
    from ..io.run_folder import RunFolder

    path = Path(arguments.run)
    folder = RunFolder(path.parent if path.is_file() else path)
    newest = path if path.is_file() else folder.checkpoint
    state, remark = checkpoint.read_good(newest)
    if remark:
        print(f"taichi-mps: {remark}", file=sys.stderr)
    options = Run(**{**state.header["settings"], **given(arguments, Run, leave_out=kept)})
    folder.check_writable()
    with lock.held(folder.path):
        scene = state.scene(options.until, arguments.scene)
        if options.until:
            scene = replace(scene, until=options.until)
        problem = state.admit(scene)
        start(options)
        sim = state.resume(problem, profile=options.profile)
        if remark:
            os.replace(checkpoint.previous(newest), newest)  # so that the next one does not replace the good one
        return carry_out(sim, folder, options, state.header["source"], arguments.json, resumed=True)


def plot(argv) -> int:
    """draw the curves of one or more runs"""
    parser = Parser("plot", description="Slump curve and history; the slump curves of several runs in one picture.")
    parser.add_argument("run", nargs="+", help="run folder")
    parser.add_argument("--out", help="picture of the compared slump curves, slump.png by default")
    parser.add_argument("--verbose", action="store_true", help="the numerics in history.png, too")
    parser.add_argument("--json", action="store_true", help="print the names of the pictures as JSON")
    arguments = parser.parse(argv)
    from ..io.history import read_history
    from ..io.run_folder import RunFolder

    folders = [RunFolder(path) for path in arguments.run]
    runs = {str(folder.path): read_history(folder.history) for folder in folders}
    try:
        import matplotlib  # noqa: F401

        from ..viz.plots import slump_curve
    except ImportError:
        raise SceneError("plot needs matplotlib: pip install 'taichi-mps[plots]'") from None
    if len(folders) == 1 and arguments.out is None:
        made = curves(folders[0], arguments.verbose)
    else:
        made = [arguments.out or "slump.png"]
        slump_curve(runs, made[0])
    tell({"pictures": made}, arguments.json, "\n".join(made))
    return DONE


def render(argv) -> int:
    """draw a run again"""
    parser = Parser(
        "render", description="Pictures and animation of a run from its run.h5, without computing it again."
    )
    parser.add_argument("run", help="run folder")
    parser.add_argument("--beside", metavar="RUN", help="another run, drawn beside it with the same camera and range")
    parser.add_argument("--surface", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--film", action="store_true", help="an MP4, too (extra film)")
    parser.options(Pictures)
    parser.add_argument("--scene", help=SCENE_FILE)
    parser.add_argument("--json", action="store_true", help="print the names of the results as JSON")
    arguments = parser.parse(argv)
    options = Pictures(**given(arguments, Pictures))
    if arguments.surface:
        print(
            "taichi-mps: --surface is what render draws by now; this option goes with the next release", file=sys.stderr
        )
    from ..io.run_folder import RunFolder
    from ..io.vtkhdf import Trajectory

    folders = [RunFolder(path) for path in (arguments.run, arguments.beside) if path]
    replays = [Trajectory(folder.trajectory).whole(arguments.scene) for folder in folders]
    start(options)
    suffix = ("" if options.view == "concrete" else f"-{options.view}") + "-beads" * options.beads
    suffix += f"-beside-{folders[1].path.resolve().name}" if arguments.beside else ""
    made = redraw(replays, folders[0].path, suffix, options, arguments.film)
    tell(
        made, arguments.json, f"{made['pictures']} pictures in {made['frames']}, {made.get('film', made['animation'])}"
    )
    return DONE


def report(argv) -> int:
    """write the page of a run again"""
    parser = Parser("report", description="report.html of a run, also of an earlier one or one that was killed.")
    parser.add_argument("run", help="run folder")
    parser.add_argument("--scene", help=SCENE_FILE)
    parser.add_argument("--json", action="store_true", help="print the name of the page as JSON")
    arguments = parser.parse(argv)
    from ..io.run_folder import RunFolder
    from ..report.page import write

    page = str(write(RunFolder(arguments.run), scene_file=arguments.scene))
    tell({"report": page}, arguments.json, page)
    return DONE


def export(argv) -> int:
    """write a run as .vtu and .pvd"""
    parser = Parser("export", description="One .vtu file for each output of a run, and a .pvd that opens them all.")
    parser.add_argument("run", help="run folder")
    parser.add_argument("--out", help="folder of the files, vtu in the run folder by default")
    parser.add_argument("--whole", action="store_true", help="the whole body where the scene is a part of it")
    parser.add_argument("--surface", action="store_true", help="its smooth surface, not its particles")
    parser.add_argument("--scene", help=SCENE_FILE)
    parser.add_argument("--json", action="store_true", help="print the name of the result as JSON")
    arguments = parser.parse(argv)
    from ..io.run_folder import RunFolder
    from ..io.vtkhdf import Trajectory

    folder = RunFolder(arguments.run)
    out = Path(arguments.out or folder.path / "vtu")
    from ..io.vtu import vtu

    count = vtu(Trajectory(folder.trajectory).whole(arguments.scene), out, arguments.whole, arguments.surface)
    tell({"pvd": str(out / "run.pvd"), "outputs": count}, arguments.json, f"{count} outputs: {out / 'run.pvd'}")
    return DONE


def scenes(argv) -> int:
    """list the scenes"""
    parser = Parser("scenes", description="The built-in scenes; 'taichi-mps run SCENE --help' lists their keywords.")
    parser.add_argument("--json", action="store_true", help="print as JSON")
    arguments = parser.parse(argv)
    listed = [
        {"name": name, "description": text, "file": str(catalogue.locate(name))}
        for name, text in catalogue.describe().items()
    ]
    width = max((len(scene["name"]) for scene in listed), default=0)
    tell(listed, arguments.json, "\n".join(f"{scene['name']:{width}}  {scene['description']}" for scene in listed))
    return DONE


def info(argv) -> int:
    """describe the installation, or a run"""
    parser = Parser("info", description="The installation, or the summary of a run.")
    parser.add_argument("run", nargs="?", help="run folder")
    parser.add_argument("--json", action="store_true", help="print as JSON")
    arguments = parser.parse(argv)
    if arguments.run:
        from ..io.run_folder import RunFolder

        folder = RunFolder(arguments.run)
        facts = folder.read_summary()
        folder.verify()
    else:
        packages = ("taichi", "numpy", "h5py", "pydantic", "matplotlib")
        facts = {"version": __version__, "python": platform.python_version(), "platform": platform.platform()}
        facts |= {"cpus": os.cpu_count(), "scenes": str(catalogue.folder())}
        facts |= {name: version_of(name) for name in packages}
    tell(facts, arguments.json, "\n".join(f"{key:18} {value}" for key, value in facts.items()))
    return DONE


def version_of(package: str) -> str | None:
    """Version of an installed package; None where it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def tell(facts, as_json: bool, text: str) -> None:
    """Print the facts as JSON, or the text."""
    print(json.dumps(facts) if as_json else plain(text))


def validate(argv) -> int:
    """run the validation table, or some of its rows"""
    parser = Parser(
        "validate", description="Run cases with a known answer; ends with 1 where a target is missed or a row fails."
    )
    parser.add_argument("rows", nargs="*", help="names of rows; all by default")
    parser.add_argument("--quick", action="store_true", help="only the rows of a few seconds")
    parser.options(Table, "table")
    parser.add_argument("--out", default="renders/validation", help="folder for table.md and a JSON file a row")
    parser.add_argument("--page", help="Markdown page with the marks of the table, to write it into")
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
    arguments = parser.parse(argv)
    options = Table(**given(arguments, Table))
    from ..validation import table as validation

    names = arguments.rows, arguments.quick
    text, results = validation.run_table(*names, Path(arguments.out), arguments.page, options.scheme, options.budget)
    tell(results, arguments.json, text)
    failed = any(result["error"] and not result["error"].startswith("not run") for result in results)
    missed = not all(item["met"] for result in results for item in result["numbers"])
    return MISSED if failed or missed else DONE


COMMANDS = {"run": run, "new": new, "resume": resume, "render": render, "export": export, "plot": plot}
COMMANDS |= {"report": report, "validate": validate} | STUDY | REQUIRE | APP | {"scenes": scenes, "info": info}


def main(argv=None) -> int:
    """Run a command line; 0 done, 2 bad input, 3 diverged, 130 and 143 ended by Ctrl-C and SIGTERM; of a sweep 1: a
    case failed. BrokenPipeError where nobody reads what it prints any more."""
    argv = [str(word) for word in (sys.argv[1:] if argv is None else argv)]
    try:
        if not argv or argv[0] in ("-h", "--help"):
            lines = [f"  {name:9} {command.__doc__}" for name, command in COMMANDS.items()]
            print("\n".join(["usage: taichi-mps COMMAND ... [--help]", "", *lines]))
            return DONE if argv else BAD_INPUT
        if argv[0] == "--version":
            print(__version__)
            return DONE
        if argv[0] not in COMMANDS:
            raise SceneError(f"unknown command '{argv[0]}'{suggestion(argv[0], COMMANDS)}")
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_: print(f"taichi-mps: {plain(message)}", file=sys.stderr)
            return COMMANDS[argv[0]](argv[1:])
    except SceneError as error:
        print("taichi-mps: " + plain(" ".join(str(error).split())), file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:
        raise
    except OSError as error:  # the disk is full, a file belongs to somebody else
        print(f"taichi-mps: {plain(error)}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt as stopped:
        print("taichi-mps: interrupted", file=sys.stderr)
        return 128 + getattr(stopped, "number", signal.SIGINT)
    except SystemExit as leaving:  # argparse after --help
        return int(leaving.code or 0)
