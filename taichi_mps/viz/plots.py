"""Curves of runs as PNG files. Matplotlib is the optional extra ``plots``; each function returns the file's path."""

from itertools import cycle
from pathlib import Path

import numpy as np

from ..problem.labels import is_measure, title, unit_of_measure
from ..units import SceneError, plain

COLOURS = ("#1f5f99", "#d1662a", "#2e8b57", "#8f4f9f", "#b8323f", "#7a6a35", "#4b8ea8", "#555b63")
STYLE = {
    "font.size": 11, "axes.titlesize": 12, "axes.labelsize": 11, "axes.edgecolor": "#6b727a", "axes.linewidth": 0.8,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#e3e6ea",
    "grid.linewidth": 0.8, "axes.axisbelow": True, "lines.linewidth": 1.8, "lines.solid_capstyle": "round",
    "xtick.color": "#4a5058", "ytick.color": "#4a5058", "figure.dpi": 100,
}  # fmt: skip


MEASURES = "cm", "N m", "N", "N/m", "kPa"  # units of the measures that are drawn, a panel for each
FLOWS = "share of the concrete that flows [%]: viscous stress over 5 % of the yield stress"
ALWAYS = ("largest speed [m/s]", [("max_speed_m_s", 1.0, "")]), (FLOWS, [("flowing_fraction", 100.0, "")])
NUMERICS = (  # title of a panel, and its columns of history.csv with factor and name
    ("time step [ms]", (("dt_s", 1e3, ""),)),
    ("iterations", (("viscous_iterations", 1.0, "viscous"), ("pressure_iterations", 1.0, "pressure"))),
    ("volume error [%]", (("volume_error", 100.0, ""),)),
    ("below the yield stress, by number [%]", (("unyielded_fraction", 100.0, ""),)),
)


def _figure(width, height, rows=1, columns=1, layout="constrained", **options):
    """Figure and axes that need no display and no global state."""
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ImportError:
        raise ImportError("plots need matplotlib: pip install 'taichi-mps[plots]'") from None
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout=layout)
        return figure, figure.subplots(rows, columns, **options)


def _save(figure, out):
    out = Path(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=150, format="png")
    return out


def _columns(rows):
    """Columns as arrays, of a dict of columns or a list of rows."""
    if not hasattr(rows, "keys"):
        rows = {key: [row[key] for row in rows] for key in rows[0]}
    return {key: np.atleast_1d(np.asarray(values, float)) for key, values in rows.items()}


def _colours(labels):
    """A colour for each of some labels, in their order."""
    return dict(zip(dict.fromkeys(labels), cycle(COLOURS), strict=False))


def _label_ends(axes, ends):
    """Write a label right of the last point of each curve (x, y, text, colour), pushed apart where they would touch."""
    place = axes.transAxes.inverted().transform
    heights = [place(axes.transData.transform(end[:2]))[1] for end in ends]
    order = np.argsort(heights, kind="stable")
    steps = 0.05 * np.arange(len(ends))
    pushed = np.maximum.accumulate(np.array(heights)[order] - steps) + steps
    pushed -= max(0.0, pushed.max(initial=0.0) - 1.0)
    for k, height in zip(order, pushed, strict=True):
        text, colour = ends[k][2:]
        axes.annotate(text, (1.01, height), xycoords="axes fraction", color=colour, va="center", annotation_clip=False)


def slump_curve(histories, out, references=None, log_time=False):
    """Slump [cm], downwards, against time [s] of runs {label: history with time_s and slump_m}.

    references: {label: (time [s], slump [m])}, dashed and, where the label is that of a run, in its colour.
    """
    figure, axes = _figure(8.0, 4.8)
    runs, references = {label: _columns(rows) for label, rows in histories.items()}, references or {}
    colour, ends = _colours([*runs, *references]), []
    curves = [(label, "-", run["time_s"], run["slump_m"]) for label, run in runs.items()]
    curves += [(label, "--", *points) for label, points in references.items()]
    for label, style, *points in curves:
        t, slump = (np.atleast_1d(np.asarray(column, float)) for column in points)
        keep = np.isfinite(slump) & ((t > 0) | (not log_time))
        t, slump = t[keep], 100.0 * slump[keep]
        axes.plot(t, slump, style, color=colour[label], marker="o" if style == "--" and len(t) < 3 else None)
        if len(t) and (style == "-" or label not in runs):
            ends.append((t[-1], slump[-1], plain(label).replace("$", r"\$"), colour[label]))  # $ begins a formula
    axes.margins(x=0.0)
    axes.set_xscale("log" if log_time else "linear")
    if not log_time:
        axes.set_xlim(left=0.0)
    axes.set(xlabel="time [s]", ylabel="slump [cm]", ylim=(max(axes.get_ylim()[1], 1.0), min(axes.get_ylim()[0], 0.0)))
    if references:
        handles = [axes.plot([], [], style, color="#555b63")[0] for style in ("-", "--")]
        axes.legend(handles, ["computed", "reference"], loc="lower left" if log_time else "upper right", frameon=False)
    _label_ends(axes, ends)
    return _save(figure, out)


