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
PAGES = [DOCS / f"{name}.md" for name in ("equations", "architecture", "recipes", "limits")]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.S | re.M)
FILE = re.compile(r"# file: (\S+\.py)\n")
CALL = re.compile(r"`((?:schemes\.)?[a-z_]+)\.([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)?)`")
TEST = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def names(path):
    """Functions, classes, their members and the constants that a module defines, 'Class.member' among them."""
    found = set()

    def collect(body, prefix=""):
        for node in body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                found.add(prefix + node.name)
            if isinstance(node, ast.ClassDef):
                collect(node.body, f"{node.name}.")
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            for target in targets:
                items = target.elts if isinstance(target, ast.Tuple) else [target]
                found.update(prefix + item.id for item in items if isinstance(item, ast.Name))

    collect(ast.parse(path.read_text(encoding="utf-8")).body)
    return found


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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_named_functions_exist(page):
    text = page.read_text(encoding="utf-8")
    modules = {
        ".".join(path.relative_to(ROOT / "taichi_mps").with_suffix("").parts): path
        for path in (ROOT / "taichi_mps").rglob("*.py")
    }
    named = [match.groups() for match in CALL.finditer(text) if match[1] in modules and match[2] != "py"]
    assert named or page.stem != "equations"
    missing = {f"{module}.{name}" for module, name in named if name not in names(modules[module])}
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_row_of_a_table_names_its_function(page):
    """In equations.md the third column of each row of the long tables names at least one function."""
    if page.stem != "equations":
        pytest.skip("only the equations have such tables")
    rows = [line.split(" | ") for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| (")]
    assert len(rows) > 20
    for row in rows:
        assert len(row) == 4, row
        assert CALL.search(row[2]), row


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
