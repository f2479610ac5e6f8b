"""Curves of runs as PNG files. Matplotlib is the optional extra ``plots``; each function returns the file's path."""

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


def _figure(width, height, rows=1, columns=1, layout="constrained", **options):
    """Figure and axes that need no display and no global state."""
    try:
        import matplotlib
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise ImportError("plots need matplotlib: pip install 'taichi-mps[plots]'") from None
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout=layout)
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, columns, **options)
    return figure, axes


def _save(figure, out):
    out = Path(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=150, format="png")
    return out


def _columns(rows):
    """Columns as arrays, of a dict of columns or a list of rows."""
    if not hasattr(rows, "keys"):
        rows = {key: [row[key] for row in rows] for key in rows[0]} if len(rows) else {}
    return {key: np.atleast_1d(np.asarray(values, float)) for key, values in rows.items()}


def _label_ends(axes, ends):
    """Write a label right of the last point of each curve (x, y, text, colour), pushed apart where they would touch."""
    if not ends:
        return
    rightmost = max(x for x, *_ in ends)
    place = axes.transAxes.inverted().transform
    ends = sorted(ends, key=lambda end: axes.transData.transform((rightmost, end[1]))[1])
    heights = [place(axes.transData.transform((rightmost, y)))[1] for _, y, *_ in ends]
    for k in range(1, len(heights)):
        heights[k] = max(heights[k], heights[k - 1] + 0.05)
    heights = np.array(heights) - max(0.0, heights[-1] - 1.0)
    for (_, _, text, colour), height in zip(ends, heights, strict=True):
        axes.annotate(text, (1.01, height), xycoords="axes fraction", color=colour, va="center", annotation_clip=False)


def _points(reference):
    """A pair of sequences (x, y) as arrays."""
    x, y = (np.atleast_1d(np.asarray(column, float)) for column in reference)
    return x, y


def slump_curve(histories, out, references=None, log_time=False):
    """Slump [cm], downwards, against time [s] of runs {label: history with time_s and slump_m}.

    references: {label: (time [s], slump [m])}, dashed and, where the label is that of a run, in its colour.
    """
    figure, axes = _figure(8.0, 4.8)
    runs = {label: _columns(rows) for label, rows in histories.items()}
    references = {label: _points(points) for label, points in (references or {}).items()}
    colour = {label: COLOURS[k % len(COLOURS)] for k, label in enumerate(dict.fromkeys([*runs, *references]))}
    ends = []
    curves = [(label, run["time_s"], run["slump_m"], "-") for label, run in runs.items()]
    for label, t, slump, style in curves + [(label, *points, "--") for label, points in references.items()]:
        keep = np.isfinite(slump) & ((t > 0) | (not log_time))
        t, slump = t[keep], 100.0 * slump[keep]
        axes.plot(t, slump, style, color=colour[label], marker="o" if style == "--" and len(t) < 3 else None)
        if len(t) and not (style == "--" and label in runs):
            ends.append((t[-1], slump[-1], plain(label).replace("$", r"\$"), colour[label]))  # $ begins a formula
    if log_time:
        axes.set_xscale("log")
    else:
        axes.margins(x=0.0)
        axes.set_xlim(left=0.0)
    axes.set(xlabel="time [s]", ylabel="slump [cm]", ylim=(max(axes.get_ylim()[1], 1.0), min(axes.get_ylim()[0], 0.0)))
    if references:
        handles = [axes.plot([], [], style, color="#555b63")[0] for style in ("-", "--")]
        axes.legend(handles, ["computed", "reference"], loc="lower left" if log_time else "upper right", frameon=False)
    _label_ends(axes, ends)
    return _save(figure, out)


def slump_against_yield_value(points, references, out):
    """Final slump [cm], downwards, against the yield stress [Pa] of points {label: (yield stresses, slumps [m])}.

    references: the same, drawn as lines (a law, measured data), or None.
    """
    figure, axes = _figure(7.0, 4.8)
    points = points if hasattr(points, "keys") else {"computed": points}
    for k, (label, reference) in enumerate((references or {}).items()):
        tau, slump = _points(reference)
        order = np.argsort(tau)
        style = ("--", ":", "-.")[k % 3]
        axes.plot(tau[order], 100.0 * slump[order], style, color="#555b63", label=label)
    for k, (label, pair) in enumerate(points.items()):
        tau, slump = _points(pair)
        axes.plot(tau, 100.0 * slump, "o", ms=7, color=COLOURS[k % len(COLOURS)], mec="white", mew=0.8, label=label)
    axes.set(xlabel="yield stress [Pa]", ylabel="slump [cm]")
    axes.set_xlim(left=0.0)
    axes.set_ylim(max(axes.get_ylim()[1], 1.0), 0.0)
    axes.legend(loc="best", frameon=False)
    return _save(figure, out)


