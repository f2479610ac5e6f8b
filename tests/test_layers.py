"""Architecture: who may import whom, read from the source with ast; an import of the package is instant.

The rule: a room imports only from rooms before it in the list of pyproject.toml; terms do not import each other, but
all may import the constitutive law and the constants. The engine imports units and spelling alone, and hands outward
what its list says.
"""

import ast
import re
import sys
from graphlib import TopologicalSorter
from importlib import import_module, reload

import pytest
import tomlkit
from packaging.requirements import Requirement

from taichi_mps import engine
from tests.support.child import ROOT, child

PACKAGE = ROOT / "taichi_mps"
SETTINGS = tomlkit.parse((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LAYERS = SETTINGS["tool"]["taichi-mps"]["layers"]
LOOSE = {"__init__", "__main__", "spelling", "units"}  # all else lives in a room
SHARED_TERMS = {"engine.terms.rheology", "engine.terms.constants"}


MODULES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts): ast.parse(path.read_text(encoding="utf-8"))
    for path in sorted(PACKAGE.rglob("*.py"))
}
PLAIN = [name for name in MODULES if not name.endswith(("__init__", "__main__")) and not name.startswith("scenes.")]


def targets(name, tree):
    """(module or room, names) of each import from the package by a module, anywhere in its text."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            path = [*name.split(".")[: -node.level], node.module] if node.level else (node.module or "").split(".")[1:]
            if node.level or node.module.startswith("taichi_mps"):
                yield ".".join(filter(None, path)), [each.name for each in node.names]
        elif isinstance(node, ast.Import):
            whole = (each.name.partition(".") for each in node.names)
            yield from ((rest, []) for package, _, rest in whole if package == "taichi_mps")


def imports(name, tree):
    """Modules of the package that a module imports, anywhere in its text."""
    found = {f"{target}.{each}".lstrip(".") for target, names in targets(name, tree) for each in names}
    return (found | {target for target, _ in targets(name, tree)}) & MODULES.keys()


def room(name):
    return ".".join(name.split(".")[: 1 + name.startswith("engine.")])


@pytest.mark.parametrize("name", [name for name in PLAIN if name not in LOOSE - {"units"}])
def test_a_room_imports_only_from_rooms_before_it_and_a_term_no_other(name):
    for other in imports(name, MODULES[name]):
        assert LAYERS.index(room(other)) <= LAYERS.index(room(name)), f"{name} imports {other}"
        assert not room(name) == room(other) == "engine.terms" or other in SHARED_TERMS, f"{name} imports {other}"


def test_the_engine_has_one_border():
    """Inward only units and spelling; outward only the names of its list, from itself and from none of its rooms."""
    for name, tree in MODULES.items():
        for target, names in targets(name, tree):
            if name.startswith("engine."):
                assert target.split(".")[0] in ("engine", "units", "spelling"), f"{name} imports {target}"
            elif target.split(".")[0] == "engine":
                assert target == "engine" and set(names) <= set(engine.__all__), name
    assert all(hasattr(engine, each) for each in engine.__all__)


@pytest.mark.parametrize(
    ("former", "now"),
    [
        ("problem.catalogue", "input.catalogue"),
        ("problem.materials", "engine.problem.materials"),
        ("simulation.forecast", "forecast.cost"),
        ("runtime", "engine.runtime"),
    ],
)
def test_modules_are_found_by_their_names_of_before(former, now):
    """Until 0.5, as the same module: what a scene of 0.2 imports."""
    found = import_module(f"taichi_mps.{former}")
    assert found is import_module(f"taichi_mps.{now}") and found.__spec__.name == f"taichi_mps.{now}"
    parent, _, name = former.rpartition(".")
    assert not parent or getattr(__import__(f"taichi_mps.{parent}", fromlist=[name]), name) is found


def test_the_package_loaded_again_finds_former_names_once():
    before, package = list(sys.meta_path), sys.modules["taichi_mps"]
    try:
        for _ in range(2):
            assert reload(package) is package
        assert sys.meta_path[1:] == before[1:] and sys.meta_path[0] is package._Moved is not before[0]
        assert import_module("taichi_mps.problem.labels") is import_module("taichi_mps.input.labels")
    finally:
        sys.meta_path[:] = before


def test_every_room_stands_in_the_list_and_nothing_lies_loose():
    assert {room(name) for name in MODULES} - LOOSE - {"engine.__init__"} == set(LAYERS) - LOOSE
    assert len([path for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()]) <= 9
    assert {name for name in MODULES if "." not in name} <= LOOSE


def test_rooms_say_what_lives_there_and_what_to_read_first():
    for name in set(LAYERS) - LOOSE:
        text = ast.get_docstring(MODULES[f"{name}.__init__"]) or ""
        first = re.search(r"Read (\w+\.py) first", text)
        there = first and PACKAGE.joinpath(*name.split("."), first[1]).is_file()
        assert len(text) > 100 and there, f"{name}/__init__.py"


def test_no_import_circles():
    graph = {name: imports(name, MODULES[name]) for name in PLAIN}
    assert list(TopologicalSorter(graph).static_order())  # CycleError names the circle


def test_the_package_itself_reads_nothing_at_its_import():
    """The import of taichi_mps.__main__ loads no numpy and of the package only cli and cli.stopped, so that signals are
    handled before the long part of the start."""
    script = "import sys, taichi_mps.__main__; print([m for m in sys.modules if 'taichi_mps.' in m or m == 'numpy'])"
    assert child("-c", script).stdout.strip() == str(
        ["taichi_mps.cli", "taichi_mps.cli.stopped", "taichi_mps.__main__"]
    )


@pytest.mark.parametrize("name", [*MODULES, *(f"../scenes/{p.name}" for p in sorted((ROOT / "scenes").glob("*.py")))])
def test_only_the_room_runtime_imports_taichi_and_none_what_a_wheel_lacks(name):
    """The package runs without validation/, benchmarks/ and tests/ of a checkout."""
    tree = MODULES[name] if name in MODULES else ast.parse((PACKAGE / name).read_text(encoding="utf-8"))
    names = [a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names]
    names += [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and not node.level]
    found = {item.split(".")[0] for item in names}
    assert not found & {"taichi", "quadrants"} or room(name) == "engine.runtime"
    assert not found & {"validation", "benchmarks", "tests"}


def test_nothing_in_the_package_runs_data():
    """No module that can run what it reads is imported, and no such function is called."""
    words = ("pickle", "marshal", "shelve", "yaml", "dill", "joblib", " eval(", "=eval(", " exec(")
    for path in [*PACKAGE.rglob("*.py"), *(ROOT / "scenes").glob("*.py")]:
        text = path.read_text(encoding="utf-8")
        assert not [word for word in words if word in text], path


@pytest.mark.parametrize("name", list(MODULES))
def test_only_the_backend_starts_taichi(name):
    """And not at its import, which says nothing (runtime/test_workarounds.py)."""
    calls = {ast.unparse(node.func) for node in ast.walk(MODULES[name]) if isinstance(node, ast.Call)}
    assert ("ti.init" in calls) == (name == "engine.runtime.backend")


LARGE = {"taichi", "h5py", "matplotlib", "meshio", "imageio", "scipy", "pysplashsurf"}


@pytest.mark.parametrize(
    ("code", "without", "seconds"),
    [
        ("mps.Bingham()", LARGE, 0.3),
        ("mps.main(['--help'])", LARGE - {"h5py"}, 0.5),
        ("[mps.catalogue.load(n) for n in mps.catalogue.names()]", LARGE, 0.6),
    ],
)
def test_import_is_instant(code, without, seconds):
    """The processor time of an import is at most three times that measured, for slower machines."""
    told = f"print(sorted({without} & set(sys.modules)), time.process_time())"
    found, spent = (
        child("-c", f"import sys, time, taichi_mps as mps; {code}; {told}").stdout.split("\n")[-2].split("] ")
    )
    assert found == "[" and float(spent) < 3.0 * seconds


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
    needs = map(Requirement, SETTINGS["project"]["dependencies"])
    known = {"python_version": python, "sys_platform": system, "platform_machine": machine}
    found = [need.name for need in needs if need.name in ("taichi", "quadrants") and need.marker.evaluate(known)]
    assert found == ["taichi" if taichi and python < "3.14" else "quadrants"]
