"""Finding scenes: by name in the installed package or the checkout, or by the path of any Python file."""

import ast
import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..units import SceneError, require, suggestion
from .accuracy import Mix, choose
from .materials import Bingham
from .scene import Scene

PACKAGE = Path(__file__).resolve().parents[1]


def folder() -> Path:
    """Folder of the built-in scenes: inside an installed package, next to the package in a checkout."""
    inside = PACKAGE / "scenes"
    return inside if inside.is_dir() else PACKAGE.parent / "scenes"


def names() -> dict[str, Path]:
    """The built-in scenes, name -> file."""
    return {path.stem: path for path in sorted(folder().glob("*.py")) if not path.stem.startswith("_")}


def docstring(path: Path) -> str:
    """Docstring of a file, which is read without being run."""
    return ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""


def describe() -> dict[str, str]:
    """The built-in scenes, name -> first line of the docstring."""
    return {name: docstring(path).split("\n", 1)[0] for name, path in names().items()}


def run_time(name: str) -> str:
    """What a built-in scene says of its run time, '' where it says nothing; reads the file without running it."""
    text = docstring(names()[name])
    return next((line.removeprefix("Run time: ") for line in text.splitlines() if line.startswith("Run time: ")), "")


def locate(name: str) -> Path:
    """File of a scene given by name ('slump') or by path ('scenes/slump.py')."""
    known = names()
    if str(name) in known:
        return known[str(name)]
    path = Path(name)
    if path.suffix == ".py" and path.is_file():
        return path.resolve()
    require(path.suffix != ".py", f"scene = {name}: no such file{suggestion(path.stem, known)}")
    raise SceneError(f"unknown scene '{name}'{suggestion(name, known) or ';'} known are {', '.join(known) or 'none'}")


def source(name: str) -> str:
    """What a checkpoint keeps to find the scene again: the name of a built-in scene, else the file's full path."""
    path = locate(name)
    return path.stem if names().get(path.stem) == path else str(path)


def load(name: str):
    """The scene function of a name or a file; its ``parameters`` is the pydantic model of its keywords."""
    path = locate(name)
    spec = importlib.util.spec_from_file_location(f"scene_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except SceneError:
        raise
    except Exception as error:
        raise SceneError(f"scene file {path} cannot be loaded: {type(error).__name__}: {error}") from error
    function = getattr(module, "scene", None)
    require(hasattr(function, "parameters"), f"scene file {path} has no function 'scene' decorated with @checked")
    return function


def build(name: str, /, **keywords) -> Scene:
    """The Scene of a name or a file, with every keyword it was made from in ``parameters``."""
    function = load(name)
    valid = function.parameters(**keywords)
    try:
        with np.errstate(all="ignore"):  # what overflows here is refused, by name
            scene = function.at(valid)
    except SceneError:
        raise
    except Exception as error:
        raise SceneError(f"scene {name} cannot be made: {type(error).__name__}: {error}") from error
    require(isinstance(scene, Scene), f"scene {name}: its function returns {type(scene).__name__}; must return a Scene")
    if getattr(valid, "accuracy", None) is not None and not {"model", "spacing"} <= set(keywords):
        mix, material = None, scene.material
        if type(material) is Bingham and material.yields:  # of such mixes the errors were measured
            mix = Mix.of(material.yield_value, material.plastic_viscosity, material.density, valid.height)
        fixed = {key: getattr(valid, key) for key in ("model", "spacing") if key in keywords}
        if getattr(valid, "lift_speed", None):  # a lifted mould needs the whole cone
            fixed["model"] = "full"
        choice = choose(valid.accuracy, **fixed, mix=mix, height=valid.height)
        print(f"taichi-mps: accuracy = {1e3 * valid.accuracy:g} mm: {choice}", file=sys.stderr)
        return build(name, **{**keywords, "model": choice.model, "spacing": choice.spacing})
    return replace(scene, parameters=valid.model_dump(mode="json"))


def rebuild(source: str, parameters: dict, scene_file=None) -> Scene:
    """The Scene of a run folder. A folder may come from anybody, so the scene file it names, which is code, is run only
    if the caller names it, too; a built-in scene is taken by its name."""
    require(isinstance(parameters, dict), f"scene = {source}: its parameters are damaged")
    require(
        scene_file is not None or source in names(),
        f"scene = {source}: is code of yours, and run only if you name it again: --scene {source}",
    )
    return build(source if scene_file is None else scene_file, **parameters)


def slump_cone(material: Bingham | None = None, **keywords) -> Scene:
    """The slump test with a material and the keywords of scenes/slump.py (spacing [m], until [s], ...)."""
    known = load("slump").parameters.model_fields
    given = material.model_dump() if material else {}
    for key, value in keywords.items():
        require(key not in given, f"{key} = {value}: already given by the material")
    scene = build("slump", **{key: value for key, value in given.items() if key in known}, **keywords)
    return replace(scene, material=material) if material else scene
