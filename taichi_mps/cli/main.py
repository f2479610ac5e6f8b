"""Command line: one function for each command, see ``commands``. Taichi is imported when a run starts, the studies
where a command is one of theirs."""

import logging
import os
import platform
import signal
import sys
import warnings
from contextlib import suppress
from dataclasses import replace
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from .. import __version__
from ..engine import NUMERICS, Implicit, Problem
from ..input import catalogue
from ..io import checkpoint, lock
from ..io.run_folder import RunFolder, next_free
from ..io.summary import commit
from ..io.vtkhdf import Trajectory
from ..units import INSTANT, SceneError, plain, quote, require, suggestion, user_path
from .case_file import NOT_IN_CASE, case_text, expand_case_file
from .drawing import Drawing
from .grains import chosen_for, grains_of
from .options import (
    BAD_INPUT,
    DONE,
    GONE,
    JSON,
    OutputError,
    Pictures,
    Remedy,
    Run,
    command,
    given,
    is_tuple,
    notify,
    parse_scene,
    read_back,
    say,
    tell,
)
from .run import (
    CASE,
    carry_out,
    complete,
    describe_run,
    make_clock,
    print_answer,
    redraw,
    require_slump,
    show_end,
)

WITHOUT_REST = 5.0  # time limit [s] of a scene without one, with the scheme that does not come to rest
RUN = {"run": {"help": "run folder"}} | JSON
SCENE = {"--scene": {"help": "the Python file of the scene, where it is not a built-in one"}}
KEPT_OPTIONS = [
    "scheme",
    "precision",
    "out",
    "overwrite",
    *(name for name in Run.model_fields if name.startswith("grains")),
]  # options of a run that resume cannot change


# ---- commands ---------------------------------------------------------------------------------------------------
def planned(name, argv):
    """Parse the command line of run or new: arguments, options of the run, problem."""
    argv = expand_case_file(argv)
    known, function, parser = parse_scene(name, argv, Run, "SCENE|CASE.toml")
    numerics, parameters = NUMERICS.get(known.scheme, Implicit), function.parameters
    own_until = parameters.model_fields.get("until")
    without = (["until"] if own_until else []) + ([*NOT_IN_CASE] if name == "new" else [])
    for model, left_out in ((parameters, ()), (numerics, ()), (Run, without)):
        parser.options(model, leave_out=left_out)
    if name == "run":
        parser.groups["output"].add_argument("--json", **JSON["--json"])
        cost = parser.groups["accuracy and cost"]
        cost.add_argument("--forecast", action="store_true", help="tell size, memory and time of the run, and end")
    arguments = parser.parse(argv)

    options = Run(**given(arguments, Run))
    keywords = given(arguments, parameters)
    if options.scheme == "semi-implicit" and own_until and own_until.default is None:
        keywords.setdefault("until", WITHOUT_REST)
    if "accuracy" in keywords:
        choose = f"accuracy = {keywords['accuracy']}: chooses model and particle size of"
        require(options.scheme == "implicit", f"{choose} the scheme implicit; must be left out")
        if {"model", "spacing"} <= keywords.keys():
            notify(f"{choose} a run without them; has no effect here")
    grains = grains_of(options)
    if grains:
        require("accuracy" not in keywords, "accuracy: no data with grains; must be left out, or without grains")
        keywords = chosen_for(grains, keywords, parameters)
    scene = catalogue.build(arguments.scene, **keywords)
    for key in (key for key in keywords if is_tuple(parameters.model_fields[key])):
        read_back(key, scene.parameters[key], parameters.model_fields[key])
    scene = replace(scene, until=options.until or scene.until, grains=grains or scene.grains)
    if options.cut or options.view == "distance":
        from ..viz.render import require_grains

        require_grains(scene, options.view, options.cut)
    return arguments, options, Problem(scene, numerics(**given(arguments, numerics)))