def viscosity_against_shear_rate(samples, law, out):
    """Viscosity [Pa s] against shear rate [1/s], both logarithmic.

    samples: {case: (shear rate, viscosity)}, drawn as points; law: one such pair or {case: pair}, as lines, or None.
    """
    figure, axes = _figure(7.0, 4.8)
    laws = {} if law is None else law if hasattr(law, "keys") else {"law": law}
    labels = list(dict.fromkeys([*samples, *(label for label in laws if label in samples)]))
    colour = {label: COLOURS[k % len(COLOURS)] for k, label in enumerate(labels)}
    for label, pair in samples.items():
        rate, viscosity = _points(pair)
        axes.plot(rate, viscosity, ".", ms=4, alpha=0.5, mew=0, color=colour[label], label=label, rasterized=True)
    for label, pair in laws.items():
        rate, viscosity = _points(pair)
        known = label in colour
        name = None if known else label
        axes.plot(rate, viscosity, color=colour.get(label, "#22262b"), lw=1.4, label=name)
    axes.set(xscale="log", yscale="log", xlabel="shear rate [1/s]", ylabel="viscosity [Pa s]")
    legend = axes.legend(loc="best", markerscale=2.5, frameon=False)
    for handle in legend.legend_handles:
        handle.set_alpha(1.0)
    return _save(figure, out)


MEASURES = "cm", "N m", "N", "N/m", "kPa"  # units of the measures that are drawn, a panel for each
NUMERICS = (  # title of a panel, and its columns of history.csv with factor and name
    ("time step [ms]", (("dt_s", 1e3, ""),)),
    ("iterations", (("viscous_iterations", 1.0, "viscous"), ("pressure_iterations", 1.0, "pressure"))),
    ("volume error [%]", (("volume_error", 100.0, ""),)),
    ("below the yield stress, by number [%]", (("unyielded_fraction", 100.0, ""),)),
)


def panels_of(columns, numerics=False) -> list:
    """Titles of panels and their curves (values, name), of columns of history.csv that hold numbers."""
    panels = []
    for unit in MEASURES:
        keys = [key for key in columns if is_measure(key) and unit_of_measure(key)[1] == unit and key != "slump_max_m"]
        heading = " and ".join(map(title, keys[:2])) + ", ..." * (len(keys) > 2) + f" [{unit}]"
        panels += [(heading, [(key, unit_of_measure(key)[0], title(key)) for key in keys])]
    panels += [("largest speed [m/s]", [("max_speed_m_s", 1.0, "")])]
    heading = "share of the concrete that flows [%]: viscous stress over 5 % of the yield stress"
    panels += [(heading, [("flowing_fraction", 100.0, "")])]
    found = []
    for heading, curves in (*panels, *(NUMERICS * numerics)):
        shown = [(columns[key] * factor, name) for key, factor, name in curves if key in columns]
        shown = [(values, name) for values, name in shown if np.isfinite(values).any()]
        if shown:
            found.append((heading, shown))
    return found


def history(rows, out, numerics=False):
    """What history.csv holds against time: slump and spread or what else is measured, the largest speed, and the share
    that flows (where the viscous stress is over 5 % of the yield stress); numerics: time step, iterations, errors."""
    columns = _columns(rows)
    columns = {key: values for key, values in columns.items() if np.isfinite(values).any()}
    t, panels = columns.get("time_s"), panels_of(columns, numerics)
    if not panels:
        raise SceneError("history.csv: holds no numbers to draw; must hold a step of a run")
    lines, below = len(panels), 0.6  # [inches] for the label of the time
    tall = 1.9 * lines + below
    figure, axes = _figure(7.5, tall, lines, sharex=True, squeeze=False, layout=None)
    figure.subplots_adjust(left=0.09, right=0.97, top=1.0 - 0.35 / tall, bottom=below / tall, hspace=0.35)
    for panel, (heading, curves) in zip(axes.flat, panels, strict=True):
        for k, (values, name) in enumerate(curves):
            panel.plot(t, values, color=COLOURS[k % len(COLOURS)], label=name, marker="." if len(t) < 3 else None)
        panel.set_title(heading, loc="left")
        panel.margins(x=0.0)
        if len(curves) > 1:
            panel.legend(loc="best", fontsize=10, frameon=False)
        if "[%]" in heading and "flows" in heading:
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
        every = np.concatenate(list(lines.values()))
        panel.set(xscale="log", yscale="log", xlabel=label, title=quantity)
        _order_guides(panel, every, sign)
        for k, points in enumerate(lines.values()):
            panel.plot(*points.T, "o-", color=COLOURS[k % len(COLOURS)], ms=6, mec="white", mew=0.8)
        ticks = np.unique(every[:, 0])
        panel.set_xticks(ticks, [f"{x:g}" for x in ticks], minor=False)
        panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.tick_params(which="minor", left=False, bottom=False, labelleft=False, labelbottom=False)
        colours = [COLOURS[k % len(COLOURS)] for k in range(len(lines))]
        ends = [(*points[-1], text, colour) for (text, points), colour in zip(lines.items(), colours, strict=True)]
        _label_ends(panel, ends)
    return _save(figure, out)


def _order_guides(axes, points, sign):
    """Thin lines of the orders 1 and 1.5 from above the largest error at the coarsest spacing to the finest."""
    x = np.array([points[:, 0].min(), points[:, 0].max()])
    coarse, fine = x if sign < 0 else x[::-1]
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
