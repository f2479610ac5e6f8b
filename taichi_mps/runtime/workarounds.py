"""All that is changed in the kernel language or kept from it, and which language it is.

The engine is written for Taichi 1.7.4, which has no wheel for Python 3.14 and gets no more releases. Where it is not
installed the engine runs on Quadrants, its maintained fork; TAICHI_MPS_KERNELS=taichi or quadrants chooses.

WORKAROUNDS says of each one for which version it is, why, what it gains, which test holds it, and when it can go. Cures
of wrong results are always on. Speed patches reach into Taichi's internals, and no bit of a result depends on them:
TAICHI_MPS_WORKAROUNDS=0 leaves them out, and so does a version that they were not written for.
"""

import ast
import functools
import importlib
import inspect
import linecache
import math
import os
import textwrap
import warnings
from collections import defaultdict
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from types import SimpleNamespace

from ..units import SceneError
from .caches import provide


@dataclass(frozen=True)
class Workaround:
    """What stands in the way, and what is known of it. Speed patches have a gain, as a share of the processor seconds
    of a whole process: the default cone at 10 mm, without a cache of kernels."""

    name: str
    versions: dict  # of each language
    reason: str
    test: str  # in tests/runtime/test_workarounds.py
    until: str  # when it can go
    gain: float | None = None


TAICHI, BOTH = {"taichi": ("1.7.4",)}, {"taichi": ("1.7.4",), "quadrants": ("1.3.3", "1.4.0")}
WORKAROUNDS = (
    Workaround(
        "cfg_optimization=False",
        TAICHI,
        "A vector local that is read, conditionally changed and overwritten is miscompiled (taichi issue 8744). Costs "
        "no run time. Quadrants computes the known patterns rightly; it is off there, too, for equal code.",
        "test_vector_local_keeps_its_old_value",
        "Taichi is no longer supported",
    ),
    Workaround(
        "require_trees",
        BOTH,
        "The 513th tree of fields kills the process.",
        "test_fields_are_refused_before_the_tree_that_kills_the_process",
        "the language raises an error instead",
    ),
    Workaround(
        "in_own_memory",
        TAICHI,
        "On Vulkan fields are packed without alignment: 8 bytes that begin at an odd multiple of 4 overwrite the last "
        "number of another field.",
        "test_an_f64_field_in_memory_of_its_own_holds_its_numbers",
        "a field of f64 after an odd number of f32 keeps its numbers on Vulkan",
    ),
    Workaround(
        "sine_by_f32",
        BOTH,
        "Vulkan has no sine of f64.",
        "test_sine_by_f32_is_that_of_the_angle_less_whole_turns",
        "it has one",
    ),
    Workaround(
        "silence",
        BOTH,
        "A greeting at import, a line for each replaced stdout, and a warning of each NumPy number that a kernel takes "
        "would stand between the lines of --json.",
        "test_import_says_nothing",
        "the language greets no more",
    ),
    Workaround(
        "remember_texts",
        TAICHI,
        "For each expression of a kernel its text is wrapped and guarded by a generator, 65,000 times in a cone; for "
        "each call of a function in a kernel its source is looked up, wrapped and parsed again, 1,000 times.",
        "test_speed_patches_change_no_bit",
        "Taichi is no longer supported: Quadrants remembers both",
        gain=0.1,
    ),
    Workaround(
        "launch_directly",
        TAICHI,
        "To call a kernel takes Taichi 30 microseconds, in which it finds out again what has not changed, while its "
        "threads fall asleep and must be woken. A kernel that is given numbers alone can be started in 5. Gain with "
        "two threads; with one it is 0.04.",
        "test_speed_patches_change_no_bit",
        "a call takes no longer than starting its threads",
        gain=0.2,
    ),
)


# ---- which language -------------------------------------------------------------------------------------------------
def chosen() -> str:
    """Name of the kernel language: that of TAICHI_MPS_KERNELS, else Taichi where it is installed, else Quadrants."""
    here = [name for name in BOTH if find_spec(name)]
    name = os.environ.get("TAICHI_MPS_KERNELS") or (here or list(BOTH))[0]
    if name not in BOTH:
        raise SceneError(f"TAICHI_MPS_KERNELS = {name}: must be {' or '.join(BOTH)}")
    if name not in here:
        raise SceneError(f"TAICHI_MPS_KERNELS = {name}: is not installed; pip install {name}")
    return name


def silence() -> None:
    """Before the import: no greeting, no buffer for what kernels print; no warning of what is meant."""
    for start in ("TI", "QD"):
        os.environ.setdefault(f"{start}_ENABLE_PYBUF", "0")
    for name in BOTH:
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
OPTIONS = {"cfg_optimization": False, "unrolling_limit": 0}  # of ti.init; a warning of what is meant to be unrolled
MOST_TREES, TREES_OF_A_SIMULATION = 512, 32  # measured 5 to 6 a Simulation, and 3 more for each solid with inner edges


def require_trees() -> None:
    """RuntimeError when the trees of fields are nearly used up."""
    used = ti.lang.impl.get_runtime().prog.get_snode_tree_size()
    if used > MOST_TREES - TREES_OF_A_SIMULATION:
        raise RuntimeError(
            f"this process holds {used} groups of Taichi fields of at most {MOST_TREES}, a Simulation needs up to "
            f"{TREES_OF_A_SIMULATION}: call taichi_mps.init() again, which drops every earlier Simulation"
        )


