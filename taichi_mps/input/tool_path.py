"""Tool paths of printers: the straight beads that a G-code file lays."""

import re
import warnings
from dataclasses import dataclass, replace
from itertools import groupby, takewhile
from typing import Literal

import numpy as np

from ..units import SceneError, regular_file, require

MAX_BYTES, MAX_NUMBER = 2e7, 1e6  # of a file, of a place, so that an arc has some thousand chords
AXES = "XYZ"
# codes that move nothing while a bead is laid, among them a retraction by the firmware (G10, G11)
IGNORED_CODES = {"G10", "G11", "G17", "G28", "G29", "G40", "G49", "G54", "G61", "G64", "G80", "G94"}
NEUTRAL_CODES = {  # codes that change nothing with one value of one word
    "M200": ("D", 0.0, "E in mm3"),
    "M220": ("S", 100.0, "a fraction of the speed"),
    "M221": ("S", 100.0, "a fraction of the flow"),
}
MOTIONS, PLACED = ("G0", "G1", "G2", "G3"), {"G10", "G28", "G29", "G92"}  # and other codes that may have axes
TEXT_CODES = {"M16", "M23", "M28", "M30", "M32", "M117", "M118", "M928"}  # whose line is text
SUPPORTED_CODES = "must be G0 to G4, G10, G11, G20, G21, G90, G91, G92 E, M82 or M83"
NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)"
BLOCK = re.compile(rf"(?:N\s*\d+\s*)?((?:[A-Z]\s*(?:{NUMBER}\s*)?)*)")
WORD = re.compile(rf"([A-Z])\s*({NUMBER})?")
MACRO = re.compile(r"[A-Z][A-Z0-9]*_\w*")  # name of a command of Klipper
FED_ALONG = re.compile(r"(?im)^[^;(\n]*G\s*0*[123]\b[^;(\n]*[XY][^;(\n]*E")  # a move that feeds
Dialect = Literal["auto", "marlin", "klipper", "reprapfirmware"]
ARC_STEP, ARC_ERROR = np.radians(10.0), 5e-4  # of the chords of an arc: largest angle, distance from it [m]
# height [m] of a bead, speed [m/s], and filament [m] that is fed: less is of rounding, as after a retraction
LEAST_HEIGHT, LEAST_SPEED, LEAST_FED = 1e-6, 1e-9, 1e-9
LEAST_STEP = 0.25  # of the root of a bead's section, by which it lies at least above what it lies on
LEAST_PART = 0.1  # of the length of a bead, over which it lies at least on something


@dataclass(frozen=True)
class Bead:
    """A straight line that a nozzle lays.

    From ``start`` to ``end`` (3,) [m], places of the nozzle, from the time ``begin`` [s] on for ``duration`` [s], with
    a ``volume`` [m3], in layer number ``layer`` from 0 on, at a ``height`` [m] above what lies below it; by a ``line``
    of a file.
    """

    start: np.ndarray
    end: np.ndarray
    begin: float
    duration: float
    volume: float
    layer: int = 0
    height: float = 0.0
    line: int = 0

    @property
    def section(self) -> float:
        """Area [m2] of its section."""
        return self.volume / np.linalg.norm(self.end - self.start)

    @property
    def width(self) -> float:
        """Width [m] of its section, if that is a rectangle as high as the bead."""
        return self.section / self.height


