"""Options of the command line made from pydantic models: unit, allowed range and default in --help."""

import argparse
import json
import re
import sys
from collections import defaultdict
from contextlib import suppress
from functools import wraps
from typing import Annotated, Literal, get_args, get_origin

from pydantic import AfterValidator, Field

from ..engine import COURANT, LAWS, NUMERICS, Concrete
from ..input import catalogue
from ..input.labels import keyword_description, option_name
from ..io.run_folder import strict
from ..units import (
    Arch,
    Checked,
    Count,
    Density,
    Duration,
    Only,
    Ratio,
    SceneError,
    checked,
    notes,
    plain,
    quote,
    real,
    require,
    suggestion,
    unit_of,
)

EXAMPLES = {
    "run": "run slump --yield-stress 500 --accuracy 5mm",
    "new": "new wall > case.toml",
    "resume": "resume renders/slump --until 4",
    "render": "render renders/slump --view speed",
    "export": "export renders/slump --surface",
    "report": "report renders/slump",
    "sweep": "sweep slump --yield-stress 50:1500:12 --plastic-viscosity 20,50,100",
    "calibrate": "calibrate --slump 18cm --slump-flow 32cm",
    "chart": "chart --out chart.png",
    "require": "require wall --filled 0.97",
    "mortar": "mortar --yield-stress 300 --plastic-viscosity 50 --grains-volume 0.3",
    "info": "info renders/slump",
    "app": "app --folder renders",
}
GROUPS = "mix", "test", "accuracy and cost", "output", "expert"  # of the options of a run, as --help has them
MIX = set(Concrete.model_fields)
COST = {"spacing", "model", "accuracy", "threads", "budget"}
EXPERT = {"critical_strain_rate", "scheme", "precision", "arch", "profile"}
RESULTS = {"--slump", "--slump-flow", "--spread", "--t500"}  # which some users give as options
GONE = {  # options of earlier versions by their keyword, and what there is instead
    "plots": "report.html draws the curves of a run, history.csv holds them",
    "renderer": "pictures are drawn in software; 'beads' shows the particles",
    "surface": "it is what is drawn; must be left out",
    **dict.fromkeys(("source", "gradient"), "the scheme semi-implicit has two forms, its own and --literal"),
    "pressure": "a mix that fills presses as a liquid; 'run wall --measure-pressure' tells it",
}


DONE, BAD_INPUT, DIVERGED = 0, 2, 3  # exit codes; 128 plus the number of a signal that ended the command
MAX_READ_BACK = 8  # values of a list that are printed one by one
JSON = {"--json": {"action": "store_true", "help": "print the result as JSON"}}


def command(description: str, arguments: dict, models: dict | None = None):
    """Make a decorator that turns a function of parsed arguments into the command of its name, a function of words.
    ``arguments``: {name: settings of argparse}; ``models`` with more options: {model: (heading, fields left out)}."""

    def of(function):
        @wraps(function)
        def from_words(argv) -> int:
            parser = Parser(function.__name__, description=description)
            for name, settings in arguments.items():
                parser.add_argument(name, **settings)
            for model, placed in (models or {}).items():
                parser.options(model, *placed)
            return function(parser.parse(argv))

        return from_words

    return of


class OutputError(OSError):
    """Error of the standard output, as of a full disk; other files have a name."""


def say(text: str, end="\n") -> None:
    """Print a result; OutputError where that cannot be written, BrokenPipeError where nobody reads it any more."""
    try:
        sys.stdout.write(text + end)  # at once: 'head -1' goes after the first part
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(error.errno, error.strerror) from None


def notify(text: str) -> None:
    """Print a notice on one line, beside the result."""
    print(plain(f"taichi-mps: {text}"), file=sys.stderr, flush=True)


def tell(arguments, facts, text) -> int:
    """Print the facts as JSON with ``--json``, else the text; returns DONE."""
    say(json.dumps(strict(facts)) if arguments.json else plain(text))
    return DONE


class Pictures(Checked):
    """Options of every command that draws."""

    view: Literal["concrete", "speed", "pressure", "shear-rate", "yielded", "mix", "distance"] = Field(
        "concrete", description="what the pictures are coloured by"
    )
    beads: bool = Field(False, description="show the particles, not the smooth surface")
    cut: bool = Field(False, description="cut the mortar around grains open, instead of translucent")


class Workers(Checked):
    """Options of every command that computes many cases."""

    executor: str = Field("local", description="where to compute: local or dask://HOST:PORT")
    workers: Count | None = Field(
        None, description="cases at once: processes of this machine, one for each CPU by default; of a cluster: all"
    )


Caption = Annotated[str, AfterValidator(plain)]


