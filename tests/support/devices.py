"""A GPU where there is none."""

import taichi_mps as mps
from taichi_mps.engine.runtime.backend import for_kernels, session, ti
from taichi_mps.engine.runtime.thread_team import Block


def as_gpu(monkeypatch, precision: str = "f64") -> None:
    """Start Taichi so that the code of a GPU is compiled for the processor, its blocks of one thread."""
    mps.init(precision=precision)
    monkeypatch.setitem(session().settings, "arch", "cuda")
    monkeypatch.setattr(Block, "in_a_block", 1)
    monkeypatch.setattr(ti.simt.block, "sync", for_kernels(lambda: None))
