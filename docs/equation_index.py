"""The index of functions and tests by equation, docs/equations.md, and the API pages to which its links lead.

    python docs/equation_index.py

The equations and their order are the numbered ones of docs/theory/. What belongs to each stands in docs/equations.toml,
and in the docstrings of functions and tests that name it, as eq 13, eqs 1-3 or (I14).
"""

import ast
import re
import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
THEORY = ["semi_implicit", "implicit", "walls", "grains", "steps"]
OWN = {"functions": "Functions of the equations", "tests": "Tests of the equations"}  # pages written here
NAME = re.compile(r"^::: taichi_mps\.(\S+)$", re.M)
LINKED = re.compile(r"\(api/(\w+)\.md#([\w.]+)\)")
HEAD = """---
hide: [toc]
---
# Index of equations, functions, tests

Which function computes an equation, and which test checks it. A function is named by its room and module in
`taichi_mps/engine/`. (1) to (29) are the paper's, the others this project's. Written by
`python docs/equation_index.py`.

<div class="names" markdown>

| Equation | Functions | Tests |
|---|---|---|
"""


def equations() -> list[tuple[str, list[str]]]:
    """Page and labels of each numbered equation, in the order of the pages."""
    texts = {page: (DOCS / "theory" / f"{page}.md").read_text(encoding="utf-8") for page in THEORY}
    return [(page, tag.split(", ")) for page, text in texts.items() for tag in re.findall(r"\\tag\{([^}]*)\}", text)]


def cited(text: str) -> set[str]:
    """Labels that a docstring names: of 'eq 13', 'eqs 1-3, (5)', '(I14)', 'S1-S5', 'R1 to R4'."""
    found = set()
    for numbers in re.findall(r"\b[Ee]qs? (\(?\d+\)?(?:(?:, | and |-)\(?\d+\)?)*)", text):
        for first, last in re.findall(r"(\d+)(?:-(\d+))?", numbers.replace("(", "").replace(")", "")):
            found |= {str(k) for k in range(int(first), int(last or first) + 1)}
    for letter, first, last in re.findall(r"\b([ISR])([1-9]\d?)\b(?:(?:-| to )\1([1-9]\d?))?", text):
        found |= {f"{letter}{k}" for k in range(int(first), int(last or first) + 1)}
    return found


def docstrings(folder: Path):
    """(file, name with its class, docstring) of all functions, methods and classes below a folder."""
    for path in sorted(folder.rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            for inner in [node, *getattr(node, "body", [])] if isinstance(node, ast.ClassDef) else [node]:
                if isinstance(inner, ast.FunctionDef | ast.ClassDef):
                    name = node.name if inner is node else f"{node.name}.{inner.name}"
                    yield path, name, ast.get_docstring(inner) or ""


def shown() -> dict[str, str]:
    """Page of each name on the written pages of the API."""
    pages = [path for path in (DOCS / "api").glob("*.md") if path.stem not in OWN]
    return {name: path.stem for path in pages for name in NAME.findall(path.read_text(encoding="utf-8"))}


def link(item: str, pages: dict[str, str]) -> str:
    """Markdown of a function or test, with a link to where its docstring and source are shown."""
    name = item.removesuffix(".py").replace(".py::", ".").replace("/", ".")
    if name == item:
        room = ROOT / "taichi_mps" / item.split(".")[0]
        outside = (room / "__init__.py").exists() or room.with_suffix(".py").exists()
        whole = item if outside else f"engine.{item}"
        name, parts = f"taichi_mps.{whole}", whole.split(".")
        over = [".".join(parts[:k]) for k in range(2, len(parts) + 1)] * (not re.search(r"\._", item))
        page = next((pages[each] for each in over if each in pages), "functions")
    else:
        page = "tests"
    return f"[`{item}`](api/{page}.md#{name})"


def index() -> dict[Path, str]:
    """The pages: the index, and functions and tests of it that have no page of the API."""
    pages, linked = shown(), []
    known = tomllib.loads((DOCS / "equations.toml").read_text(encoding="utf-8"))
    code, tests = {}, {}
    for labels, entry in known.items():
        for label in labels.split(", "):
            code.setdefault(label, []).extend(entry["code"])
            tests.setdefault(label, []).extend(entry["tests"])
    for path, name, text in docstrings(ROOT / "taichi_mps"):
        for label in cited(text):
            module = ".".join(path.relative_to(ROOT / "taichi_mps").with_suffix("").parts)
            code.setdefault(label, []).append(f"{module.removeprefix('engine.')}.{name}")
    for path, name, text in docstrings(ROOT / "tests"):
        for label in cited(text) if name.startswith("test_") else ():
            tests.setdefault(label, []).append(f"{path.relative_to(ROOT).as_posix()}::{name}")
    lines = []
    for page, labels in equations():
        title = ", ".join(f"({label})" for label in labels)
        cells = [list(dict.fromkeys(item for label in labels for item in of.get(label, []))) for of in (code, tests)]
        cells = [" ".join(link(item, pages) for item in cell) for cell in cells]
        linked += LINKED.findall(" ".join(cells))
        lines.append(f"| [{title}](theory/{page}.md#eq-{labels[0].replace(' ', '-')}) | {cells[0]} | {cells[1]} |")
    made = {DOCS / "equations.md": HEAD + "\n".join(lines) + "\n\n</div>\n"}
    for page, title in OWN.items():
        names = sorted({name for own, name in linked if own == page})
        blocks = [f"::: {name}\n    options: {{show_source: true}}\n" for name in names]
        made[DOCS / "api" / f"{page}.md"] = f"# {title}\n\n" + "\n".join(blocks)
    return made


if __name__ == "__main__":
    for path, text in index().items():
        path.write_text(text, encoding="utf-8")