class Run(Pictures):
    """Options of run; a checkpoint keeps them for resume."""

    arch: Arch = Field("cpu", description="where to compute")
    threads: Count | None = Field(None, description="processor cores to use, all of them by default")
    scheme: Literal["implicit", "semi-implicit"] = Field("implicit", description="numerical scheme")
    precision: Literal["f32", "f64"] = Field("f32", description="of the solver's numbers")
    until: Duration | None = Field(None, description="time limit of the flow, the scene's own by default")
    every: Duration | None = Field(
        None,
        description="time between pictures, by default a twentieth of the time limit, and of what falls to rest at "
        "most 0.3 sqrt(H/g)",
    )
    title: Caption | None = Field(None, description="title of the report, by default the name of the test")
    note: Caption | None = Field(None, description="remark that stands in the report")
    out: str | None = Field(None, description="folder of the results, by default renders/<scene> or the next free name")
    overwrite: bool = Field(False, description="replace the run that is in the folder")
    pictures: bool = Field(True, description="draw pictures, animation and report when the result is there")
    profile: bool = Field(False, description="show the time that each stage took")
    grains: str | None = Field(
        None, description="diameter of grains in the mortar, 12mm, or a grading by volume, 8mm:0.4+16mm:0.6"
    )
    grains_volume: Annotated[real("-", gt=0.0, le=0.35) | None, Only("grains")] = Field(  # as mps.Grains has it
        None, description="volume of the grains over that of the body"
    )
    grains_density: Annotated[Density | None, Only("grains")] = Field(
        None, description="density of the stone, by default 2650 kg/m3"
    )
    grains_friction: Annotated[real("-", ge=0.0, le=10.0) | None, Only("grains")] = Field(
        None, description="coefficient of friction of the grains"
    )
    grains_seed: Annotated[Count | None, Only("grains")] = Field(
        None, description="number from which the places of the grains follow"
    )
    grains_shape: Annotated[str | None, Only("grains")] = Field(
        None, description="shape of the grains, 'ellipsoid 2:1:1', in a plane 'ellipse 2:1', by default spheres"
    )
    quiet: bool = Field(False, description="no progress and no result on the screen")
    verbose: bool = Field(
        False, description="show the parts of the time and the numerics, too: steps, iterations, volume error"
    )


class Remedy(Checked):
    """Numerics with which resume may go on, where a run diverged."""

    courant_number: Ratio | None = Field(None, description=COURANT)
    max_time_step: Duration | None = Field(None, description="no step is longer")
    diffusion_number: Ratio | None = Field(None, description="of the scheme semi-implicit")


class Parser(argparse.ArgumentParser):
    """Parser of argparse with options from pydantic models, which raises a SceneError of one line for bad input."""

    def __init__(self, command, what="", **settings):
        super().__init__(
            f"taichi-mps {command}",
            f"taichi-mps {command} {what} [options]" if what else None,
            epilog=f"example: taichi-mps {EXAMPLES[command]}" if command in EXAMPLES else None,
            formatter_class=lambda prog: argparse.HelpFormatter(prog, max_help_position=42, width=112),
            allow_abbrev=False,
            **settings,
        )
        self._negative_number_matcher = re.compile(r"-([\d.,]|inf|nan)")  # argparse's own knows neither -1e3 nor -3cm
        self.groups = defaultdict(self.add_argument_group, {name: self.add_argument_group(name) for name in GROUPS})

    def error(self, message):
        """Raise the error of argparse as a SceneError."""
        raise SceneError(message)

    def options(self, model, title=None, leave_out=()):
        """Add an option for every field of a pydantic model, with its unit, allowed range and default, to the group of
        this title or to its own."""
        for name, field in model.model_fields.items():
            if name in leave_out:
                continue
            flag = "--" + name.replace("_", "-")
            require(
                flag not in self._option_string_actions,
                f"scene keyword '{name}' has the name of an option of run; rename it",
            )
            flags = [option_name(name, model.model_fields), flag]
            range_and_default = " ".join(filter(None, (default(field), allowed(field))))
            text = ", ".join(filter(None, (field.description or keyword_description(name), range_and_default)))
            switch = {"action": argparse.BooleanOptionalAction if field.default else "store_true", "default": None}
            unit = unit_of(field).replace("-", "N").replace(" ", ".")
            number = {"metavar": "|".join(filter(None, (unit, *choices(field)))) or "X"}
            self.groups[title or group_of(name, model)].add_argument(
                *dict.fromkeys(flags), dest=name, help=text, **(switch if field.annotation is bool else number)
            )

    def parse(self, argv):
        """Parse a command line; an unknown option is refused with the nearest known one."""
        arguments, unknown = self.parse_known_args(argv)
        for word in unknown:
            flag = word.split("=", 1)[0]
            require(flag.startswith("-"), f"unexpected argument '{word}'")
            require(flag not in RESULTS, f"{flag} is a result; 'taichi-mps calibrate {word}' finds the mix that has it")
            raise SceneError(f"unknown option {flag}{suggested(flag, self._option_string_actions.keys() - {'--help'})}")
        return arguments


