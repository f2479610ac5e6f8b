"""taichi_mps: Moving Particle Semi-implicit flow of fresh concrete, in Taichi."""

from importlib import import_module

from . import measure, rest_shapes
from .bodies import Box, Cone, fill, fill_rings, lattice, rings, shell
from .filling import Cavity
from .geometry import Cylinder, Plane, box_planes
from .inlet import Inlet
from .material import Bingham, FlowCurve, Friction, HerschelBulkley, Newtonian, rational_critical_strain_rate
from .quantity import SceneError, checked
from .report import DivergedError, StepReport
from .scene import Implicit, Scene, SemiImplicit
from .solids import Solid, polygon_distance, write_bars

__version__ = "0.1.0"

_LAZY = {  # names whose modules import Taichi or the edges: loaded at first use, so that --help is instant
    "init": "backend",
    "Simulation": "notebook",
    "CapacityError": "neighbors",
    "png": "render",
    "gif": "render",
    "slump_cone": "catalogue",
    "main": "cli",
}

__all__ = [
    "Bingham",
    "Box",
    "Cavity",
    "Cone",
    "Cylinder",
    "DivergedError",
    "FlowCurve",
    "Friction",
    "HerschelBulkley",
    "Implicit",
    "Inlet",
    "Newtonian",
    "Plane",
    "Scene",
    "SceneError",
    "SemiImplicit",
    "Solid",
    "StepReport",
    "box_planes",
    "checked",
    "fill",
    "fill_rings",
    "lattice",
    "measure",
    "polygon_distance",
    "rational_critical_strain_rate",
    "rest_shapes",
    "rings",
    "shell",
    "write_bars",
    *_LAZY,
]


def __getattr__(name):
    if name in _LAZY:
        return getattr(import_module(f".{_LAZY[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
