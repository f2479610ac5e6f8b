"""Any G-code is read as the firmware would, in each of its spellings, or refused in one line. Drawn; thousands by
``pytest -n0 tests/scenes/test_tool_paths.py --hypothesis-profile thorough``."""

import contextlib
import random
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import taichi_mps as mps
from taichi_mps.input.tool_path import read_gcode

if settings.get_current_profile_name() in ("default", "ci"):
    settings.load_profile("quick")

FILAMENT = 0.004  # [m]
NOISE = [
    "",
    "",
    "",
    "; G1 X500 E5",
    "M117 G1 X9 E9",
    "m104 S200",
    "T0",
    "G4 P0",
    "M220 S100",
    "(G1 Y9)",
    "%",
    "N8 ; E9",
]
PLACE = (st.integers(-3000, -1) | st.integers(1, 3000)).map(lambda tenths: 0.1 * tenths)  # [mm]
KINDS = ["travel", "bead", "quarter", "three quarters", "circle", "spiral", "retract", "prime"]
TURNS = {"quarter": 0.25, "three quarters": 0.75, "circle": 1.0, "spiral": 1.0}
STEPS = st.tuples(
    st.sampled_from(KINDS), PLACE, PLACE, st.sampled_from([5.0, 40.0, 131.25]), st.sampled_from([5.0, 10.0, 12.5])
)


def move(kind, x, y, fed, rise):
    """Code, step (3,) [mm], filament [mm], and of an arc its centre (3,) [mm] and radius, negative for a long one."""
    centre, turned, up = np.array([[x, y, 0.0], [y, -x, 0.0], [0.0, 0.0, rise]])
    return {
        "travel": ("G0", centre + up, 0.0, None, 0.0),
        "bead": ("G1", centre, fed, None, 0.0),
        "quarter": ("G3", centre + turned, fed, centre, np.hypot(x, y)),
        "three quarters": ("G2", centre + turned, fed, centre, -np.hypot(x, y)),
        "circle": ("G3", 0.0 * up, fed, centre, 0.0),
        "spiral": ("G2", up, fed, centre, 0.0),
        "retract": ("G1", 0.0 * up, -rise, None, 0.0),
        "prime": ("G1", 0.0 * up, rise, None, 0.0),
    }[kind]


def text_of(path, dice):
    """Lines of moves in modes, units, orders and words that change nothing."""
    lines, place, extruded, motion = ["G1 F6000"], np.zeros(3), 0.0, ""
    unit, relative, relative_e = 1.0, False, False
    for code, step, fed, centre, radius in path:
        if dice.random() < 0.4:
            unit, relative, relative_e = dice.choice([1.0, 25.4]), dice.random() < 0.5, dice.random() < 0.5
            modes = "G20" if unit > 1.0 else "G21", "G91" if relative else "G90", "M83" if relative_e else "M82"
            lines.append(dice.choice(" \n").join(modes))
        if dice.random() < 0.1:
            extruded = dice.choice([0.0, 25.4])
            lines.append(f"G92 E{extruded / unit}")
        words = {axis: step[k] + place[k] * (not relative) for k, axis in enumerate("XYZ") if step[k]}
        words |= {"F": 6000.0} | ({"E": fed + extruded * (not relative_e)} if fed else {})
        if centre is not None:
            words |= {"R": radius} if radius and dice.random() < 0.5 else {"I": centre[0], "J": centre[1]}
        numbers = {letter: f"{number / unit:.9f}" for letter, number in words.items()}
        parts = [letter + dice.choice(["", " "]) + dice.choice([n, n.rstrip("0"), f"+{n}".replace("+-", "-")])
                 for letter, n in numbers.items()]  # fmt: skip
        head = [] if code == motion and dice.random() < 0.3 else [dice.choice([code, f"{code[0].lower()}0{code[1]}"])]
        line = dice.choice(["", " ", "\t"]).join([*head, *dice.sample(parts, len(parts))])
        lines += [
            dice.choice(NOISE),
            dice.choice(["", "N12 "]) + line + dice.choice(["", " ; E9", "*71", "(X9)", "\r"]),
        ]
        place, extruded, motion = place + step, extruded + fed, code
    return "\n".join(lines)


