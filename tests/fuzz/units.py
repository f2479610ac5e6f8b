"""Texts of a number with a unit, made from a known value, and the same texts damaged."""

import random
from fractions import Fraction

from taichi_mps.spelling import AmbiguousError
from taichi_mps.units import in_unit

MINUS, TIMES, TINY = "-−–", "*·⋅×. ", "\u00a0\u2009\u202f"
RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
WIDE = str.maketrans("0123456789", "０１２３４５６７８９")
PREFIXES = {"M": 6, "k": 3, "": 0, "m": -3, "u": -6, "µ": -6, "μ": -6}
SIZES = {  # of other units in ours, exactly
    "Pa": {p + "Pa": Fraction(10) ** n for p, n in PREFIXES.items()}
    | {"bar": 10**5, "mbar": 100, "psi": Fraction("4.4482216152605") / Fraction("0.0254") ** 2},
    "m": {p + "m": Fraction(10) ** n for p, n in PREFIXES.items() if p != "M"}
    | {"cm": Fraction(1, 100), "dm": Fraction(1, 10), "in": Fraction("0.0254"), "ft": Fraction("0.3048")},
    "s": {"s": 1, "sec": 1, "min": 60, "h": 3600},
    "kg": {"kg": 1, "g": Fraction(1, 1000), "t": 1000, "lb": Fraction("0.45359237")},
    "turn": {"rev": 1, "turn": 1, "U": 1, "°": Fraction(1, 360)},
    "l": {"l": 1, "L": 1, "cc": Fraction(1, 1000), "ml": Fraction(1, 1000)},
}
UNITS = {  # of ours: factor of it and powers of what it is made of
    "Pa": [(1, {"Pa": 1})],
    "m": [(1, {"m": 1})],
    "s": [(1, {"s": 1})],
    "Pa s": [(1, {"Pa": 1, "s": 1}), (1, {"kg": 1, "m": -1, "s": -1})],
    "kg/m3": [(1, {"kg": 1, "m": -3}), (1000, {"kg": 1, "l": -1})],
    "m/s": [(1, {"m": 1, "s": -1})],
    "m3/s": [(1, {"m": 3, "s": -1}), (Fraction(1, 1000), {"l": 1, "s": -1})],
    "Pa/s": [(1, {"Pa": 1, "s": -1})],
    "1/s": [(1, {"s": -1})],
    "rpm": [(60, {"turn": 1, "s": -1}), (60, {"s": -1})],
}


def number(dice: random.Random) -> tuple[Fraction | None, str]:
    """A number and how people write it; None for digits that are two numbers, 1,000."""
    digits = str(dice.randrange(10 ** dice.randint(1, 7)))
    part = str(dice.randrange(10**6))[: dice.randint(1, 6)] if dice.random() < 0.6 else ""
    value = Fraction(f"{digits}.{part}" if part else digits)
    point = dice.choice(".,")
    groups = f"{int(digits):,}".split(",")
    mark = dice.choice(["", "'", "’", *TINY, ",.".replace(point, "")])
    if len(groups) == 2 and not part and mark in ".,":
        mark = ""  # 1.000: one group alone is a decimal point
    text = mark.join(groups) + (point + part if part else "")
    if len(part) == 3 and point == "," and (mark == "" or len(groups) == 1) and len(digits) <= 3 and digits != "0":
        value = None
    if value is not None and dice.random() < 0.3:
        power = dice.randint(-9, 9)
        value *= Fraction(10) ** power
        raised = dice.choice([f"10^{power}", f"10{str(power).translate(RAISED)}", f"10**{power}"])
        text += dice.choice([f"e{power}", f"E{power:+d}", f"x{raised}", f" × {raised}", f"·{raised}"])
    if dice.random() < 0.2:
        value, text = value and -value, dice.choice(MINUS) + text
    return value, text.translate(WIDE) if dice.random() < 0.1 else text


def unit(ours: str, dice: random.Random) -> tuple[Fraction, str]:
    """Size of a unit in ours, and how people write it."""
    size, powers = dice.choice(UNITS[ours])
    above, below = [], []
    size, solidus = Fraction(size), dice.random() < 0.5
    for part, power in powers.items():
        name = dice.choice(list(SIZES[part]))
        size *= Fraction(SIZES[part][name]) ** power
        shown = abs(power) if solidus else power
        exponent = str(shown) if shown != 1 else ""
        if exponent:
            ways = [f"^{exponent}", f"**{exponent}", exponent.translate(RAISED), f"^{{{exponent}}}", f"^({exponent})"]
            exponent = dice.choice([*ways, exponent] if name != "°" else ways)
        (below if solidus and power < 0 else above).append(name + exponent)
    times = dice.choice(TIMES)
    text = times.join(above) or "1"
    if below:
        text += dice.choice(["/", " / "]) + (below[0] if len(below) == 1 else f"({times.join(below)})")
    return size, text


def wrong_spelling(dice: random.Random) -> str | None:
    """A text that is read as another number than it was made from, or is not refused in words; None where none is."""
    ours = dice.choice(list(UNITS))
    value, text = number(dice)
    size, name = unit(ours, dice)
    text += dice.choice([" ", "", "\u00a0"] if not name.startswith("1") else [" "]) + name
    if dice.random() < 0.3:  # damaged: any answer will do that is a number or is in words
        k = dice.randrange(len(text) + 1)
        text = text[:k] + dice.choice("0,.-^/ *()e%²'½Ωx") + text[k + dice.randint(0, 2) :]
        try:
            in_unit(ours, text)
        except ValueError as error:
            return None if "must be" in str(error) else f"{ours}, {text!r}: {error}"
        except Exception as error:
            return f"{ours}, {text!r}: {error!r}"
        return None
    try:
        found = float(in_unit(ours, text))
    except AmbiguousError:
        found = None
    except Exception as error:
        return f"{ours}, {text!r}: must be {value and float(value * size)}, {error!r}"
    right = None if value is None else float(value * size)
    return None if found == right else f"{ours}, {text!r}: must be {right}, is {found}"
