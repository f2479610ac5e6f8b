"""python -m taichi_mps is the command line."""

from .cli.main import entry

entry()
