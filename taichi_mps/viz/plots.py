"""Curves of runs as PNG files. Matplotlib is the optional extra ``plots``; each function returns the file's path."""

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from itertools import cycle

import numpy as np
from pydantic import InstanceOf

from ..engine import Cavity, Snapshot
from ..input.labels import is_measure, title, unit_of_measure
from ..units import File, Flag, Picture, plain, require, user_path, validated, writing

COLOURS = ("#1f5f99", "#d1662a", "#2e8b57", "#8f4f9f", "#b8323f", "#7a6a35", "#4b8ea8", "#555b63")
STYLE = {
    "font.size": 11, "axes.titlesize": 12, "axes.labelsize": 11, "axes.edgecolor": "#6b727a", "axes.linewidth": 0.8,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#e3e6ea",
    "grid.linewidth": 0.8, "axes.axisbelow": True, "lines.linewidth": 1.8, "lines.solid_capstyle": "round",
    "xtick.color": "#4a5058", "ytick.color": "#4a5058", "figure.dpi": 100,
}  # fmt: skip


PANEL_UNITS = "cm", "N m", "N", "N/m", "kPa"  # units of the measures that are drawn, a panel for each
FLOWING_TITLE = "share of the concrete that flows [%]: viscous stress over 5 % of the yield stress"
COMMON_PANELS = (
    ("largest speed [m/s]", [("max_speed_m_s", 1.0, "")]),
    (FLOWING_TITLE, [("flowing_fraction", 100.0, "")]),
)
NUMERICS_PANELS = (  # title of a panel, and its columns of history.csv with factor and name
    ("time step [ms]", (("dt_s", 1e3, ""),)),
    ("iterations", (("outer_iterations", 1.0, "outer"), ("solver_iterations", 1.0, "of the solver"))),
    ("volume error [%]", (("volume_error", 100.0, ""),)),
    ("below the yield stress, by number [%]", (("unyielded_fraction", 100.0, ""),)),
)


def _figure(width, height, rows=1, columns=1, layout="constrained", **options):
    """Make a figure and axes that need no display and no global state. MPLBACKEND is hidden from the import of
    matplotlib, which fails if it names a backend that is not installed, as that of a notebook may be."""
    backend = None if "matplotlib" in sys.modules else os.environ.pop("MPLBACKEND", None)
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ImportError:
        raise ImportError("plots need matplotlib: pip install 'taichi-mps[plots]'") from None
    finally:
        os.environ |= {"MPLBACKEND": backend} if backend else {}
    if backend:
        with suppress(ValueError):
            matplotlib.rcParams["backend"] = backend
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout=layout)
        return figure, figure.subplots(rows, columns, **options)


def _save(figure, out):
    out = user_path(out)
    with writing("out", out):
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out, dpi=150, format="png")
    return out


def _colours(labels):
    """Assign a colour to each label, in their order."""
    return dict(zip(dict.fromkeys(labels), cycle(COLOURS), strict=False))


@validated
def slump_curve(
    histories: dict[str, dict], out: Picture, references: dict[str, Sequence] | None = None, log_time: Flag = False
):
    """Plot the slump [cm], downwards, against time [s] of runs {label: history with time_s and slump_m}.

    references: {label: (time [s], slump [m])}, dashed, in the colour of the run with the same label.
    """
    slumps = [run["slump_m"] for run in histories.values()]
    require(any(np.isfinite(slump).any() for slump in slumps), f"histories = {[*histories]}: must have a slump")
    figure, axes = _figure(8.0, 4.8)
    references = references or {}
    colour = _colours([*histories, *references])
    curves = [(label, "-", label, run["time_s"], run["slump_m"]) for label, run in histories.items()]
    curves += [(label, "--", f"{label}, reference", *points) for label, points in references.items()]
    for label, style, name, *points in curves:
        t, slump = np.array(points, float)
        keep = np.isfinite(slump) & ((t > 0) | (not log_time))
        t, slump = t[keep], 100.0 * slump[keep]
        name = " " + plain(name).replace("$", r"\$")  # $ begins a formula, and with _ in front it would be left out
        axes.plot(t, slump, style, color=colour[label], label=name, marker="o" if len(t) < 3 else None)
    axes.margins(x=0.0)
    axes.set_xscale("log" if log_time else "linear")
    low, high = axes.get_ylim()
    axes.set(xlabel="time [s]", ylabel="slump [cm]", ylim=(max(high, 1.0), min(low, 0.0)))
    axes.set_xlim(left=None if log_time else 0.0)
    if len(curves) > 1:
        figure.legend(loc="outside right upper", frameon=False)
    return _save(figure, out)


def panels_of(columns, numerics=False) -> list:
    """Panels of history.png as pairs of a title and curves (values, name), from columns of history.csv."""
    panels = []
    for unit in PANEL_UNITS:
        keys = [key for key in columns if is_measure(key) and unit_of_measure(key)[1] == unit and key != "slump_max_m"]
        heading = " and ".join(map(title, keys[:2])) + ", ..." * (len(keys) > 2) + f" [{unit}]"
        panels.append((heading, [(key, unit_of_measure(key)[0], title(key)) for key in keys]))
    panels += (*COMMON_PANELS, *(NUMERICS_PANELS * numerics))
    shown = {
        heading: [(columns[key] * factor, name) for key, factor, name in curves if key in columns]
        for heading, curves in panels
    }
    return [(heading, curves) for heading, curves in shown.items() if curves]


