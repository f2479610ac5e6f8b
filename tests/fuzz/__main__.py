"""Random scenes, options, laws and signals: each run of the program must end as done, refused in one
line, or a named divergence; after a signal it must stop cleanly and go on with ``resume``.

    python -m tests.fuzz --minutes 2                                 # of all kinds, each as often as it weighs
    python -m tests.fuzz --kind law signal --minutes 30 --seed 3     # of these

Trial k of a seed and its kinds is always the same; the line of a failure ends with the command that repeats it and
shows all that it prints. Exits with 1 on a failure.
"""

import argparse
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from taichi_mps.cli.options import choices
from taichi_mps.input import catalogue
from taichi_mps.units import unit_of
from tests.support.child import begun

LONGEST, PATIENCE = 60.0, 720.0  # [s] after which a run is asked to stop, and that a busy machine may take to do so
ENDS = {0: "done", 1: "no row", 2: "refused", 3: "diverged", 130: "stopped", 143: "stopped"}
HOSTILE = (
    "nan",
    "inf",
    "-1",
    "0",
    "1e300",
    "1e-300",
    "abc",
    "",
    "-0",
    "300kPa",
    "1,5",
    "None",
    "\x1b[31m",
    "0x10",
    "é",
)


@dataclass
class Trial:
    """What one trial does: commands one after the other, and a signal for the first of them after some seconds."""

    kind: str
    commands: list[list[str]]
    signal: int | None = None
    after: float = 0.0
    refused: bool = False  # whether the first command must be
    seen: list[str] = field(default_factory=list)  # how each command ended
    failure: str | None = None


# ---- what is drawn --------------------------------------------------------------------------------------------------
def size_options(name: str, dice: random.Random) -> list[str]:
    """Options that keep a run short: a coarse spacing, little time."""
    spacing = catalogue.load(name).parameters.model_fields["spacing"].default * dice.uniform(1.5, 3.0)
    until = 10.0 ** dice.uniform(-4.0, -1.0)
    return [f"--spacing={spacing:.6g}", f"--until={until:.6g}", f"--every={until / dice.randint(1, 3):.6g}"]


def value_of(field, dice: random.Random) -> str:
    """A value for a field of a scene: often one in its range, sometimes one that is none."""
    default = field.default if isinstance(field.default, float | int) and field.default else 10.0 ** dice.uniform(-3, 3)
    value = float(default) * 10.0 ** dice.gauss(0.0, 0.3)
    sound = str(round(value)) if isinstance(default, int) else f"{value:.4g}"
    return dice.choice(HOSTILE) if dice.random() < 0.08 else sound


def options(name: str, dice: random.Random) -> list[str]:
    """Some options of a scene and of the run."""
    known = catalogue.load(name).parameters.model_fields
    numbers = [key for key, f in known.items() if unit_of(f) and key not in ("spacing", "until", "accuracy")]
    words = [
        f"--{key.replace('_', '-')}={value_of(known[key], dice)}" for key in dice.sample(numbers, min(3, len(numbers)))
    ]
    if "model" in known and dice.random() < 0.5:
        words.append("--model=" + dice.choice([*choices(known["model"]), "whole"]))
    own = dice.choice([[], [], ["--passes=2"], ["--max-time-step=0.01"], ["--courant-number=0.9", "--tolerance=1e-2"]])
    paper = dice.choice([[], [], ["--literal"]])
    scheme = ["--scheme=semi-implicit", *paper] if dice.random() < 0.25 else own
    more = ["--precision=f64", "--profile", "--view=pressure", "--threads=2"]
    return words + scheme + dice.sample(more, dice.choice([0, 0, 1, 2])) + ["--threads=1"]


def random_options(dice, folder) -> Trial:
    name = dice.choice(list(catalogue.names()))
    return Trial("options", [["run", name, *size_options(name, dice), *options(name, dice), "--out", f"{folder}/run"]])


