"""A wall poured by a hose that moves along it, up to a cubic metre: memory a particle and cost a placed litre by size.

    python benchmarks/cubic_metre.py run small_32 small_25 small_20   # by name, see CASES; each in a process of its own
    python benchmarks/cubic_metre.py run cubic_metre_quick            # the whole, one CPU-hour; cubic_metre: 1.5
    python benchmarks/cubic_metre.py draw        # the chart, and the table of costs that a forecast reads

A case goes on from its last checkpoint where it was stopped or killed; --until cuts it short, and a later call without
it goes on. Its run folder, renders/cubic_metre/NAME, is one of `taichi-mps run`: `taichi-mps render` and `report` read
it. costs.csv in it has, at every output, time [s], steps, particles and CPU-s so far, of one thread and without the
first step, which compiles. What was found of a case stands in benchmarks/results/cubic_metre.json, beside its forecast.
"""

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import points

import taichi_mps as mps
from taichi_mps.engine import ONE_THREAD_BELOW_ROWS, Problem, memory_of, pairs_of
from taichi_mps.forecast.cost import MEASURED, cost_of
from taichi_mps.input import catalogue
from taichi_mps.io import checkpoint
from taichi_mps.io.recorder import Recorder
from taichi_mps.io.run_folder import RunFolder

RESULTS, RUNS = points.RESULTS / "cubic_metre.json", points.ROOT / "renders/cubic_metre"
WALL = {"width": 0.2, "bar_diameter": 0.01, "cover": 0.025, "hose": "moving", "hose_diameter": 0.1}
CASES = {
    "small_32": {"length": 1.0, "height": 0.6, "spacing": 0.032},
    "small_25": {"length": 1.0, "height": 0.6, "spacing": 0.025},
    "small_20": {"length": 1.0, "height": 0.6, "spacing": 0.02},
    "high_32": {"length": 1.0, "height": 1.7, "spacing": 0.032},
    "long_32": {"length": 3.0, "height": 0.6, "spacing": 0.032},
    "cubic_metre_32": {"length": 3.0, "height": 1.7, "spacing": 0.032, "courant_number": 0.5},
    "cubic_metre": {"length": 3.0, "height": 1.7, "spacing": 0.025, "courant_number": 0.5},
    "cubic_metre_quick": {"length": 3.0, "height": 1.7, "spacing": 0.025, "courant_number": 0.65, "passes": 3},
    "cubic_metre_15": {"length": 3.0, "height": 1.7, "spacing": 0.015, "courant_number": 0.5},
    "check_low": {"length": 2.2, "height": 0.35, "spacing": 0.03},
    "check_high": {"length": 0.8, "height": 1.1, "spacing": 0.028},
    "check_fine": {"length": 1.4, "height": 0.45, "spacing": 0.025},
}
# not for the table that a forecast reads but for its error
CHECKS = "check_low", "check_high", "check_fine", "cubic_metre_quick"
EVERY, OUTPUTS = 0.25, 170  # between two outputs [s], twice that where they would be more than so many
FIELDS = "time_s", "steps", "particles", "cpu_s"
FEWEST = 100  # particles from which on the cost of a step is read; before, it is the splash of the first layers


def compute(name: str, until: float | None) -> None:
    """Run a case, from its checkpoint if there is one, to its end or to ``until`` [s]; write its run folder and its
    entry in RESULTS."""
    folder = RunFolder(RUNS / name)
    mps.init(threads=1)
    problem = problem_of(CASES[name])
    if folder.checkpoint.is_file():
        state, _ = checkpoint.read_good(folder.checkpoint)
        sim = state.resume(state.admit(problem.scene))
    else:
        sim = mps.Simulation(problem)
        folder.create(overwrite=True)
    every = EVERY * (1 + (problem.scene.until > OUTPUTS * EVERY))
    costs = Costs(folder.path / "costs.csv", sim)
    recorder = Recorder(folder, sim, every, "wall", {"every": every, "threads": 1})
    sim.every(every, lambda _: costs.note(sim))
    for number in (signal.SIGINT, signal.SIGTERM):  # ends after a step, with a checkpoint
        signal.signal(number, lambda *_: sim.interrupt())
    stopped_by, error = None, None
    try:
        stopped_by = sim.run(until)
    except mps.DivergedError as failure:
        stopped_by, error = failure.stopped_by, str(failure)
    whole = stopped_by == "rest" or sim.time >= problem.scene.until - 1e-6
    found = measured(recorder.finish(stopped_by, error), costs.rows, CASES[name], whole)
    write(points.load("cubic_metre") | {name: found})
    print(json.dumps({name: {key: value for key, value in found.items() if key != "by_particles"}}))


