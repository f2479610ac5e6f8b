"""The only import of Taichi, and the one function that starts it."""

import os

os.environ.setdefault("TI_ENABLE_PYBUF", "0")
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")

import taichi as ti  # noqa: E402
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext  # noqa: E402

from .quantity import SceneError  # noqa: E402

# Taichi 1.7.4's limit; measured 5 to 6 a Simulation, and 3 more for each solid with inner edges
MOST_TREES, TREES_OF_A_SIMULATION = 512, 32
_started: dict = {}


def _place(context, node):
    """Where an expression of a kernel stands. Taichi's own wraps its text, too, in a third of the compile time."""
    line = context.src[node.lineno - 1].strip()
    return (
        f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}: {line}\n'
    )


ASTTransformerContext.get_pos_info = _place


def init(arch: str = "cpu", precision: str = "f32", threads: int | None = None, debug: bool = False) -> None:
    """Start Taichi; call once before a Simulation. Calling again drops every earlier Simulation.

    arch: cpu, cuda or vulkan; precision of the solver's fields: f32 or f64 (positions are always f64);
    threads: CPU threads, by default all that this process may use. Raises SceneError for anything else.
    """
    architectures = {"cpu": ti.cpu, "cuda": ti.cuda, "vulkan": ti.vulkan}
    if arch not in architectures:
        raise SceneError(f"arch = {arch}: must be one of {', '.join(architectures)}")
    if precision not in ("f32", "f64"):
        raise SceneError(f"precision = {precision}: must be f32 or f64")
    if threads is not None and threads < 1:
        raise SceneError(f"threads = {threads}: must be at least 1")
    if threads is None:
        threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    ti.init(
        arch=architectures[arch],
        default_fp=ti.f64 if precision == "f64" else ti.f32,
        default_ip=ti.i32,
        cfg_optimization=False,  # 1.7.4 miscompiles with it (taichi issue 8744)
        fast_math=True,
        debug=debug,
        log_level=ti.ERROR,
        cpu_max_num_threads=threads,
    )
    _started.update(arch=arch, precision=precision, threads=threads)


def started() -> dict:
    """Settings of the running backend; a clear RuntimeError if init was forgotten."""
    if not _started:
        raise RuntimeError("Taichi is not started: call taichi_mps.init() before making a Simulation")
    return dict(_started)


def require_room() -> None:
    """Refuse new fields when Taichi's 512 trees of fields are nearly used up: past the last one it crashes."""
    started()
    used = ti.lang.impl.get_runtime().prog.get_snode_tree_size()
    if used > MOST_TREES - TREES_OF_A_SIMULATION:
        raise RuntimeError(
            f"this process holds {used} groups of Taichi fields of at most {MOST_TREES}, a Simulation needs up to "
            f"{TREES_OF_A_SIMULATION}: call taichi_mps.init() again, which drops every earlier Simulation"
        )


def real():
    """Floating-point type of the solver's fields: ti.f32 or ti.f64."""
    return ti.f64 if started()["precision"] == "f64" else ti.f32
