"""Measured dam breaks, predicted without a fit: 8 tests of 4 fluids whose flow curves a rheometer measured.

    python benchmarks/measured.py run    # every test without a result: results/measured.json, half a CPU-hour
    python benchmarks/measured.py draw   # docs/measured.md and its charts

Measured: Hamamichi et al. (2023), see the heads of the files in validation/reference.
"""

import numpy as np
import points

from validation import measured

SPACINGS = 0.004, 0.02 / 7.0, 0.002, 0.004 / 3.0  # [m]; of each half of the depth is a multiple
LOW = 0.1  # shear rate [1/s] from which on the curve is fitted where all of it is
BLUES = "#c5d3e0", "#9fb6cc", "#5f8fbf", "#1f5f99"  # of the spacings
TENSION = 0.03, 0.07  # surface tension [N/m] between which water with a surfactant or without one lies; not measured


def named(key) -> str:
    fluid, width, height = key
    return f"{fluid.removesuffix(' 2023')} {1e3 * width:.0f} x {1e3 * height:.0f} mm"


def cases() -> dict[str, dict]:
    """Keywords of the scene dam_break by name, coarse ones first."""
    found = {}
    for spacing in sorted(
        SPACINGS, key=lambda spacing: (spacing < 0.002, spacing)
    ):  # the finest last, the others first
        for key in measured.tests():
            found[f"{named(key)}, {1e3 * spacing:.2f} mm"] = measured.keywords(*key, spacing)
        if spacing == SPACINGS[0]:
            for key in measured.tests():
                found[f"{named(key)}, curve from {LOW:g} 1/s"] = measured.keywords(*key, spacing, LOW)
    return found


def point(**keywords) -> dict:
    """Run a test to its end and return times [s], fronts [m], the final height [m] and the final shape [m]."""
    import taichi_mps as mps

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


def courses(results, spacing=None) -> dict:
    """Times and fronts of all tests at a spacing, or of the coarse runs with all of the rheometer's curve."""
    kind = f"{1e3 * spacing:.2f} mm" if spacing else f"curve from {LOW:g} 1/s"
    names = {key: f"{named(key)}, {kind}" for key in measured.tests()}
    kept = {key: results[name] for key, name in names.items() if name in results}
    return {key: (each["times_s"], each["fronts_m"]) for key, each in kept.items()}


def order(by_spacing: dict[float, float]) -> str:
    """The observed order of the values at the three finest spacings: their differences go as l0^p; a dash where they
    alternate or are fewer."""
    if len(by_spacing) < 3:
        return "-"
    h, i, j = sorted(by_spacing, reverse=True)[-3:]
    a, b, c = (by_spacing[spacing] for spacing in (h, i, j))
    if (a - b) * (b - c) <= 0.0:
        return "-"
    orders = np.linspace(0.05, 6.0, 1191)
    ratio = (h**orders - i**orders) / (i**orders - j**orders)
    return f"{orders[np.argmin(np.abs(ratio - (a - b) / (b - c)))]:.1f}"