def suggested(word: str, known) -> str:
    """Return what there is instead of an option of this name, or which command, scheme or law has it, else what is
    near."""
    name = word.lstrip("-").replace("-", "_")
    if name in GONE:
        return f": {GONE[name]}"
    owners = {
        "run": Run,
        "sweep": Workers,
        **{f"the scheme {scheme}": model for scheme, model in NUMERICS.items()},
        **{f"the law {law.__name__}": law for law in LAWS},
    }
    owner = next((owner for owner, model in owners.items() if name in model.model_fields), None)
    return f": {owner} has it; must be left out here" if owner else suggestion(word, known)


@checked
def unnamed():
    """Each scene has options of its own, which are listed here when it is named."""


def parse_scene(command, argv, model, what, description=None):
    """Read the options of ``model`` and the ``scene`` of a command line before the options of the scene are known; if
    these come first, the scene is the first word that names one. Returns both, the scene's function and a parser."""
    first = Parser(command, add_help=False)
    first.add_argument("scene", nargs="?")
    first.options(model, command)
    known, others = first.parse_known_args(argv)
    names = f"{', '.join(catalogue.names())}, or a Python file"
    require(known.scene or {"-h", "--help"} & set(argv), f"{command}: name a scene: {names}")
    for word in (known.scene, *others):
        with suppress(SceneError):
            catalogue.locate(word or "")
            known.scene = word
            break
    function = catalogue.load(known.scene) if known.scene else unnamed
    parser = Parser(command, what, description=description or (function.__doc__ or "").strip())
    parser._action_groups += [parser._action_groups.pop(0), parser._action_groups.pop(0)]  # what is asked first, first
    parser.add_argument("scene", help=f"name: {names}{' or case file' if 'CASE' in what else ''}")
    return known, function, parser


def choices(field) -> list[str]:
    """Words that a field accepts, alone or besides a number."""
    kinds = (field.annotation, *get_args(field.annotation))
    return [word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)]


def allowed(field) -> str:
    """Format the allowed range of a field: '(0 to 1e+06)', or 'above 0' where the bound itself is not allowed."""
    marks = {"gt": "above {:g}", "ge": "{:g}", "lt": "to below {:g}", "le": "to {:g}"}
    bounds = {mark: getattr(note, mark) for note in notes(field) for mark in marks if hasattr(note, mark)}
    if "gt" in bounds:  # one that a field sets beside that of its kind
        bounds.pop("ge", None)
    texts = [text.format(bounds[mark]) for mark, text in marks.items() if mark in bounds]
    return f"({' '.join(texts)})" if texts else ""


def default(field) -> str:
    """Format the default of a field: 'default 300 Pa', the unit alone without a default, or 'required'."""
    unit = unit_of(field).strip("-")
    if field.is_required() or field.default in (None, "") or field.default is False:
        return " ".join(["required"] * field.is_required() + ([f"[{unit}]"] if unit else []))
    return f"default {quote(field.default, unit)}"


def group_of(name: str, model) -> str:
    """Group of an option in --help: the first of these that holds, else 'test'."""
    holds = {
        "accuracy and cost": name in COST,
        "expert": name in EXPERT or model in NUMERICS.values(),
        "mix": name.startswith("grains") or (name in MIX and not issubclass(model, Pictures)),
        "output": issubclass(model, Pictures) and name != "until",
    }
    return next((group for group in holds if holds[group]), "test")


def is_tuple(field) -> bool:
    """Whether a field has several values, separated by commas on the command line."""
    return tuple in map(get_origin, (field.annotation, *get_args(field.annotation)))


def read_back(name: str, values, field) -> None:
    """Print on stderr the values that were read from a list with commas."""
    texts = [quote(value, "") for value in values]
    shown = texts if len(texts) <= MAX_READ_BACK else [*texts[:3], "...", texts[-1]]
    notify(f"{name}: {len(texts)} values: {', '.join(shown)} {unit_of(field).strip('-')}".rstrip())


def given(arguments, model, leave_out=()) -> dict:
    """Given options of a model as text, {name: text}; the model converts them to numbers."""
    values = {name: getattr(arguments, name, None) for name in model.model_fields if name not in leave_out}
    return {
        name: value.split(",") if is_tuple(model.model_fields[name]) else value
        for name, value in values.items()
        if value is not None
    }
