"""The engine: particles, walls and terms of one run, computed in Taichi; it knows no files, pictures or words.

Its rooms, in the order of reading: runtime, geometry, problem, particles, linear, boundaries, terms, schemes,
simulation. Read schemes/implicit.py first, one step. Inward it imports units and spelling alone; outward it hands what
stands here.
"""

from importlib import import_module

with open(f"{__file__}i", encoding="utf-8") as _stub:  # a line a name: from .module import name as name
    _MODULE_OF = {words[-1]: words[1][1:] for words in map(str.split, _stub) if words[:1] == ["from"]}

__all__ = [*_MODULE_OF]


def __getattr__(name):
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