def draw() -> None:
    results, known = points.read("measured"), measured.tests()
    by_spacing = {spacing: courses(results, spacing) for spacing in SPACINGS}
    most = max(map(len, by_spacing.values()))
    by_spacing = {spacing: kept for spacing, kept in by_spacing.items() if len(kept) == most}
    known = {key: known[key] for key in known if key in by_spacing[min(by_spacing)]}
    late = {spacing: measured.offset(kept) for spacing, kept in by_spacing.items()}
    finest, low = min(by_spacing), courses(results)
    lines, errors, whole = [], {spacing: [] for spacing in by_spacing}, {}
    for key, (times, fronts) in known.items():
        last = {
            spacing: float(np.interp(measured.LAST + late[spacing], *kept[key])) for spacing, kept in by_spacing.items()
        }
        apart = {spacing: 100.0 * (front / fronts[-1] - 1.0) for spacing, front in last.items()}
        for spacing, each in apart.items():
            errors[spacing].append(abs(each))
        if key in low and SPACINGS[0] in last:
            changed = np.interp(measured.LAST + late[SPACINGS[0]], *low[key]) - last[SPACINGS[0]]
            whole[key] = 100.0 * float(changed) / fronts[-1]
        band = [
            np.interp(0.25 + delay, *by_spacing[finest][key]) for delay in (measured.OFFSETS[0], measured.OFFSETS[-1])
        ]
        met = abs(apart[finest]) <= max(8.0, 0.2 / fronts[-1])
        density = measured.FLUIDS[key[0]][1]
        capillary = [1e3 * (tension / (density * 9.81)) ** 0.5 for tension in TENSION]
        shape = results[f"{named(key)}, {1e3 * finest:.2f} mm"]["shape_m"]
        lines.append(
            [
                named(key),
                f"{1e2 * fronts[-1]:.2f}",
                f"{1e2 * last[finest]:.2f}",
                *(f"{each:+.1f}" for each in apart.values()),
                order(last),
                f"{whole[key]:+.1f}" if key in whole else "-",
                "met" if met else "**missed**",
                f"{1e2 * np.interp(0.25, times, fronts):.2f}: {1e2 * band[0]:.2f} to {1e2 * band[1]:.2f}",
                f"{1e3 * max(shape[2]):.0f}, {1e3 * float(np.interp(key[1], shape[0], shape[2])):.0f}",
                f"{capillary[0]:.1f} to {capillary[1]:.1f}",
            ]
        )
    means = [f"{np.mean(each):.1f}" for each in errors.values()]
    met = "-" if most < len(measured.tests()) else "met" if np.mean(errors[finest]) <= 5.0 else "**missed**"
    lines.append(
        ["mean size", "", "", *means, "", f"{np.mean(list(whole.values())):+.1f}" if whole else "-", met, "", "", ""]
    )
    head = ["test, width x height", "front, measured [cm]", "computed [cm]"]
    head += [f"off at {1e3 * spacing:.2f} mm [%]" for spacing in by_spacing]
    head += [
        "observed order",
        f"changed by the curve from {LOW:g} 1/s [%]",
        "8 % or 2 mm",
        "at 1/4 s, and computed [cm]",
    ]
    head += ["height, at the gate [mm]", "capillary length [mm]"]
    laws = [["fluid", "yield stress [Pa]", "consistency [Pa s^n]", "flow index", f"of all from {LOW:g} 1/s"]]
    for fluid in measured.FLUIDS:
        (tau, k, n), (tau0, k0, n0) = (
            measured.herschel_bulkley(*measured.flow_curve(fluid, each)).values() for each in (measured.RATES[0], LOW)
        )
        laws.append(
            [fluid.removesuffix(" 2023"), f"{tau:.2f}", f"{k:.2f}", f"{n:.3f}", f"{tau0:.2f}, {k0:.2f}, {n0:.3f}"]
        )
    delays = ", ".join(f"{1e3 * late[spacing]:+.0f} ms at {1e3 * spacing:.2f} mm" for spacing in by_spacing)
    text = "\n\n".join(
        [
            points.table(laws[0], laws[1:]),
            f"{len(known)} of {len(measured.tests())} tests are computed. Offset of the films' time: {delays}.",
            points.table(head, lines),
        ]
    )
    fronts_chart(by_spacing, late)
    shapes_chart(results, finest)
    points.put("measured.md", "measured", text, [points.load("measured")])


def fronts_chart(by_spacing, late) -> None:
    figure, panels = points.pyplot().subplots(2, 4, figsize=(12.0, 5.6), layout="constrained", sharex=True)
    finest = min(by_spacing)
    for axis, (key, (times, fronts)) in zip(panels.T.flat, measured.tests().items(), strict=True):
        axis.set(xlim=(0.0, 0.36), title=named(key))
        axis.plot(times, 100.0 * fronts, "o", color="black", ms=4, label="measured")
        if key not in by_spacing[finest]:
            continue
        for (spacing, kept), colour in zip(by_spacing.items(), BLUES[-len(by_spacing) :], strict=True):
            t, front = np.array(kept[key])
            axis.plot(t - late[spacing], 100.0 * front, color=colour, label=f"computed, {1e3 * spacing:.2f} mm")
        t, front = np.array(by_spacing[finest][key])
        axis.fill_betweenx(100.0 * front, t - 0.04, t + 0.04, color="#1f5f99", alpha=0.12, lw=0)
        axis.set_ylim(0.0, None)
        axis.grid(alpha=0.3, lw=0.5)
    panels[0, 0].legend(frameon=False, fontsize=8)
    figure.supxlabel("time of the film [s]")
    figure.supylabel("front in front of the gate [cm]")
    figure.savefig(points.FIGURES / "measured_fronts.png", dpi=110)


def shapes_chart(results, spacing) -> None:
    figure, panels = points.pyplot().subplots(2, 4, figsize=(12.0, 6.4), layout="constrained")
    for axis, (key, (_, fronts)) in zip(panels.T.flat, measured.tests().items(), strict=True):
        axis.set(title=named(key), xlabel="[cm]")
        if f"{named(key)}, {1e3 * spacing:.2f} mm" not in results:
            axis.set_visible(False)
            continue
        at, outline, middle = 100.0 * np.array(results[f"{named(key)}, {1e3 * spacing:.2f} mm"]["shape_m"])
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
