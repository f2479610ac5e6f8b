"""Workarounds for wrong, slow or verbose parts of the kernel language; the speed patch changes no bit."""

import ast
import gc
import warnings

import numpy as np
import pytest

from taichi_mps.engine.runtime import backend, workarounds
from taichi_mps.engine.runtime.backend import ti
from tests.support.child import child


# ---- vector locals --------------------------------------------------------------------------------------------------
@ti.kernel
def overwritten(given: ti.template(), found: ti.template()):
    for i in given:
        v = given[i]
        x = v[0]
        if x < 2.0:
            x = 2.0
        v = 10.0 * given[i]
        found[i] = x + v[0]


@pytest.mark.parametrize("options", [{}, {"cfg_optimization": True, "opt_level": 1}])
def test_what_was_read_of_a_vector_local_stays_when_that_is_overwritten(options):
    """A value read from a local vector keeps its value when the vector is overwritten. By cfg_optimization above an
    opt_level of 0 it does not, in either language (Taichi's issue 8744); when it does, that is needed no more."""
    ti.init(arch=ti.cpu, offline_cache=False, log_level=ti.ERROR, **(workarounds.OPTIONS | options))
    given, found = ti.Vector.field(2, ti.f64, 3), ti.field(ti.f64, 3)
    given.from_numpy(np.array([[1.0, 2.0], [2.0, 3.0], [3.0, 4.0]]))
    overwritten(given, found)
    assert found.to_numpy().tolist() == ([3.0, 4.0, 6.0] if options else [12.0, 22.0, 33.0])
    backend.init(arch="cpu", precision="f64", threads=2)


# ---- loop invariants ------------------------------------------------------------------------------------------------
@ti.kernel
def counted(rows: ti.template()):
    for i in rows:
        for _ in range(3):
            rows[i] = rows[i] + 1


@ti.kernel
def paired(rows: ti.template()):
    ti.loop_config(serialize=True)
    for i in range(4):
        for j in range(4):
            rows[i] += 1
            rows[j] += 1


@pytest.mark.parametrize(
    ("options", "count", "pairs"),
    [
        ({"opt_level": 0, "cache_loop_invariant_global_vars": False}, 3, 8),
        ({"opt_level": 1, "cache_loop_invariant_global_vars": False}, 3, 8),
        ({"opt_level": 0, "cache_loop_invariant_global_vars": True}, 1, 7),
        ({"opt_level": 1, "cache_loop_invariant_global_vars": True}, 3, 7),
    ],
)
def test_what_a_loop_writes_to_a_field_it_reads_again(options, count, pairs):
    """Numbers that a loop increments are counted: 3 turns; 4 + 4 turns by two indices that are equal once. Taichi keeps
    a number of a field in a local variable while a loop runs, one for each expression of its place, so that one does
    not see what is written by another (its issue 8578): of 3 turns by two expressions 1 is left, of 8 by two indices 7.
    Quadrants computes all correctly; when Taichi does, the options are needed no more."""
    ti.init(arch=ti.cpu, offline_cache=False, log_level=ti.ERROR, **(workarounds.OPTIONS | options))
    if workarounds.LANGUAGE == "quadrants":
        count, pairs = 3, 8
    for kernel, number in ((counted, count), (paired, pairs)):
        rows = ti.field(ti.i32, 4)
        kernel(rows)
        assert rows.to_numpy().tolist() == [number] * 4, kernel.__name__
    backend.init(arch="cpu", precision="f64", threads=2)


# ---- fields ---------------------------------------------------------------------------------------------------------
def test_fields_are_refused_before_the_tree_that_kills_the_process(monkeypatch):
    """With a limit of 12 trees fields are refused before it is exceeded; Taichi's own limit of 512 takes half a minute
    to reach."""
    monkeypatch.setattr(backend, "MAX_TREES", 12)
    monkeypatch.setattr(backend, "TREES_OF_A_SIMULATION", 4)
    made = []
    with pytest.raises(RuntimeError, match="call taichi_mps.init"):
        for _ in range(13):
            backend.require_room()
            made.append(ti.field(ti.i32, 8))
            made[-1].fill(1)
    assert 4 < len(made) <= 9
    backend.init(arch="cpu", precision="f64", threads=2)
    backend.require_room()