def in_own_memory(field, shape):
    """The field, placed in memory of its own."""
    memory = ti.FieldsBuilder()
    shape = shape if isinstance(shape, tuple) else (shape,)
    (memory.dense(ti.axes(*range(len(shape))), shape) if shape else memory).place(field)
    memory.finalize()
    return field


@ti.func
def sine_by_f32(angle):
    """Sine [-] of an angle [rad] in f64, by that of f32: of the angle less whole turns."""
    turns = angle / (2.0 * math.pi)
    return ti.cast(ti.sin(ti.cast(2.0 * math.pi * (turns - ti.floor(turns)), ti.f32)), ti.f64)


@contextmanager
def compiled_plainly(wanted: bool):
    """What is compiled meanwhile is, if wanted, not optimised by the language itself but by LLVM alone. That takes
    40 % less time, and what is compiled is an eighth slower; the last bits differ."""
    settings = ti.lang.impl.current_cfg()
    before, settings.advanced_optimization = settings.advanced_optimization, not wanted
    try:
        yield
    finally:
        settings.advanced_optimization = before


# ---- speed patches --------------------------------------------------------------------------------------------------
def position(context, node) -> str:
    """Where an expression of a kernel stands: file, line, function and text, as an error names it."""
    line = context.src[node.lineno - 1].strip()
    return (
        f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}: {line}\n'
    )


def remember_texts() -> None:
    """Look up and wrap the source of a function once, and don't wrap the text of an expression."""
    if "remember_texts" not in SPEED_PATCHES:
        return
    from taichi.lang import kernel_impl
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

    ASTTransformerContext.get_pos_info = position
    kernel_impl.getsourcefile = lambda function: function.__code__.co_filename
    kernel_impl.getsourcelines = functools.cache(source_lines)
    kernel_impl.textwrap = SimpleNamespace(fill=functools.cache(textwrap.fill), dedent=functools.cache(textwrap.dedent))


def source_lines(function):
    """Lines of a function and the number of the first, as inspect.getsourcelines, without a search for its module."""
    code = function.__code__
    lines = linecache.getlines(code.co_filename)[code.co_firstlineno - 1 :]
    return (inspect.getblock(lines), code.co_firstlineno) if lines else inspect.getsourcelines(function)


def remember_trees() -> None:
    """Parse the source of a function once, and use its tree again wherever it is called; nodes without a guard."""
    if "remember_texts" not in SPEED_PATCHES:
        return
    from taichi.lang import impl, kernel_impl
    from taichi.lang.ast import ast_transformer_utils

    trees = defaultdict(list)  # by their source, those that are not in use: a function may call itself while compiled
    transform, build = kernel_impl.transform_tree, ast_transformer_utils.Builder.__call__

    def parse(source):
        tree = trees[source].pop() if trees[source] else ast.parse(source)
        tree.source = source
        return tree

    def transform_and_keep(tree, context):
        try:
            return transform(tree, context)
        finally:
            if not (context.is_kernel or context.is_real_function):  # which take the arguments out of their tree
                trees[tree.source].append(tree)

    def build_node(self, context, node):
        method = getattr(self, "build_" + node.__class__.__name__, None)
        if method is None:
            return build(self, context, node)
        stack = impl.get_runtime().src_info_stack
        stack.append(position(context, node) if isinstance(node, ast.stmt | ast.expr) else "")
        try:
            return method(context, node)
        except Exception as error:
            return build(Fails(error), context, node)  # which says where
        finally:
            stack.pop()

    kernel_impl.ast = SimpleNamespace(parse=parse)
    kernel_impl.transform_tree = transform_and_keep
    ast_transformer_utils.Builder.__call__ = build_node


class Fails:
    """A builder of any node that raises an error."""

    def __init__(self, error):
        self.error = error

    def __getattr__(self, name):
        def fail(context, node):
            raise self.error

        return fail


def launch_directly(kernel):
    """A kernel of one i32 and then numbers of f64, that returns nothing, as a function that starts it."""
    if "launch_directly" not in SPEED_PATCHES:
        return kernel
    ready = None

    def launch(whole, *numbers):
        nonlocal ready
        if ready is None:
            kernel(whole, *numbers)
            inner, program = kernel._primal, ti.lang.impl.get_runtime().prog
            of_taichi = inner.compiled_kernels[inner.ensure_compiled(whole, *numbers)]
            compiled = program.compile_kernel(program.config(), program.get_device_caps(), of_taichi)
            ready = program.launch_kernel, compiled, of_taichi.make_launch_context
            return
        start, compiled, make_context = ready
        context = make_context()
        context.set_arg_int((0,), whole)
        for slot, number in enumerate(numbers, 1):
            context.set_arg_float((slot,), number)
        start(compiled, context)

    return launch


def wanted_speed_patches() -> set[str]:
    """Names of those for this language; one line where it has a version that they were not written for."""
    if os.environ.get("TAICHI_MPS_WORKAROUNDS") == "0":
        return set()
    mine = [workaround for workaround in WORKAROUNDS if workaround.gain and LANGUAGE in workaround.versions]
    left_out = [workaround for workaround in mine if VERSION not in workaround.versions[LANGUAGE]]
    for workaround in left_out:
        written_for = ", ".join(workaround.versions[LANGUAGE])
        warnings.warn(f"{LANGUAGE} {VERSION}: {workaround.name} is for {written_for} and left out", stacklevel=2)
    return {workaround.name for workaround in mine if workaround not in left_out}


SPEED_PATCHES = wanted_speed_patches()
remember_texts()
remember_trees()