def points_and_lines(points, lines, out, **settings):
    """Points {label: (x, y)}, and lines of the same kind in the colour of the points of their label, or grey; settings:
    of the axes, those of matplotlib."""
    figure, axes = _figure(7.0, 4.8)
    colour, grey = _colours(points), cycle(("--", ":", "-."))
    for label, pair in lines.items():
        known = label in points
        axes.plot(
            *pair, "-" if known else next(grey), color=colour.get(label, "#555b63"), label=None if known else label
        )
    for label, pair in points.items():
        axes.plot(*pair, "o", ms=5, color=colour[label], mec="white", mew=0.5, label=label, rasterized=True)
    axes.set(**settings)
    axes.legend(loc="best", frameon=False)
    return _save(figure, out)


def panels_of(columns, numerics=False) -> list:
    """Titles of panels and their curves (values, name), of columns of history.csv that hold numbers."""
    panels = []
    for unit in MEASURES:
        keys = [key for key in columns if is_measure(key) and unit_of_measure(key)[1] == unit and key != "slump_max_m"]
        heading = " and ".join(map(title, keys[:2])) + ", ..." * (len(keys) > 2) + f" [{unit}]"
        panels.append((heading, [(key, unit_of_measure(key)[0], title(key)) for key in keys]))
    panels += (*ALWAYS, *(NUMERICS * numerics))
    shown = {
        heading: [(columns[key] * factor, name) for key, factor, name in curves if key in columns]
        for heading, curves in panels
    }
    return [(heading, curves) for heading, curves in shown.items() if curves]


def history(rows, out, numerics=False):
    """What history.csv holds against time: slump and spread or what else is measured, the largest speed, and the share
    that flows (where the viscous stress is over 5 % of the yield stress); numerics: time step, iterations, errors."""
    columns = {key: values for key, values in _columns(rows).items() if np.isfinite(values).any()} if len(rows) else {}
    panels = panels_of(columns, numerics)
    if not panels:
        raise SceneError("history.csv: holds no numbers to draw; must hold a step of a run")
    t, below = columns["time_s"], 0.6  # [inches] for the label of the time
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
        if heading == FLOWS:
            panel.set_ylim(-3.0, 103.0)
    axes.flat[-1].set_xlabel("time [s]")
    return _save(figure, out)


def convergence(series, panels, out):
    """Errors against the resolution, log-log, with guides of the orders 1 and 1.5; one panel for each quantity.

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
        _order_guides(panel, every, sign)
        for curve, points in lines.items():
            panel.plot(*points.T, "o-", color=colour[curve], ms=6, mec="white", mew=0.8)
        panel.set_xticks(np.unique(every[:, 0]), [f"{x:g}" for x in np.unique(every[:, 0])], minor=False)
        panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.tick_params(which="minor", left=False, bottom=False, labelleft=False, labelbottom=False)
        _label_ends(panel, [(*points[-1], curve, colour[curve]) for curve, points in lines.items()])
    return _save(figure, out)


def _order_guides(axes, points, sign):
    """Thin lines of the orders 1 and 1.5 from above the largest error at the coarsest spacing to the finest."""
    coarse, fine = np.sort([points[:, 0].min(), points[:, 0].max()])[::-sign]
    top = 1.3 * points[:, 1].max()
    for order in (1.0, 1.5):
        end = top * (fine / coarse) ** (sign * order)
        axes.plot([coarse, fine], [top, end], color="#9aa1a9", lw=1.0, ls="--", zorder=1)
        axes.annotate(f"order {order:g}", (fine, end), (-6 * sign, -3), textcoords="offset points", color="#6b727a",
                      fontsize=10, ha="right" if sign < 0 else "left", va="top", zorder=1)  # fmt: skip


def filling(cavity, s, out):
    """Where a form stayed empty: through its thickness (y; in 2-D the section itself) the fraction of the cavity that
    is filled at a snapshot, white where there is none, and beside it that at each height."""
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
