"""What is public, as an editor reads it and as the package finds it: each name in the module before it."""

from .__main__ import main as main
from .engine.geometry.cavity import Cavity as Cavity
from .engine.geometry.meshes import write_bars as write_bars
from .engine.geometry.shapes import Box as Box
from .engine.geometry.shapes import Cone as Cone
from .engine.geometry.shapes import fill as fill
from .engine.geometry.shapes import fill_rings as fill_rings
from .engine.geometry.shapes import lattice as lattice
from .engine.geometry.shapes import rings as rings
from .engine.geometry.shapes import shell as shell
from .engine.geometry.solid import Solid as Solid
from .engine.geometry.solid import polygon_distance as polygon_distance
from .engine.geometry.time_dependent import vibration as vibration
from .engine.geometry.walls import Cylinder as Cylinder
from .engine.geometry.walls import Friction as Friction
from .engine.geometry.walls import Plane as Plane
from .engine.geometry.walls import behind as behind
from .engine.geometry.walls import box_planes as box_planes
from .engine.geometry.walls import vessel as vessel
from .engine.particles.neighbors import CapacityError as CapacityError
from .engine.problem import measures
from .engine.problem.grains import Grains as Grains
from .engine.problem.inlet import Inlet as Inlet
from .engine.problem.jolt import Jolt as Jolt
from .engine.problem.materials import Bingham as Bingham
from .engine.problem.materials import Casson as Casson
from .engine.problem.materials import Concrete as Concrete
from .engine.problem.materials import FlowCurve as FlowCurve
from .engine.problem.materials import HerschelBulkley as HerschelBulkley
from .engine.problem.materials import Law as Law
from .engine.problem.materials import Newtonian as Newtonian
from .engine.problem.materials import rational_critical_strain_rate as rational_critical_strain_rate
from .engine.problem.numerics import Implicit as Implicit
from .engine.problem.numerics import SemiImplicit as SemiImplicit
from .engine.problem.scene import Scene as Scene
from .engine.runtime import backend as backend
from .engine.runtime.backend import init as init
from .engine.runtime.backend import ti as ti
from .engine.schemes.step_report import DivergedError as DivergedError
from .engine.schemes.step_report import DomainError as DomainError
from .engine.schemes.step_report import StepReport as StepReport
from .engine.schemes.step_report import UnmeasuredError as UnmeasuredError
from .forecast import rest_shapes as rest_shapes
from .input import catalogue as catalogue
from .input.catalogue import slump_cone as slump_cone
from .io import checkpoint as checkpoint
from .io.notebook import Simulation as Simulation
from .units import SceneError as SceneError
from .units import checked as checked
from .viz.render import gif as gif
from .viz.render import png as png

__version__: str
measure = measures
__all__: list[str]
