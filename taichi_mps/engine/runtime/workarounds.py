"""Choice of the kernel language, and the workarounds for it.

The engine is written for Taichi 1.7.4, which has no wheel for Python 3.14 and gets no more releases. Where it is not
installed the engine runs on Quadrants, its maintained fork; TAICHI_MPS_KERNELS=taichi or quadrants chooses.

Each workaround says why it is there; tests/runtime tests each. Corrections of wrong results are always on. Speed
patches reach into Taichi's internals, and no bit of a result depends on them: TAICHI_MPS_WORKAROUNDS=0 switches them
off, and so does a version that they were not written for.
"""

import ast
import functools
import importlib
import inspect
import linecache
import math
import operator
import os
import sys
import textwrap
import warnings
from collections import defaultdict
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import product
from types import SimpleNamespace

from ...units import require
from .caches import set_cache_folders

LANGUAGES = "taichi", "quadrants"


# ---- choice of the language -----------------------------------------------------------------------------------------
def chosen_language() -> str:
    """Name of the kernel language: TAICHI_MPS_KERNELS, else Taichi if it is installed, else Quadrants."""
    installed = [name for name in LANGUAGES if find_spec(name)]
    name = os.environ.get("TAICHI_MPS_KERNELS") or (installed or LANGUAGES)[0]
    require(name in LANGUAGES, f"TAICHI_MPS_KERNELS = {name}: must be {' or '.join(LANGUAGES)}")
    require(name in installed, f"TAICHI_MPS_KERNELS = {name}: is not installed; pip install {name}")
    return name


def silence_language() -> None:
    """Switch off the output of the language before its import: its header, a line for each replaced stdout, and
    warnings, of its own source under Python 3.12 and of NumPy numbers as arguments, which would stand between the lines
    of --json."""
    for start in ("TI", "QD"):
        os.environ.setdefault(f"{start}_ENABLE_PYBUF", "0")
    for name in LANGUAGES:
        os.environ.setdefault(f"ENABLE_{name.upper()}_HEADER_PRINT", "False")
    for message in ("invalid escape sequence", ".*Template mapper caching disabled"):
        warnings.filterwarnings("ignore", message=message)


FAST = os.environ.get("TAICHI_MPS_WORKAROUNDS") != "0"  # whether speed patches are wanted
LANGUAGE = chosen_language()
silence_language()
set_cache_folders(LANGUAGE)
getmodule = inspect.getmodule
if FAST:  # the language looks for the module of each function that it decorates: a quarter of the time of its import
    inspect.getmodule = lambda *_: None
ti = importlib.import_module(LANGUAGE)
inspect.getmodule = getmodule
VERSION = ".".join(map(str, ti.__version__))


# ---- names that differ between the two languages --------------------------------------------------------------------
_MARK, _OWNER = {
    "taichi": ("_is_taichi_function", "func"),
    "quadrants": ("_is_quadrants_function", "wrapper"),
}[LANGUAGE]


# decorator of kernels whose loops Quadrants starts together on a GPU, as a graph, when it is called again
graph_kernel = ti.kernel if LANGUAGE == "taichi" else ti.kernel(graph=True)
HAS_DEVICE_LOOPS = hasattr(ti.graph, "do_while")  # whether a graph repeats itself without asking Python


def for_kernels(function, part=None):
    """Mark a Python object as callable from kernels while they are compiled; ``part``: the ti.func that it wraps, if
    any."""
    setattr(function, _MARK, True)
    setattr(function, _OWNER, getattr(part, _OWNER) if part else SimpleNamespace(has_print=False))
    return function


def is_for_kernels(function) -> bool:
    """Whether kernels may call an object: a ti.func, or one marked by ``for_kernels``."""
    return getattr(function, _MARK, False)


def compiled_now():
    """Kernel that is being compiled, None outside of kernels."""
    runtime = ti.lang.impl.get_runtime()
    if not runtime.inside_kernel:
        return None
    return runtime.current_kernel if LANGUAGE == "taichi" else runtime._current_global_context.current_kernel


