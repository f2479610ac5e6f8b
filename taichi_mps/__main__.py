"""python -m taichi_mps is the command line."""

from .cli import entry

entry()
