"""Stability map: where each scheme is stable, inaccurate or fails, by diffusion, Courant and Bingham number and
viscosity ratio.

    python benchmarks/stability_map.py run    # every cell without a result, about 8 CPU-minutes in all
    python benchmarks/stability_map.py draw   # docs/figures/stability_*.png and the list in docs/stability.md

A cell is a film on a slope of 20 degrees, 12 particles deep, 10 long, periodic along it. It starts with the exact
profile of its law, which stays: what it is after N steps is the error, whatever the step. The speed u of the surface
and the plastic viscosity follow from the numbers: D = nu dt/l0^2, C = u dt/l0, so u l0/nu = C/D. Every step is dt; the
limits of the scheme are off. N = 43/D, 0.3 of the viscous time, or what moves the surface by 3 l0, at least 20, at
most 300.
"""

import numpy as np
import points

LITERAL, PRACTICE, BI_VISCOSITY, BINGHAM = "literal", "semi-implicit", "bi-viscosity", "Bingham"
NEWTONIAN = "implicit"  # the default without yield stress: no law to choose
TITLES = {
    LITERAL: "semi-implicit, literal",
    PRACTICE: "semi-implicit",
    BI_VISCOSITY: "implicit, bi-viscosity",
    BINGHAM: "implicit, true yield stress",
    NEWTONIAN: "implicit",
}
DIFFUSION = (0.05, 0.4, 1.0, 10.0, 1000.0)
COURANT = (0.05, 0.2, 1.0)
BINGHAM_NUMBERS, RATIOS = (0.1, 0.3, 0.7), (10.0, 1e3, 1e6)
YIELDING = (
    (LITERAL, 0.05),
    (PRACTICE, 0.05),
    (BI_VISCOSITY, 0.05),
    (BI_VISCOSITY, 10.0),
    (BINGHAM, 0.05),
    (BINGHAM, 10.0),
)
ACROSS, L0, DENSITY, ANGLE = 12, 0.01, 2300.0, 20.0
INACCURATE, GROWTH = 0.10, 4.0  # relative L2 error; kinetic energy over that of the start
EXPLICIT_LIMIT = 0.514449  # exact, of the Laplacian in 2-D (C_mps_lattice_constants_viscous_limit.csv)


def cells() -> dict[str, dict]:
    """All cells by name: the planes of D and C without yield stress and at Bn = 0.3, ratio 1000; then Bn and ratio at
    C = 0.2."""
    plane = [(d, c, 0.0, 1.0, s) for c in COURANT for d in DIFFUSION for s in (LITERAL, PRACTICE, NEWTONIAN)]
    laws = (LITERAL, PRACTICE, BI_VISCOSITY, BINGHAM)
    plane += [(d, c, 0.3, 1e3, s) for c in COURANT for d in DIFFUSION for s in laws]
    plane += [(d, 0.2, b, r, s) for s, d in YIELDING for b in BINGHAM_NUMBERS for r in ratios(s)]
    return {
        name(d, c, b, r, s): {"diffusion": d, "courant": c, "bingham": b, "ratio": r, "scheme": s}
        for d, c, b, r, s in plane
    }


def ratios(scheme) -> tuple[float, ...]:
    return (1e3,) if scheme == BINGHAM else RATIOS  # of a true yield stress there is none: one cell stands for all


def name(d, c, bn, ratio, scheme) -> str:
    return f"{scheme} D={d:g} C={c:g} Bn={bn:g} ratio={0 if scheme == BINGHAM else ratio:g}"