LAW = '''"""A block of a fluid with a law of its own."""
{taichi}import taichi_mps as mps
from taichi_mps.units import Duration, Length

def law({arguments}):
    {body}

def height(snapshot):
    {measure}

@mps.checked
def scene(spacing: Length = 0.02, until: Duration = 0.01) -> mps.Scene:
    """Block."""
    return mps.Scene(
        name="block", spacing=spacing, until=until,
        material=mps.FlowCurve(density=2000.0, yield_value={yield_value}, typical_slope=20.0, shear_stress=law),
        fluid=mps.fill(mps.Box((-0.05, 0.0), (0.05, 0.1)), spacing),
        walls=(mps.Plane((0.0, 0.0), (0.0, 1.0)),),
        domain=((-{reach}, -0.05), ({reach}, 0.2)), measure=height,
    )
'''
BODIES = (
    "return {y} + 20.0 * rate",
    "return {y} + 20.0 * ti.sqrt(rate)",
    "return -1.0 * rate",
    "return rate / 0.0",
    "return {y} - 5.0 * rate",
    "return 'stress'",
    "raise ValueError('no law')",
    "return {y} + 1e30 * rate ** 4",
    "return no_such_name",
    "return ti.log(rate - 1.0)",
    "return {y} + 20.0 * rate if rate > 1.0 else {y} + 20.0 * rate ** 2",
    "if rate > 1.0:\n        return {y} + 20.0 * rate\n    return {y} + 20.0",
    "return {y} + 20.0 * rate * (0.5 < rate < 1e9)",
    "return {y} + max(20, 20 * rate) + (7 // 2) * rate",
    "x = structure\n    while x < 3:\n        x += 1\n    return {y} + x * rate",
    "return {y} + 20.0 * math.sqrt(rate)",
)
CUT = (  # what Taichi computes otherwise than Python: integers, nan
    "x = 0\n    if rate > 0.0:\n        x = rate / (rate + 2.0)\n    return {y} + 20.0 * rate + 60.0 * x",
    "x = 1\n    for k in range(3):\n        x += 0.5 + 0.25 * k\n    return {y} * x + 20.0 * x * rate",
    "x = 2000000000\n    x = x + x\n    return {y} + 20.0 * rate + 1e-8 * x",
    "x = 5 if rate < 0.0 else 0\n    x += rate / (1.0 + rate)\n    return {y} + 20.0 * rate + 90.0 * x",
    "return {y} + 20.0 * rate + 0.0 * (rate - 0.5) ** 1.5",
    "x = 0.0 * rate / rate\n    return {y} + 20.0 * rate + x",
)
MEASURES = (
    "return {'height_m': float(snapshot.x[:, 1].max())}",
    "return {'height_m': float('nan')}",
    "return {}",
    "raise KeyError('none')",
    "return 3.0",
    "return {'height_m': 'tall'}",
    "return {3: 1.0}",
)


def random_law(dice, folder) -> Trial:
    y, body = dice.choice([0.0, 50.0, 300.0, -1.0]), dice.choice(BODIES + CUT)
    parts = {
        "measure": dice.choice(MEASURES),
        "body": body.format(y=y),
        "yield_value": y,
        "arguments": dice.choice(["rate, structure"] * 4 + ["rate", "rate, structure, more", ""]),
        "reach": round(dice.uniform(0.04, 0.5), 3),
        "taichi": "import math\n" * ("math." in body) + "import taichi as ti\n" * ("ti." in body),
    }
    (folder / "own.py").write_text(LAW.format(**parts))
    run = ["run", f"{folder}/own.py", "--threads=1", "--out", f"{folder}/run"]
    return Trial("law", [run], refused=body in CUT)


