"""Charts of studies, calibrations and forms; ``slump_chart`` is the one to hang up in a laboratory. Matplotlib is the
optional extra ``plots``."""

import os
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..engine import Cone
from ..forecast.rest_shapes import spread_at_rest
from ..input import catalogue
from ..input.labels import in_words, title, unit_of_measure
from ..units import Picture, Place, quote, require, unit_of, validated, writing
from .calibrate import CONE_RESULTS
from .emulator import DENSITY, emulator_of, positive
from .measured_curves import SHEAR_RATES
from .measured_mixes import VERDICTS
from .require import fills
from .tables import measures, read

COLOURS = ("#1f5f99", "#d1662a", "#2e8b57", "#8f4f9f", "#b8323f", "#7a6a35", "#4b8ea8", "#555b63")
STYLE = {
    "font.size": 11, "axes.titlesize": 12, "axes.labelsize": 11, "axes.edgecolor": "#6b727a", "axes.linewidth": 0.8,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#e3e6ea",
    "grid.linewidth": 0.8, "axes.axisbelow": True, "lines.linewidth": 1.8, "lines.solid_capstyle": "round",
    "xtick.color": "#4a5058", "ytick.color": "#4a5058", "figure.dpi": 100,
}  # fmt: skip
VISCOSITIES = (20.0, 50.0, 200.0)  # of the engine's curves [Pa s]
FORMULAS = {  # column of the reference: authors, and the range of slumps [mm] in which the formula is valid
    "s_MurataKikukawa_mm": ("Murata and Kikukawa 1992", (10.0, 300.0)),
    "s_Hu_mm": ("Hu 1995", (0.0, 300.0)),
    "s_FdL_mm": ("Ferraris and de Larrard 1998", (0.0, 300.0)),
    "s_Roussel_mm": ("Roussel 2006", (50.0, 250.0)),
    "s_schowalter_mm": ("static column, Murata 1984, Christensen", (0.0, 300.0)),
}
ELEMENTS = "finite elements, 50 Pa s", "finite elements without inertia"
GREY = {"color": "#777f88", "lw": 1.3}  # of formulas


def _figure(width, height, columns=1, **options):
    """Make a figure and axes that need no display and no global state. MPLBACKEND is hidden from the import of
    matplotlib, which fails if it names a backend that is not installed, as that of a notebook may be."""
    backend = None if "matplotlib" in sys.modules else os.environ.pop("MPLBACKEND", None)
    import matplotlib
    from matplotlib.figure import Figure

    if backend:
        os.environ["MPLBACKEND"] = backend
        with suppress(ValueError):
            matplotlib.rcParams["backend"] = backend
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        return figure, figure.subplots(1, columns, **options)


def _save(figure, out):
    with writing("out", out):
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out, dpi=150, format="png")
    return out


def set_log_ticks(axis, low: float, high: float, values=()) -> None:
    """Set ticks at 1, 2 and 5 times powers of ten between two ends of a logarithmic axis or, where there are fewer than
    three of these, at given ``values``."""
    round_ones = (k * 10.0**power for power in range(-6, 7) for k in (1, 2, 5))
    ticks = [tick for tick in round_ones if low <= 1.01 * tick and 0.99 * tick <= high]
    ticks = sorted(values) if values and len(ticks) < 3 else ticks
    axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.set_ticks([], minor=True)


