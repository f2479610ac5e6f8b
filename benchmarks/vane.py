"""Measured torque of a cement paste in a wide-gap vane rheometer beside that of its own flow curve, by the scene vane.

    python benchmarks/vane.py run    # every speed without a result: results/vane.json, some CPU-minutes
    python benchmarks/vane.py draw   # docs/scenes/vane.md and its chart

Measured: Thiedeitz, see the heads of the files in validation/reference. The flow curve is that of a
parallel-plate rheometer, by which the vane gives more by a constant factor: only the shape of torque against speed is
asked.
"""

import numpy as np
import points

from validation import read_reference

PASTES = {  # yield stress [Pa], consistency [Pa s^n] and flow index of the source's fits, means of its samples
    "0.45-250": (7.48, 1.655, 0.676),
    "0.55-250": (16.44, 0.295, 1.413),
}
FINE = 0.001  # [m]


def measured(paste) -> list[tuple[float, float]]:
    """Speeds [rpm] and torques [N m], without the long first step of the pre-shear."""
    rows = [row for row in read_reference("E_measured_paste_vane_torque.csv") if row["sample"] == paste][1:]
    return [(float(row["speed_rpm"]), 1e-3 * float(row["torque_mnm"])) for row in rows]


def cases() -> dict[str, dict]:
    """Keywords of the scene vane by name."""
    found = {}
    for paste, (tau_y, consistency, index) in PASTES.items():
        law = {"yield_value": tau_y, "consistency": consistency, "flow_index": index, "density": 1900.0}
        for speed, _ in measured(paste):
            found[f"{paste} at {speed:g} rpm"] = law | {"speed": speed}
    for speed in (0.5, 5.0, 59.99):
        law = dict(zip(("yield_value", "consistency", "flow_index"), PASTES["0.45-250"], strict=True))
        found[f"cylinder at {speed:g} rpm"] = law | {"density": 1900.0, "speed": speed, "body": "cylinder"}
        found[f"fine vane at {speed:g} rpm"] = law | {"density": 1900.0, "speed": speed, "spacing": FINE}
    return found


def point(**keywords) -> dict:
    """One run to its end: the torques, read as the scene reads them."""
    import taichi_mps as mps
    from taichi_mps.input import catalogue

    mps.init(threads=1)
    scene = catalogue.build("vane", **keywords)
    sim, rows = mps.Simulation(scene), []
    sim.each_step(lambda sim: rows.append((sim.time, sim.measures()["torque_N_m"])))
    stopped_by = sim.run()
    times, torques = np.array(rows).T
    ran = {"stopped_by": stopped_by, "steps": sim.steps, "cpu_seconds": round(sim.cpu_seconds, 1)}
    return scene.over_time({"time_s": times, "torque_N_m": torques}) | ran


def factors(paste, results) -> tuple[list[float], np.ndarray, np.ndarray]:
    """Speeds [rpm], measured torques [N m], and those over the computed ones."""
    speeds, torques = zip(*measured(paste), strict=True)
    ours = [results[f"{paste} at {speed:g} rpm"]["steady_torque_N_m"] for speed in speeds]
    return list(speeds), np.array(torques), np.array(torques) / ours


def draw() -> None:
    results, lines = points.read("vane"), []
    figure, axis = points.pyplot().subplots(figsize=(7.2, 4.6), layout="constrained")
    for paste, colour in zip(PASTES, ("#0072B2", "#D55E00"), strict=True):
        speeds, torques, ratio = factors(paste, results)
        mean = float(ratio.mean())
        apart = 100.0 * (ratio / mean - 1.0)
        ends = f"{apart.min():+.0f} and {apart.max():+.0f} %"
        lines.append([paste, f"{min(speeds):g} to {max(speeds):g}", f"{mean:.2f}", ends])
        axis.plot(speeds, 1e3 * torques, "o", color=colour, label=f"{paste}, measured")
        axis.plot(speeds, 1e3 * mean * torques / ratio, "-", color=colour, label=f"computed, times {mean:.2f}")
    axis.set(xscale="log", yscale="log", xlabel="turns a minute", ylabel="torque [mN m]")
    axis.grid(alpha=0.3, which="both", lw=0.5)
    axis.legend(frameon=False)
    figure.savefig(points.FIGURES / "vane.png", dpi=110)
    head = ["paste", "speeds [rpm]", "measured over computed, mean", "farthest from that mean"]
    points.put("scenes/vane.md", "vane", points.table(head, lines), [points.load("vane")])


if __name__ == "__main__":
    points.main(__file__, "vane", cases, point, draw, __doc__)