# ---- what the language would do by itself: where one of these fails, what works around it is needed no more ----------
def calling(function):
    """A kernel that calls a Python function, 40 times."""

    @ti.kernel
    def run():
        for _ in ti.static(range(40)):
            function()

    return run


def test_it_warns_of_functions_without_a_mark_and_of_long_loops_that_are_unrolled_and_optimises():
    """A marked one is called without a word, and knows the kernel that is being compiled."""
    seen = []
    with pytest.warns(SyntaxWarning, match="Calling non-"):
        calling(lambda: 2)()
    with warnings.catch_warnings(record=True) as told:
        calling(workarounds.for_kernels(lambda: seen.append(workarounds.compiled_now())))()
    assert told == [] and len(set(seen)) == 1 and None not in seen
    assert workarounds.compiled_now() is None
    ti.init(arch=ti.cpu, log_level=ti.ERROR)
    with pytest.warns(Warning, match="unroll"):
        calling(workarounds.for_kernels(lambda: 2))()
    backend.init(arch="cpu", precision="f64", threads=2)
    with workarounds.optimised(True):
        assert ti.lang.impl.current_cfg().opt_level == 1
    assert ti.lang.impl.current_cfg().opt_level == 0


PATCHED = """
import hashlib, inspect, re
import taichi_mps.engine.runtime.backend
from taichi.lang import kernel_impl, snode
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext, Builder
patched = ASTTransformerContext.get_pos_info, Builder.__call__, kernel_impl.transform_tree, snode.get_traceback
for replaced in (*patched, kernel_impl._inside_class):
    print(hashlib.sha256(inspect.getsource(replaced).encode()).hexdigest()[:16], end=" ")
print(*re.findall(r"getsource\\w+\\(|textwrap\\.\\w+| ast\\.\\w+|transform_tree\\(", inspect.getsource(kernel_impl)))
"""
HERE = "fabeb718a3ead74d", "37fb69c0e9ebf033", "e888203947a2a0fb", "58cf656ed1b8487c", "c4c1de77f9b5be91"
USES = "getsourcefile( getsourcelines( textwrap.fill ast.parse textwrap.dedent" + 3 * " transform_tree("


@pytest.mark.skipif(workarounds.LANGUAGE != "taichi", reason="a patch of Taichi")
@pytest.mark.parametrize("switch", [None, "0"])
def test_the_speed_patch_replaces_what_it_was_written_for_unless_it_is_switched_off(switch):
    """The texts of what it replaces, and the uses of what it caches, are those of 1.7.4."""
    *replaced, uses = child("-c", PATCHED, TAICHI_MPS_WORKAROUNDS=switch).stdout.split(" ", 5)
    assert [text in HERE for text in replaced] == [switch == "0"] * 5
    assert uses.split() == USES.split()


@ti.func
def twice(x):
    return 2.0 * x


@pytest.mark.skipif(not workarounds.PATCHED, reason="a patch of Taichi 1.7.4")
def test_a_function_that_is_called_in_its_own_argument_is_read_rightly_and_keeps_no_field():
    """Its syntax tree serves each call, one at a time, and holds nothing of a kernel that was compiled before."""

    def compiled(factor):
        rows = ti.field(ti.f64, 3)

        @ti.kernel
        def run():
            for i in rows:
                rows[i] = twice(factor * twice(1.0 + twice(ti.cast(i, ti.f64) + rows[i])))

        run()
        return rows.to_numpy().tolist()

    for factor in (1.0, 3.0):
        assert compiled(factor) == [4.0 * factor * (1.0 + 2.0 * i) for i in range(3)]
    gc.collect()
    assert not any(isinstance(node, ast.AST) and hasattr(node, "ptr") for node in gc.get_objects())


