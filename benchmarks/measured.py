"""Measured dam breaks, predicted without a fit: 8 tests of 4 fluids whose flow curves a rheometer measured.

    python benchmarks/measured.py run    # every test without a result: results/measured.json, half a CPU-hour
    python benchmarks/measured.py draw   # docs/measured.md and its charts

Measured: Hamamichi et al. (2023), see the heads of the files in validation/reference.
"""

import numpy as np
import points

import taichi_mps as mps
from validation import measured
from validation.table import VERDICTS

SPACINGS = 0.004, 0.02 / 7.0, 0.002, 0.004 / 3.0  # [m]; of each half of the depth is a multiple
LOW = 0.1  # shear rate [1/s] from which on the curve is fitted where all of it is
# spacing and that shear rate of the runs of all tests, by the end of their names
KINDS = {f"{1e3 * spacing:.2f} mm": (spacing, measured.RATES[0]) for spacing in SPACINGS}
WHOLE = {f"curve from {LOW:g} 1/s": (SPACINGS[0], LOW)}
BLUES = "#c5d3e0", "#9fb6cc", "#5f8fbf", "#1f5f99"  # of the spacings
TENSION = 0.03, 0.07  # surface tension [N/m] between which water with a surfactant or without one lies; not measured
KNOWN = measured.tests()


def cases() -> dict[str, dict]:
    """Keywords of the scene dam_break by name, the finest last."""
    return {
        f"{measured.named(*key)}, {kind}": measured.keywords(*key, *how)
        for kind, how in (WHOLE | KINDS).items()
        for key in KNOWN
    }


def point(**keywords) -> dict:
    """Run a test to its end and return times [s], fronts [m], the final height [m] and the final shape [m]."""
    mps.init(threads=1)
    sim, times, fronts = measured.course(**keywords)
    body, l0 = sim.snapshot(), keywords["spacing"]
    at = np.arange(0.5 * l0, body.x[:, 0].max() + l0, l0)
    columns = [np.abs(body.x[:, 0] - x) < 0.5 * l0 for x in at]
    outline = [float(np.abs(body.x[here, 1]).max(initial=0.0)) for here in columns]
    middle = [float(body.x[here & (np.abs(body.x[:, 1]) < l0), 2].max(initial=0.0)) for here in columns]
    summary = sim.summary()
    return {
        "times_s": np.round(times, 5).tolist(),
        "fronts_m": np.round(fronts, 6).tolist(),
        "shape_m": np.round([at, outline, middle], 5).tolist(),
        **{name: summary[name] for name in ("fluid_particles", "steps", "stopped_by", "volume_error")},
        "cpu_seconds": round(sim.cpu_seconds, 1),
    }


def order(fronts) -> str:
    """The observed order of values at the three finest spacings: their differences go as l0^p; a dash where they
    alternate."""
    (h, i, j), (a, b, c) = SPACINGS[-3:], fronts[-3:]
    orders = np.linspace(0.05, 6.0, 1191)
    ratio = (h**orders - i**orders) / (i**orders - j**orders)
    return f"{orders[np.argmin(np.abs(ratio - (a - b) / (b - c)))]:.1f}" if (a - b) * (b - c) > 0.0 else "-"