def run(argv) -> int:
    """compute a scene or a case"""
    arguments, options, problem = planned("run", argv)
    if arguments.scene in catalogue.names():  # a measure of the user's may need more than the places of particles
        require_slump(problem.scene)
    clock = make_clock(problem, options)
    if arguments.forecast:
        forecast = describe_run(problem, clock, options.verbose)
        return tell(arguments, {"forecast": forecast}, "\n".join(forecast))
    default = Path("renders") / problem.scene.name
    folder = RunFolder(options.out or (default if options.overwrite else next_free(default)))
    if not options.out and folder.path != default:
        notify(f"{default} is taken; this run goes to {folder.path}")
    folder.check(options.overwrite)
    with Drawing(folder, options, problem.scene, arguments.scene) as drawing, lock.held(folder.path):
        if not (arguments.json or options.quiet):
            say(plain("\n".join(describe_run(problem, clock, options.verbose))))
        from ..engine import Simulation, init

        init(options.arch, options.precision, options.threads)
        sim = Simulation(problem, profile=options.profile)
        clock.begin("ready")
        return carry_out(sim, folder, options, catalogue.source(arguments.scene), arguments.json, clock, drawing)


def new(argv) -> int:
    """print a case file, to be changed and run"""
    arguments, options, problem = planned("new", argv)
    say(case_text(catalogue.source(arguments.scene), problem, options.model_dump()), end="")
    return DONE


@command(
    "Continue a run from its checkpoint.",
    {"run": {"help": "run folder, or the checkpoint file in it"}, **SCENE, **JSON},
    {Run: (None, KEPT_OPTIONS), Remedy: ("expert",)},
)
def resume(arguments) -> int:
    """continue an interrupted run"""
    path = user_path(arguments.run)
    folder = RunFolder(path.parent if path.is_file() else path)
    require(path.is_file() or folder.resumable or not folder.ours, f"run = {folder.path}: {folder.lost}")
    newest = path if path.is_file() else folder.checkpoint
    state, remark = checkpoint.read_good(newest)
    if remark:
        notify(remark)
    kept, passed = state.header["settings"], state.header["time"]
    changed, remedy = given(arguments, Run, leave_out=KEPT_OPTIONS), given(arguments, Remedy)
    options = Run(**{key: value for key, value in kept.items() if key != CASE} | changed)
    state.header["numerics"].update(remedy)
    if arguments.until and options.until < passed - INSTANT:
        raise SceneError(f"until = {options.until:g} s: {passed:g} s of the run have passed; must be longer")
    folder.check_frames()
    with Drawing(folder, options, scene_file=arguments.scene) as drawing, lock.held(folder.path):
        missing = folder.check_checkpoint(newest, state)
        summary = folder.summary_at(passed)
        limited = summary.get("stopped_by") == "time"
        # where nothing is left to compute
        unused = ", ".join(key for key in changed | remedy if key not in ("until", "quiet", "verbose"))
        if summary and not (limited and arguments.until and options.until > passed + INSTANT):
            notice = "; --until TIME goes on" if limited else ", it is at rest"
            notice += f"; without effect: {unused}" if unused else ""
            notify(f"run = {folder.path}: nothing left to compute{notice}")
            if not (arguments.json or options.quiet):
                print_answer(summary, options.verbose)
            complete(folder, drawing)
            return show_end(summary, folder, options.quiet, arguments.json)
        scene = state.scene(options.until, arguments.scene)
        scene = replace(scene, until=options.until or scene.until, grains=grains_of(options) or scene.grains)
        require(
            scene.until > passed + INSTANT or not unused,
            f"{unused}: nothing is left to compute; must be left out, or with a later until",
        )
        problem = state.admit(scene)
        clock = make_clock(problem, options)
        from ..engine import init

        init(options.arch, options.precision, options.threads)
        sim = state.resume(problem, profile=options.profile)
        clock.begin("ready")
        if missing:
            notify(f"run = {folder.path}: {missing} missing; written anew from {passed:g} s on")
        if not folder.ours:
            folder.mark()
        if remark:
            os.replace(checkpoint.previous(newest), newest)  # so that the next one does not replace the good one
        return carry_out(
            sim,
            folder,
            options,
            catalogue.source(arguments.scene or state.header["source"]),
            arguments.json,
            clock,
            drawing,
            resumed=kept,
        )


