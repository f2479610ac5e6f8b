"""taichi_mps: Moving Particle Semi-implicit flow of fresh concrete, in Taichi."""

from importlib import import_module

__version__ = "0.3.0.dev0"

# What is public, by module. Loaded at first use: --help is instant, and Ctrl-C is heard before anything large is read.
_PUBLIC = {
    "__main__": ["main"],
    "geometry.in_time": ["vibration"],
    "geometry.cavity": ["Cavity"],
    "geometry.shapes": ["Box", "Cone", "fill", "fill_rings", "lattice", "rings", "shell"],
    "geometry.meshes": ["write_bars"],
    "geometry.solid": ["Solid", "polygon_distance"],
    "geometry.walls": ["Cylinder", "Friction", "Plane", "behind", "box_planes", "vessel"],
    "particles.neighbors": ["CapacityError"],
    "problem.catalogue": ["slump_cone"],
    "problem.inlet": ["Inlet"],
    "problem.jolt": ["Jolt"],
    "problem.materials": [
        "Bingham",
        "Casson",
        "Concrete",
        "FlowCurve",
        "HerschelBulkley",
        "Law",
        "Newtonian",
        "rational_critical_strain_rate",
    ],
    "problem.numerics": ["Implicit", "SemiImplicit"],
    "problem.scene": ["Scene"],
    "runtime.backend": ["init"],
    "schemes.step_report": ["DivergedError", "DomainError", "StepReport", "UnmeasuredError"],
    "units": ["SceneError", "checked"],
    "viz.notebook": ["Simulation"],
    "viz.render": ["gif", "png"],
}
_MODULE_OF = {name: module for module, names in _PUBLIC.items() for name in names}
_MODULES = {  # public modules, by the name they have here
    "backend": "runtime.backend",
    "catalogue": "problem.catalogue",
    "checkpoint": "io.checkpoint",
    "measure": "problem.measures",
    "rest_shapes": "problem.rest_shapes",
}

__all__ = ["measure", "rest_shapes", *_MODULE_OF]


def __getattr__(name):
    if name in _MODULE_OF:
        return getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
    if name in _MODULES:
        return import_module(f".{_MODULES[name]}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return sorted([*globals(), *__all__])