class Printer:
    """State of a printer that executes a G-code file line by line, and the beads that it has laid."""

    def __init__(self, rate, filament, dialect, feeds_along: bool):
        self.rate, self.filament, self.dialect, self.feeds_along = rate, filament, dialect, feeds_along
        self.unit, self.position, self.speed, self.time = 1e-3, np.zeros(3), 0.0, 0.0
        self.extruded = self.max_extruded = 0.0  # length of filament by E, and its largest value so far [m]
        self.absolute, self.absolute_e, self.line = True, True, 0
        self.motion = ""  # code of the last motion, which a line without a code repeats
        self.macros: dict[str, None] = {}  # names of what is no G-code, in their order
        self.beads: list[Bead] = []

    def execute(self, line: str) -> None:
        """Execute the codes of a line; SceneError for an unknown code."""
        text = re.sub(r"\([^)]*\)|[;*].*", "", line).strip().upper()
        if text in ("", "%"):
            return
        if macro := MACRO.match(text):
            self.macros[macro[0]] = None
            return
        block, codes = BLOCK.fullmatch(text), []
        if not block and re.match(r"T|M(?!\s*0*(?:8[23]|200|22[01])\b)", text):  # codes with text, as for a display
            return
        for letter, number in WORD.findall(block[1]) if block else [("", "")]:
            if letter in ("G", "M", "T") and number:
                codes.append((f"{letter}{float(number):g}", {}))
                continue
            require(
                codes or (self.motion and number and not re.search("[GMT]", text)),
                f"{line.strip()[:40]}: cannot be read",
            )
            codes = codes or [(self.motion, {})]
            codes[-1][1][letter] = float(number or "nan")
        for code, words in takewhile(lambda each: each[0] not in TEXT_CODES, codes):
            self.execute_code(code, words)

    def execute_code(self, code: str, words: dict[str, float]) -> None:
        """Execute a code with its words; SceneError for an unknown one."""
        letter, neutral, meaning = NEUTRAL_CODES.get(code, ("", 0.0, ""))
        require(words.get(letter, neutral) == neutral, f"{code}: {meaning}, is not known; {SUPPORTED_CODES}")
        wrong = [w for w, value in words.items() if not abs(value) <= MAX_NUMBER * (1e3 if w in "EFPS" else 1.0)]
        require(
            not wrong or code[0] != "G" or code in IGNORED_CODES,
            f"{code} {''.join(wrong[:1])}: must have a number of at most {MAX_NUMBER:g}, E, F, P, S of 1000 times that",
        )
        if code in MOTIONS:
            self.motion = code
            self.move(code, words)
        elif code in ("G90", "G91"):
            self.absolute = code == "G90"
            self.absolute_e = self.absolute if self.dialect == "marlin" else self.absolute_e
        elif code in ("M82", "M83"):
            self.absolute_e = code == "M82"
        elif code in ("G20", "G21"):
            self.unit = 0.0254 if code == "G20" else 1e-3
        elif code == "G4":
            self.time += words.get("S", 0.0) + 1e-3 * words.get("P", 0.0)
        elif code == "G92":
            require(not words.keys() & set(AXES), f"{code}: moves the origin, is not known; {SUPPORTED_CODES}")
            self.max_extruded += self.unit * words.get("E", 0.0) - self.extruded
            self.extruded = self.unit * words.get("E", 0.0)
        else:
            ignored = code in IGNORED_CODES and not (code == "G10" and words.keys() & {"L", "P", *AXES})
            require(code[0] != "G" or ignored, f"{code}: is not known; {SUPPORTED_CODES}")
        idle = code not in (*MOTIONS, *PLACED) and (code[0] == "G" or code in ("M82", "M83"))
        stray = "".join(word for word in words if idle and word in "XYZEFIJR")
        require(not stray, f"{code} {stray}: must be on a line with G0, G1, G2 or G3")

    def move(self, code: str, words: dict[str, float]) -> None:
        """Move the nozzle along a straight line or an arc, and lay beads where E grows, or where a rate is given."""
        target = self.position.copy()
        for axis in (axis for axis in range(3) if AXES[axis] in words):
            target[axis] = self.unit * words[AXES[axis]] + (0.0 if self.absolute else target[axis])
        self.speed, fed = self.unit * words["F"] / 60.0 if "F" in words else self.speed, 0.0
        if "E" in words:
            self.extruded = self.unit * words["E"] + (0.0 if self.absolute_e else self.extruded)
            fed = self.extruded - self.max_extruded
            fed, self.max_extruded = (fed, self.extruded) if fed > LEAST_FED else (0.0, self.max_extruded)
        places = self.arc(code, target, words) if code in ("G2", "G3") else target[None]
        steps = np.diff(places, axis=0, prepend=self.position[None])
        lengths, flat = np.linalg.norm(steps, axis=1), np.linalg.norm(steps[:, :2], axis=1).sum()
        climb, length = abs(float(target[2] - self.position[2])), float(lengths.sum())
        opens = bool(fed) if self.rate is None or self.feeds_along else code != "G0" and 2.0 * climb < flat
        if length:
            require(self.speed > LEAST_SPEED or code == "G0", f"{code}: must have a speed F above 0, here or before")
            duration = length / self.speed if self.speed > LEAST_SPEED else 0.0
            require(
                not opens or self.filament or self.rate is not None,
                f"{code} E: needs filament_diameter, as of the slicer, or print_rate",
            )
            require(not opens or climb < flat, f"{code}: lays a bead that rises; must rise by less than 45 degrees")
            volume = opens * (
                fed * 0.25 * np.pi * (self.filament or 0.0) ** 2 if self.rate is None else self.rate * duration
            )
            for start, place, part in zip([self.position, *places], places, lengths / length, strict=False):
                if volume and part:
                    self.beads.append(Bead(start, place, self.time, part * duration, part * volume, line=self.line))
                self.time += part * duration
        self.position = target

    def arc(self, code: str, target, words) -> np.ndarray:
        """Return the ends of chords (n, 3) [m] of an arc or a helix to a target, about (I, J) or with a radius R."""
        require("P" not in words, f"{code} P: more circles than one are not known; must be left out")
        start, chord = self.position[:2], target[:2] - self.position[:2]
        if "R" in words:
            radius, half = self.unit * words["R"], 0.5 * float(np.linalg.norm(chord))
            require(0.0 < half <= 1.001 * abs(radius), f"{code}: R must be at least half of the way to its end")
            side = np.copysign(max(radius**2 - half**2, 0.0) ** 0.5, radius) * (1.0 if code == "G3" else -1.0)
            centre = start + 0.5 * chord + side * np.array((-chord[1], chord[0])) / (2.0 * half)
        else:
            centre = start + self.unit * np.array([words.get("I", 0.0), words.get("J", 0.0)])
        from_centre = np.array([start - centre, target[:2] - centre])
        (first, last), (near, far) = np.arctan2(*from_centre.T[::-1]), np.linalg.norm(from_centre, axis=1)
        require(near and abs(far - near) < 0.01 * near + 1e-5, f"{code}: its end does not lie on its circle")
        sign = 1.0 if code == "G3" else -1.0
        angle = (sign * (last - first) - 1e-6) % (2.0 * np.pi) + 1e-6  # a full circle where it ends at its start
        step = min(ARC_STEP, (8.0 * ARC_ERROR / near) ** 0.5)
        along = np.linspace(0.0, 1.0, int(np.ceil(angle / step - 1e-6)) + 1)[1:, None]
        turned, radius = first + sign * angle * along, near + (far - near) * along
        level = self.position[2] + along * (target[2] - self.position[2])
        return np.hstack([centre + radius * np.hstack([np.cos(turned), np.sin(turned)]), level])


