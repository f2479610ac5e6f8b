"""taichi_mps: Moving Particle Semi-implicit flow of fresh concrete, in Taichi."""

import sys
from importlib import import_module
from importlib.util import find_spec, spec_from_loader

__version__ = "0.4.0.dev0"

# What is public stands once, in __init__.pyi, where editors look, too: lines "from .module import name as public".
# Loaded at first use: --help is instant, and Ctrl-C is heard before anything large is read.
with open(f"{__file__}i", encoding="utf-8") as _stub:
    _PUBLIC = {words[-1]: (words[1][1:], words[3]) for words in map(str.split, _stub) if words[:1] == ["from"]}
_PUBLIC["measure"] = _PUBLIC.pop("measures")
# Until 0.5 modules are found by the names that they had in 0.2, too: rooms of the engine, and what left them
_ROOMS = ["runtime", "geometry", "problem", "particles", "linear", "boundaries", "terms", "schemes", "simulation"]
_MOVED = {
    "geometry.in_time": "engine.geometry.time_dependent",
    "problem.accuracy": "forecast.accuracy",
    "problem.catalogue": "input.catalogue",
    "problem.labels": "input.labels",
    "problem.rest_shapes": "forecast.rest_shapes",
    "problem.tool_path": "input.tool_path",
    "simulation.clock": "forecast.clock",
    "simulation.forecast": "forecast.cost",
    "simulation.reuse": "study.reuse",
    "simulation.summary": "io.summary",
    "study.curves": "study.measured_curves",
    "study.mixes": "study.measured_mixes",
    "terms.wall_loads": "engine.terms.wall_forces",
    "viz.notebook": "io.notebook",
}


class _Moved:
    """Finder and loader of modules by their former names."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        former = name.removeprefix(f"{__name__}.").removeprefix("engine.")
        inside = name.startswith(f"{__name__}.engine")
        if name.startswith(f"{__name__}.") and (former in _MOVED or former.split(".")[0] in _ROOMS and not inside):
            now = f"{__name__}.{_MOVED.get(former, f'engine.{former}')}"
            return find_spec(now) and spec_from_loader(name, _Moved, origin=now)
        return None

    @staticmethod
    def create_module(spec):
        """A module of the former name stands only until the other is imported."""

    @staticmethod
    def exec_module(module):
        sys.modules[module.__name__] = import_module(module.__spec__.origin)


# the only finder of this module, also where it is loaded again
sys.meta_path[:] = [_Moved, *(finder for finder in sys.meta_path if getattr(finder, "__module__", "") != __name__)]

__all__ = [*_PUBLIC]


def __getattr__(name):
    if name in _ROOMS:
        return import_module(f".{name}", __name__)
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, item = _PUBLIC[name]
    return getattr(__import__(module, globals(), fromlist=[item], level=1), item)


def __dir__():
    return sorted([*globals(), *__all__])
