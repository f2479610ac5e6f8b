"""Options of the command line made from pydantic models: unit, allowed range and default in --help."""

import argparse
from contextlib import suppress
from typing import Literal, get_args, get_origin

from pydantic import Field

from ..problem import catalogue
from ..problem.labels import in_words
from ..units import Checked, Count, Duration, SceneError, suggestion, unit_of

SCHEMES = Literal["implicit", "semi-implicit"]
VIEWS = Literal["concrete", "speed", "pressure", "shear-rate", "yielded", "mix"]


class Pictures(Checked):
    """Options of every command that draws."""

    view: VIEWS = Field("concrete", description="what the pictures show")
    renderer: Literal["software", "ggui"] = Field("software", description="what draws them")
    arch: Literal["cpu", "cuda", "vulkan"] = Field("cpu", description="where to compute")
    threads: Count | None = Field(None, description="CPU threads, all of them by default")


class Run(Pictures):
    """Options of run; a checkpoint keeps them for resume."""

    scheme: SCHEMES = Field("implicit", description="numerical scheme")
    precision: Literal["f32", "f64"] = Field("f32", description="of the solver's numbers")
    until: Duration | None = Field(None, description="end of the simulated time, the scene's own by default")
    every: Duration | None = Field(None, description="interval of the pictures, about until/100 by default")
    out: str | None = Field(None, description="run folder, renders/<scene> or the next free name by default")
    overwrite: bool = Field(False, description="replace the run that is in the folder")
    profile: bool = Field(False, description="show the time that each stage took")
    quiet: bool = Field(False, description="no progress and no table")


class Table(Checked):
    """Options of validate."""

    scheme: SCHEMES = Field("implicit", description="numerical scheme, with its defaults")
    budget: Duration | None = Field(None, description="CPU time after which a row is stopped")


class Parser(argparse.ArgumentParser):
    """One clear line instead of the usage text for bad input."""

    def __init__(self, command, **settings):
        settings.setdefault(
            "formatter_class", lambda prog: argparse.HelpFormatter(prog, max_help_position=42, width=112)
        )
        super().__init__(prog=f"taichi-mps {command}".strip(), allow_abbrev=False, **settings)

    def error(self, message):
        """Bad input, as argparse says it."""
        raise SceneError(message)

    def options(self, model, title, leave_out=()):
        """One option for every field of a pydantic model, with its unit, allowed range and default."""
        group = self.add_argument_group(title)
        for name, field in model.model_fields.items():
            if name in leave_out:
                continue
            flag = "--" + name.replace("_", "-")
            if flag in self._option_string_actions:
                raise SceneError(f"scene keyword '{name}' has the name of an option of run; rename it")
            text = ", ".join(filter(None, (field.description or in_words(name), allowed(field), default(field))))
            if field.annotation is bool:
                switch = argparse.BooleanOptionalAction if field.default else "store_true"
                group.add_argument(flag, dest=name, action=switch, default=None, help=text)
            else:
                unit = unit_of(field).replace("-", "N").replace(" ", ".")
                group.add_argument(flag, dest=name, metavar="|".join([unit] * bool(unit) + choices(field)) or "X",
                                   help=text)  # fmt: skip

    def parse(self, argv):
        """Namespace; an option that does not exist is refused with the nearest one that does."""
        arguments, unknown = self.parse_known_args(joined(argv))
        for word in unknown:
            flag = word.split("=", 1)[0]
            if flag.startswith("-"):
                raise SceneError(
                    f"unknown option {flag}{suggestion(flag, set(self._option_string_actions) - {'--help'})}"
                )
            raise SceneError(f"unexpected argument '{word}'")
        return arguments


def scene_of(command, argv, model) -> argparse.Namespace:
    """The scene that a command line names, ``scene``, and the options of ``model`` in it, before those of the scene are
    known: with these before it, the first word that is a scene."""
    first = Parser(command, add_help=False)
    first.add_argument("scene", nargs="?")
    first.options(model, command)
    known, others = first.parse_known_args(joined(argv))
    if not known.scene and not {"-h", "--help"} & set(argv):
        raise SceneError(f"{command}: name a scene: {', '.join(catalogue.names())}, or a Python file")
    for word in (known.scene, *others):
        with suppress(SceneError):
            catalogue.locate(word or "")
            known.scene = word
            break
    return known


def joined(argv) -> list[str]:
    """``--key -1e3`` as ``--key=-1e3``, which argparse would take for an option."""
    words = []
    for word in argv:
        negative = word.startswith("-") and not word.startswith("--") and is_number(word)
        if negative and words and words[-1].startswith("--") and "=" not in words[-1]:
            words[-1] += f"={word}"
        else:
            words.append(word)
    return words


def is_number(word: str) -> bool:
    """Is a word of a command line a number?"""
    try:
        float(word)
    except ValueError:
        return False
    return True


def choices(field) -> list[str]:
    """The words that a field accepts, alone or beside a number."""
    kinds = (field.annotation, *get_args(field.annotation))
    return [word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)]


def allowed(field) -> str:
    """'[Pa], 0 <= . <= 1e+06' from the field's declaration."""
    unit = unit_of(field).strip("-")
    marks = {"gt": "> {:g}", "ge": ">= {:g}", "lt": "< {:g}", "le": "<= {:g}"}
    bounds = [text.format(getattr(item, mark)) for item in field.metadata for mark, text in marks.items()
              if getattr(item, mark, None) is not None]  # fmt: skip
    return " ".join(filter(None, (f"[{unit}]" if unit else "", " and ".join(bounds))))


def default(field) -> str:
    """'default 300.0', 'required' or nothing, of a field."""
    if field.is_required():
        return "required"
    return "" if field.default in (None, False, "") else f"default {field.default}"


def given(arguments, model, leave_out=()) -> dict:
    """The options of a model that were given, as text; the model turns them into numbers."""
    values = {name: getattr(arguments, name, None) for name in model.model_fields if name not in leave_out}
    return {
        name: value.split(",") if get_origin(model.model_fields[name].annotation) is tuple else value
        for name, value in values.items()
        if value is not None
    }