@command(
    "Pictures and animation of a run from its run.h5, without computing it again.",
    {
        **RUN,
        "--beside": {"metavar": "RUN", "help": "another run, drawn beside it with the same camera and range"},
        "--film": {"action": "store_true", "help": "an MP4, too (extra film)"},
        **SCENE,
    },
    {Pictures: ()},
)
def render(arguments) -> int:
    """draw a run again"""
    options = Pictures(**given(arguments, Pictures))
    folders = [RunFolder(path) for path in (arguments.run, arguments.beside) if path]
    replays = [Trajectory(folder.trajectory).checked_replay(arguments.scene) for folder in folders]
    view = {options.view: options.view != "concrete", "beads": options.beads, "cut": options.cut}
    suffix = "".join(f"-{name}" for name, on in view.items() if on)
    suffix += f"-beside-{folders[1].path.resolve().name}" if arguments.beside else ""
    files = redraw(replays, folders[0].path, suffix, options, arguments.film)
    text = f"{files['pictures']} pictures in {files['frames']}, {files.get('film', files['animation'])}"
    return tell(arguments, files, text)


@command(
    "report.html of a run, also of an earlier one or one that was killed.",
    {
        **RUN,
        "--title": {"help": "title of the report, by default as the run was given"},
        "--note": {"help": "remark that stands in the report, by default as the run was given"},
        **SCENE,
    },
)
def report(arguments) -> int:
    """write the page of a run again"""
    from ..report.page import write

    words = {key: text and plain(text) for key, text in (("title", arguments.title), ("note", arguments.note))}
    page = str(write(RunFolder(arguments.run), scene_file=arguments.scene, **words))
    return tell(arguments, {"report": page}, page)


@command(
    "One .vtu file for each output of a run, and a .pvd that opens them all.",
    {
        **RUN,
        "--out": {"help": "folder of the files, vtu in the run folder by default"},
        "--whole": {"action": "store_true", "help": "the whole body where the scene is a part of it"},
        "--surface": {"action": "store_true", "help": "its smooth surface, not its particles"},
        **SCENE,
    },
)
def export(arguments) -> int:
    """write a run as .vtu and .pvd"""
    from ..io.vtu import vtu

    folder = RunFolder(arguments.run)
    out = user_path(arguments.out or folder.path / "vtu")
    count = vtu(Trajectory(folder.trajectory).checked_replay(arguments.scene), out, arguments.whole, arguments.surface)
    return tell(arguments, {"pvd": str(out / "run.pvd"), "outputs": count}, f"{count} outputs: {out / 'run.pvd'}")


@command("The built-in scenes; 'taichi-mps run SCENE --help' lists their keywords.", JSON)
def scenes(arguments) -> int:
    """list the scenes"""
    descriptions = catalogue.describe()
    facts = [
        {"name": name, "description": descriptions[name], "file": str(path)} for name, path in catalogue.names().items()
    ]
    return tell(arguments, facts, "\n".join(f"{name:12}  {text}" for name, text in descriptions.items()))


@command("The installation, or the summary of a run.", {"run": {"nargs": "?", "help": "run folder"}} | JSON)
def info(arguments) -> int:
    """describe the installation, or a run"""
    if arguments.run:
        folder = RunFolder(arguments.run)
        facts = folder.read_summary()
        with suppress(Exception):  # of a folder that comes from anybody all that is there is shown
            if not arguments.json:
                print_answer(facts, verbose=True)
                return show_end(facts, folder, quiet=False, as_json=False)
    else:
        facts = {
            "version": __version__,
            **({"commit": commit()} if commit() else {}),
            "python": platform.python_version(),
            "platform": platform.platform(),
            "cpus": os.cpu_count(),
            "scenes": str(catalogue.folder()),
            **{
                name: metadata.version(name)
                for name in ("taichi", "quadrants", "numpy", "h5py", "pydantic", "matplotlib")
                if find_spec(name)
            },
        }
    return tell(arguments, facts, "\n".join(f"{key:18} {value}" for key, value in facts.items()))


