"""The only import of Taichi, the one function that starts it, and how its kernels are called."""

import functools
import math
import os
import weakref

os.environ.setdefault("TI_ENABLE_PYBUF", "0")
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")

import numpy as np  # noqa: E402
import taichi as ti  # noqa: E402
from taichi.lang import kernel_impl  # noqa: E402
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext  # noqa: E402
from taichi.types.primitive_types import real_type_ids  # noqa: E402

from ..units import SceneError  # noqa: E402

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
# Taichi looks for the text of a function again at each of its calls in a kernel, 900 times in a Simulation
kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
kernel_impl.getsourcelines = functools.cache(kernel_impl.getsourcelines)

VALUES = int, float, bool, str  # templates that Taichi tells apart by value, all other objects by identity
_call = kernel_impl.Kernel.__call__


def _start(kernel, *arguments, **named):
    """Kernel.__call__, but for a kernel of this package and the objects of an earlier call it takes 5 microseconds:
    Taichi's own takes 30 to find out again what has not changed."""
    if getattr(kernel, "prepared_for", None) is not kernel.compiled_kernels:  # new, or Taichi was started again
        _prepare(kernel)
    if named or not kernel.quick or len(arguments) != len(kernel.arguments):
        return _call(kernel, *arguments, **named)
    objects = [arguments[k] for k in kernel.objects]
    key = tuple([an_object if type(an_object) in VALUES else id(an_object) for an_object in objects])
    ready = kernel.ready.get(key)
    if ready is None or not _alive(ready):  # an id may by now be that of another object
        _call(kernel, *arguments)
        _remember(kernel, key, arguments)
        return None
    compiled, program, of_taichi, _ = ready
    context = of_taichi.make_launch_context()
    for k, slot, pass_on in kernel.passed_on:
        pass_on(context, slot, arguments[k])
    program.launch_kernel(compiled, context)
    return None


def _prepare(kernel) -> None:
    """Note which arguments of a kernel are objects that stay, and how the others are passed on."""
    kernel.prepared_for, kernel.ready, kernel.objects, kernel.passed_on = kernel.compiled_kernels, {}, [], []
    kernel.quick = kernel.func.__module__.startswith(f"{__package__}.") and not ti.lang.impl.current_cfg().debug
    for k, argument in enumerate(kernel.arguments):
        kind, slot = argument.annotation, (len(kernel.passed_on),)
        if isinstance(kind, (ti.template, ti.types.ndarray)):
            kernel.objects.append(k)
        if isinstance(kind, ti.types.ndarray):
            kernel.passed_on.append((k, slot, _pass_array))
        elif id(kind) in real_type_ids:
            kernel.passed_on.append((k, slot, _pass_real))
        elif kind in (ti.i32, ti.i64):
            kernel.passed_on.append((k, slot, _pass_integer))
        elif not isinstance(kind, ti.template):
            kernel.quick = False


def _pass_real(context, slot, value):
    context.set_arg_float(slot, value)


def _pass_integer(context, slot, value):
    context.set_arg_int(slot, value)


def _pass_array(context, slot, value):
    context.set_arg_external_array_with_shape(slot, value.ctypes.data, value.nbytes, value.shape, 0)


def _remember(kernel, key, arguments) -> None:
    """Keep what a call with these objects needs as long as they live; not if it returns, prints or copies."""
    arrays = [arguments[k] for k, _, pass_on in kernel.passed_on if pass_on is _pass_array]
    as_it_is = all(isinstance(array, np.ndarray) and array.flags.c_contiguous for array in arrays)
    if kernel.return_type or kernel.has_print or not as_it_is:
        return
    program, of_taichi = kernel.runtime.prog, kernel.compiled_kernels[kernel.ensure_compiled(*arguments)]
    compiled = program.compile_kernel(program.config(), program.get_device_caps(), of_taichi)
    objects = [arguments[k] for k in kernel.objects]
    try:
        alive = [weakref.ref(an_object) for an_object in objects if type(an_object) not in VALUES]
    except TypeError:  # a tuple, say: nothing tells when it is gone
        return
    kernel.ready = {key: ready for key, ready in kernel.ready.items() if _alive(ready)}
    kernel.ready[key] = compiled, program, of_taichi, alive


def _alive(ready) -> bool:
    return all([reference() is not None for reference in ready[-1]])


kernel_impl.Kernel.__call__ = _start


def init(arch: str = "cpu", precision: str = "f32", threads: int | None = None, debug: bool = False) -> None:
    """Start Taichi; call once before a Simulation. Calling again drops every earlier Simulation.

    arch: cpu, cuda or vulkan; precision of the solver's fields: f32 or f64 (positions are always f64);
    threads: CPU threads, by default all that this process may use. Raises SceneError for anything else.
    """
    architectures = {"cpu": ti.cpu, "cuda": ti.cuda, "vulkan": ti.vulkan}
    if not isinstance(arch, str) or arch not in architectures:
        raise SceneError(f"arch = {arch}: must be one of {', '.join(architectures)}")
    if precision not in ("f32", "f64"):
        raise SceneError(f"precision = {precision}: must be f32 or f64")
    if threads is not None and (not isinstance(threads, int) or threads < 1):
        raise SceneError(f"threads = {threads}: must be at least 1, a whole number")
    if arch == "vulkan" and precision == "f64":
        raise SceneError("precision = f64: must be f32 on arch = vulkan, which has no sine or power of f64")
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
    if ti.cfg.arch != architectures[arch]:  # Taichi goes on with the processor, in silence
        _started.clear()
        raise SceneError(f"arch = {arch}: no such device is found here; must be one that this machine has, such as cpu")
    for kernel in ti.lang.impl.get_runtime().kernels:
        kernel.ready = {}  # else they would keep the program before alive
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


def double_field(shape=(), components=None):
    """Field of f64, or of vectors of them. On Vulkan it has memory of its own: Taichi 1.7.4 packs fields without
    alignment there, and 8 bytes that begin at an odd multiple of 4 would overwrite the last number of another field."""
    make = ti.field if components is None else functools.partial(ti.Vector.field, components)
    if started()["arch"] != "vulkan":
        return make(ti.f64, shape)
    field, memory = make(ti.f64), ti.FieldsBuilder()
    shape = shape if isinstance(shape, tuple) else (shape,)
    (memory.dense(ti.axes(*range(len(shape))), shape) if shape else memory).place(field)
    memory.finalize()
    return field


def real():
    """Floating-point type of the solver's fields: ti.f32 or ti.f64."""
    return ti.f64 if started()["precision"] == "f64" else ti.f32


@ti.func
def sine(angle):
    """Sine [-] of an angle [rad] in f64; Vulkan has it in f32 only, where it is that of the angle less whole turns."""
    result = ti.cast(0.0, ti.f64)
    if ti.static(started()["arch"] == "vulkan"):
        turns = angle / (2.0 * math.pi)
        result = ti.cast(ti.sin(ti.cast(2.0 * math.pi * (turns - ti.floor(turns)), ti.f32)), ti.f64)
    else:
        result = ti.sin(angle)
    return result
