"""Finding scenes: by name in the installed package or the checkout, or by the path of any Python file."""

import ast
import importlib.util
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from typing_extensions import TypedDict, Unpack

from ..engine import AnyMaterial, Bingham, Concrete, Scene
from ..forecast.accuracy import MixNumbers, choose
from ..units import SceneError, Text, require, suggestion, user_path, validated

SceneName = Text | Path
PACKAGE = Path(__file__).resolve().parents[1]


def folder() -> Path:
    """Return the folder of the built-in scenes.

    Returns
    -------
    Path
        Inside an installed package, next to the package in a checkout.
    """
    inside = PACKAGE / "scenes"
    return inside if inside.is_dir() else PACKAGE.parent / "scenes"


def names() -> dict[str, Path]:
    """Return the built-in scenes.

    Returns
    -------
    dict of str to Path
        File of each scene by its name.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> "slump" in mps.catalogue.names()
    True
    """
    return {path.stem: path for path in sorted(folder().glob("*.py")) if not path.stem.startswith("_")}


def describe() -> dict[str, str]:
    """Return the first line of the docstring of each built-in scene.

    Returns
    -------
    dict of str to str
        Descriptions by name.
    """
    trees = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in names().items()}
    return {name: (ast.get_docstring(tree) or "").split("\n", 1)[0] for name, tree in trees.items()}


@validated
def locate(name: SceneName) -> Path:
    """Find the file of a scene.

    Parameters
    ----------
    name : str
        Name of a built-in scene ('slump') or path of a Python file ('scenes/slump.py').

    Returns
    -------
    Path
        File.

    Raises
    ------
    SceneError
        If there is no such scene; names a similar one.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.catalogue.locate("slump").name
    'slump.py'
    """
    known = names()
    if str(name) in known:
        return known[str(name)]
    path = user_path(name)
    if path.suffix == ".py" and path.is_file():
        return path.resolve()
    require(path.suffix != ".py", f"scene = {name}: no such file{suggestion(path.stem, known)}")
    raise SceneError(f"unknown scene '{name}'{suggestion(name, known) or ';'} known are {', '.join(known) or 'none'}")


@validated
def source(name: SceneName) -> str:
    """Return what a checkpoint keeps to find a scene again.

    Parameters
    ----------
    name : str
        Name or path of the scene.

    Returns
    -------
    str
        Name of a built-in scene, else the full path of the file.
    """
    path = locate(name)
    return path.stem if names().get(path.stem) == path else str(path)


@validated
def load(name: SceneName) -> Callable[..., Scene]:
    """Import the function of a scene.

    Parameters
    ----------
    name : str
        Name of a built-in scene or path of a Python file.

    Returns
    -------
    callable
        Function ``scene`` of the file; its ``parameters`` is the pydantic model of its keywords.

    Raises
    ------
    SceneError
        If the file is missing, cannot be run, or has no such function.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> "spacing" in mps.catalogue.load("slump").parameters.model_fields
    True
    """
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


