"""Statements without docstrings of each part of the project, and how many there are a function and a line of code.

python .ci/statements.py            # the parts beside their budgets; ends with 1 where one is over its own
python .ci/statements.py PATH ...   # each file below these paths, largest first
"""

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# of 0.4.0
BUDGETS = {"taichi_mps": 14_400, "benchmarks and validation": 4_100, "tests": 11_400}
DOCUMENTED = ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef


def counts(path: Path) -> tuple[int, int, int]:
    """Statements, functions and lines that are neither empty, comment nor docstring, of one file."""
    text = path.read_text(encoding="utf-8")
    nodes = list(ast.walk(ast.parse(text)))
    documented = [n for n in nodes if isinstance(n, DOCUMENTED)]
    docstrings = [n.body[0] for n in documented if ast.get_docstring(n, clean=False) is not None]
    of_docstrings = {k for d in docstrings for k in range(d.lineno, d.end_lineno + 1)}
    code = [line.strip() for k, line in enumerate(text.splitlines(), 1) if k not in of_docstrings]
    lines = sum(bool(line) and not line.startswith("#") for line in code)
    functions = sum(isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef) for n in nodes)
    return sum(isinstance(n, ast.stmt) for n in nodes) - len(docstrings), functions, lines


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [folder]


def main() -> int:
    if paths := [path for name in sys.argv[1:] for path in files(Path(name))]:
        for statements, path in sorted(((counts(path)[0], path) for path in paths), reverse=True):
            print(f"{statements:6} {path}")
        return 0
    over = False
    print(f"{'':26}{'statements':>11}{'budget':>8}{'files':>7}{'a function':>12}{'a line':>8}")
    for part, budget in BUDGETS.items():
        found = [counts(path) for folder in part.split(" and ") for path in files(ROOT / folder)]
        statements, functions, lines = (sum(column) for column in zip(*found, strict=True))
        means = f"{statements / functions:12.2f}{statements / lines:8.3f}"
        print(f"{part:26}{statements:11}{budget:8}{len(found):7}{means}")
        over = over or statements > budget
    return int(over)


if __name__ == "__main__":
    sys.exit(main())
