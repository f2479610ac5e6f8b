"""How near the tests come to their bounds: the suite as it is and in variants that differ only in rounding.
    python -m tests.bounds                            # all of the suite; the table in benchmarks/results/bounds.md
    python -m tests.bounds tests/terms -m "not long"  # some, with the options of pytest

An assertion `value < bound`, `value == approx(...)` or an allclose of NumPy is rated by value/bound (of approx:
deviation/tolerance). A bound is reported where rounding moves the value by more than a tenth of the remaining margin
and the worst variant leaves less than a factor of three, except in a statement marked ``# rule``: the bound of a scene,
at which a run ends or a value counts as met, and none of the test. Tests that fail in a variant are named.
"""

import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "benchmarks/results/bounds.md"
SEEDS = 3  # of particles that are moved
VARIANTS = {  # environment, and the variant of tests/variants.py
    "as it is": ({}, ""),
    "no fast_math": ({}, "no_fast_math"),
    "no speed patches": ({"TAICHI_MPS_WORKAROUNDS": "0"}, ""),
    "Quadrants": ({"TAICHI_MPS_KERNELS": "quadrants"}, ""),
    **{f"moved by 1e-6 l0, {seed}": ({}, f"moved:{seed}") for seed in range(1, SEEDS + 1)},
    "numbered at random": ({}, "numbered:1"),
}
RULE = re.compile(r"# rule\b")
FACTOR, PART = 3.0, 0.1  # room that the worst leaves; what rounding moves, over the room that is left
PLAIN = re.compile(r"np\.float\d+\(([^()]*)\)")
ARITHMETIC = re.compile(r"[-+*/().\de ]+")
seen: dict[str, float] = {}  # nearness of each assertion, the largest of its calls


# ---- in the tests -------------------------------------------------------------------------------------------------
def nearness(text: str) -> float | None:
    """Value over bound of a comparison as pytest writes it; None of others and of a bound that is not positive."""
    parts = re.split(r" (<=?|>=?|==|±) ", PLAIN.sub(r"\1", text.split("\n")[0]))
    if not all(ARITHMETIC.fullmatch(part) for part in parts[::2]):
        return None
    try:
        numbers = [float(eval(part)) for part in parts[::2]]
    except SyntaxError:  # one of several lines
        return None
    if parts[1::2] == ["==", "±"]:
        small, large = abs(numbers[0] - numbers[1]), numbers[2]
    elif len(parts) == 3 and parts[1] != "==":
        small, large = numbers if "<" in parts[1] else numbers[::-1]
    else:
        return None
    return max(0.0, small) / large if large > 0.0 else None


def note(name: str, near: float | None) -> None:
    if near is not None:
        seen[name] = max(near, seen.get(name, 0.0))


def pytest_assertion_pass(item, lineno, orig, expl):
    if not RULE.search(orig):
        note(f"{item.nodeid} `{orig}`", nearness(expl))


def noted(compare):
    """An allclose of NumPy that notes how near it comes."""

    def close(a, b, rtol, atol, **others):
        with np.errstate(all="ignore"):
            near = np.abs(np.subtract(a, b, dtype=float)) / (atol + rtol * np.abs(b))
        test, caller = os.environ.get("PYTEST_CURRENT_TEST", "").split(" ")[0], sys._getframe(2)
        if Path(caller.f_code.co_filename).is_relative_to(ROOT / "tests"):  # what others compare is no bound
            note(f"{test} `allclose, line {caller.f_lineno}`", float(np.nanmax(near, initial=0.0)))
        return compare(a, b, rtol=rtol, atol=atol, **others)

    return close


def pytest_configure(config):
    allclose, assert_allclose = noted(np.allclose), noted(np.testing.assert_allclose)
    np.allclose = lambda a, b, rtol=1e-5, atol=1e-8, **others: allclose(a, b, rtol, atol, **others)
    np.testing.assert_allclose = lambda a, b, rtol=1e-7, atol=0.0, **o: assert_allclose(a, b, rtol, atol, **o)


def pytest_sessionfinish(session):
    Path(os.environ["BOUNDS_FOLDER"], f"{os.getpid()}.json").write_text(json.dumps(seen), encoding="utf-8")


# ---- all variants -------------------------------------------------------------------------------------------------
def run(variant: str, words: list[str]) -> tuple[dict[str, float], list[str]]:
    """Nearness of each assertion and the tests that failed, of a run of pytest in a variant."""
    with tempfile.TemporaryDirectory() as folder:
        environment, name = VARIANTS[variant]
        place = os.environ | environment | {"BOUNDS_FOLDER": folder}
        options = ["-p", "tests.bounds", "-o", "enable_assertion_pass_hook=true", "-o", "verbosity_assertions=2"]
        options += ["-p", "tests.variants", "--variant", name]
        command = [sys.executable, "-m", "pytest", "-q", *options, *words]
        done = subprocess.run(command, cwd=ROOT, env=place, stdout=subprocess.PIPE, text=True)
        near: dict[str, float] = {}
        for file in Path(folder).glob("*.json"):
            for name, value in json.loads(file.read_text(encoding="utf-8")).items():
                near[name] = max(value, near.get(name, 0.0))
    return near, re.findall(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", done.stdout, re.M)


def main() -> int:
    results = {variant: run(variant, sys.argv[1:]) for variant in VARIANTS}
    sys.path.append(str(ROOT / "benchmarks"))
    import points

    made = f"By `{shlex.join(['python', '-m', 'tests.bounds', *sys.argv[1:]])}` ({points.stamp()}): value over bound."
    lines = ["# Bounds that rounding can reach", "", made, ""]
    lines += ["| test | " + " | ".join(VARIANTS) + " |", "|---|" + "---|" * len(VARIANTS)]
    told = 0
    for name in dict.fromkeys(name for near, _ in results.values() for name in near):
        values = [near.get(name) for near, _ in results.values()]
        known = [value for value in values if value is not None]
        worst, least = max(known), min(known)
        if worst * FACTOR > 1.0 and worst - least > PART * max(0.0, 1.0 - worst):
            told += 1
            lines.append(f"| {name} | " + " | ".join("-" if v is None else f"{v:.2g}" for v in values) + " |")
    failed = [f"- {variant}: {test}" for variant, (_, tests) in results.items() for test in tests]
    number = len(set().union(*(near for near, _ in results.values())))
    lines += ["", f"{told} of {number} bounds are told; failed:" + " none" * (not failed), "", *failed]
    PAGE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(PAGE.read_text(encoding="utf-8"))
    return int(bool(told or failed))


if __name__ == "__main__":
    sys.exit(main())