@validated
def build(name: SceneName, material: AnyMaterial | None = None, /, **keywords: Any) -> Scene:
    """Make a scene from its name or file and its keywords.

    Parameters
    ----------
    name : str
        Name of a built-in scene or path of a Python file.
    material : Material, optional
        Material instead of the numbers of one, for a scene that takes a material; by place, not by name.
    **keywords
        Keywords of the scene's function, such as ``spacing`` [m] and ``until`` [s]; a number or text with a unit.

    Returns
    -------
    Scene
        Scene with every keyword in ``parameters``.

    Raises
    ------
    SceneError
        If a keyword is unknown or out of range, or the scene cannot be made.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.catalogue.build("slump", spacing="3 cm").spacing
    0.03
    """
    function = load(name)
    valid = function.parameters(**keywords)
    try:
        with np.errstate(all="ignore"):  # what overflows here is refused, by name
            scene = function.at(valid, **({"material": material} if material else {}))
    except SceneError:
        raise
    except Exception as error:
        raise SceneError(f"scene {name} cannot be made: {type(error).__name__}: {error}") from error
    require(isinstance(scene, Scene), f"scene {name}: its function returns {type(scene).__name__}; must return a Scene")
    if getattr(valid, "accuracy", None) is not None and not {"model", "spacing"} <= set(keywords):
        mix, law = None, scene.material
        if type(law) is Bingham and law.yields and law.straight:  # errors were measured for such mixes alone
            mix = MixNumbers.of(law.yield_value, law.plastic_viscosity, law.density, valid.height)
        choice = choose(
            valid.accuracy,
            **{key: getattr(valid, key) for key in ("model", "spacing") if key in keywords},
            mix=mix,
            height=valid.height,
            lift_speed=getattr(valid, "lift_speed", None),
        )
        warnings.warn(f"accuracy = {1e3 * valid.accuracy:g} mm: {choice}", stacklevel=3)
        return build(name, material, **{**keywords, "model": choice.model, "spacing": choice.spacing})
    numbers = {name: dict(material).get(name) for name in Concrete.model_fields} if material else {}
    return replace(scene, parameters=valid.model_dump(mode="json") | numbers)


def rebuild(source: str, parameters: dict, scene_file=None) -> Scene:
    """Make the scene of a run folder again.

    Parameters
    ----------
    source : str
        What ``source`` gave when the run was made.
    parameters : dict
        Keywords of the scene's function.
    scene_file : path-like, optional
        File of a scene that is not built in. A run folder may come from anybody, so code that it names is run only if
        the caller names it, too.

    Returns
    -------
    Scene
        Scene.

    Raises
    ------
    SceneError
        If the parameters are damaged, or the scene is not built in and ``scene_file`` is not given.
    """
    require(isinstance(parameters, dict), f"scene = {source}: its parameters are damaged")
    require(
        scene_file is not None or source in names(),
        f"scene = {source}: is code of yours, and run only if you name it again: --scene {source}",
    )
    require(
        scene_file is not None or None in map(parameters.get, ("consistency", "plastic_viscosity")),
        f"scene = {source}: of version 0.2; version 0.3.0 reads it",
    )
    name = source if scene_file is None else scene_file
    unused = load(name).parameters.without_effect(parameters)  # keywords that an earlier version took
    return build(name, **{key: value for key, value in parameters.items() if key not in unused})


Number = float | str  # in SI units, or text with a unit


class SlumpKeywords(TypedDict, total=False):  # noqa: D101  (scenes/slump.py describes them)
    density: Number
    yield_value: Number
    plastic_viscosity: Number | None
    critical_strain_rate: Number | None
    friction_angle: Number
    consistency: Number | None
    flow_index: Number
    structuration: Number
    destructuration: Number
    age: Number
    casson_viscosity: Number | None
    spacing: Number
    base_diameter: Number
    top_diameter: Number
    height: Number
    floor_radius: Number | None
    lift_speed: Number | None
    until: Number | None
    model: Literal["full", "half", "quarter", "axisymmetric"]
    accuracy: Number | None


@validated
def slump_cone(material: AnyMaterial | None = None, **keywords: Unpack[SlumpKeywords]) -> Scene:
    """Make the slump test of a material.

    Parameters
    ----------
    material : Material, optional
        Mix, the scene's own by default.
    **keywords
        Keywords of scenes/slump.py, such as ``spacing`` [m], ``model`` and ``until`` [s].

    Returns
    -------
    Scene
        Standard cone, 30 cm high, on a rough floor.

    Raises
    ------
    SceneError
        If a keyword is unknown, out of range, or a number of the given material.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> scene = mps.slump_cone(mps.Bingham(yield_value=500.0), model="axisymmetric", spacing=0.02)
    >>> scene.material.yield_value, scene.dimension
    (500.0, 2)
    """
    for key, value in keywords.items():
        require(not material or key not in Concrete.model_fields, f"{key} = {value}: already given by the material")
    return build("slump", material, **keywords)