# ---- corrections of wrong results ------------------------------------------------------------------------------------
# Options of ti.init. Taichi miscompiles a vector local that is read, conditionally changed and overwritten (its issue
# 8744), and so does Quadrants; without cfg_optimization, or at an opt_level of 0, it does not. It keeps a number of a
# field in a local variable while a loop runs, one for each expression of its place, so that one does not see what is
# written by another (its issue 8578); without cache_loop_invariant_global_vars it does not. At an opt_level above 0 a
# pass over the whole kernel hides most of the latter, and takes up to half of the time to compile; it spares a
# twentieth of a solve, and of a step where one thread computes 1,000 rows or more (``optimised``). Quadrants keeps no
# number too long; it has the same options for equal code. An unrolling limit of 0 avoids a warning of what is intended.
OPTIONS = {
    "cfg_optimization": False,
    "cache_loop_invariant_global_vars": False,
    "opt_level": 0,
    "unrolling_limit": 0,
}


def in_own_memory(field, shape):
    """Place a field in memory of its own and return it. On Vulkan Taichi packs fields without alignment: 8 bytes that
    begin at an odd multiple of 4 overwrite the last number of another field."""
    memory = ti.FieldsBuilder()
    shape = shape if isinstance(shape, tuple) else (shape,)
    (memory.dense(ti.axes(*range(len(shape))), shape) if shape else memory).place(field)
    memory.finalize()
    return field


@ti.func
def sine_by_f32(angle):
    """Sine [-] of an angle [rad] in f64, computed by the sine of f32 of the angle modulo 2 pi: Vulkan has no sine of
    f64."""
    turns = angle / (2.0 * math.pi)
    return ti.cast(ti.sin(ti.cast(2.0 * math.pi * (turns - ti.floor(turns)), ti.f32)), ti.f64)


@contextmanager
def optimised(wanted: bool):
    """Context in which kernels, if ``wanted``, are compiled at an opt_level of 1."""
    settings = ti.lang.impl.current_cfg()
    before, settings.opt_level = settings.opt_level, max(settings.opt_level, int(wanted))
    try:
        yield
    finally:
        settings.opt_level = before


# ---- speed patches --------------------------------------------------------------------------------------------------
def position(context, node) -> str:
    """Position of an expression of a kernel for error messages: file, line, function and text."""
    line = context.src[node.lineno - 1].strip()
    return (
        f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}: {line}\n'
    )


def is_in_class(level_of_class_stackframe: int) -> bool:
    """Whether a function that is being decorated is defined in a class: by the line of that frame of the stack. At the
    top of a script there is no such frame."""
    try:
        frame = sys._getframe(level_of_class_stackframe)
    except ValueError:
        return False
    line = linecache.getline(frame.f_code.co_filename, frame.f_lineno).strip()
    return any(start.match(line) for start in ti.lang.kernel_impl._KERNEL_CLASS_STACKFRAME_STMT_RES)


def cache_sources() -> None:
    """Patch Taichi to look up and wrap the source of a function once, and not to wrap the text of an expression; and to
    look for lines of a file where it looked for the module of a source.

    Taichi wraps the text of each expression of a kernel, 65,000 times in a cone, and looks up and wraps the source of a
    function wherever a kernel calls it, 1,000 times. A process that computes the default cone to 0.04 s with compiled
    kernels in the cache takes 7 processor seconds with this and 10 without. Quadrants caches both.
    """
    from taichi.lang import _wrap_inspect, kernel_impl
    from taichi.lang.ast import checkers
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

    @functools.cache
    def source_of(function):
        code = inspect.unwrap(function).__code__
        linecache.checkcache(code.co_filename)
        lines = linecache.getlines(code.co_filename)[code.co_firstlineno - 1 :]
        return (inspect.getblock(lines), code.co_firstlineno) if lines else _wrap_inspect.getsourcelines(function)

    ASTTransformerContext.get_pos_info = position
    kernel_impl._inside_class = is_in_class
    for module in (kernel_impl, checkers):
        module.getsourcefile, module.getsourcelines = inspect.getfile, source_of
    kernel_impl.textwrap = SimpleNamespace(fill=functools.cache(textwrap.fill), dedent=functools.cache(textwrap.dedent))