def problem_of(case: dict, **part):
    """The wall of a case, with the longer steps and the fewer outer iterations of those that ask for them."""
    of_numerics = {key: case[key] for key in ("courant_number", "passes") if key in case}
    of_scene = {key: value for key, value in case.items() if key not in of_numerics}
    return Problem(catalogue.build("wall", **WALL | of_scene | part), mps.Implicit(**of_numerics))


class Costs:
    """Rows of FIELDS, one at each output, in a file that goes on with the run."""

    def __init__(self, path: Path, sim):
        before = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2).tolist() if sim.steps else []
        self.path, self.rows = path, [row for row in before if row[1] <= sim.steps]
        self.before, self.compiling = self.rows[-1][3] if self.rows else 0.0, None
        sim.each_step(self.first)

    def first(self, sim) -> None:
        """Seconds of the first step of this call, which compiles, also after a checkpoint."""
        if self.compiling is None:
            self.compiling = sim.cpu_seconds

    def note(self, sim) -> None:
        """A row, at most one a step."""
        spent = self.before + sim.cpu_seconds - (self.compiling or 0.0)
        if not self.rows or self.rows[-1][1] < sim.steps:
            self.rows.append([round(sim.time, 9), sim.steps, sim.fluid_particles, round(spent, 4)])
            lines = [",".join(map(str, row)) for row in (FIELDS, *self.rows)]
            self.path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def measured(summary: dict, rows, case: dict, whole: bool) -> dict:
    """Measured cost and memory of a run beside the forecast to the time that it reached; ``whole``: it reached the
    end."""
    time_s, steps, particles, cpu_s = np.array(rows, float).T
    did, spent, mean = np.diff(steps), np.diff(cpu_s), 0.5 * (particles[1:] + particles[:-1])
    counted = (did > 0) & (spent > 0)  # a killed run's first row repeats
    particle_steps = float((did * mean)[counted].sum())
    litres = 1e3 * summary["poured_m3"]
    found = {
        "case": WALL | case,
        "stopped_by": summary["stopped_by"],
        "whole": whole,
        "simulated_s": summary["simulated_seconds"],
        "poured_l": litres,
        "pour_delay_s": summary["pour_delay_s"],
        "filled_ratio": summary["filled_ratio"],
        "volume_error": summary["volume_error"],
        "volume_error_max": summary["volume_error_max"],
        "particles_computed": summary["fluid_particles"],
        "steps": int(steps[-1]),
        "cpu_s": float(cpu_s[-1]),
        "us_per_particle_and_step": 1e6 * float(spent[counted].sum()) / particle_steps,
        "cpu_s_per_litre": float(cpu_s[-1]) / litres,
        "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "process_cpu_s": time.process_time(),  # of the last call, with compiling and files
        "by_particles": by_particles(mean[counted], did[counted], spent[counted]),
        "machine": points.head(),
        "forecast": forecast(case, None if whole else summary["simulated_seconds"]),
    }
    return found | {"bytes_per_particle": found["peak_bytes"] / summary["fluid_particles"]}


def by_particles(particles, steps, seconds) -> list[list[float]]:
    """Mean number of particles, steps and CPU-s a step, in bins of a quarter of a decade."""
    bins, found = np.floor(6.0 * np.log10(np.maximum(particles, 1.0))), []
    for number in np.unique(bins[particles >= FEWEST]):
        here = (bins == number) & (particles >= FEWEST)
        did = steps[here].sum()
        found.append([float((particles * steps)[here].sum() / did), float(did), float(seconds[here].sum() / did)])
    return found


def forecast(case: dict, until: float | None) -> dict:
    """Forecast of the case to its end, or to ``until`` [s]."""
    problem = problem_of(case, **({} if until is None else {"until": until}))
    cost = cost_of(problem) if MEASURED.is_file() else None
    told = {"bytes": memory_of(problem, pairs_of(problem.scene), "f32")}
    return told | ({"ends_s": problem.scene.until, "steps": cost.steps, "cpu_s": cost.cpu_seconds} if cost else {})


