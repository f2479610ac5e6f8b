"""Verdict on a run in one sentence, from its summary alone: whether it fills, passes or stands, its class, or whether
it is at rest."""

from math import inf

from ..input.labels import title, written

# {test: (its keywords as the standard has them, lengths [m], {result: classes of EN 206: name, least, largest value})},
# of lengths [m] to 10 mm and times [s]
CLASSES = {
    "slump": (
        {"height": 0.3, "base_diameter": 0.2, "top_diameter": 0.1},
        {
            "spread_m": (("SF1", 0.55, 0.65), ("SF2", 0.66, 0.75), ("SF3", 0.76, 0.85)),
            "slump_max_m": (
                ("S1", 0.01, 0.04),
                ("S2", 0.05, 0.09),
                ("S3", 0.1, 0.15),
                ("S4", 0.16, 0.21),
                ("S5", 0.22, inf),
            ),
        },
    ),
    "flow_table": (
        {"table": "hinged", "jolts": 15, "height": 0.2, "base_diameter": 0.2, "top_diameter": 0.13, "until": None},
        {
            "spread_m": (
                ("F1", 0.2, 0.34),
                ("F2", 0.35, 0.41),
                ("F3", 0.42, 0.48),
                ("F4", 0.49, 0.55),
                ("F5", 0.56, 0.62),
                ("F6", 0.63, inf),
            )
        },
    ),
    "v_funnel": (
        {"top": 0.515, "outlet": 0.065, "thickness": 0.075, "taper": 0.45, "spout": 0.15},
        {"flow_time_s": (("VF1", 0.0, 8.99), ("VF2", 9.0, 25.0))},
    ),
}
LIMITS = {  # {test: result, least and largest value, and who asks for it}
    "l_box": ("passing_ratio", 0.8, inf, "EN 206 asks for 0.80"),
    "u_box": ("h2_m", 0.3, inf, "JSCE asks for 30 cm"),
    "j_ring": ("blocking_step_m", -inf, 0.01, "EN 206 allows 1 cm"),
}
FULL = 0.97  # fraction of what is poured, from which on a form is full
EMPTY = 0.05  # fraction of its height, below which an end is empty
SPILT = 0.02  # fraction of what was poured, above which a form of any shape overflows
ENDS = {"near_m": "hose", "far_m": "far end"}  # levels of a form, and where they are


def verdict(found: dict) -> str:
    """Sentence on what a run tells its user; empty for one that was cut off, and for a rheometer."""
    if found["stopped_by"] not in ("rest", "unyielded", "time") or "steady_torque_N_m" in found:
        return ""
    known = found.get("parameters", {})
    text = filling(found, known) or passing(found, known) or standing(found) or classes(found, known)
    rest = f"{'Not at' if found['stopped_by'] == 'time' else 'At'} rest after {found['simulated_seconds']:.3g} s"
    return f"{text or rest}."


def filling(found: dict, known: dict) -> str:
    """Return whether a form is filled, which end is empty, and by how much it overflows."""
    if "filled_ratio" not in found:
        return ""
    ratio, rim, spare = found["filled_ratio"], known.get("height", inf), 0.5 * known.get("spacing", 0.0)
    fills = "Fills" if ratio > FULL * known.get("fill_ratio", 1.0) else "Does not fill"
    levels = [(found[key], place) for key, place in ENDS.items() if found.get(key) is not None]
    told = [f", the {place} is empty" for level, place in levels if level < EMPTY * rim]
    told += [
        f"; the concrete stands {100.0 * (level - rim):.0f} cm above the rim at the {place}: it overflows"
        for level, place in levels
        if level > rim + spare
    ]
    above, rests = found.get("above_m3", 0.0), found["stopped_by"] == "rest"
    if rests and not levels and above > SPILT * found.get("poured_m3", inf):
        told += [f"; {written('above_m3', above)} stand above the rim: it overflows"]
    return f"{fills}: {100.0 * ratio:.0f} % after {found['simulated_seconds']:.3g} s{''.join(told)}"


def passing(found: dict, known: dict) -> str:
    """Return whether a mix passes the bars of its test, as a standard asks for."""
    key, least, most, asked = LIMITS.get(found["scene"], ("", 0.0, 0.0, ""))
    if found.get(key) is None or known.get("bars") in ("none", "no") or found.get("grains"):
        return ""
    passes = (
        "Passes as a fluid, without grains that jam"
        if least <= found[key] <= most
        else "Does not pass" + " so far" * (found["stopped_by"] == "time")
    )
    return f"{passes}: {title(key)} {written(key, found[key])}, {asked}"


def standing(found: dict) -> str:
    """Return whether what was printed stands."""
    if found["scene"] != "printing":
        return ""
    fallen, height = found.get("failure_height_m"), found["height_m"]
    return (
        f"Stands: {written('height_m', height)} high"
        if fallen is None
        else f"Collapses at {written('height_m', fallen)}"
    )


def classes(found: dict, known: dict) -> str:
    """Return the class by EN 206 of a mix in the vessel of the standard, or that the funnel does not run empty."""
    vessel, results = CLASSES.get(found["scene"], ({}, {}))
    if found.get("flow_time_s", 0.0) is None:
        return f"Does not run out: {written('left_m3', found['left_m3'])} are left in the funnel"
    texts = [
        f"Class {name} of EN 206: {title(key)} {written(key, found[key])}"
        for key, rows in results.items()
        for name, least, most in rows
        if found.get(key) is not None and least <= round(found[key], 2) <= most and vessel.items() <= known.items()
    ]
    return texts[0] if texts else ""