def dialect_of(path) -> str:
    """Return the firmware that a G-code file names; klipper where it names none."""
    text = regular_file(f"gcode {path}", path, MAX_BYTES).read_text(encoding="utf-8-sig", errors="replace").lower()
    named = {"klipper": "klipper|exclude_object", "reprapfirmware": "reprapfirmware|duet", "marlin": "marlin"}
    return next((name for name, words in named.items() if re.search(words, text)), "klipper")


def read_gcode(path, rate=None, filament=None, dialect: Dialect = "auto") -> list[Bead]:
    """Read the beads that a G-code file lays.

    Parameters
    ----------
    path : path-like
        File; lengths are in millimetres, or inches after G20. Codes M and T of heaters and fans are ignored, and so is
        filament fed while the nozzle stands; commands of Klipper are ignored with a warning.
    rate : float, optional
        Flow rate of the nozzle [m3/s] where E grows or, in a file without E, in G1, G2 and G3; by default E gives the
        amount.
    filament : float, optional
        Diameter [m] of the filament whose length is E.
    dialect : {'auto', 'marlin', 'klipper', 'reprapfirmware'}, optional
        Firmware. With Marlin G90 and G91 hold for E, too. By default the one that the file names, else Klipper.

    Returns
    -------
    list of Bead
        In the order of time; 0 s is where the first begins. The nozzle is as fast as F says at once; before the first F
        a G0 takes no time. An arc is a row of chords.

    Raises
    ------
    SceneError
        With the line of an unsupported code, or of a bead that rises steeply or lies at 0 m; or if no bead is laid.
    """
    text = regular_file(f"gcode {path}", path, MAX_BYTES).read_text(encoding="utf-8-sig", errors="replace")
    dialect = dialect_of(path) if dialect == "auto" else dialect
    printer = Printer(rate, filament, dialect, bool(FED_ALONG.search(text)))
    for printer.line, line in enumerate(text.split("\n"), 1):
        try:
            printer.execute(line)
        except SceneError as error:
            raise SceneError(f"gcode {path}, line {printer.line}: {error}") from None
    if printer.macros:
        warnings.warn(f"gcode {path}: not executed: {', '.join(printer.macros)}", stacklevel=2)
    require(printer.beads, f"gcode {path}: lays nothing; G1 must have E, or print_rate be given")
    z, line = min((max(bead.start[2], bead.end[2]), bead.line) for bead in printer.beads)
    require(z > LEAST_HEIGHT, f"gcode {path}, line {line}: lays a bead at z = {z:g} m; must be above 0 m")
    beads = levelled(printer.beads, path)
    heights = heights_above_what_lies_below(beads)
    _, layers = np.unique(np.round([[bead.end[2] for bead in beads], heights], 7), axis=1, return_inverse=True)
    return [
        replace(bead, begin=bead.begin - beads[0].begin, layer=int(k), height=height)
        for bead, k, height in zip(beads, layers.ravel(), heights, strict=True)
    ]