def point(diffusion, courant, bingham, ratio, scheme) -> dict:
    """Run one cell: fate (None, or what ended it), error of the velocity, growth of the energy, steps."""
    from dataclasses import replace

    import taichi_mps as mps
    from taichi_mps.input import catalogue
    from validation.flows import l2, profile

    depth, along = ACROSS * L0, 9.81 * float(np.sin(np.radians(ANGLE)))
    nu = float(np.sqrt(along * depth**2 * (1.0 - bingham) ** 2 * L0 * diffusion / (2.0 * courant)))
    eta, weight, dt = DENSITY * nu, DENSITY * along, diffusion * L0**2 / nu
    tau_y = bingham * weight * depth
    knee_rate = tau_y / (eta * (ratio - 1.0)) if bingham and scheme != BINGHAM else 1e-9
    law = {"critical_strain_rate": 0.5 * knee_rate} if bingham and scheme != BINGHAM else {}
    scene = catalogue.build("film", spacing=L0, depth=depth, angle=ANGLE, density=DENSITY, plastic_viscosity=eta,
                            yield_value=tau_y, **law)  # fmt: skip
    exact = profile(scene.fluid[:, 1], weight, eta, tau_y, depth, knee_rate)
    scene = replace(scene, velocity=np.column_stack([exact, 0.0 * exact]))
    semi_implicit = scheme in (LITERAL, PRACTICE)
    mps.init(threads=1)
    sim = mps.Simulation(
        scene, mps.SemiImplicit(literal=scheme == LITERAL) if semi_implicit else mps.Implicit(max_time_step=dt)
    )
    sim.scheme.time_step_limits = lambda speeds: {"maximum": dt}
    steps = int(np.clip(max(43.0 / diffusion, 3.0 / courant), 20, 300))
    start = 0.5 * DENSITY * L0**2 * float((exact**2).sum())
    fate, growth = None, 1.0
    try:
        for _ in range(steps):
            growth = max(growth, sim.step().kinetic_energy / start)
            if growth > GROWTH:
                fate = "energy grows"
                break
    except mps.DivergedError as failure:
        fate = str(failure).split(": ", 1)[1].split(";")[0]
    state = sim.snapshot()
    error = l2(state.u, np.column_stack([profile(state.x[:, 1], weight, eta, tau_y, depth, knee_rate), 0.0 * exact]))
    return {
        "fate": fate,
        "error": round(min(error, 1e9), 4) if np.isfinite(error) else None,
        "growth": round(min(growth, 1e9), 3),
        "steps": sim.steps,
        "wanted_steps": steps,
        "plastic_viscosity": round(eta, 3),
        "cpu_seconds": round(sim.cpu_seconds, 2),
    }


# ---- drawing ---------------------------------------------------------------------------------------------------
WAYS = {"runaway": "speed", "left the domain": "lost", "energy": "energy", "matrix": "matrix", "volume": "volume"}
COLOURS = {"stable": "#56B4E9", "inaccurate": "#F0E442", "fails": "#3B3B3B"}  # Okabe and Ito; in grey they differ, too


def judge(cell: dict) -> tuple[str, str]:
    """(stable, inaccurate or fails; the text of the cell: its error in per cent, or how it fails)."""
    if cell["fate"]:
        return "fails", next(short for known, short in WAYS.items() if known in cell["fate"])
    return "inaccurate" if cell["error"] > INACCURATE else "stable", f"{100 * cell['error']:.0f} %"


def panel(axis, found, x, y, key_of):
    """One map: cells at the values x, y."""
    from matplotlib.patches import Rectangle

    for i, a in enumerate(x):
        for j, b in enumerate(y):
            verdict, text = judge(found[key_of(a, b)])
            box = {"facecolor": COLOURS[verdict], "edgecolor": "white", "linewidth": 1.5}
            axis.add_patch(Rectangle((i - 0.5, j - 0.5), 1, 1, **box))
            axis.text(i, j, text, ha="center", va="center", fontsize=7.5, color="w" if verdict == "fails" else "k")
    axis.set(xlim=(-0.5, len(x) - 0.5), ylim=(-0.5, len(y) - 0.5))
    axis.set_xticks(range(len(x)), [written(v) for v in x])
    axis.set_yticks(range(len(y)), [written(v) for v in y])
    axis.tick_params(length=0)


def written(value) -> str:
    return f"{value:g}" if value < 1e4 else f"$10^{{{round(np.log10(value))}}}$"


