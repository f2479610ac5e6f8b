"""taichi_mps: Moving Particle Semi-implicit flow of fresh concrete, in Taichi."""

from importlib import import_module

from .geometry.cavity import Cavity
from .geometry.friction import Friction
from .geometry.shapes import Box, Cone, fill, fill_rings, lattice, rings, shell
from .geometry.solid import Solid, polygon_distance, write_bars
from .geometry.walls import Cylinder, Plane, behind, box_planes
from .problem import measures as measure
from .problem import rest_shapes
from .problem.inlet import Inlet
from .problem.materials import Bingham, FlowCurve, HerschelBulkley, Newtonian, rational_critical_strain_rate
from .problem.numerics import Implicit, SemiImplicit
from .problem.scene import Scene
from .schemes.step_report import DivergedError, DomainError, StepReport, UnmeasuredError
from .units import SceneError, checked

__version__ = "0.1.0"

_LAZY = {  # names whose modules import Taichi or the edges: loaded at first use, so that --help is instant
    "init": "runtime.backend",
    "Simulation": "viz.notebook",
    "CapacityError": "particles.neighbors",
    "png": "viz.render",
    "gif": "viz.render",
    "slump_cone": "problem.catalogue",
    "main": "cli.main",
}
_MODULES = {"catalogue": "problem.catalogue", "checkpoint": "io.checkpoint", "backend": "runtime.backend"}  # for users

__all__ = [
    "Bingham",
    "Box",
    "Cavity",
    "Cone",
    "Cylinder",
    "DivergedError",
    "DomainError",
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
    "UnmeasuredError",
    "behind",
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
    if name in _MODULES:
        return import_module(f".{_MODULES[name]}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
