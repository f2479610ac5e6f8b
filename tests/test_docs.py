"""The documentation is true: its code runs, the functions and tests it names exist, its links lead somewhere."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("*.md"))
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.S | re.M)
FILE = re.compile(r"# file: (\S+\.py)\n")
CALL = re.compile(r"`((?:schemes\.)?[a-z_]+)\.([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)?)`")
TEST = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def names(path):
    """Functions, classes and members, as 'Class.member', that a module defines."""
    found = set()

    def collect(body, prefix=""):
        for node in body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                found.add(prefix + node.name)
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
    for name in ("taichi_mps.Simulation.step", "taichi_mps.scene.Scene", "taichi_mps.bodies.fill"):
        assert name.replace("taichi_mps.Sim", "taichi_mps.simulation.Sim") in pages["api"], name


def test_the_api_has_every_public_name():
    from taichi_mps import __all__ as public

    shown = set()
    for name in re.findall(r"^::: taichi_mps\.(\S+)$", (DOCS / "api.md").read_text(encoding="utf-8"), re.M):
        module = ROOT / "taichi_mps" / f"{name}.py"
        shown |= {name.rsplit(".")[-1]} | (names(module) if module.is_file() else set())
    assert not set(public) - shown


def test_named_functions_exist():
    text = (DOCS / "equations.md").read_text(encoding="utf-8")
    modules = {
        ".".join(path.relative_to(ROOT / "taichi_mps").with_suffix("").parts): path
        for path in (ROOT / "taichi_mps").rglob("*.py")
    }
    named = [match.groups() for match in CALL.finditer(text)]
    assert {module for module, _ in named} <= set(modules)
    assert len(named) > 30
    missing = {f"{module}.{name}" for module, name in named if name not in names(modules[module])}
    assert not missing


def test_every_equation_names_its_function_and_its_test():
    lines = (DOCS / "equations.md").read_text(encoding="utf-8").splitlines()
    rows = [line.split(" | ") for line in lines if line.startswith("| (")]
    assert len(rows) > 35
    for row in rows:
        assert len(row) == 4, row
        assert CALL.search(row[2]), row
        assert TEST.search(row[3]), row
    numbers = {int(n) for row in rows for n in re.findall(r"\((\d+)\)", row[0])} | set(range(22, 29))
    assert numbers == set(range(1, 30)), "an equation of the paper has no row"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_named_tests_exist(page):
    for match in TEST.finditer(page.read_text(encoding="utf-8")):
        path = ROOT / match[1]
        assert path.is_file(), match[1]
        assert match[2] is None or match[2] in names(path), match[0]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_resolve(page):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if not target.startswith(("http://", "https://", "#")):
            assert (page.parent / target.split("#")[0]).exists(), target