def write(known: dict) -> None:
    RESULTS.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def draw() -> None:
    """The table of costs that a forecast reads, the forecasts with it, and the chart."""
    known, bins = points.load("cubic_metre"), {}
    for longer in (False, True):  # longer steps iterate more: they tell of sizes only that nothing else tells of
        found = {}
        for name, case in known.items():
            if name not in CHECKS and ("courant_number" in case["case"]) == longer:
                fused = case["particles_computed"] < ONE_THREAD_BELOW_ROWS
                for row in case["by_particles"]:
                    found.setdefault((fused, int(np.floor(6.0 * np.log10(row[0])))), []).append(row)
        bins = found | bins
    lines = [
        "# CPU-s of a step of implicit in space, by the number of particles: mean of pours into walls, one thread.",
        "# Written by `python benchmarks/cubic_metre.py draw` from benchmarks/results/cubic_metre.json.",
        "# particles, seconds, whether the run is of so few that its stages are fused",
    ]
    for (fused, _), rows in sorted(bins.items()):
        particles, steps, seconds = np.array(rows).T
        lines.append(f"{particles @ steps / steps.sum():.4g},{seconds @ steps / steps.sum():.4g},{fused:d}")
    MEASURED.write_text("\n".join(lines) + "\n", encoding="utf-8")
    for case in known.values():
        own = {key: value for key, value in case["case"].items() if key not in WALL}
        case["forecast"] = forecast(own, None if case["whole"] else case["simulated_s"])
    write(known)
    for name, case in known.items():
        told = case["forecast"]
        print(
            f"{name}: {case['particles_computed']} particles, {case['simulated_s']:.1f} s ({told['ends_s']:.1f}), "
            f"{case['steps']} steps ({told['steps']:.0f}), {case['cpu_s']:.0f} CPU-s ({told['cpu_s']:.0f}, "
            f"{told['cpu_s'] / case['cpu_s'] - 1.0:+.0%}), {case['us_per_particle_and_step']:.1f} us, "
            f"{case['peak_bytes'] / 1e6:.0f} MB ({told['bytes'] / 1e6:.0f}), {case['cpu_s_per_litre']:.2f} CPU-s/l, "
            f"poured {case['poured_l']:.0f} l, delay {case['pour_delay_s']:.2f} s"
        )
    chart(known)


def chart(known: dict) -> None:
    """Memory a particle, cost a particle and step, and cost a placed litre, over the size; open: a part of a pour,
    crosses: forecasts."""
    figure, axes = points.pyplot().subplots(1, 3, figsize=(11.0, 3.6), layout="constrained")
    for number, spacing in enumerate(sorted({case["case"]["spacing"] for case in known.values()})):
        for k, case in enumerate(case for case in known.values() if case["case"]["spacing"] == spacing):
            size, told = case["particles_computed"], case["forecast"]
            values = case["bytes_per_particle"] / 1e3, case["us_per_particle_and_step"], case["cpu_s_per_litre"]
            expected = told["bytes"] / size / 1e3, None, told["cpu_s"] / case["poured_l"]
            for axis, value, cross in zip(axes, values, expected, strict=True):
                label = f"{1e3 * spacing:g} mm" if k == 0 else None
                axis.plot(size, value, f"C{number}o", mfc=None if case["whole"] else "white", label=label)
                if cross:
                    axis.plot(size, cross, f"C{number}x")
    titles = "memory a particle [kB]", "CPU time a particle and step [us]", "CPU time a placed litre [s]"
    for axis, title in zip(axes, titles, strict=True):
        axis.set(title=title, xlabel="computed particles at the end", xscale="log", xlim=(1e3, 2e5))
        axis.set_ylim(0.0, 1.1 * axis.get_ylim()[1])
        axis.grid(alpha=0.3)
    axes[0].legend()
    figure.savefig(points.FIGURES / "cubic_metre.png", dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "draw", "compute"))
    parser.add_argument("names", nargs="*", choices=(*CASES, []))
    parser.add_argument("--until", type=float, help="time at which to stop for now [s]")
    arguments = parser.parse_args()
    if arguments.what == "draw":
        draw()
    elif arguments.what == "compute":
        compute(arguments.names[0], arguments.until)
    else:
        options = [] if arguments.until is None else ["--until", str(arguments.until)]
        for name in arguments.names:
            command = [sys.executable, str(Path(__file__)), "compute", name, *options]
            subprocess.run(command, check=True, env=os.environ | {"OMP_NUM_THREADS": "1"})


if __name__ == "__main__":
    main()
