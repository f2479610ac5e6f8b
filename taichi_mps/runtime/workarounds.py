"""All that is changed in the kernel language or kept from it, and which language it is.

The engine is written for Taichi 1.7.4, which has no wheel for Python 3.14 and gets no more releases. Where it is not
installed the engine runs on Quadrants, its maintained fork; TAICHI_MPS_KERNELS=taichi or quadrants chooses.

Each workaround says why it is there and when it can go; tests/runtime holds each. Cures of wrong
results are always on. Speed patches reach into Taichi's internals, and no bit of a result depends on them:
TAICHI_MPS_WORKAROUNDS=0 leaves them out, and so does a version that they were not written for.
"""

import functools
import importlib
import math
import os
import textwrap
import warnings
from contextlib import contextmanager
from importlib.util import find_spec
from types import SimpleNamespace

from ..units import SceneError
from .caches import provide

LANGUAGES = "taichi", "quadrants"


# ---- which language -------------------------------------------------------------------------------------------------
def chosen() -> str:
    """Name of the kernel language: that of TAICHI_MPS_KERNELS, else Taichi where it is installed, else Quadrants."""
    here = [name for name in LANGUAGES if find_spec(name)]
    name = os.environ.get("TAICHI_MPS_KERNELS") or (here or LANGUAGES)[0]
    if name not in LANGUAGES:
        raise SceneError(f"TAICHI_MPS_KERNELS = {name}: must be {' or '.join(LANGUAGES)}")
    if name not in here:
        raise SceneError(f"TAICHI_MPS_KERNELS = {name}: is not installed; pip install {name}")
    return name


def silence() -> None:
    """Switch off, before the import, what the language prints: no greeting, no line for each replaced stdout, no
    warning of NumPy numbers that kernels take. They would stand between the lines of --json. Until the language greets
    no more."""
    for start in ("TI", "QD"):
        os.environ.setdefault(f"{start}_ENABLE_PYBUF", "0")
    for name in LANGUAGES:
        os.environ.setdefault(f"ENABLE_{name.upper()}_HEADER_PRINT", "False")
    warnings.filterwarnings("ignore", message=".*Template mapper caching disabled")


LANGUAGE = chosen()
silence()
provide(LANGUAGE)
ti = importlib.import_module(LANGUAGE)
VERSION = ".".join(map(str, ti.__version__))


# ---- what the two languages call differently ------------------------------------------------------------------------
_MARK, _OWNER = {
    "taichi": ("_is_taichi_function", "func"),
    "quadrants": ("_is_quadrants_function", "wrapper"),
}[LANGUAGE]


def for_kernels(function, part=None):
    """Let kernels call a Python object while they are compiled; part: the ti.func that it stands for, if it is one."""
    setattr(function, _MARK, True)
    setattr(function, _OWNER, getattr(part, _OWNER) if part else SimpleNamespace(has_print=False))
    return function


def is_for_kernels(function) -> bool:
    """Whether kernels may call it: a ti.func, or what ``for_kernels`` was told of."""
    return getattr(function, _MARK, False)


def compiled_now():
    """The kernel that is being compiled, None outside of kernels."""
    runtime = ti.lang.impl.get_runtime()
    if not runtime.inside_kernel:
        return None
    return runtime.current_kernel if LANGUAGE == "taichi" else runtime._current_global_context.current_kernel


# ---- cures ----------------------------------------------------------------------------------------------------------
# Of ti.init. Taichi miscompiles a vector local that is read, conditionally changed and overwritten (its issue 8744):
# without cfg_optimization it does not, which costs no run time. Quadrants computes the known patterns rightly; off
# there, too, for equal code. Without a limit there is no warning of what is meant to be unrolled.
OPTIONS = {"cfg_optimization": False, "unrolling_limit": 0}


def in_own_memory(field, shape):
    """The field, placed in memory of its own. On Vulkan Taichi packs fields without alignment: 8 bytes that begin at an
    odd multiple of 4 overwrite the last number of another field."""
    memory = ti.FieldsBuilder()
    shape = shape if isinstance(shape, tuple) else (shape,)
    (memory.dense(ti.axes(*range(len(shape))), shape) if shape else memory).place(field)
    memory.finalize()
    return field


@ti.func
def sine_by_f32(angle):
    """Sine [-] of an angle [rad] in f64, by that of f32, of the angle less whole turns: Vulkan has none of f64."""
    turns = angle / (2.0 * math.pi)
    return ti.cast(ti.sin(ti.cast(2.0 * math.pi * (turns - ti.floor(turns)), ti.f32)), ti.f64)


@contextmanager
def compiled_plainly(wanted: bool):
    """Context in which kernels, if wanted, are optimised by LLVM alone and not by the language, too: compiling takes
    40 % less time, the kernels run an eighth slower, and the last bits differ."""
    settings = ti.lang.impl.current_cfg()
    before, settings.advanced_optimization = settings.advanced_optimization, not wanted
    try:
        yield
    finally:
        settings.advanced_optimization = before


# ---- speed patches --------------------------------------------------------------------------------------------------
def position(context, node) -> str:
    """Position of an expression of a kernel as an error names it: file, line, function and text."""
    line = context.src[node.lineno - 1].strip()
    return (
        f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}: {line}\n'
    )


def remember_texts() -> None:
    """Look up and wrap the source of a function once, and don't wrap the text of an expression.

    Taichi wraps the text of each expression of a kernel, 65,000 times in a cone, and looks up and wraps the source of a
    function wherever a kernel calls it, 1,000 times. A process that computes the default cone to 0.04 s with compiled
    kernels in the cache takes 7 processor seconds with this and 10 without. Quadrants remembers both.
    """
    from taichi.lang import kernel_impl
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

    ASTTransformerContext.get_pos_info = position
    kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
    kernel_impl.getsourcelines = functools.cache(kernel_impl.getsourcelines)
    kernel_impl.textwrap = SimpleNamespace(fill=functools.cache(textwrap.fill), dedent=functools.cache(textwrap.dedent))


PATCHED = (LANGUAGE, VERSION) == ("taichi", "1.7.4") and os.environ.get("TAICHI_MPS_WORKAROUNDS") != "0"
if PATCHED:
    remember_texts()