def random_signal(dice, folder) -> Trial:
    name = dice.choice(["slump", "dam_break", "film", "l_flow", "wall"])
    first = ["run", name, *size_options(name, dice), "--threads=1", "--out", f"{folder}/run"]
    first = [word.replace("--until=", "--until=1") if word.startswith("--until=") else word for word in first]
    sent = dice.choice([signal.SIGTERM, signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
    reading = [["info", f"{folder}/run"], ["resume", f"{folder}/run", "--until=1e-3"], ["export", f"{folder}/run"]]
    return Trial("signal", [first, *reading], sent, dice.uniform(0.0, 12.0))


KINDS = {  # how often each is drawn
    "options": (random_options, 8),
    "law": (random_law, 4),
    "signal": (random_signal, 4),
}


# ---- how it ends ----------------------------------------------------------------------------------------------------
def run(words, sent=None, after=0.0):
    """(exit code, what was printed, signals that were sent) of a command of the program."""
    child, signals = begun("-m", "taichi_mps", *words), []
    first = [(after, sent)] if sent else []
    for seconds, number in [*first, (LONGEST, signal.SIGTERM), (PATIENCE, None)]:
        with suppress(subprocess.TimeoutExpired):
            out, err = child.communicate(timeout=seconds)
            return child.returncode, out, err, signals
        if number is not None:
            child.send_signal(number)
            signals.append(number)
    child.kill()
    return None, *child.communicate(), signals


def judge(code, err, sent) -> tuple[str, str | None]:
    """How a command ended, and what is wrong with that."""
    said = [line for line in err.splitlines() if line.strip()]
    if code is None:
        return "hangs", f"did not stop within {PATIENCE:g} s of a SIGTERM"
    if code == -signal.SIGKILL and signal.SIGKILL in sent:
        return "killed", None
    if code is not None and -code in sent and -code != signal.SIGKILL:  # before the program itself had begun
        return "stopped", None
    if "Traceback" in err or code not in ENDS:
        return "broken", f"exit {code}: {' | '.join(said[-6:])}"
    end = ENDS[code]
    if end == "stopped" and not sent:
        return end, f"exit {code} without a signal"
    if end in ("refused", "diverged") and not (said and said[-1].startswith("taichi-mps: ")):
        return end, f"exit {code} and no line that says why: {' | '.join(said[-3:])}"
    if any(ord(letter) < 32 and letter != "\t" for line in said for letter in line):
        return end, f"control characters on the terminal: {said!r}"
    return end, None


def try_out(number: int, chosen, show=False) -> Trial:
    """Trial ``number`` of a seed, done; of a kind that its number chooses."""
    dice = random.Random(f"{chosen.seed}-{number}")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (draw,) = dice.choices(*zip(*(KINDS[kind] for kind in chosen.kind), strict=True))
        trial = draw(dice, folder)
        for k, words in enumerate(trial.commands):
            code, out, err, sent = run(words, *((trial.signal, trial.after) if k == 0 else ()))
            end, failure = judge(code, err, sent)
            trial.seen.append(end)
            if trial.refused and end not in ("refused", "stopped"):
                failure = failure or f"{end}, must be refused: {(folder / 'own.py').read_text()}"
            if show:
                print(words, code, sent, out, err, sep="\n")
            if failure:
                trial.failure = f"{' '.join(map(repr, words))}: {failure}"
                break
    return trial


def main(argv=None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.split("\n\n")[0])
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS), help="these alone")
    parser.add_argument("--minutes", type=float, default=2.0, help="wall-clock time, default 2")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="trials at once, default one a processor")
    parser.add_argument("--seed", type=int, default=1, help="default 1")
    parser.add_argument("--only", type=int, help="repeat this trial and show what it prints")
    chosen = parser.parse_args(argv)
    ended, failures, ends = Counter(), 0, time.monotonic() + 60.0 * chosen.minutes
    if chosen.only is not None:
        failure = try_out(chosen.only, chosen, show=True).failure
        print(failure or "as it should")
        return int(failure is not None)

    def work(number):
        return try_out(number, chosen) if time.monotonic() < ends else None

    with ThreadPoolExecutor(chosen.workers) as pool:
        for number, trial in enumerate(pool.map(work, range(math.ceil(1000 * chosen.minutes)))):
            ended.update(f"{trial.kind}: {end}" for end in (trial.seen if trial else ()))
            if trial and trial.failure:
                failures += 1
                again = f"--seed {chosen.seed} --only {number} --kind {' '.join(chosen.kind)}"
                print(f"{trial.kind}: {trial.failure} (python -m tests.fuzz {again})", flush=True)
    print(*(f"{count:6} {end}" for end, count in sorted(ended.items())), f"{failures:6} failures", sep="\n")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
