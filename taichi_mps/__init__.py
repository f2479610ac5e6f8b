"""taichi_mps: Moving Particle Semi-implicit flow of fresh concrete, in Taichi."""

import sys
from importlib import import_module
from importlib.util import find_spec, spec_from_loader

__version__ = "0.3.0.dev0"

# What is public, by module. Loaded at first use: --help is instant, and Ctrl-C is heard before anything large is read.
_PUBLIC = {
    "__main__": ["main"],
    "engine": [
        "Bingham",
        "Box",
        "CapacityError",
        "Casson",
        "Cavity",
        "Concrete",
        "Cone",
        "Cylinder",
        "DivergedError",
        "DomainError",
        "FlowCurve",
        "Friction",
        "HerschelBulkley",
        "Implicit",
        "Inlet",
        "Jolt",
        "Law",
        "Newtonian",
        "Plane",
        "Scene",
        "SemiImplicit",
        "Solid",
        "StepReport",
        "UnmeasuredError",
        "behind",
        "box_planes",
        "fill",
        "fill_rings",
        "init",
        "lattice",
        "polygon_distance",
        "rational_critical_strain_rate",
        "rings",
        "shell",
        "vessel",
        "vibration",
        "write_bars",
    ],
    "input.catalogue": ["slump_cone"],
    "io.notebook": ["Simulation"],
    "units": ["SceneError", "checked"],
    "viz.render": ["gif", "png"],
}
_MODULE_OF = {name: module for module, names in _PUBLIC.items() for name in names}
_MODULES = {  # public modules, by the name they have here
    "backend": "engine.runtime.backend",
    "catalogue": "input.catalogue",
    "checkpoint": "io.checkpoint",
    "measure": "engine.problem.measures",
    "rest_shapes": "forecast.rest_shapes",
}
# Until 0.5 modules are found by the names that they had in 0.2, too: rooms of the engine, and what left them
_ROOMS = ["runtime", "geometry", "problem", "particles", "linear", "boundaries", "terms", "schemes", "simulation"]
_MOVED = {
    "problem.accuracy": "forecast.accuracy",
    "problem.catalogue": "input.catalogue",
    "problem.labels": "input.labels",
    "problem.rest_shapes": "forecast.rest_shapes",
    "problem.tool_path": "input.tool_path",
    "simulation.clock": "forecast.clock",
    "simulation.forecast": "forecast.cost",
    "simulation.reuse": "study.reuse",
    "simulation.summary": "io.summary",
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


sys.meta_path.insert(0, _Moved)

__all__ = ["measure", "rest_shapes", *_MODULE_OF]


def __getattr__(name):
    if name in _MODULE_OF:
        return getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
    if name in _MODULES or name in _ROOMS:
        return import_module(f".{_MODULES.get(name, name)}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return sorted([*globals(), *__all__])
