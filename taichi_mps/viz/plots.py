"""Picture of a filled form, and the look of every chart. Matplotlib is the optional extra ``plots``."""

import os
import sys
from contextlib import suppress

import numpy as np
from pydantic import InstanceOf

from ..engine import Cavity, Snapshot
from ..units import File, user_path, validated, writing

COLOURS = ("#1f5f99", "#d1662a", "#2e8b57", "#8f4f9f", "#b8323f", "#7a6a35", "#4b8ea8", "#555b63")
STYLE = {
    "font.size": 11, "axes.titlesize": 12, "axes.labelsize": 11, "axes.edgecolor": "#6b727a", "axes.linewidth": 0.8,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#e3e6ea",
    "grid.linewidth": 0.8, "axes.axisbelow": True, "lines.linewidth": 1.8, "lines.solid_capstyle": "round",
    "xtick.color": "#4a5058", "ytick.color": "#4a5058", "figure.dpi": 100,
}  # fmt: skip


def _figure(width, height, columns=1, **options):
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
        figure = Figure(figsize=(width, height), layout="constrained")
        return figure, figure.subplots(1, columns, **options)


def _save(figure, out):
    out = user_path(out)
    with writing("out", out):
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out, dpi=150, format="png")
    return out


@validated
def filling(cavity: InstanceOf[Cavity], s: InstanceOf[Snapshot], out: File):
    """Plot where a form is filled at a snapshot: the filled fraction through its thickness (y; in 2-D the section
    itself), white where there is no cavity, and beside it the fraction at each height. Returns the path of the file."""
    room, filled = cavity.cells, cavity.filled(s)
    if room.ndim == 3:
        room, filled = room.sum(1), filled.sum(1)
    fraction = np.where(room > 0, filled / np.maximum(room, 1), np.nan)
    length, height = (cavity.high[a] - cavity.low[a] for a in (0, -1))
    wide = min(8.0, max(3.0, 4.5 * length / height))
    figure, picture = _figure(1.5 * wide + 1.0, wide * height / length + 2.2)
    from matplotlib.colors import LinearSegmentedColormap

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
