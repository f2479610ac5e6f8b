"""Any G-code is read as the firmware would, in each of its spellings, or refused in one line. Drawn; thousands by
``pytest -n0 tests/scenes/test_tool_paths.py --hypothesis-profile thorough``."""

import random
import re

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

import taichi_mps as mps
from taichi_mps.input.tool_path import read_gcode

if settings.get_current_profile_name() == "default":
    settings.load_profile("quick")

FILAMENT = 0.004  # [m]
NOISE = ("", "; G1 X500 E5", "M117 G1 X9 E9", "m104 S200", "T0", "G4 P0", "M220 S100", "(G1 Y9)", "%", "N7 M106 S25*33")
PLACE = st.integers(-3000, 3000).map(lambda tenths: 0.1 * tenths)  # [mm]
STEPS = st.tuples(
    st.sampled_from(["travel", "bead", "bead", "arc", "circle", "spiral", "retract", "prime"]),
    PLACE,
    PLACE,
    st.sampled_from([60, 90, 120, 240, 300]),  # of an arc [degrees]
    st.sampled_from([0.2, 1.0, 2.125]),  # of filament a length of a bead
    st.sampled_from([5.0, 10.0, 12.5]),  # a level up [mm]
)


def moves(steps):
    """Moves of steps: code, end (3,) [mm], filament [mm], and of an arc its centre and radius."""
    place, found = np.zeros(3), [("G0", np.array([0.0, 0.0, 10.0]), 0.0, None, 0.0)]
    for kind, x, y, angle, ratio, rise in steps:
        place, end = found[-1][1], found[-1][1].copy()
        offset, sweep = np.array([x, y, 0.0]), angle if kind == "arc" else 360
        radius, code = float(np.hypot(x, y)), "G3" if x > 0 else "G2"
        if kind in ("travel", "bead"):
            end[:2], end[2] = (x, y), end[2] + rise * (kind == "travel")
            length = np.linalg.norm(end - place)
            found.append(("G1" if kind == "bead" else "G0", end, ratio * length * (kind == "bead"), None, 0.0))
        elif kind in ("retract", "prime"):  # nothing is laid where the nozzle stands
            found += [("G1", end, amount, None, 0.0) for amount in ((-rise, rise) if kind == "retract" else (rise,))]
        elif radius > 1.0:
            turn = np.radians(sweep if code == "G3" else -sweep)
            rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            if kind == "arc":
                end[:2] = (place + offset)[:2] - rotation @ offset[:2]
            end[2] += rise * (kind == "spiral")
            signed = radius * (0.0 if kind != "arc" else 1.0 if sweep < 180 else -1.0)
            found.append((code, end, ratio * radius * abs(turn), offset, signed))
    return found


def spelled(number, dice):
    """A number as a slicer or a person writes it."""
    text = f"{number:.9f}"
    return dice.choice([text, text.rstrip("0"), text.rstrip("0").rstrip("."), re.sub(r"^(-?)0\.", r"\1.", text)])


def text_of(path, dice):
    """Lines of moves in modes, units, orders and words that change nothing."""
    lines, place, extruded, motion = ["G1 F6000"], np.zeros(3), 0.0, ""
    unit, relative, relative_e = 1.0, False, False
    for code, end, fed, offset, signed in path:
        if dice.random() < 0.4:
            unit, relative, relative_e = dice.choice([1.0, 25.4]), dice.random() < 0.5, dice.random() < 0.5
            modes = ["G20" if unit > 1.0 else "G21", "G91" if relative else "G90", "M83" if relative_e else "M82"]
            lines += modes if dice.random() < 0.5 else [" ".join(modes)]
        lines += dice.sample(NOISE, dice.choice([0, 0, 1, 2]))
        if dice.random() < 0.1:
            extruded = dice.choice([0.0, 25.4])
            lines.append(f"G92 E{spelled(extruded / unit, dice)}")
        words = {axis: (end[k] - relative * place[k]) / unit for k, axis in enumerate("XYZ") if end[k] != place[k]}
        words |= {"E": (fed + (0.0 if relative_e else extruded)) / unit} if fed else {}
        if offset is not None:
            by_radius = signed and dice.random() < 0.5
            words |= {"R": signed / unit} if by_radius else {"I": offset[0] / unit, "J": offset[1] / unit}
        words["F"] = 6000.0 / unit
        gap, blank = dice.choice(["", " "]), dice.choice(["", " ", "\t"])
        parts = [f"{letter}{gap}{spelled(number, dice)}" for letter, number in words.items()]
        head = [] if code == motion and dice.random() < 0.3 else [dice.choice([code, f"{code[0]}0{code[1]}"])]
        line = blank.join([*head, *dice.sample(parts, len(parts))])
        line = dice.choice(["", "", "N12 ", "n12"]) + dice.choice([line, line.lower()])
        lines.append(line + dice.choice(["", "", " ; E9", "*71", "(X9 E9)", "\r"]))
        place, extruded, motion = end, extruded + fed, code
    return "\n".join(lines)


