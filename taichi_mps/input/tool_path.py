"""Tool paths of printers: the straight beads on level layers that a G-code file lays."""

import re
from dataclasses import dataclass, replace

import numpy as np

from ..units import SceneError, regular_file, require

MAX_BYTES = 2e7
AXES = "XYZ"
IGNORED_CODES = {"G17", "G28", "G29", "G40", "G49", "G54", "G80", "G94"}  # codes that move nothing while a bead is laid
MODES = {"G90": (True, True), "G91": (False, False), "M82": (None, True), "M83": (None, False)}  # absolute: X Y Z, E
UNSUPPORTED_CODES = {
    **dict.fromkeys(("G2", "G3"), "an arc; a slicer must fit none"),
    "M200": "E in mm3",
    "M220": "a share of the speed",
    "M221": "a share of the flow",
}
SUPPORTED_CODES = "must be G0, G1, G4, G20, G21, G90, G91, G92 E, M82 or M83"
BLOCK = re.compile(r"(?:N\d+\s*)?([GMT])0*(\d+(?:\.\d+)?)((?:\s*[A-Z](?:[-+]?(?:\d+\.?\d*|\.\d+))?)*)\s*")
WORD = re.compile(r"([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))")


@dataclass(frozen=True)
class Bead:
    """A straight line that a nozzle lays.

    From ``start`` to ``end`` (3,) [m], places of the nozzle, from the time ``begin`` [s] on for ``duration`` [s], with
    a ``volume`` [m3], in layer number ``layer`` from 0 on, which has a ``height`` [m].
    """

    start: np.ndarray
    end: np.ndarray
    begin: float
    duration: float
    volume: float
    layer: int = 0
    height: float = 0.0

    @property
    def width(self) -> float:
        """Width [m] of its section, if that is a rectangle as high as the layer."""
        return self.volume / (np.linalg.norm(self.end - self.start) * self.height)


class Printer:
    """State of a printer that executes a G-code file line by line, and the beads that it has laid."""

    def __init__(self, rate, filament):
        self.rate, self.filament = rate, filament
        self.unit, self.position, self.speed, self.time = 1e-3, np.zeros(3), 0.0, 0.0
        self.extruded = self.max_extruded = 0.0  # length of filament by E, and its largest value so far [m]
        self.absolute = self.absolute_e = True
        self.beads: list[Bead] = []

    def execute(self, line: str) -> None:
        """Execute a line of G-code; SceneError for an unknown code."""
        text = re.sub(r"\([^)]*\)|[;*].*", "", line).strip().upper()
        if text in ("", "%"):
            return
        block = BLOCK.fullmatch(text)
        if not block and text[0] in "MT":  # codes with text, as for a display
            return
        require(block, f"{line.strip()[:40]}: cannot be read")
        code, words = block[1] + block[2], {letter: float(value) for letter, value in WORD.findall(block[3])}
        require(words.keys().isdisjoint("GM"), f"{line.strip()[:40]}: holds two codes; must be one a line")
        require(
            code not in UNSUPPORTED_CODES, f"{code}: {UNSUPPORTED_CODES.get(code)}, is not known; {SUPPORTED_CODES}"
        )
        if code in ("G0", "G1"):
            self.move(code, words)
        elif code in MODES:
            axes, self.absolute_e = MODES[code]
            self.absolute = self.absolute if axes is None else axes
        elif code in ("G20", "G21"):
            self.unit = 0.0254 if code == "G20" else 1e-3
        elif code == "G4":
            self.time += words.get("S", 0.0) + 1e-3 * words.get("P", 0.0)
        elif code == "G92":
            require(not words.keys() & set(AXES), f"{code}: moves the origin, is not known; {SUPPORTED_CODES}")
            self.extruded = self.max_extruded = self.unit * words.get("E", 0.0)
        else:
            require(code[0] != "G" or code in IGNORED_CODES, f"{code}: is not known; {SUPPORTED_CODES}")

    def move(self, code: str, words: dict[str, float]) -> None:
        """Move the nozzle along a straight line, and lay a bead where E grows, or in G1 where a rate is given."""
        target = self.position.copy()
        for axis in (axis for axis in range(3) if AXES[axis] in words):
            target[axis] = self.unit * words[AXES[axis]] + (0.0 if self.absolute else target[axis])
        self.speed = self.unit * words["F"] / 60.0 if "F" in words else self.speed
        length, level, fed = float(np.linalg.norm(target - self.position)), target[2] == self.position[2], 0.0
        if "E" in words:
            self.extruded = self.unit * words["E"] + (0.0 if self.absolute_e else self.extruded)
            fed, self.max_extruded = max(0.0, self.extruded - self.max_extruded), max(self.max_extruded, self.extruded)
        if length:
            require(self.speed > 0.0, f"{code}: must have a speed F above 0, here or before")
            duration = length / self.speed
            if self.rate is not None:
                volume = self.rate * duration if code == "G1" and level else 0.0
            else:
                require(not fed or self.filament, f"{code} E: needs filament_diameter, as of the slicer, or print_rate")
                volume = fed * 0.25 * np.pi * (self.filament or 0.0) ** 2
            if volume:
                require(level, f"{code}: lays a bead that rises; must lay level layers")
                self.beads.append(Bead(self.position, target, self.time, duration, volume))
            self.time += duration
        self.position = target


