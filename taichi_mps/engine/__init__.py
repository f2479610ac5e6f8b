"""The engine: particles, walls and terms of one run, computed in Taichi; it knows no files, pictures or words.

Its rooms, in the order of reading: runtime, geometry, problem, particles, linear, boundaries, terms, schemes,
simulation. Read schemes/implicit.py first, one step. Inward it imports units and spelling alone; outward it hands what
stands here.
"""

from importlib import import_module

_OUTWARD = {
    # what a scene is made of
    "geometry.cavity": ["Cavity"],
    "geometry.in_time": ["vibration"],
    "geometry.meshes": ["write_bars"],
    "geometry.shapes": ["Box", "Cone", "fill", "fill_rings", "lattice", "rings", "shell"],
    "geometry.solid": ["Solid", "polygon_distance"],
    "geometry.walls": ["Cylinder", "Friction", "Plane", "behind", "box_planes", "vessel"],
    "problem.inlet": ["Inlet"],
    "problem.jolt": ["Jolt"],
    "problem.materials": [
        "COMMON_NUMBERS",
        "FLOW_THRESHOLD",
        "LAWS",
        "AnyMaterial",
        "Bingham",
        "Casson",
        "Concrete",
        "FlowCurve",
        "HerschelBulkley",
        "Law",
        "Material",
        "Newtonian",
        "chooses_law",
        "numbers_of",
        "rational_critical_strain_rate",
    ],
    "problem.scene": ["Scene"],
    # how it is computed, and what is read of it
    "problem.measures": ["SCALARS", "Snapshot", "embed", "reflected", "still", "surface"],
    "problem.numerics": ["COURANT", "NUMERICS", "Implicit", "SemiImplicit"],
    "problem.problem": ["Problem"],
    # what it will take
    "runtime.stages": ["ONE_THREAD_BELOW_ROWS"],
    "simulation.memory": ["memory_of", "pairs_of", "particles_of", "require_memory"],
    "simulation.pouring": ["Pouring"],
    # the run
    "particles.neighbors": ["CapacityError"],
    "particles.particles": ["DUMMY", "FLUID", "WALL"],
    "runtime.backend": ["compiled_before", "init", "require_room", "session"],
    "schemes.step_report": ["DOUBTFUL_VOLUME_ERROR", "DivergedError", "DomainError", "StepReport", "UnmeasuredError"],
    "simulation.frame": ["Frame", "interpolate"],
    "simulation.simulation": ["Simulation"],
}
_MODULE_OF = {name: module for module, names in _OUTWARD.items() for name in names}

__all__ = [*_MODULE_OF]


def __getattr__(name):
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
