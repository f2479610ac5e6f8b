"""Pictures of a run, from scenes and snapshots.

The painter draws the smooth surface of the body or, on request and for two-dimensional scenes, its particles, their
shadow and the floor. Pillow draws rulers, the lifted mould and the measures over it. Two-dimensional scenes lie in the
plane y = 0, z up.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Annotated, Any, Literal

import imageio.v3 as iio
import numpy as np
from PIL import Image
from pydantic import Field, InstanceOf

from ..engine import SCALARS, Scene, Snapshot, embed
from ..input.labels import constants_of, mix_in_words
from ..units import (
    Count,
    Duration,
    File,
    Flag,
    Place,
    SceneError,
    array,
    quote,
    real,
    require,
    user_path,
    validated,
    writing,
)
from .beads import Beads
from .body import GRAINS, PICTURE_CELL, grains_of, surface_of
from .overlay import FAINT, GLASS, INK, MOULD, Overlay, with_film_speed
from .painter import Camera, Mesh, Painter
from .view_volume import dimensions, lifted_mould_faces, view_volume, wall_lines

DRAWN_RADIUS = 0.62  # of a drawn sphere over l0
CONCRETE, FLOWING, RIGID = np.array([(0.68, 0.675, 0.66), (0.93, 0.50, 0.16), (0.45, 0.53, 0.64)])
MIXES = np.array([(0.68, 0.675, 0.66), (0.30, 0.50, 0.72), (0.86, 0.55, 0.25), (0.42, 0.62, 0.40)])  # of mixes in turn
GRAIN_VIEWS = "concrete", "distance"  # that show grains as bodies of their own
CLEAR = 2.0  # mortar over the largest grain, behind which the light of grains has fallen by a factor of e
VIEW_VALUES = {  # values of a view, and the label of its colour bar
    "speed": (lambda s: s.speed, "speed [m/s]"),
    "pressure": (lambda s: 1e-3 * s.p, "pressure [kPa]"),
    "shear-rate": (lambda s: s.shear_rate, "shear rate [1/s]"),
    "distance": (None, "way of grains [m]"),
}
# fields that a view reads
VIEW_FIELDS = {"speed": ["u"], "pressure": ["p"], "shear-rate": ["shear_rate"], "yielded": ["yielded"]}
View = Literal["concrete", "speed", "pressure", "shear-rate", "yielded", "mix", "distance"]
Pixels, Limits, Rate = (
    Annotated[Count, Field(ge=16, le=8192)],
    array("", (2,), kind=tuple),
    real("1/s", ge=0.02, le=100.0),
)
TITLE_MEASURES = {  # shown in cm
    "slump_m": "slump",
    "spread_m": "slump flow",
    "front_m": "front",
    "height_m": "height",
    "flow_m": "flow",
    "h1_m": "H1",
    "h2_m": "H2",
    "step_m": "step",
    "blocking_step_m": "step",
}
VIRIDIS = np.array(
    [(68, 1, 84), (71, 44, 122), (59, 81, 139), (44, 113, 142), (33, 144, 141), (39, 173, 129), (92, 200, 99)]
    + [(170, 220, 50), (253, 231, 37)]
)


def viridis(t):
    """Return colours of the map viridis.

    Parameters
    ----------
    t : array_like, shape (n,)
        Values; beyond 0 and 1 the end colours, nan is grey.

    Returns
    -------
    ndarray, shape (n, 3)
        Red, green and blue, 0 to 1.
    """
    t = np.asarray(t, float)
    colours = np.stack([np.interp(t, np.linspace(0, 1, 9), VIRIDIS[:, k] / 255.0) for k in range(3)], -1)
    return np.where(np.isnan(t)[..., None], 0.5, colours)


def require_grains(scene, view: str, cut: bool) -> None:
    """Refuse what is shown of grains where there are none."""
    require(
        scene.grains or not (cut or view == "distance"),
        "cut, view = distance: the scene has no grains; must be left out",
    )


class Renderer:
    """Pictures of one run, with fixed camera, rulers and range of the colours.

    Parameters
    ----------
    scene : Scene
        Scene of the run.
    width, height : int, optional
        Size of a picture [pixels].
    view : str, optional
        What is shown: 'concrete', 'speed', 'pressure', 'shear-rate', 'yielded' or 'mix'; of grains, which 'concrete'
        shows in the mortar by their size, 'distance', how far they have come.
    limits : tuple of float, length 2, optional
        Ends of the colour bar in its unit, by default from the scene.
    beside : sequence of Scene, optional
        Scenes shown beside it, with the same camera and range.
    beads : bool, optional
        Show the particles and not the smooth surface of the body, as always of a scene in the plane.
    cut : bool, optional
        Cut the mortar around grains open in the middle of its width, and show it translucent no more.

    Raises
    ------
    SceneError
        For an unknown view, or one of grains where there are none.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> from taichi_mps.viz.render import Renderer
    >>> scene = mps.slump_cone(model="axisymmetric", spacing=0.05)
    >>> body = mps.measure.still(scene.fluid, scene.spacing)
    >>> Renderer(scene, width=320, height=180, view="yielded").colours(body).shape == body.x.shape[:1] + (3,)
    True
    """

    @validated
    def __init__(
        self,
        scene: InstanceOf[Scene],
        width: Pixels = 1280,
        height: Pixels = 720,
        view: View = "concrete",
        limits: Limits | None = None,
        beside: Sequence[InstanceOf[Scene]] = (),
        beads: Flag = False,
        cut: Flag = False,
    ):
        self.scene, self.view, self.cut = scene, view, cut
        require_grains(scene, view, cut)
        self.beads = beads or (scene.dimension == 2 and not scene.axisymmetric)
        self.limits = limits or max(self._limits(other, view) for other in (scene, *beside))
        lows, highs, floors = zip(*(view_volume(other) for other in (scene, *beside)), strict=True)
        self.low, self.high = np.min(lows, axis=0), np.max(highs, axis=0)
        self.middle = 0.5 * (self.low[1] + self.high[1])
        corners = np.stack(np.meshgrid(*zip(self.low, self.high, strict=True)), -1).reshape(-1, 3)
        steps = [digit * 10.0**power for power in range(-6, 4) for digit in (1, 2, 5)]
        self.tick = min(steps, key=lambda t: abs(np.log(np.ptp(corners) / 14 / t)))  # about 14 on the longest side
        tilt = np.radians(15.0 if scene.dimension == 3 or scene.axisymmetric else 0.0)
        self.camera = Camera((0.0, np.cos(tilt), -np.sin(tilt)), corners, width, height, (0.09, 0.17, 0.88, 0.89))
        relief = 1.0 if view in GRAIN_VIEWS else 0.7
        self.painter = Painter(self.camera, corners, DRAWN_RADIUS * scene.spacing, floors[0], self.tick, relief)

    @staticmethod
    def _limits(scene, view):
        head = np.linalg.norm(scene.gravity_vector) * np.ptp(scene.reach[:, -1])  # g H
        moved = [wall.speed for wall in scene.walls]
        moved += [] if scene.velocity is None else [np.linalg.norm(scene.velocity, axis=1).max()]
        heaviest = max(m.density for m in scene.materials)
        highest = {"speed": max([0.5 * np.sqrt(2.0 * head), *moved]), "pressure": 1e-3 * heaviest * head}
        highest["distance"] = np.max(np.subtract(*view_volume(scene)[1::-1]))
        top = float(highest.get(view, 10.0)) or 1.0
        round_ones = np.array((1, 1.5, 2, 3, 4, 5, 6, 8, 10)) * 10.0 ** np.floor(np.log10(top))
        return 0.0, float(round_ones[round_ones > 0.97 * top][0])

    def colours(self, snapshot: Snapshot) -> np.ndarray:
        """Return the colours of the particles, or of the vertices of the surface, in this view.

        Parameters
        ----------
        snapshot : Snapshot
            Fluid.

        Returns
        -------
        ndarray, shape (n, 3)
            Red, green and blue, 0 to 1.
        """
        if self.view in GRAIN_VIEWS:  # beads beside each other differ a little
            bright = 0.94 + 0.12 * np.modf(0.618034 * np.arange(len(snapshot.x)))[0]
            return CONCRETE * (bright if self.beads else np.ones(len(bright)))[:, None]
        if self.view == "yielded":
            return np.where(np.asarray(snapshot.yielded, bool)[:, None], FLOWING, RIGID)
        if self.view == "mix":
            return MIXES[np.asarray(snapshot.mix) % len(MIXES)]
        low, high = self.limits
        return viridis((np.asarray(VIEW_VALUES[self.view][0](snapshot), float) - low) / (high - low))

    @validated
    def draw(self, snapshot: InstanceOf[Snapshot], measures: dict | None = None) -> np.ndarray:
        """Draw the whole body.

        Parameters
        ----------
        snapshot : Snapshot
            Computed part of the body.
        measures : dict of str to float, optional
            Results to write into the picture.

        Returns
        -------
        ndarray of uint8, shape (height, width, 3)
            Picture.
        """
        grains, clear = [], 1e-9
        if self.view in GRAIN_VIEWS and self.scene.grains and snapshot.grain.any():
            x, radii, kinds, way = grains_of(self.scene, snapshot)
            x, clear = embed(x), clear if self.cut else 2.0 * CLEAR * radii.max()
            rows = np.flatnonzero(x[:, 1] >= (self.middle if self.cut else -np.inf))
            colours = GRAINS[kinds % len(GRAINS)] if self.view == "concrete" else viridis(way / self.limits[1])
            grains = [Beads(x[rows], colours[rows], radii[rows])]
        if self.beads:
            snapshot = self.scene.unfold(snapshot)
            radii = DRAWN_RADIUS * snapshot.spacing * ~(bool(grains) & (snapshot.grain > 0))
            body = Beads(embed(snapshot.x), self.colours(snapshot), radii)
        else:
            if self.cut:  # where the surface of the rest lies before the plane, it is moved onto it
                kept = snapshot.x[:, 1] > self.middle - 2.0 * snapshot.spacing
                snapshot = replace(snapshot, **{name: getattr(snapshot, name)[kept] for name in ("x", "u", *SCALARS)})
            snapshot, normals, triangles = surface_of(
                self.scene, snapshot, PICTURE_CELL, VIEW_FIELDS.get(self.view, ())
            )
            front = self.cut & (snapshot.x[:, 1] < self.middle)
            snapshot.x[front, 1], normals[front] = self.middle, (0.0, -1.0, 0.0)
            body = Mesh(snapshot.x, self.colours(snapshot), normals, triangles)
        pixels, depth = self.painter.draw(body, *grains, clear=clear)
        image, measures = Image.fromarray(pixels), measures or {}
        over = Overlay(image, depth, self.camera)
        for face in (*lifted_mould_faces(self.scene, snapshot.time), *self.scene.vessel):
            over.pane(face)
        over.lines([np.vstack([face, face[:1]]) for face in self.scene.vessel], GLASS)
        over.lines(wall_lines(self.scene, self.low, self.high, snapshot.time), FAINT)
        over.lines(self.scene.outline, MOULD, dashed=True)
        over.rulers(self.low, self.high, self.tick)
        over.dimensions(dimensions(self.scene, measures, self.low, self.high, body.x[:, 0].max(initial=0.0)))
        self._titles(over, snapshot, measures)
        self._legend(image, over)
        return np.asarray(image)

    def _titles(self, over, snapshot, measures):
        unit = over.unit
        mix = mix_in_words(self.scene.material.facts()).removeprefix("yield stress 0 Pa, plastic ").replace(", ", "   ")
        over.write((28 * unit, 22 * unit), self.scene.name, 26)
        over.write((28 * unit, 58 * unit), f"{mix}   particle size {1e3 * self.scene.spacing:g} mm", 16, FAINT)
        shown = [
            f"{name} {round(100 * measures[key], 1) + 0.0:.1f} cm"
            for key, name in TITLE_MEASURES.items()
            if key in measures
        ]
        over.write((28 * unit, 86 * unit), "   ".join([f"t = {snapshot.time:.2f} s", *shown]), 22)

    def _legend(self, image, over):
        unit, pen, (low, high) = over.unit, over.pen, self.limits
        x, y, wide, tall = (round(v * unit) for v in (image.width / unit - 105, 150, 20, 300))
        keys = []
        if self.view == "yielded":
            keys = [("flowing", FLOWING), ("below the yield stress", RIGID)]
        elif self.view == "concrete" and self.scene.grains:
            sizes = np.sort(self.scene.grains.diameters)
            keys = zip([f"grains, {1e3 * size:g} mm" for size in sizes], cycle(GRAINS), strict=False)
        elif self.view == "mix":
            mixes = [", ".join(list(constants_of(m.facts()).values())[:2]) for m in self.scene.materials]
            keys = zip(mixes, cycle(MIXES), strict=False)
        for k, (name, colour) in enumerate(keys):
            top = round((28 + 30 * k) * unit)
            pen.rectangle((x + 57 * unit, top, x + 77 * unit, top + wide), fill=tuple(int(255 * c) for c in colour))
            over.write((x + 48 * unit, top + 0.5 * wide), name, 16, INK, "rm")
        if self.view not in VIEW_VALUES:
            return
        bar = (255 * viridis(np.linspace(1, 0, tall))[:, None] + 0.5).astype(np.uint8)
        image.paste(Image.fromarray(np.repeat(bar, wide, 1)), (x, y))
        over.write((x + 77 * unit, y - 24 * unit), VIEW_VALUES[self.view][1], 16, INK, "rm")
        for t in np.linspace(0, 1, 6):
            at = y + (1 - t) * (tall - 1)
            pen.line((x + wide, at, x + wide + 5 * unit, at), fill=FAINT)
            over.write((x + wide + 10 * unit, at), f"{low + t * (high - low):.3g}", 15, FAINT, "lm")


def save(picture, path):
    """Write a picture as PNG, whole or not at all.

    Parameters
    ----------
    picture : ndarray of uint8, shape (height, width, 3)
        Picture.
    path : path-like
        File.
    """
    partial = user_path(path).with_suffix(".partial")
    iio.imwrite(partial, picture, extension=".png", compress_level=1)
    os.replace(partial, user_path(path))


@validated
def png(folder: Place, view: View = "concrete", **options: Any) -> Callable[[Any], None]:
    """Return a callback of a Simulation that writes numbered pictures.

    Parameters
    ----------
    folder : path-like
        Folder of the pictures, frame_00000.png, ... (speed_00000.png, ... for the view 'speed').
    view : str, optional
        What is shown, see ``Renderer``.
    **options
        Other parameters of ``Renderer``.

    Returns
    -------
    callable
        Function of a Simulation, for ``Simulation.every``.

    Examples
    --------
    >>> import tempfile, pathlib, types, taichi_mps as mps
    >>> mps.init(threads=1)
    >>> scene = mps.slump_cone(model="axisymmetric", spacing=0.05)
    >>> body = mps.measure.still(scene.fluid, scene.spacing)
    >>> sim = types.SimpleNamespace(scene=scene, snapshot=lambda: body, measures=dict)  # in place of a Simulation
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     mps.png(folder, width=320, height=180, beads=True)(sim)
    ...     sorted(path.name for path in pathlib.Path(folder).iterdir())
    ['frame_00000.png']
    """
    Renderer.__init__.check(view=view, **options)
    count, renderer = 0, None

    def write(sim):
        nonlocal count, renderer
        if renderer is None:
            with writing("folder", folder):
                folder.mkdir(parents=True, exist_ok=True)
            renderer = Renderer(sim.scene, view=view, **options)
        save(
            renderer.draw(sim.snapshot(), sim.measures()),
            folder / f"{'frame' if view == 'concrete' else view}_{count:05d}.png",
        )
        count += 1

    return write


@validated
def gif(
    frames: Place | Sequence[File], out: File, fps: Rate = 10.0, width: Pixels = 640, every: Duration | None = None
) -> None:
    """Write an animated GIF.

    Parameters
    ----------
    frames : path-like or sequence of path-like
        Folder of pictures (its frame_*.png, or else all PNG), or pictures.
    out : path-like
        File.
    fps : float, optional
        Pictures a second [1/s].
    width : int, optional
        Width [pixels].
    every : float, optional
        Time between two pictures [s], from which the speed of the film is written into it.

    Raises
    ------
    SceneError
        If there are no pictures, or the file is no GIF.

    Examples
    --------
    >>> import tempfile, pathlib, numpy as np, taichi_mps as mps
    >>> from taichi_mps.viz.render import save
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for k in range(2):
    ...         save(np.full((90, 160, 3), 100 * k, np.uint8), f"{folder}/frame_{k}.png")
    ...     out = pathlib.Path(folder) / "run.gif"
    ...     mps.gif(folder, out, width=80)
    ...     out.stat().st_size > 0
    True
    """
    require(
        out.suffix.lower() == ".gif", f"out = {out}: must end in .gif; 'taichi-mps render RUN --film' writes an MP4"
    )
    paths = [frames] if isinstance(frames, Path) else list(frames)
    if len(paths) == 1 and paths[0].is_dir():
        paths = sorted(paths[0].glob("frame_*.png")) or sorted(paths[0].glob("*.png"))
    require(paths, f"frames = {quote(frames, '')}: holds no pictures; must be a folder of pictures, or pictures")
    pictures = []
    for path in paths:
        try:
            with Image.open(path) as picture:
                size = (width, max(1, round(width * picture.height / picture.width)))
                pictures.append(with_film_speed(picture.convert("RGB").resize(size, Image.Resampling.BOX), every, fps))
        except OSError:
            raise SceneError(f"frames = {path}: cannot be read; must be a picture") from None
    sample = pictures[:: max(1, len(pictures) // 4)]
    sheet, palette = Image.fromarray(np.concatenate([np.asarray(p)[::2, ::2] for p in sample])), Image.new("P", (1, 1))
    common, rare = sheet.quantize(208), sheet.quantize(48, Image.Quantize.MAXCOVERAGE)  # smooth greys, thin red lines
    palette.putpalette(common.getpalette()[: 3 * 208] + rare.getpalette()[: 3 * 48])
    pictures = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    with writing("out", out):
        pictures[0].save(
            out,
            "GIF",
            save_all=True,
            append_images=pictures[1:],
            duration=round(1000 / fps),
            loop=0,
            optimize=True,
        )