def prepare_streams() -> None:
    """Replace missing standard streams (>&-, pythonw) by the null device, or the next files would get their numbers;
    and let outputs show characters that their encoding lacks as codes."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:
            stream = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115
            os.set_inheritable(stream.fileno(), True)
            setattr(sys, name, stream)
        elif mode == "w" and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


COMMANDS = {
    "run": run,
    "new": new,
    "resume": resume,
    "render": render,
    "export": export,
    "report": report,
    "scenes": scenes,
    "info": info,
}
GONE_COMMANDS = {"plot": GONE["plots"], "validate": "from a checkout: python -m validation ROW"}


def commands(name=None) -> dict:
    """Return COMMANDS, and those of studies where ``name`` is none of them: their import takes a tenth of a second."""
    if name in COMMANDS:
        return COMMANDS
    from .study import COMMANDS as STUDY

    return COMMANDS | STUDY


def main(argv=None, more=None) -> int:
    """Run a command line, of ``commands`` and ``more``; 0 done, 2 bad input, 3 diverged, 130, 143 and 129 ended by
    Ctrl-C, SIGTERM and SIGHUP; of a sweep 1: a case failed. BrokenPipeError where nobody reads what it prints any more,
    OutputError where that cannot be written."""
    require(argv is None or isinstance(argv, list | tuple), f"argv = {quote(argv, '')}: must be a list of words")
    prepare_streams()
    argv = [str(word) for word in (sys.argv[1:] if argv is None else argv)]
    try:
        known = commands(*argv[:1]) | (more or {})
        if not argv or argv[0] in ("-h", "--help"):
            lines = [
                "usage: taichi-mps COMMAND ... [--help]",
                "",
                *(f"  {name:9} {command.__doc__}" for name, command in known.items()),
                "",
                "example: taichi-mps run slump --yield-stress 500; its result is renders/slump/report.html",
            ]
            say("\n".join(lines))
            return DONE if argv else BAD_INPUT
        if argv[0] == "--version":
            say(__version__)
            return DONE
        gone = GONE_COMMANDS.get(argv[0])
        require(not gone, f"the command {argv[0]} is gone; {gone}")
        require(argv[0] in known, f"unknown command '{argv[0]}'{suggestion(argv[0], known)}")
        # progress of what takes long, on a terminal
        logging.basicConfig(format="taichi-mps: %(message)s")
        logging.getLogger(__package__).parent.setLevel("INFO" if sys.stderr.isatty() else "WARNING")
        with warnings.catch_warnings():  # a warning is a line and never ends a run, whatever PYTHONWARNINGS says
            warnings.filters = [each for each in warnings.filters if each[0] != "error"]
            once = cache(notify)  # not for each case of a study
            warnings.showwarning = lambda message, *_: once(str(message))
            return known[argv[0]](argv[1:])
    except (BrokenPipeError, OutputError):
        raise
    except (SceneError, OSError, ImportError, MemoryError) as error:  # or the disk is full, memory has an end
        text = error if isinstance(error, OSError) else " ".join(str(error).split()) or "out of memory"
        removed = "the current folder has been removed; must be one that is there"
        notify(removed if str(error) == f"[Errno 2] {os.strerror(2)}" else text)  # of os.getcwd
        return BAD_INPUT
    except KeyboardInterrupt as stopped:
        notify("interrupted")
        return 128 + getattr(stopped, "number", signal.SIGINT)
    except SystemExit as leaving:  # argparse after --help
        return int(leaving.code or 0)