def read(folder, text, **how):
    """Beads of a text, or the refusal without its line; checks what holds of any beads, and of any refusal."""
    file = folder / "part.gcode"
    file.write_text(text, encoding="utf-8", newline="")
    try:
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            beads = read_gcode(file, **{"filament": FILAMENT} | how)
    except mps.SceneError as refusal:
        said = re.fullmatch(r"gcode .*part.gcode(?:, line \d+)?: (.*)", str(refusal))
        assert ", line" in said[0] or said[1].startswith("lays nothing")
        return said[1]
    sizes = np.array([[b.volume, b.height, b.section, b.width] for b in beads])
    assert np.isfinite(sizes).all() and sizes.min() > 0.0
    assert np.isfinite([[*b.start, *b.end, b.end[2] >= b.height - 1e-7 or np.nan] for b in beads]).all()
    assert np.diff([time for b in beads for time in (b.begin, b.begin + b.duration)]).min() >= -1e-9
    return beads


@pytest.mark.filterwarnings("ignore:gcode")
@given(steps=st.lists(STEPS, min_size=1, max_size=8), seed=st.integers(0, 10**9))
def test_a_path_is_the_same_in_all_its_spellings(tmp_path_factory, steps, seed):
    """All filament fed along a line is laid, along all of its length, to 0.2 % of arcs, and within the box of the path,
    whatever the modes, units and words."""
    path, dice = [move("travel", 1.0, 1.0, 0.0, 10.0), *(move(*step) for step in steps)], random.Random(seed)
    dialects = ["auto", "marlin", "klipper", "reprapfirmware"]
    texts = [(text_of(path, dice), {"dialect": dice.choice(dialects)}) for _ in range(2)]
    one, other = (read(tmp_path_factory.getbasetemp(), text, **how) for text, how in texts)
    tops = np.maximum.accumulate(np.cumsum([0.0] + [fed for _, _, fed, _, _ in path]))
    laid = np.diff(tops) * [centre is not None or step.any() for _, step, _, centre, _ in path]
    if isinstance(one, str) or isinstance(other, str):
        assert one == other and (not laid.any() or "spiral" in {kind for kind, *_ in steps}), (one, other)
        return
    lengths = [0.0] + [np.hypot(x, y) * 2.0 * np.pi * TURNS.get(kind, 0.5 / np.pi) for kind, x, y, *_ in steps]
    assert sum(b.volume for b in one) == pytest.approx(1e-3 * laid.sum() * np.pi * 0.25 * FILAMENT**2)
    assert sum(np.linalg.norm(b.end - b.start) for b in one) == pytest.approx(1e-3 * (laid > 0.0) @ lengths, rel=2e-3)
    places = np.cumsum([step for _, step, *_ in path], axis=0)
    reach = 2.0 * max(np.hypot(x, y) * (kind in TURNS) for kind, x, y, *_ in steps)
    for a, b in zip(one, other, strict=True):
        ends = 1e3 * np.array([a.start, a.end])
        assert (ends > places.min(0) - reach - 1e-3).all() and (ends < places.max(0) + reach + 1e-3).all()
        assert np.array([*a.start, *a.end, a.begin, a.duration]) == pytest.approx(
            np.array([*b.start, *b.end, b.begin, b.duration]), abs=1e-7
        )
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
GOOD = re.split(
    r"[|\n]",
    """M83|G1 Z10 F6000|G1 X100 E50|G3 X0 Y100 I-100 E20|G2 X100 Y0 R-100 E30|G1 Y-50 E7|G92 E0|G1 E-5|G0 X0 Z20
G1 E5|M82|G1 X90 E40|G3 X0 Y90 I-90 Z25 E70|G3 I0 J-90 Z30 E90|G1 X50 Z10.5 E3""",
)
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
        with contextlib.suppress(mps.SceneError):
            mps.catalogue.build("printing", gcode=str(folder / "part.gcode"), spacing=spacing, **options)
