"""taichi_mps: Moving Particle Semi-implicit flow of fresh concrete, in Taichi."""

import sys
from importlib import import_module
from importlib.util import spec_from_loader

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

    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if not name.startswith(f"{__name__}."):
            return None
        former = name.removeprefix(f"{__name__}.").removeprefix("engine.")
        if former not in _MOVED and (former.split(".")[0] not in _ROOMS or name.startswith(f"{__name__}.engine")):
            return None
        module = import_module(f".{_MOVED.get(former, f'engine.{former}')}", __name__)
        spec = spec_from_loader(name, cls)
        spec.loader_state = module, module.__spec__
        return spec

    @staticmethod
    def create_module(spec):
        return spec.loader_state[0]

    @staticmethod
    def exec_module(module):
        module.__spec__ = module.__spec__.loader_state[1]  # as before this import


sys.meta_path.insert(0, _Moved)

__all__ = ["measure", "rest_shapes", *_MODULE_OF]


def __getattr__(name):
    if name in _MODULE_OF:
        return getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
    if name in _MODULES:
        return import_module(f".{_MODULES[name]}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return sorted([*globals(), *__all__])