@pytest.mark.skipif(not workarounds.PATCHED, reason="a patch of Taichi 1.7.4")
@pytest.mark.parametrize("d", [2, 3])
def test_matrices_built_directly_are_those_that_the_language_reads_bit_for_bit(d, monkeypatch):
    """Of numbers whose sums are not exact, of zeros of either sign, and of what is no number."""
    numbers = np.random.default_rng(1).standard_normal((2, 4, 3, 3))[:, :, :d, :d].copy()
    numbers[0, 1, 0], numbers[1, 1, 1], numbers[0, 2, 0, 0], numbers[1, 3, 1, 0] = 0.0, -0.0, np.nan, np.inf

    def computed():
        x, y, matrices = (ti.Matrix.field(d, d, ti.f64, shape) for shape in (4, 4, (4, 4)))
        vectors, sums = ti.Vector.field(d, ti.f64, (4, 2)), ti.field(ti.f64, (4, 4))
        x.from_numpy(numbers[0]), y.from_numpy(numbers[1])

        @ti.kernel
        def run():
            for i in x:
                a, b, v = x[i], y[i], y[i][:, 0]
                matrices[i, 0], matrices[i, 1] = a.transpose() @ b, v.outer_product(a @ v)
                matrices[i, 2], matrices[i, 3] = a @ b @ a, ti.Matrix.zero(ti.f64, d, d) - b
                vectors[i, 0], vectors[i, 1] = a @ v, v @ a
                sums[i, 0], sums[i, 1], sums[i, 2], sums[i, 3] = a.sum(), v.dot(a @ v), v @ v, a.max() - v.min()

        run()
        return [field.to_numpy().tobytes() for field in (matrices, vectors, sums)]

    built = computed()
    for direct in ("_reduce", "dot", "transpose", "outer_product", "matmul", "_matmul_helper", "_filled_matrix"):
        monkeypatch.delattr(getattr(ti.lang.matrix_ops, direct).func, "__call__")
    assert built == computed() and all(map(any, built))


# ---- silence and speed ----------------------------------------------------------------------------------------------
def test_import_says_nothing_and_leaves_python_as_it_was():
    """By itself the language greets."""
    switch = f"ENABLE_{workarounds.LANGUAGE.upper()}_HEADER_PRINT"
    assert "version" in child("-c", f"import {workarounds.LANGUAGE}", **{switch: None}).stdout
    as_it_was = "assert inspect.getmodule(inspect.getmodule) is inspect"
    done = child("-c", f"import inspect; import taichi_mps.engine.runtime.backend; {as_it_was}")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.slow
def test_the_language_does_not_warn_of_its_own_source(tmp_path):
    """Compiled at its first import, as by uv, Taichi's source gives no warning of an escape sequence."""
    settings = {"PYTHONWARNINGS": "default", "PYTHONPYCACHEPREFIX": str(tmp_path)}
    done = child("-c", "import taichi_mps.engine.runtime.backend", **settings)
    assert done.returncode == 0
    assert "escape" not in done.stderr


def test_a_kernel_may_stand_at_the_top_of_a_script(tmp_path):
    (tmp_path / "own.py").write_text("import taichi_mps as mps\n@mps.ti.kernel\ndef one() -> int:\n    return 1\n")
    assert child(tmp_path / "own.py").stderr == ""


@ti.kernel
def misspelt():
    for i in range(3):
        missing[i] = 1.0  # noqa: F821


def test_a_kernel_that_does_not_compile_names_its_line():
    with pytest.raises(Exception, match=r'test_workarounds.py", line \d+, in misspelt:\s+missing\[i\] = 1.0'):
        misspelt()


# ---- which language -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("asked", "here", "chosen"),
    [
        ("", ("taichi", "quadrants"), "taichi"),
        ("", ("quadrants",), "quadrants"),
        ("quadrants", ("taichi", "quadrants"), "quadrants"),
        ("", (), "TAICHI_MPS_KERNELS = taichi: is not installed"),
        ("quadrants", ("taichi",), "TAICHI_MPS_KERNELS = quadrants: is not installed"),
        ("fortran", ("taichi",), "TAICHI_MPS_KERNELS = fortran: must be taichi or quadrants"),
    ],
)
def test_taichi_is_the_language_where_it_is_installed_else_quadrants(monkeypatch, asked, here, chosen):
    monkeypatch.setenv("TAICHI_MPS_KERNELS", asked)
    monkeypatch.setattr(workarounds, "find_spec", lambda name: name if name in here else None)
    if ":" in chosen:
        with pytest.raises(backend.SceneError, match=chosen):
            workarounds.chosen_language()
    else:
        assert workarounds.chosen_language() == chosen