def draw() -> None:
    results = points.read("measured")
    courses = {
        kind: {key: [results[f"{measured.named(*key)}, {kind}"][of] for of in ("times_s", "fronts_m")] for key in KNOWN}
        for kind in KINDS | WHOLE
    }
    late = {kind: measured.offset(courses[kind]) for kind in KINDS}
    (coarsest, *_, finest), (whole,) = KINDS, WHOLE
    found = [measured.judged(courses[kind], late[kind]) for kind in KINDS]
    changed = [
        a.value - b.value
        for a, b in zip(measured.judged(courses[whole], late[coarsest])[1:], found[0][1:], strict=True)
    ]
    lines = []
    for (key, (times, fronts)), change, *numbers in zip(
        KNOWN.items(), changed, *(one[1:] for one in found), strict=True
    ):
        ends = [fronts[-1] * (1.0 + 0.01 * number.value) for number in numbers]
        band = [np.interp(0.25 + delay, *courses[finest][key]) for delay in measured.OFFSETS[[0, -1]]]
        capillary = [1e3 * (tension / (measured.FLUIDS[key[0]][1] * 9.81)) ** 0.5 for tension in TENSION]
        shape = results[f"{measured.named(*key)}, {finest}"]["shape_m"]
        lines.append(
            [
                measured.named(*key),
                f"{1e2 * fronts[-1]:.2f}",
                f"{1e2 * ends[-1]:.2f}",
                *(f"{number.value:+.1f}" for number in numbers),
                order(ends),
                f"{change:+.1f}",
                VERDICTS[numbers[-1].met],
                f"{1e2 * np.interp(0.25, times, fronts):.2f}: {1e2 * band[0]:.2f} to {1e2 * band[1]:.2f}",
                f"{1e3 * max(shape[2]):.0f}, {1e3 * float(np.interp(key[1], shape[0], shape[2])):.0f}",
                f"{capillary[0]:.1f} to {capillary[1]:.1f}",
            ]
        )
    means = [f"{of_spacing[0].value:.1f}" for of_spacing in found]
    lines.append(["mean size", "", "", *means, "", f"{np.mean(changed):+.1f}", VERDICTS[found[-1][0].met], "", "", ""])
    head = ["test, width x height", "front, measured [cm]", "computed [cm]", *(f"off at {kind} [%]" for kind in KINDS)]
    head += ["observed order", f"changed by the {whole} [%]", "8 % or 2 mm", "at 1/4 s, and computed [cm]"]
    head += ["height, at the gate [mm]", "capillary length [mm]"]
    laws = []
    for fluid in measured.FLUIDS:
        (tau, k, n), (tau0, k0, n0) = (
            measured.herschel_bulkley(*measured.flow_curve(fluid, each)).values() for each in (measured.RATES[0], LOW)
        )
        laws.append(
            [fluid.removesuffix(" 2023"), f"{tau:.2f}", f"{k:.2f}", f"{n:.3f}", f"{tau0:.2f}, {k0:.2f}, {n0:.3f}"]
        )
    of_laws = ["fluid", "yield stress [Pa]", "consistency [Pa s^n]", "flow index", f"of all from {LOW:g} 1/s"]
    delays = ", ".join(f"{1e3 * shift:+.0f} ms at {kind}" for kind, shift in late.items())
    told = f"{len(KNOWN)} of {len(KNOWN)} tests are computed. Offset of the films' time: {delays}."
    text = "\n\n".join([points.table(of_laws, laws), told, points.table(head, lines)])
    fronts_chart(courses, late)
    shapes_chart(results, finest)
    points.put("measured.md", "measured", text, [points.load("measured")])


def fronts_chart(courses, late) -> None:
    figure, panels = points.pyplot().subplots(2, 4, figsize=(12.0, 5.6), layout="constrained", sharex=True)
    for axis, (key, (times, fronts)) in zip(panels.T.flat, KNOWN.items(), strict=True):
        axis.set(xlim=(0.0, 0.36), title=measured.named(*key))
        axis.plot(times, 100.0 * fronts, "o", color="black", ms=4, label="measured")
        for (kind, shift), colour in zip(late.items(), BLUES, strict=True):
            t, front = np.array(courses[kind][key])
            axis.plot(t - shift, 100.0 * front, color=colour, label=f"computed, {kind}")
        axis.fill_betweenx(100.0 * front, t - 0.04, t + 0.04, color="#1f5f99", alpha=0.12, lw=0)
        axis.set_ylim(0.0, None)
        axis.grid(alpha=0.3, lw=0.5)
    panels[0, 0].legend(frameon=False, fontsize=8)
    figure.supxlabel("time of the film [s]")
    figure.supylabel("front in front of the gate [cm]")
    figure.savefig(points.FIGURES / "measured_fronts.png", dpi=110)


def shapes_chart(results, kind) -> None:
    figure, panels = points.pyplot().subplots(2, 4, figsize=(12.0, 6.4), layout="constrained")
    for axis, (key, (_, fronts)) in zip(panels.T.flat, KNOWN.items(), strict=True):
        axis.set(title=measured.named(*key), xlabel="[cm]")
        at, outline, middle = 100.0 * np.array(results[f"{measured.named(*key)}, {kind}"]["shape_m"])
        width, lowest = 100.0 * key[1], -outline.max() - 0.5
        axis.fill_between(at, -outline, outline, color="#9fb6cc", lw=0)
        axis.fill_between(at, lowest - 100.0 * key[2], lowest - 100.0 * key[2] + middle, color="#5f8fbf", lw=0)
        for y in (-2.0, 2.0):
            axis.plot([0.0, width], [y, y], color="black", lw=2)
        axis.plot(width + 100.0 * fronts[-1], 0.0, "o", color="black", ms=5)
        axis.set_aspect("equal")
    figure.savefig(points.FIGURES / "measured_shapes.png", dpi=110)


if __name__ == "__main__":
    points.main(__file__, "measured", cases, point, draw, __doc__)
