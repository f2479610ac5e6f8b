"""How keywords and results are shown: their names in words, with unit and digits."""

# of a result by the end of its name: factor, unit, digits; the longer end first
UNITS = {"_m_s": (1.0, "m/s", ".3g"), "_m3": (1e3, "l", ".3g"), "_ratio": (1.0, "", ".3f")}
UNITS |= {"_m": (100.0, "cm", ".2f"), "_s": (1.0, "s", ".2f")}
WORDS = {"yield_value": "yield stress"}  # keys that people read otherwise


def in_words(key: str) -> str:
    """A keyword or a column as people read it."""
    return WORDS.get(key, key.replace("_", " "))


def is_measure(name: str) -> bool:
    """Whether a name ends with the unit of a result."""
    return name.endswith(tuple(UNITS))


def unit_of_measure(name: str) -> tuple[float, str, str]:
    """Factor, unit and format in which a result is shown."""
    return next(shown for end, shown in UNITS.items() if name.endswith(end))


def title(name: str) -> str:
    """The name of a result in words."""
    end = next(end for end in UNITS if name.endswith(end))
    return name.removesuffix("" if end == "_ratio" else end).replace("_", " ")


def written(name: str, value: float) -> str:
    """A result with its unit."""
    factor, unit, digits = unit_of_measure(name)
    return f"{factor * value:{digits}} {unit}".rstrip()
