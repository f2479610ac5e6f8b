"""Workarounds for wrong, slow or verbose parts of the kernel language; the speed patch changes no bit."""

from pathlib import Path

import numpy as np
import pytest
import tomlkit
from packaging.requirements import Requirement

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


def test_what_was_read_of_a_vector_local_stays_when_that_is_overwritten():
    """A value read from a local vector keeps its value when the vector is overwritten; Taichi's cfg_optimization would
    give 3, 4 and 6."""
    given, found = ti.Vector.field(2, ti.f64, 3), ti.field(ti.f64, 3)
    given.from_numpy(np.array([[1.0, 2.0], [2.0, 3.0], [3.0, 4.0]]))
    overwritten(given, found)
    assert found.to_numpy().tolist() == [12.0, 22.0, 33.0]


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


# ---- silence and speed ----------------------------------------------------------------------------------------------
def test_import_says_nothing():
    done = child("-c", "import taichi_mps.engine.runtime.backend")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.slow
def test_the_language_does_not_warn_of_its_own_source(tmp_path):
    """Compiled at its first import, as by uv, Taichi's source gives no warning of an escape sequence."""
    settings = {"PYTHONWARNINGS": "default", "PYTHONPYCACHEPREFIX": str(tmp_path)}
    done = child("-c", "import taichi_mps.engine.runtime.backend", **settings)
    assert done.returncode == 0
    assert "escape" not in done.stderr


@ti.kernel
def misspelt():
    for i in range(3):
        missing[i] = 1.0  # noqa: F821


def test_a_kernel_that_does_not_compile_names_its_line():
    with pytest.raises(Exception, match=r'test_workarounds.py", line \d+, in misspelt:\s+missing\[i\] = 1.0'):
        misspelt()


PATCHED = """
import taichi_mps.engine.runtime.backend
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext
print(ASTTransformerContext.get_pos_info.__module__.startswith("taichi_mps"))
"""


@pytest.mark.skipif(workarounds.LANGUAGE != "taichi", reason="a patch of Taichi")
@pytest.mark.parametrize("switch", [None, "0"])
def test_the_speed_patch_is_left_out_where_it_is_switched_off(switch):
    assert child("-c", PATCHED, TAICHI_MPS_WORKAROUNDS=switch).stdout.strip() == str(switch is None)


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


PROJECT = Path(__file__).resolve().parents[2] / "pyproject.toml"


@pytest.mark.parametrize("python", ["3.10", "3.13", "3.14"])
@pytest.mark.parametrize(
    ("system", "machine", "taichi"),
    [
        ("linux", "x86_64", True),
        ("darwin", "arm64", True),
        ("win32", "AMD64", True),
        ("linux", "aarch64", False),
        ("darwin", "x86_64", False),
    ],
)
def test_an_installation_takes_the_language_that_has_a_wheel(python, system, machine, taichi):
    """One of the two, as benchmarks/wheels.py finds them; for an Intel Mac pip finds neither."""
    needs = map(Requirement, tomlkit.parse(PROJECT.read_text(encoding="utf-8"))["project"]["dependencies"])
    known = {"python_version": python, "sys_platform": system, "platform_machine": machine}
    found = [need.name for need in needs if need.name in workarounds.LANGUAGES and need.marker.evaluate(known)]
    assert found == ["taichi" if taichi and python < "3.14" else "quadrants"]