def reference(name: str) -> np.ndarray:
    """Rows of a reference CSV by column name: inside an installed package, of validation/ in a checkout."""
    inside = Path(__file__).parent / "reference" / name
    file = inside if inside.is_file() else catalogue.PACKAGE.parent / "validation" / "reference" / name
    lines = [line for line in file.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return np.genfromtxt(lines, delimiter=",", names=True, dtype=None, encoding="utf-8", deletechars="")


def engine_curves(study) -> list[tuple]:
    """Return curves of the cone at one viscosity each: the viscosity [Pa s], yield stresses [Pa], slump and slump flow
    [m], by similarity at DENSITY. They are the cases of a study that has one viscosity, else its emulator's."""
    rows = [row for row in read(study) if row["status"] == "done"] if study else []
    names, scenes = ("plastic_viscosity", "yield_value", *CONE_RESULTS), {str(row.get("scene")) for row in rows}
    if {Path(scene).stem for scene in scenes} == {"slump"} and all(positive(row.get(n)) for row in rows for n in names):
        by_density = DENSITY / np.array([row.get("density") or DENSITY for row in rows])
        viscosity, yields, *lengths = np.array([[row[name] for name in names] for row in rows]).T
        if np.ptp(viscosity * by_density) == 0.0:
            order = np.argsort(yields * by_density)
            return [(viscosity[0] * by_density[0], *np.array([yields * by_density, *lengths])[:, order])]
    emulator = emulator_of(study)
    yields = np.exp(np.linspace(emulator.low[0], emulator.high[0], 200)) * DENSITY
    low, middle, high = DENSITY * np.exp([emulator.low[1], emulator.axes[1].mean(), emulator.high[1]])
    shown = [eta for eta in VISCOSITIES if low <= eta <= high] or [float(f"{middle:.2g}")]
    found = [emulator.at(np.log(yields / DENSITY), np.full(len(yields), np.log(eta / DENSITY))) for eta in shown]
    return [(eta, yields, *map(at.get, CONE_RESULTS)) for eta, at in zip(shown, found, strict=True)]


@validated
def slump_chart(out: Picture, study: Place | None = None) -> Path:
    """Draw slump and slump flow [cm] of the cone against yield stress, by a study, finite elements and formulas."""
    curves = engine_curves(study)
    figure, (left, right) = _figure(13.0, 6.6, columns=2)
    for (eta, yields, *lengths), colour in zip(curves, COLOURS, strict=False):
        for axes, length in zip((left, right), lengths, strict=True):
            axes.semilogx(yields, 100.0 * length, color=colour, lw=2.4, label=f"this engine, {eta:g} Pa s")
    formulas = reference("A_slump_vs_yield_abrams.csv")
    tau = formulas["tau0_Pa"]
    for (name, (who, (low, high))), style in zip(FORMULAS.items(), ("-", "--", "-.", ":", (0, (1, 3))), strict=True):
        valid = (formulas[name] >= low) & (formulas[name] <= high)
        left.semilogx(tau, np.where(valid, 0.1 * formulas[name], np.nan), ls=style, label=who, **GREY)
    soft = np.geomspace(yields[0], 200.0)
    flow = [100.0 * spread_at_rest(Cone(0.1, 0.05, 0.3).volume, DENSITY, float(tau)) for tau in soft]
    right.semilogx(soft, flow, label="thin layer at rest, Roussel and Coussot 2005", **GREY)
    final = reference("A_fe_inertial_slump_summary.csv")
    final = final[(final["model"] == "A") & (final["eta_Pa_s"] == 50.0)]
    static = reference("A_fe_slump_abrams_final.csv")
    for table, selected, x, names, marker, label in (
        (final, np.char.startswith(final["kind"], "final"), "tau_Pa", ("mean20_mm", "spread_mm"), "o", ELEMENTS[0]),
        (static, np.char.find(static["run"], "fine") < 0, "tau0_Pa", ("slump_mm", "spread_diam_mm"), "s", ELEMENTS[1]),
    ):
        marker_style = {"color": "black", "mfc": "white", "ms": 8, "mew": 1.6, "ls": "none", "label": label}
        for axes, name in zip((left, right), names, strict=True):
            axes.semilogx(table[x][selected], 0.1 * table[name][selected], marker, **marker_style)
    left.set(ylabel="slump [cm]", ylim=(0.0, 30.0), title="Slump of the cone, JIS A 1101 / EN 12350-2")
    right.set(ylabel="slump flow [cm]", ylim=(20.0, 125.0), title="Slump flow, EN 12350-8")
    for axes in (left, right):
        axes.set(xlabel=f"yield stress [Pa] at {DENSITY:g} kg/m3", xlim=(yields[0], yields[-1]))
        set_log_ticks(axes.xaxis, yields[0], yields[-1])
        axes.legend(frameon=False, fontsize=9)
    return _save(figure, out)


def mixes_chart(rows, out) -> Path:
    """Draw slump flow against slump [cm] of a laboratory's mixes, each joined with the nearest mix of the model."""
    figure, axes = _figure(8.0, 6.0)
    compared = [row for row in rows if all(row.get(f"{name}_missed") is not None for name in CONE_RESULTS)]
    for verdict, colour in zip(VERDICTS, COLOURS, strict=False):
        selected = [row for row in compared if row["verdict"] == verdict]
        model, missed = (
            100.0 * np.array([[row[f"{name}_{suffix}"] for row in selected] for name in CONE_RESULTS])
            for suffix in ("model", "missed")
        )
        if selected:
            measured = model - missed
            axes.plot(*np.stack([measured, model], axis=1), "-", color=colour, lw=0.8, alpha=0.6)
            axes.plot(*measured, "o", color=colour, ms=5, label=f"{verdict}, measured")
            axes.plot(*model, ".", color="black", ms=4)
            axes.legend(frameon=False)
    axes.set(xlabel="slump [cm]", ylabel="slump flow [cm]", title="Measured, and the nearest mix of the model (dots)")
    axes.grid(alpha=0.3)
    return _save(figure, out)


def curves_chart(found, out) -> Path:
    """Draw measured curves (circles) beside those of a CurveFit, a panel for each measure, and the flow curve with its
    95 % band."""
    names = list(found.missed)
    figure, panels = _figure(4.8 * (len(names) + 1), 4.4, columns=len(names) + 1)
    for axes, name in zip(panels, names, strict=False):
        factor, unit, _ = unit_of_measure(name)
        for k, curve in enumerate(curve for curve in found.curves if curve["measure"] == name):
            x = curve["times"] or [k + 1.0] * len(curve["measured"])
            colour = COLOURS[k % len(COLOURS)] if curve["times"] else COLOURS[0]
            axes.plot(x, factor * np.array(curve["measured"], float), "o", color=colour, ms=4, mfc="none")
            axes.plot(
                x, factor * np.array(curve["model"]), "-" if curve["times"] else "x", color=colour, label=curve["name"]
            )
            label = "time of the curve [s]" if curve["times"] else "number of the point"
        axes.set(xlabel=label, ylabel=title(name) + (f" [{unit}]" if unit else ""))
        if len(found.curves) <= len(COLOURS):
            axes.legend(frameon=False, fontsize=8)
    stress, factors = found.flow_curve()
    panels[-1].fill_between(SHEAR_RATES, stress / factors, stress * factors, color=COLOURS[0], alpha=0.2, lw=0)
    panels[-1].loglog(SHEAR_RATES, stress, color=COLOURS[0])
    panels[-1].set(xlabel="shear rate [1/s]", ylabel="shear stress [Pa]", title="Flow curve, band of 95 %")
    return _save(figure, out)


def borders_chart(borders, rows, wanted, out) -> Path:
    """Draw the mixes that were run, those that fill the form and those that do not, as yield stress against plastic
    viscosity, with the border between them and lines of equal slump."""
    (figure, axes), emulator, density = _figure(8.0, 5.4), emulator_of(), borders[0].density
    for filled, marker, label in ((True, "o", "fills"), (False, "x", "does not")):
        selected = [row for row in rows if fills(row, wanted) is filled]
        x, y = ([row[name] for row in selected] for name in ("plastic_viscosity", "yield_value"))
        axes.plot(x, y, marker, color=COLOURS[0 if filled else 1], ms=8, ls="none", label=label)
    border = [
        (b.plastic_viscosity, (b.fills_up_to * b.empty_from) ** 0.5) for b in borders if b.fills_up_to and b.empty_from
    ]
    axes.plot(*np.array(border).reshape(-1, 2).T, "-", color="black")
    etas = [border.plastic_viscosity for border in borders]
    ends = (0.7 * min(etas), 1.4 * max(etas)), (0.8 * wanted.softest, 1.25 * wanted.stiffest)
    axes.set(xscale="log", yscale="log", xlabel="plastic viscosity [Pa s]", ylabel="yield stress [Pa]")
    axes.set(title=f"{rows[0]['scene']}: {wanted.filled:.0%} filled in {wanted.time:g} s", xlim=ends[0], ylim=ends[1])
    for axis, (low, high) in zip((axes.xaxis, axes.yaxis), ends, strict=True):
        set_log_ticks(axis, low, high)
    grid = [
        np.unique(np.clip(np.log(np.geomspace(*end, 60) / density), low, high))
        for end, low, high in zip(reversed(ends), emulator.low, emulator.high, strict=True)
    ]
    if min(map(len, grid)) > 1:
        yields, viscosities = (density * np.exp(axis) for axis in grid)
        slump = 100.0 * emulator.at(*grid, grid=True)["slump_m"]
        lines = axes.contour(viscosities, yields, slump, levels=np.arange(2.0, 30.0, 2.0), colors="#b9bfc6")
        axes.clabel(lines, fmt="slump %g cm", fontsize=8)
    axes.legend(frameon=False)
    return _save(figure, out)


def study_chart(rows, varied, out) -> Path:
    """Draw each measure of a study against its first numeric parameter, a curve for every value of the others.

    varied: the names of the parameters that differ between the rows.
    """
    done = [row for row in rows if row["status"] == "done"]
    numbers = [name for name in varied if all(isinstance(row[name], float | int) for row in rows)]
    names = [name for name in measures(done) if any(row.get(name) is not None for row in done)]
    require(
        numbers and names, "chart: needs a case that is done, with a measure, and a parameter that is varied by numbers"
    )
    unit = unit_of(catalogue.load(rows[0]["scene"]).parameters.model_fields[numbers[0]])
    x, others = numbers[0], [name for name in varied if name != numbers[0]]
    values = sorted({row[x] for row in done})
    figure, panels = _figure(4.6 * len(names), 4.4, columns=len(names), squeeze=False)
    for axes, name in zip(panels[0], names, strict=True):
        factor, unit_y, _ = unit_of_measure(name)
        for k, key in enumerate(dict.fromkeys(tuple(row[other] for other in others) for row in done)):
            points = [(row[x], row.get(name)) for row in done if tuple(row[other] for other in others) == key]
            points = np.array(sorted(points), float)  # None becomes nan: a gap
            label = ", ".join(f"{in_words(other)} {quote(value, '')}" for other, value in zip(others, key, strict=True))
            axes.plot(points[:, 0], factor * points[:, 1], "o-", color=COLOURS[k % len(COLOURS)], label=label)
        axes.set(
            xlabel=in_words(x) + (f" [{unit}]" if unit else ""), ylabel=title(name) + (f" [{unit_y}]" if unit_y else "")
        )
        if values[0] > 0.0:
            axes.set_xscale("log")
            set_log_ticks(axes.xaxis, values[0], values[-1], values)
    if others:
        panels[0][0].legend(frameon=False, fontsize=9)
    return _save(figure, out)
