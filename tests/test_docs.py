"""The documentation is true: its code runs, the functions and tests it names exist, its links lead somewhere."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "taichi_mps"
DOCS = ROOT / "docs"
PAGES = [*sorted(DOCS.glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "renders" / "README.md"]
ARCHITECTURE = (DOCS / "architecture.md").read_text(encoding="utf-8")
EQUATIONS = (DOCS / "equations.md").read_text(encoding="utf-8")
LAYERS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["taichi-mps"]["layers"]
EXAMPLES = {"terms/drag.py", "schemes/ballistic.py"}  # files that architecture.md shows how to add
MOST_WORDS = 1500  # of architecture.md: an afternoon, not a book
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.S | re.M)
FILE = re.compile(r"# file: (\S+\.py)\n")
DOTTED = re.compile(r"`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+)`")
CALL = re.compile(r"`([a-z_]+\.[a-z_]+)\.([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)?)`")  # room.module, name
TEST = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")
TESTS = re.compile(r"`(tests/[\w/]+\.py)?(?:::(\w+))?`")  # with no path: in the file that was named before
PYTHON = re.compile(r"`((?:\w+/)+\w+\.py)`")
IMPORT = re.compile(r"^(?:from (taichi_mps[\w.]*) import|import (taichi_mps[\w.]*))(?: (.+))?$", re.M)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def modules():
    """Files of the package by their dotted names."""
    return {".".join(path.relative_to(PACKAGE).with_suffix("").parts): path for path in PACKAGE.rglob("*.py")}


def names(path):
    """Functions, classes and members, as 'Class.member', that a module defines; of a record also its fields."""
    found = set()

    def collect(body, prefix=""):
        for node in body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                found.add(prefix + node.name)
            if isinstance(node, ast.AnnAssign) and prefix and isinstance(node.target, ast.Name):
                found.add(prefix + node.target.id)
            if isinstance(node, ast.ClassDef):
                collect(node.body, f"{node.name}.")

    collect(ast.parse(path.read_text(encoding="utf-8")).body)
    return found


@pytest.mark.long
def test_recipes_run(tmp_path):
    """All Python blocks of recipes.md, in order, as one script; a block that names a file becomes that file."""
    script = ""
    for match in BLOCK.finditer((DOCS / "recipes.md").read_text(encoding="utf-8")):
        file = FILE.match(match[1])
        if file:
            (tmp_path / file[1]).write_text(match[1], encoding="utf-8")
        else:
            script += match[1]
    assert script.count("mps.init(") == 1, "a second init would drop the simulations of the blocks before"
    (tmp_path / "recipes.py").write_text(script, encoding="utf-8")
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    result = subprocess.run(
        [sys.executable, "recipes.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert result.returncode == 0, result.stdout + result.stderr


def test_the_site_is_built_offline_without_a_warning(tmp_path):
    """mkdocs --strict: every link, anchor and name of the API; nothing on its pages is fetched from elsewhere."""
    pytest.importorskip("mkdocs", reason="mkdocs is not installed: pip install 'taichi-mps[docs]'")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stdout + result.stderr
    pages = {path.stem: path.read_text(encoding="utf-8") for path in tmp_path.glob("*.html")}
    assert {page.stem for page in DOCS.glob("*.md")} <= set(pages)
    fetched = [url for text in pages.values() for url in re.findall(r'(?:src|link [^>]*href)="(https?:[^"]+)', text)]
    assert not fetched
    for name in ("simulation.simulation.Simulation.step", "problem.scene.Scene", "geometry.shapes.fill"):
        assert f"taichi_mps.{name}" in pages["api"], name


def test_the_api_has_every_public_name():
    from taichi_mps import __all__ as public

    shown, known = set(), modules()
    for name in re.findall(r"^::: taichi_mps\.(\S+)$", (DOCS / "api.md").read_text(encoding="utf-8"), re.M):
        shown |= {name.rsplit(".")[-1]} | (names(known[name]) if name in known else set())
    hidden = {"measure": "problem.measures", "rest_shapes": "problem.rest_shapes"}  # modules
    assert not {hidden.get(name, name).rsplit(".")[-1] for name in public} - shown


def test_named_functions_exist():
    """A dotted name of equations.md is one of a function, room.module.name; so is one of any page that begins with a
    room and a module."""
    known = modules()
    assert set(DOTTED.findall(EQUATIONS)) == {f"{module}.{name}" for module, name in CALL.findall(EQUATIONS)}
    assert len(CALL.findall(EQUATIONS)) > 100
    for page in PAGES:
        for module, name in CALL.findall(page.read_text(encoding="utf-8")):
            if page.stem == "equations" or module in known:
                assert module in known and name in names(known[module]), f"{page.name}: {module}.{name}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}-{page.stem}")
def test_named_files_and_imports_exist(page):
    """Files with a folder, from the root of the project or of the package; what Python blocks import."""
    text = page.read_text(encoding="utf-8")
    for name in set(PYTHON.findall(text)) - EXAMPLES:
        assert (ROOT / name).is_file() or (PACKAGE / name).is_file(), name
    for match in IMPORT.finditer("\n".join(BLOCK.findall(text))):
        module = (match[1] or match[2]).split(".")[1:]
        for name in (match[3] or "").split(", ") if match[1] and module else []:
            inside = PACKAGE.joinpath(*module)
            file = inside.with_suffix(".py")
            bound = (inside / f"{name}.py").is_file() or (
                file.is_file() and re.search(rf"\b{name}\b", file.read_text())
            )
            assert bound, match[0]


# ---- architecture.md ------------------------------------------------------------------------------------------------
def table(heading):
    """Rows of the tables below a heading, each as cells without marks of code."""
    section = re.search(rf"^## {heading}$(.*?)(?=^## |\Z)", ARCHITECTURE, re.S | re.M)[1]
    rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip().strip("`") for cell in row] for row in rows if row[0].strip() not in ("stage", "stop")]


def test_the_picture_of_the_rooms_is_that_of_the_project():
    picture = re.search(r"^## Rooms$.*?^```$(.*?)^```$", ARCHITECTURE, re.S | re.M)[1].strip().splitlines()
    assert [line.split()[0] for line in picture] == LAYERS
    assert all(len(line.split()) > 3 for line in picture), "a room without a word of what it is"


def test_the_stages_of_a_step_are_called_in_this_order_and_have_an_equation():
    def called(path):
        """Calls of stages in the order of step(), those of its own methods in their place."""
        tree = ast.parse((PACKAGE / "schemes" / path).read_text(encoding="utf-8"))
        scheme = next(node for node in tree.body if isinstance(node, ast.ClassDef))
        methods = {node.name: node for node in scheme.body if isinstance(node, ast.FunctionDef)}

        def order(name):
            calls = [node for node in ast.walk(methods[name]) if isinstance(node, ast.Call)]
            for call in sorted(calls, key=lambda node: (node.lineno, node.col_offset)):
                text = ast.unparse(call.func).removeprefix("self.")
                yield from order(text) if text in methods else [text]

        return list(order("step"))

    rows = table("One time step")
    for path, first, last in (("implicit.py", "motion.drift", "diagnostics.report"),
                              ("semi_implicit.py", "viscosity.predict", "pressure.correct")):  # fmt: skip
        stages = [row[0] for row in rows]
        stages = stages[stages.index(first) : stages.index(last) + 1]
        calls = iter(called(path))
        assert len(stages) > 4 and all(stage in calls for stage in stages), path
    for row in rows:
        for label in re.findall(r"\([^)]+\)", row[3]) if len(row) > 3 else []:
            assert re.search(rf"^\| .*{re.escape(label)}", EQUATIONS, re.M), label


def test_the_stops_of_a_number_exist():
    stops = table("What a number passes through")
    assert 3 <= len(stops) <= 6
    for number, path, name, _ in stops:
        assert name in names(ROOT / path), f"stop {number}: {name} is not in {path}"


def test_architecture_is_short():
    assert len(ARCHITECTURE.split()) <= MOST_WORDS


# ---- equations.md ---------------------------------------------------------------------------------------------------
def test_every_equation_names_its_function_and_its_test():
    lines = EQUATIONS.splitlines()
    rows = [line.split(" | ") for line in lines if line.startswith("| (")]
    assert len(rows) > 35
    for row in rows:
        assert len(row) == 4, row
        assert CALL.search(row[2]), row
        assert TEST.search(row[3]), row
    numbers = {int(n) for row in rows for n in re.findall(r"\((\d+)\)", row[0])} | set(range(22, 29))
    assert numbers == set(range(1, 30)), "an equation of the paper has no row"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}-{page.stem}")
def test_named_tests_exist(page):
    path = None
    for file, name in TESTS.findall(page.read_text(encoding="utf-8")):
        path = ROOT / file if file else path
        assert path is None or path.is_file(), file
        assert not name or name in names(path), f"{path}::{name}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}-{page.stem}")
def test_links_resolve(page):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if not target.startswith(("http://", "https://", "#")):
            assert (page.parent / target.split("#")[0]).exists(), target