def read_gcode(path, rate=None, filament=None) -> list[Bead]:
    """Read the beads that a G-code file lays.

    Parameters
    ----------
    path : path-like
        File; lengths are in millimetres, or inches after G20. Codes M and T of heaters and fans are ignored, and so is
        filament fed while the nozzle stands.
    rate : float, optional
        Flow rate of the nozzle in a level G1 [m3/s]; by default E gives the amount.
    filament : float, optional
        Diameter [m] of the filament whose length is E.

    Returns
    -------
    list of Bead
        In the order of time; 0 s is where the first begins. The nozzle is as fast as F says at once.

    Raises
    ------
    SceneError
        For an unsupported code, such as an arc, or a bead that rises, with its line; or if no bead is laid.
    """
    printer = Printer(rate, filament)
    text = regular_file(f"gcode {path}", path, MAX_BYTES).read_text(encoding="utf-8-sig", errors="replace")
    for number, line in enumerate(text.splitlines(), 1):
        try:
            printer.execute(line)
        except SceneError as error:
            raise SceneError(f"gcode {path}, line {number}: {error}") from None
    require(printer.beads, f"gcode {path}: lays nothing; G1 must have E, or print_rate be given")
    places = np.array([bead.end[2] for bead in printer.beads]).round(7)
    levels, layers = np.unique(places, return_inverse=True)
    require(levels[0] > 0.0, f"gcode {path}: lays a bead at z = {levels[0]:g} m; must be above 0 m")
    heights, first = np.diff(levels, prepend=0.0).round(7).tolist(), printer.beads[0].begin
    return [
        replace(bead, begin=bead.begin - first, layer=int(k), height=heights[k])
        for bead, k in zip(printer.beads, layers, strict=True)
    ]


def straight_runs(beads: list[Bead], turn: float, spacing: float) -> list[list[Bead]]:
    """Group beads into straight runs: beads that follow without a pause, each within an angle [rad] of the first and
    equally wide.

    A run that is shorter than a spacing [m] takes the next bead, too.
    """
    runs: list[list[Bead]] = []
    for bead in beads:
        last = runs[-1][-1] if runs else None
        joined = last and bead.layer == last.layer and abs(last.begin + last.duration - bead.begin) < 1e-6
        if joined and np.allclose(last.end, bead.start, atol=1e-7):
            along, first = bead.end - bead.start, runs[-1][0].end - runs[-1][0].start
            straight = along @ first > np.cos(turn) * np.linalg.norm(along) * np.linalg.norm(first)
            short = np.linalg.norm(last.end - runs[-1][0].start) < spacing
            if short or (straight and abs(bead.width / last.width - 1.0) < 0.05):
                runs[-1].append(bead)
                continue
        runs.append([bead])
    return runs