def read(folder, text, **how):
    """Beads of a text, or the refusal without its line; checks what holds of any beads, and of any refusal."""
    file = folder / "part.gcode"
    file.write_text(text, encoding="utf-8", newline="")
    try:
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            beads = read_gcode(file, **{"filament": FILAMENT} | how)
    except mps.SceneError as refusal:
        event(re.sub(r"[-\d.e+]+", "0", str(refusal).partition(str(file))[2])[:40])
        assert "\n" not in str(refusal)
        assert re.search(r", line \d+: |lays nothing|lays a bead at z = |a bead rises at z = ", str(refusal))
        return str(refusal).rpartition("line")[2].partition(":")[2]
    event("read")
    numbers = [[*b.start, *b.end, b.begin, b.duration, b.volume, b.height, b.section, b.width] for b in beads]
    assert np.isfinite(numbers).all() and min(min(b.volume, b.height, b.width) for b in beads) > 0.0
    assert min(b.duration for b in beads) >= 0.0 and (np.diff([b.begin for b in beads]) >= 0.0).all()
    assert min(b.end[2] - b.height for b in beads) > -1e-7
    return beads


@pytest.mark.filterwarnings("ignore:gcode")
@given(steps=st.lists(STEPS, min_size=1, max_size=8), seed=st.integers(0, 10**9))
def test_a_path_is_the_same_in_all_its_spellings(tmp_path_factory, steps, seed):
    """All filament fed along a line is laid, within the box of the path, whatever the modes, units and words."""
    folder, dice, path = tmp_path_factory.getbasetemp(), random.Random(seed), moves(steps)
    dialects = ("auto", "marlin", "klipper", "reprapfirmware")
    one, other = (read(folder, text_of(path, dice), dialect=dice.choice(dialects)) for _ in range(2))
    places = [np.zeros(3), *(end for _, end, *_ in path)]
    fed = [fed for before, (_, end, fed, offset, _) in zip(places, path, strict=False)
           if fed > 0.0 and (offset is not None or (end != before).any())]  # fmt: skip
    if isinstance(one, str) or isinstance(other, str):
        assert one == other and (not fed or any(kind == "spiral" for kind, *_ in steps)), (one, other)
        return
    assert sum(b.volume for b in one) == pytest.approx(1e-3 * sum(fed) * np.pi * 0.25 * FILAMENT**2)
    reach = max(0.0 if offset is None else 2.0 * np.linalg.norm(offset) for *_, offset, _ in path) + 1e-6
    inside = 1e-3 * np.array([np.min(places, axis=0) - reach, np.max(places, axis=0) + reach])
    for a, b in zip(one, other, strict=True):
        assert (inside[0] <= [a.start, a.end]).all() and ([a.start, a.end] <= inside[1]).all()
        for x, y in ((a.start, b.start), (a.end, b.end), (a.begin, b.begin), (a.duration, b.duration)):
            assert x == pytest.approx(y, abs=1e-7)
        assert a.volume == pytest.approx(b.volume) and (a.height, a.layer) == (b.height, b.layer)


NUMBERS = st.sampled_from(
    ["", "0", "1", "10", "20.5", "-7", "+3", ".5", "5.", "100", "1e3", "-0", "0.0000001", "." + "0" * 300 + "1"]
    + [
        "12345",
        "1" + "0" * 8,
        "9" * 10,
        "9" * 30,
        "9" * 400,
        "-" + "9" * 400,
        "--1",
        "1.2.3",
        "0x10",
        "nan",
        "inf",
        "\u0663",
        "1,5",
    ]
)
WORDS = st.tuples(st.sampled_from("XXYYZZEEEFFIJRSPNKA*"), NUMBERS).map("".join)
CODES = """G0 G1 G1 G1 G1 G2 G3 G4 G10 G11 G20 G21 G28 G90 G91 G92 M82 M83 M200 M220 M221 M117 M104 T0 G5 G18 G1.5 G-1 G
N10 PAUSE SET_X % ( ) ; * \u00e9 G1X10E5 G1Y10E5"""
GOOD = """M83|G1 Z10 F6000|G1 X100 E50|G3 X0 Y100 I-100 E20|G2 X100 Y0 R-100 E30|G1 Y-50 E7|G92 E0|G1 E-5|G0 X0 Z20
G1 E5|M82|G1 X90 E40|G3 X0 Y90 I-90 Z25 E70|G3 I0 J-90 Z30 E90|G1 X50 Z10.5 E3"""
GOOD = re.split(r"[|\n]", GOOD)
KNOWN = st.sampled_from(GOOD)
LINES = st.lists(st.sampled_from(CODES.split()) | WORDS, max_size=6).map(" ".join) | st.just("\u2028")
LINES |= KNOWN | st.tuples(KNOWN, WORDS).map(" ".join)  # a known line with another word


@pytest.mark.filterwarnings("ignore:gcode")
@given(
    st.lists(LINES, max_size=8),
    st.booleans(),
    st.integers(0, 200),
    st.sampled_from([{}, {}, {"rate": 1e-6}, {"filament": None}, {"dialect": "marlin"}]),
)
def test_any_text_is_read_or_refused_by_its_line(tmp_path_factory, lines, begun, cut, how):
    """A file of any words, or that ends within a line, gives beads or one line; so does the scene of its beads."""
    text, folder = "\n".join(GOOD[:3] * begun + lines), tmp_path_factory.getbasetemp()
    found = read(folder, text[: len(text) - cut % 11 if cut < 100 else None], **how)
    if not isinstance(found, str):
        spacing = min(max(0.2 * min(b.height for b in found), 1e-4), 1.0)
        options = {"print_rate": how.get("rate"), "filament_diameter": how.get("filament", FILAMENT)}
        try:
            mps.catalogue.build("printing", gcode=str(folder / "part.gcode"), spacing=spacing, **options)
        except mps.SceneError as refusal:
            event("scene: " + re.sub(r"[-\d.e+]+", "0", str(refusal))[-60:])
            assert "\n" not in str(refusal)