def history(rows, out, numerics=False):
    """Plot history.csv against time: slump, slump flow or other measures, largest speed, and the share that flows
    (where the viscous stress is over 5 % of the yield stress); with ``numerics`` time step, iterations and errors."""
    panels = panels_of({key: values for key, values in rows.items() if np.isfinite(values).any()}, numerics)
    require(panels, "history.csv: holds no numbers to draw; must hold a step of a run")
    t, below = rows["time_s"], 0.6  # [inches] for the label of the time
    tall = 1.9 * len(panels) + below
    figure, axes = _figure(7.5, tall, len(panels), sharex=True, squeeze=False, layout=None)
    figure.subplots_adjust(left=0.09, right=0.97, top=1.0 - 0.35 / tall, bottom=below / tall, hspace=0.35)
    for panel, (heading, curves) in zip(axes.flat, panels, strict=True):
        for (values, name), colour in zip(curves, cycle(COLOURS), strict=False):
            panel.plot(t, values, color=colour, label=name, marker="." if len(t) < 3 else None)
        panel.set_title(heading, loc="left")
        panel.margins(x=0.0)
        if len(curves) > 1:
            panel.legend(loc="best", fontsize=10, frameon=False)
        if heading == FLOWING_TITLE:
            panel.set_ylim(-3.0, 103.0)
    axes.flat[-1].set_xlabel("time [s]")
    return _save(figure, out)


def convergence(series, panels, out):
    """Plot errors against the resolution, log-log, with guides of the orders 1 and 1.5; one panel for each quantity.

    series: [{quantity, curve, x, y}]; points of the same curve are joined. panels: {quantity: (label of the x axis,
    sign of the slope)}, -1 where the error falls with growing x. A panel without points is left out. Raises ValueError
    if all are.
    """
    curves = {}  # quantity -> curve -> points
    for item in series:
        points = curves.setdefault(item["quantity"], {}).setdefault(item["curve"], [])
        points += [(x, y) for x, y in zip(item["x"], item["y"], strict=True) if y > 0.0]
    shown = [quantity for quantity in panels if curves.get(quantity)]
    if not shown:
        raise ValueError("convergence: no result holds errors at several spacings")
    figure, axes = _figure(6.6 * len(shown), 4.8, 1, len(shown), squeeze=False)
    from matplotlib.ticker import LogLocator

    for panel, quantity in zip(axes.flat, shown, strict=True):
        label, sign = panels[quantity]
        lines = {curve: np.array(sorted(points)) for curve, points in curves[quantity].items()}
        colour, every = _colours(lines), np.concatenate(list(lines.values()))
        panel.set(xscale="log", yscale="log", xlabel=label, title=quantity)
        ends, top = np.sort([every[:, 0].min(), every[:, 0].max()])[::-sign], 1.3 * every[:, 1].max()
        for order in (1.0, 1.5):  # thin, from above the largest error at the coarsest spacing to the finest
            lowest = top * (ends[1] / ends[0]) ** (sign * order)
            panel.plot(ends, (top, lowest), color="#9aa1a9", lw=1.0, ls="--", zorder=1)
            panel.annotate(
                f"order {order:g}",
                (ends[1], lowest),
                (-6 * sign, -3),
                textcoords="offset points",
                color="#6b727a",
                fontsize=10,
                ha="right" if sign < 0 else "left",
                va="top",
                zorder=1,
            )
        for curve, points in lines.items():
            panel.plot(*points.T, "o-", color=colour[curve], ms=6, mec="white", mew=0.8, label=curve)
        panel.set_xticks(np.unique(every[:, 0]), [f"{x:g}" for x in np.unique(every[:, 0])], minor=False)
        panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.tick_params(which="minor", left=False, bottom=False, labelleft=False, labelbottom=False)
        panel.legend(loc="best", fontsize=10, frameon=False)
    return _save(figure, out)


@validated
def filling(cavity: InstanceOf[Cavity], s: InstanceOf[Snapshot], out: File):
    """Plot where a form is filled at a snapshot: the filled fraction through its thickness (y; in 2-D the section
    itself), white where there is no cavity, and beside it the fraction at each height."""
    room, filled = cavity.cells, cavity.filled(s)
    if room.ndim == 3:
        room, filled = room.sum(1), filled.sum(1)
    fraction = np.where(room > 0, filled / np.maximum(room, 1), np.nan)
    length, height = (cavity.high[a] - cavity.low[a] for a in (0, -1))
    from matplotlib.colors import LinearSegmentedColormap

    wide = min(8.0, max(3.0, 4.5 * length / height))
    figure, picture = _figure(1.5 * wide + 1.0, wide * height / length + 2.2)
    colours = LinearSegmentedColormap.from_list("filling", (COLOURS[4], "#f0c9a8", "#9aa1a9"))
    corners = (cavity.low[0], cavity.high[0], cavity.low[-1], cavity.high[-1])
    image = picture.imshow(fraction.T, origin="lower", extent=corners, cmap=colours, vmin=0.0, vmax=1.0, aspect="equal")
    picture.grid(False)
    picture.set(xlabel="x [m]", ylabel="z [m]")
    picture.set_title(f"filled {cavity.report(s)['filled_ratio']:.1%} at {s.time:.3g} s", loc="left")
    figure.colorbar(
        image, ax=picture, label="filled fraction of the thickness", location="bottom", shrink=0.5, aspect=40
    )
    curve = picture.inset_axes((1.04, 0.0, 0.25, 1.0), sharey=picture)
    heights, fractions = cavity.by_height(s)
    curve.plot(100.0 * fractions, heights, color=COLOURS[0])
    curve.set(xlabel="filled [%]", xlim=(-3.0, 103.0))
    curve.tick_params(labelleft=False)
    return _save(figure, out)
