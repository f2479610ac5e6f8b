"""The index of functions and tests by equation, docs/equations.md, made anew; CONTRIBUTING says when.

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
THEORY = ["semi_implicit", "implicit", "walls", "steps"]
HEAD = """---
hide: [toc]
---
# Index of equations, functions, tests

Which function computes an equation, and which test checks it. A function is named by its room and module in
`taichi_mps/`. (1) to (29) are the paper's, the others this project's. Written by `python docs/equation_index.py`.

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


def index() -> str:
    """The page."""
    known = tomllib.loads((DOCS / "equations.toml").read_text(encoding="utf-8"))
    code, tests = {}, {}
    for labels, entry in known.items():
        for label in labels.split(", "):
            code.setdefault(label, []).extend(entry["code"])
            tests.setdefault(label, []).extend(entry["tests"])
    for path, name, text in docstrings(ROOT / "taichi_mps"):
        for label in cited(text):
            module = ".".join(path.relative_to(ROOT / "taichi_mps").with_suffix("").parts)
            code.setdefault(label, []).append(f"{module}.{name}")
    for path, name, text in docstrings(ROOT / "tests"):
        for label in cited(text) if name.startswith("test_") else ():
            tests.setdefault(label, []).append(f"{path.relative_to(ROOT).as_posix()}::{name}")
    lines = []
    for page, labels in equations():
        title = ", ".join(f"({label})" for label in labels)
        cells = [list(dict.fromkeys(item for label in labels for item in of.get(label, []))) for of in (code, tests)]
        cells = [" ".join(f"`{item}`" for item in cell) for cell in cells]
        lines.append(f"| [{title}](theory/{page}.md#eq-{labels[0].replace(' ', '-')}) | {cells[0]} | {cells[1]} |")
    return HEAD + "\n".join(lines) + "\n\n</div>\n"


if __name__ == "__main__":
    (DOCS / "equations.md").write_text(index(), encoding="utf-8")