def levelled(beads: list[Bead], path) -> list[Bead]:
    """Return beads with each turn of a line that rises, a spiral vase, laid level where it ends; SceneError for a line
    that rises and makes no whole turns, which are those of its direction in plan."""
    found = []
    for rises, group in groupby(beads, lambda bead: bead.start[2] != bead.end[2]):
        line = list(group)
        if rises:
            points = np.array([line[0].start, *(bead.end for bead in line), line[0].end])
            (x, y), z = np.diff(points[:, :2], axis=0).T, points[:-1, 2]
            corners = (np.diff(np.arctan2(y, x)) + np.pi) % (2.0 * np.pi) - np.pi  # with that from the end to the start
            turns = round(abs(corners.sum()) / (2.0 * np.pi))
            gap, most = np.linalg.norm((points[-2] - points[0])[:2]), 0.5 * line[0].section ** 0.5
            rise = round((z[-1] - z[0]) / max(turns, 1), 7)
            require(
                turns and rise > 0.0 and gap <= most,
                f"gcode {path}, line {line[0].line}: a bead rises at z = {z[0]:g} m; must be level, or a spiral of "
                "whole turns that ends above its start",
            )
            tops = z[0] + rise * np.ceil((0.5 * (z[1:] + z[:-1]) - z[0]) / rise - 1e-6)
            line = [
                replace(bead, start=np.array([*bead.start[:2], top]), end=np.array([*bead.end[:2], top]))
                for bead, top in zip(line, tops, strict=True)
            ]
        found += line
    return found


def heights_above_what_lies_below(beads: list[Bead]) -> list[float]:
    """Return the height [m] of each bead above the highest of what was laid before and lies below its centre line, or
    above the floor.

    A map holds the top of what lies in each cell, and what lies below that: beads beside it in the same layer, or the
    last part of a line that rises, are nothing that a bead lies on.
    """
    ends = np.array([place[:2] for bead in beads for place in (bead.start, bead.end)])
    roots = np.array([bead.section for bead in beads]) ** 0.5
    cell = max(0.25 * float(np.median(roots)), 0.01 * float(roots.max()), float(np.ptp(ends, axis=0).max()) / 2000)
    low, heights = ends.min(0), []
    margin = int(np.ceil(float(roots.max()) / cell)) * 4 + 1
    tops = np.zeros((2, *(np.ceil(np.ptp(ends, axis=0) / cell).astype(int) + 2 * margin + 1)))  # top, and below it
    for bead in beads:
        count = int(np.ceil(np.linalg.norm(bead.end - bead.start) / cell)) + 1
        places, least = np.linspace(bead.start, bead.end, count), max(LEAST_STEP * bead.section**0.5, LEAST_HEIGHT)
        cells, z = np.round((places[:, :2] - low) / cell).astype(int) + margin, places[:, 2]
        gaps = z - tops[:, cells[:, 0], cells[:, 1]]
        gaps = np.where(gaps[0] >= least, gaps[0], np.where(gaps[1] >= least, gaps[1], z))
        heights.append(float(np.quantile(gaps, LEAST_PART, method="higher").round(7)))
        half = min(margin, int(0.5 * bead.section / heights[-1] / cell))
        square = np.stack(np.mgrid[-half : half + 1, -half : half + 1], -1).reshape(-1, 2)
        some = np.r_[0 : count : max(1, half // 4), count - 1]  # whose squares overlap
        around, at = (cells[some, None] + square).reshape(-1, 2).T, np.repeat(z[some], len(square))
        above = at - tops[0][tuple(around)] >= least
        tops[1][tuple(around[:, above])] = tops[0][tuple(around[:, above])]
        tops[0][tuple(around)] = at
    return heights


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