def shorten_front_end() -> None:
    """Patch Taichi to spare what it does again and again while it reads kernels: a fifth of that time.

    Expressions, two thirds of what it reads, are built without a position and a handler of errors of their own; those
    of their statement serve. A function that a kernel calls is parsed once; its syntax tree, which must not be in use
    twice, waits for the next call without what the last one wrote into it. Fields take no trace of the Python stack.
    """
    from taichi.lang import impl, kernel_impl, matrix, snode
    from taichi.lang.ast import ast_transformer
    from taichi.lang.ast.ast_transformer_utils import Builder

    transformer, build, transform = ast_transformer.ASTTransformer, Builder.__call__, kernel_impl.transform_tree
    kinds = {kind: getattr(transformer, f"build_{kind.__name__}", None) for kind in ast.expr.__subclasses__()}
    waiting = defaultdict(list)  # text of a function -> its syntax trees

    def build_plainly(self, context, node):
        method = kinds.get(type(node))
        return method(context, node) if method else build(self, context, node)

    def parse(text):
        if waiting[text]:
            return waiting[text].pop()
        tree = ast.parse(text)
        tree.text, tree.nodes = text, list(ast.walk(tree))
        return tree

    def transform_and_keep(tree, context):
        result = transform(tree, context)
        if not context.is_kernel and not context.is_real_function:
            for node in tree.nodes:
                vars(node).pop("ptr", None)
            waiting[tree.text].append(tree)
        return result

    Builder.__call__ = build_plainly
    kernel_impl.ast, kernel_impl.transform_tree = SimpleNamespace(parse=parse), transform_and_keep
    for module in (impl, matrix, snode):
        module.get_traceback = lambda stacklevel=1: ""


def build_matrices_directly() -> None:
    """Patch Taichi to build sums, products and transposes of matrices from the expressions of their entries, in the
    order of its own functions, which it reads anew for each: a third of the functions that a cone reads."""
    from taichi.lang import impl, matrix, matrix_ops

    def once(value):
        """Shape of a matrix that is computed once, and a function that gives its entries."""
        value = impl.expr_init(value)
        return value.get_shape(), lambda *place: impl.subscript(None, value, *place)

    def _reduce(mat, fun):
        shape, at = once(mat)
        return impl.expr_init(functools.reduce(fun, (at(*place) for place in product(*map(range, shape)))))

    def dot(x, y):
        return _reduce(x * y, operator.add)

    def transpose(mat):
        (n, m), at = once(mat)
        return matrix.make_matrix([[at(i, j) for i in range(n)] for j in range(m)])

    def outer_product(x, y):
        ((n,), x), ((m,), y) = once(x), once(y)
        return matrix.make_matrix([[x(i) * y(j) for j in range(m)] for i in range(n)])

    def matmul(x, y):
        turned = len(x.get_shape()) < len(y.get_shape())
        return matrix_ops._matmul_helper(*((matrix_ops.transpose(y), x) if turned else (x, y)))

    def _matmul_helper(x, y):
        if len(x.get_shape()) == 1:
            return dot(x, y)
        ((n, inner), x), ((_, *columns), y) = once(x), once(y)
        zero = impl.expr_init(x(0, 0) * y(*(0 for _ in (0, *columns))) * 0)

        def entry(i, *k):
            return functools.reduce(operator.add, (x(i, j) * y(j, *k) for j in range(inner)), zero)

        rows = [[entry(i, k) for k in range(*columns)] if columns else entry(i) for i in range(n)]
        return impl.expr_init(matrix.make_matrix(rows))

    def _filled_matrix(n, m, dtype, val):
        return matrix.make_matrix([[val] * m] * n, dtype)

    def chosen(read, direct, *values):
        return direct(*values) if impl.inside_kernel() else read(*values)

    for direct in (_reduce, dot, transpose, outer_product, matmul, _matmul_helper, _filled_matrix):
        function = getattr(matrix_ops, direct.__name__).func
        function.__call__ = functools.partial(chosen, function.func, direct)


PATCHED = FAST and (LANGUAGE, VERSION) == ("taichi", "1.7.4")
if PATCHED:
    cache_sources()
    shorten_front_end()
    build_matrices_directly()