def finish(figure, name, title):
    from matplotlib.patches import Patch

    labels = {
        "stable": f"stable: error of the velocity at most {100 * INACCURATE:.0f} %",
        "inaccurate": "inaccurate: its error [%]",
        "fails": "fails, and how",
    }
    handles = [Patch(color=COLOURS[key], label=label) for key, label in labels.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(title)
    figure.savefig(points.FIGURES / name, dpi=110)


def draw() -> None:
    found = points.read("stability_map")
    draw_steps(found)
    draw_yield(found)
    points.put("stability.md", "stability_map", counted(found), [points.load("stability_map")])


def draw_steps(found) -> None:
    """Diffusion and Courant number, without and with a yield stress."""
    figure, axes = points.pyplot().subplots(2, 4, figsize=(13, 6.2), layout="constrained", sharex=True, sharey=True)
    rows = (0.0, 1.0, (LITERAL, PRACTICE, NEWTONIAN)), (0.3, 1e3, (LITERAL, PRACTICE, BI_VISCOSITY, BINGHAM))
    for line, (bn, ratio, schemes) in zip(axes, rows, strict=True):
        for axis, scheme in zip(line, schemes, strict=False):
            panel(axis, found, DIFFUSION, COURANT, lambda d, c, p=(bn, ratio, scheme): name(d, c, *p))
            law = f"Bn = {bn:g}" + (f", ratio {ratio:g}" if scheme != BINGHAM else "") if bn else "Newtonian"
            axis.set_title(f"{TITLES[scheme]}\n{law}", fontsize=9)
            if scheme in (LITERAL, PRACTICE):
                stable = sum(d * ratio < EXPLICIT_LIMIT for d in DIFFUSION)
                axis.axvline(stable - 0.5, color="#D55E00", linewidth=4, clip_on=False)
        line[0].set_ylabel(r"Courant number $u\,\Delta t/l_0$")
    for axis in axes[1]:
        axis.set_xlabel(r"diffusion number $\nu\,\Delta t/l_0^2$")
    axes[0, 3].axis("off")
    axes[0, 2].tick_params(labelbottom=True)
    title = "Film on a slope after N steps of fixed length; red: exact limit of the explicit viscosity, unyielded"
    finish(figure, "stability_steps.png", title)


def draw_yield(found) -> None:
    """Draw the map of Bingham number and viscosity ratio."""
    widths = [3.0 if scheme != BINGHAM else 1.7 for scheme, _ in YIELDING]
    settings = {"figsize": (13, 3.6), "layout": "constrained", "sharey": True, "width_ratios": widths}
    figure, axes = points.pyplot().subplots(1, 6, **settings)
    for axis, (scheme, d) in zip(axes, YIELDING, strict=True):
        panel(axis, found, ratios(scheme), BINGHAM_NUMBERS, lambda r, b, p=(d, scheme): name(p[0], 0.2, b, r, p[1]))
        axis.set_title(f"{TITLES[scheme].replace(', ', ',' + chr(10), 1)}\n$D$ = {d:g}", fontsize=9)
        if scheme == BINGHAM:
            axis.set_xticks([0], [r"$\infty$"])
        else:
            axis.set_xlabel("unyielded over plastic viscosity")
    axes[0].set_ylabel(r"Bingham number $\tau_y/\tau_{wall}$")
    title = r"The same film at Courant number 0.2, $D = \nu\,\Delta t/l_0^2$: yield stress and viscosity ratio"
    finish(figure, "stability_yield.png", title)


def counted(found: dict[str, dict]) -> str:
    """Return how many cells of each scheme are stable, inaccurate or fail, and how they fail."""
    lines = []
    for scheme, title in TITLES.items():
        verdicts = [judge(cell) for cell in found.values() if cell["scheme"] == scheme]
        ways = [text for verdict, text in verdicts if verdict == "fails"]
        how = ", ".join(f"{way} {ways.count(way)}" for way in sorted(set(ways)))
        lines.append(
            [title, len(verdicts), *(sum(verdict == each for verdict, _ in verdicts) for each in COLOURS), how]
        )
    return points.table(["scheme", "cells", "stable", "inaccurate", "fail", "how they fail"], lines)


if __name__ == "__main__":
    points.main(__file__, "stability_map", cells, point, draw, __doc__)
