"""Fixtures and markers of all tests. Taichi is started once per test module: a process holds at most 512 trees of
fields, and init drops them all.

LONGEST, PAGES and CORE name files by their place in tests/; the files must exist.
"""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

import taichi_mps as mps
from taichi_mps.engine.runtime import backend

TESTS = Path(__file__).parent

for language in ("TI", "QD"):  # at 100 MB, the default, the first kernels of the suite go before its end
    os.environ.setdefault(f"{language}_OFFLINE_CACHE_MAX_SIZE_OF_FILES", str(10**9))

slow = {"deadline": None, "suppress_health_check": list(HealthCheck)}
settings.register_profile("thorough", max_examples=2000, **slow)  # --hypothesis-profile thorough
settings.register_profile("quick", max_examples=25, derandomize=True, **slow)


@pytest.fixture(scope="module", autouse=True)
def taichi():
    backend.init(arch="cpu", precision="f64", threads=1)


@pytest.fixture
def command(capsys):
    """Run a command line in this process: (exit code, stdout, stderr)."""

    def run(*words):
        code = mps.main([str(word) for word in words])
        return code, *capsys.readouterr()

    return run


@pytest.fixture
def resumed(monkeypatch):
    """What ``resume`` does with nothing started or computed: "started", and the options with which it would go on."""
    seen = []
    monkeypatch.setattr(mps.backend, "init", lambda *_: seen.append("started"))
    monkeypatch.setattr("taichi_mps.io.checkpoint.Checkpoint.resume", lambda *_, **__: None)
    monkeypatch.setattr("taichi_mps.cli.main.carry_out", lambda *given, **_: seen.append(given[2]) or 0)
    return seen


# files of 20 s and more, the slow part among them, the longest first: at the end no worker waits for a long file
LONGEST = (
    "app/test_app.py",
    "terms/test_grains.py",
    "cli/test_cli.py",
    "schemes/test_semi_implicit.py",
    "simulation/test_forces_in_time.py",
    "scenes/test_scenes.py",
    "schemes/test_axisymmetric.py",
    "scenes/test_methods.py",
    "schemes/test_active_set.py",
    "simulation/test_sessions.py",
    "simulation/test_outputs.py",
    "cli/test_environment.py",
    "boundaries/test_moving_walls.py",
    "scenes/test_printing.py",
    "simulation/test_pay_for_use.py",
    "validation/test_validation.py",
    "boundaries/test_mirror.py",
    "schemes/test_implicit.py",
    "linear/test_pcg.py",
    "viz/test_notebooks.py",
    "linear/test_node_multigrid.py",
    "boundaries/test_walls.py",
    "simulation/test_volume.py",
    "geometry/test_solid.py",
)

# the docs, and what a browser shows: in .ci/run after the default suite
PAGES = ("app/test_app.py", "benchmarks/test_explore.py", "report/test_page.py", "test_docs.py")

# each term, solver and wall, and a resume, in three minutes on two cores: what .ci/run repeats on the other kernel
# language
CORE = (
    "runtime/test_backend.py",
    "runtime/test_workarounds.py",
    "runtime/test_field_io.py",
    "runtime/test_stages.py",
    "runtime/test_sums.py::test_a_solve_that_a_gpu_repeats_has_the_bits_of_one_that_asks_python_at_each_iteration",
    "runtime/test_sums.py::test_an_outer_iteration_on_a_gpu_is_one_kernel_with_the_bits_of_those_between_which_python_reads",
    "runtime/test_thread_team.py::test_members_wait_for_each_other",
    "runtime/test_thread_team.py::test_more_members_than_threads_do_not_wait_for_ever",
    "runtime/test_thread_team.py::test_a_team_solves_bit_for_bit_as_one_thread",
    "particles/test_gradient.py",
    "particles/test_neighbors.py",
    "linear/test_pcg.py::test_the_product_of_a_sparse_matrix_is_that_of_scipy",
    "linear/test_pcg.py::test_poisson_of_the_gallery",
    "linear/test_pcg.py::test_masked_rows_keep_their_values_and_act_as_dirichlet_values",
    "linear/test_pcg.py::test_a_solve_goes_on_from_the_last_one",
    "linear/test_node_multigrid.py::test_the_preconditioner_is_symmetric_and_positive",
    "linear/test_node_multigrid.py::test_levels_change_the_iterations_and_not_the_answer",
    "boundaries/test_friction.py::test_newtonian_film_slips_by_the_wall_stress_over_the_viscous_constant",
    "boundaries/test_friction.py::test_the_matrix_at_a_floor_with_friction_is_symmetric_positive_definite",
    "boundaries/test_mirror.py::test_symmetric_linear_fields_have_the_gradient_of_the_whole",
    "boundaries/test_moving_walls.py::test_force_at_a_thin_wall_is_the_negative_transpose_of_the_gradient",
    "boundaries/test_walls.py::test_hydrostatic_pressure_carries_the_weight",
    "boundaries/test_walls.py::test_force_at_curved_walls_is_the_negative_transpose_of_the_gradient",
    "schemes/test_active_set.py::test_a_layer_at_rest_wakes_where_a_weight_lands_and_nowhere_else",
    "terms/test_deferred_correction.py",
    "terms/test_flow_curves.py::test_a_thixotropic_law_of_ones_own_comes_to_rest",
    "terms/test_initial_relaxation.py::test_a_lattice_stays_where_it_is",
    "terms/test_momentum.py",
    "terms/test_momentum_drift.py::test_a_block_that_collapses_on_a_frictionless_floor_stays_where_it_is",
    "terms/test_pressure_smoothing.py",
    "terms/test_rheology.py",
    "terms/test_wall_stress.py::test_what_has_not_yielded_keeps_its_stress_and_what_flows_well_has_all_of_the_excess",
    "schemes/test_axisymmetric.py::test_forces_are_the_negative_transpose_of_the_gradient",
    "schemes/test_axisymmetric.py::test_the_cone_slumps_as_the_finite_elements",
    "schemes/test_implicit.py::test_film_stands_below_its_yield_value_and_flows_above",
    "schemes/test_semi_implicit.py::test_laplacian_is_exact_on_the_lattice",
    "schemes/test_semi_implicit.py::test_poisson_matrix_is_symmetric_positive_definite_and_equals_a_dense_one",
    "schemes/test_semi_implicit.py::test_the_run_ends_when_nine_tenths_are_unyielded",
    "simulation/test_reproducible.py",
    "io/test_files.py::test_a_checkpoint_comes_back_bit_for_bit",
)


def pytest_configure():
    for name in (*LONGEST, *PAGES, *CORE):
        file, _, test = name.partition("::")
        if not (TESTS / file).is_file() or f"def {test}" not in (TESTS / file).read_text(encoding="utf-8"):
            raise pytest.UsageError(f"tests/conftest.py names {name}, which does not exist")


def pytest_collection_modifyitems(items):
    for item in items:
        file = item.path.relative_to(TESTS).as_posix()
        if {file, f"{file}::{item.originalname}"} & set(CORE) and not item.get_closest_marker("long"):
            item.add_marker(pytest.mark.core)
        if file in PAGES:
            item.add_marker(pytest.mark.pages)
    place = {TESTS / name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path, len(place)))
