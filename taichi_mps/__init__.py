"""taichi_mps: Moving Particle Semi-implicit flow of fresh concrete, in Taichi."""

__version__ = "0.1.0"

from . import measure
from .geometry import Box, Cone, Plane, fill, lattice
from .material import Bingham, Newtonian
from .quantity import SceneError, checked
from .scene import Implicit, Scene, SemiImplicit
