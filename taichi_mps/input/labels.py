"""Labels of keywords and results: name in the field's words, unit, digits and meaning."""

import re

from ..engine import COMMON_NUMBERS, LAWS, chooses_law, numbers_of
from ..units import quote, unit_of

# results by the end of their names: factor, unit, format; longer ends first
UNITS = {
    "_N_m_per_m": (1.0, "N m/m", ".4g"),
    "_N_per_m": (1.0, "N/m", ".4g"),
    "_N_m": (1.0, "N m", ".4g"),
    "_N": (1.0, "N", ".4g"),
    "_Pa": (1e-3, "kPa", ".3g"),
    "_m_s": (1.0, "m/s", ".3g"),
    "_m3_per_m": (1e3, "l/m", ".3g"),
    "_m2": (1.0, "m2", ".4g"),
    "_kg": (1.0, "kg", ".4g"),
    "_deg": (1.0, "degrees", ".3g"),
    "_1_s": (1.0, "1/s", ".3g"),
    "_m3": (1e3, "l", ".3g"),
    "_ratio": (1.0, "", ".3f"),
    "_number": (1.0, "", ".0f"),
    "_m": (100.0, "cm", ".1f"),
    "_s": (1.0, "s", ".2f"),
}
CONSTANT_UNITS = {  # of the numbers of a mix
    **{name: unit_of(field) for law in LAWS for name, field in numbers_of(law).items()},
    "friction_angle": "degrees",
}
KEYWORDS = {  # descriptions of keywords of many scenes
    "spacing": "particle size; half of it takes 16 times as long in space",
    "until": "time limit of the flow; it ends before where the concrete stops flowing",
    "model": "how much of the test is computed: all of it, a part between mirror planes, or a section",
    "accuracy": "wanted error of the result; chooses model and particle size",
    "lift_speed": "speed at which the mould or gate is lifted, by default gone at once",
    "sides": "upright walls without friction (smooth) or to which concrete sticks (rough)",
}
KEYWORD_TEXTS = {
    "yield_value": "yield stress",
    "spacing": "particle size",
    "until": "time limit",
    "structuration": "growth of the yield stress at rest",
    "destructuration": "loss of that growth by shear",
    "sleep": "skip what stands still",
    "passes": "outer iterations",
    "every": "time between pictures",
    "grains": "diameter of grains (stones)",
    "grains_volume": "volume fraction of grains",
    "grains_density": "density of grains",
    "grains_friction": "friction of grains",
    "grains_seed": "seed of grains",
    "j_ring": "J-ring",
    "l_box": "L-box",
    "u_box": "U-box",
    "l_flow": "L-flow",
    "v_funnel": "V-funnel",
    "lcpc_box": "LCPC box",
}
OPTIONS = {  # names of options by keyword
    "yield_value": "yield-stress",
    "spread": "slump-flow",
    "spread_error": "slump-flow-error",
    "rho": "density",
    "passes": "outer-iterations",
}
STOP_REASONS = {  # reasons by the words of ``stopped_by``
    "rest": "concrete stopped flowing",
    "unyielded": "concrete stopped flowing",
    "time": "time limit",
    "interrupted": "stopped by you",
    "diverged": "computation failed",
    "edge of the domain": "concrete left the computed space",
}
RESULTS = {  # key: (name, what it is)
    "slump_m": ("slump", "how far the middle of the top has sunk, as read with a ruler at the axis"),
    "slump_max_m": (
        "slump at the highest point",
        "as EN 12350-2 reads it; less than at the axis, as JIS A 1101, where a rim is higher",
    ),
    "spread_m": ("slump flow", "mean of perpendicular diameters in all directions"),
    "t500_s": ("T500", "time until the slump flow is 50 cm"),
    "flow_ratio": ("flow", "growth of the diameter over that of the mould, ASTM C1437"),
    "flow_class_number": ("flow class F", "1 to 6 of EN 206, by the flow after the last jolt to 10 mm"),
    "front_m": ("front", "farthest reach of the concrete, from the end of the vessel"),
    "hose_distance_m": ("distance from the hose", "largest horizontal distance of the concrete from the hose"),
    "height_m": ("height", "highest point of the fluid"),
    "breadth_m": ("breadth", "of the fluid across the flow, seen from above"),
    "flow_m": ("flow", "distance of the front from the gate"),
    "drop_m": ("drop", "how far the level behind the gate has sunk"),
    "t100_s": ("T100", "time until the front is 10 cm from the gate"),
    "t200_s": ("T200", "time until the front is 20 cm from the gate"),
    "t400_s": ("T400", "time until the front is 40 cm from the gate"),
    "t300_s": ("T300", "time until the second leg is filled to 30 cm"),
    "early_speed_m_s": ("early speed", "of the front between 5 and 10 cm from the gate"),
    "h1_m": ("height H1", "level behind the gate, or in the first leg"),
    "h2_m": ("height H2", "level at the far end, or in the second leg"),
    "passing_ratio": (
        "passing ratio H2/H1",
        "1: level; less: bars or the yield stress hold back; more: it arrived fast and stays",
    ),
    "step_m": ("step", "difference of level before and behind the bars"),
    "blocking_step_m": ("blocking step", "difference of level before and behind the bars of the ring"),
    "grains_number": ("grains", "in all"),
    "grains_passed_number": ("grains beyond", "the bars' far side, or out of the opening, with their centre"),
    "mortar_passed_ratio": ("mortar beyond", "fraction of its volume that is there"),
    "grains_top_ratio": ("grains in the top third", "fraction of them, of the depth where they are"),
    "grains_middle_ratio": ("grains in the middle third", "fraction of them, of the depth where they are"),
    "grains_bottom_ratio": ("grains in the bottom third", "fraction of them, of the depth where they are"),
    "flow_time_s": ("flow time", "until light is seen through the outlet"),
    "half_time_s": ("half time", "until half of the concrete has left the funnel"),
    "left_m3": ("left in the funnel", "what has not yet flowed out"),
    "light_ratio": ("light", "fraction of the outlet through which one can see"),
    "near_m": ("level below the hose", "mean height of the concrete at that end of the form"),
    "far_m": ("level at the far end", "mean height of the concrete at that end of the form"),
    "filled_ratio": ("filled", "fraction of the form's volume"),
    "above_m3": ("above the form", "volume of the concrete above its rim"),
    "void_m3": ("empty", "volume of the form that is not filled, that above the concrete included"),
    "torque_N_m": ("torque", "of the fluid against what turns"),
    "steady_torque_N_m": ("steady torque", "mean over the last quarter of the time"),
    "cylinder_torque_N_m": ("torque of a cylinder", "without ends, in closed form (Reiner and Riwlin)"),
    "printed_m": ("printed", "what has been laid, over its area"),
    "foot_m": ("foot", "width near the floor"),
    "limit_height_m": ("limit height", "at which a slender wall or column fails, in closed form"),
    "failure_height_m": ("failure height", "printed when the foot had become wider by 1 %"),
    "width_m": ("width", "of what is printed, mean of its layers"),
    "lean_m": ("lean", "how far the layer that leans most is off the path"),
    "commanded_width_m": ("commanded width", "of a bead as high as its layer, by the tool path"),
    "commanded_height_m": ("commanded height", "top of the last layer, by the tool path"),
    "collapsed_number": ("layer that has collapsed", "10 % wider than it was laid; 0: none"),
    "first_collapse_number": ("first layer to collapse", "counted from 1 at the floor; 0: none"),
    "poured_m3": ("poured", "what has come out of the hose"),
    "poured_m3_per_m": ("poured", "what has come out of the hose, of a metre of a section"),
    "pour_delay_s": ("delay of the pour", "hose blocked by concrete"),
}
RESULT_GROUPS = {  # meanings of results by the beginning of their names
    "force_": "of the fluid on this wall and its images",
    "torque_": "of the fluid on this wall, about its axis",
    "pressure_at_": "mean on the sides of the form at this height",
    "hydrostatic_at_": "of a liquid as high as the concrete",
    "less_what_sides_bear_at_": "hydrostatic, less what rough sides may bear by the yield stress",
}


def option_name(key: str, others=()) -> str:
    """Option of a keyword in the field's words, or by the keyword itself if another keyword has that option."""
    name = OPTIONS.get(key, key).replace("-", "_")
    return "--" + (key if name in others else name).replace("_", "-")


def keyword_description(key: str) -> str:
    """Description of a keyword for a scene that gives none."""
    return KEYWORDS.get(key, in_words(key))


def in_words(key: str) -> str:
    """Name of a keyword or a column for texts."""
    return KEYWORD_TEXTS.get(key, key.replace("_", " "))


def is_measure(name: str) -> bool:
    """Whether a name ends with the unit of a result."""
    return name.endswith(tuple(UNITS))


def unit_of_measure(name: str) -> tuple[float, str, str]:
    """Factor, unit and format in which a result is shown."""
    return next(shown for end, shown in UNITS.items() if name.endswith(end))


def title(name: str) -> str:
    """Name of a result in words."""
    end = next(end for end in UNITS if name.endswith(end))
    if name in RESULTS:
        return RESULTS[name][0]
    name = re.sub(r"^(force|torque)_", r"\1_on_", name)
    return re.sub(r"(\d)mm\b", r"\1 mm", name.removesuffix("" if end == "_ratio" else end).replace("_", " "))


def meaning(name: str) -> str:
    """Meaning of a result in a few words; empty for a user's own measure."""
    kind = next((kind for kind in RESULT_GROUPS if name.startswith(kind) and name not in RESULTS), "")
    return RESULT_GROUPS.get(kind) or RESULTS.get(name, ("", ""))[1]


def written(name: str, value: float) -> str:
    """Format the value of a result with its unit."""
    factor, unit, digits = unit_of_measure(name)
    text = f"{factor * value:{digits}}"
    return f"{text.lstrip('-') if float(text) == 0.0 else text} {unit}".rstrip()


def constants_of(facts: dict) -> dict[str, str]:
    """Return the numbers that characterize a mix, {name in words: value with unit}, from the facts of a material.

    Yield stress first, density last.
    """
    # the slope is no constant of a mix
    names = ["yield_value", *(name for name in facts if name not in {*COMMON_NUMBERS, "typical_slope"}), "density"]
    return {
        in_words(name): quote(float(facts[name]), CONSTANT_UNITS.get(name, ""))
        for name in names
        if isinstance(facts.get(name), float | int) and (name in COMMON_NUMBERS or chooses_law(name, facts[name]))
    }


def mix_in_words(facts: dict) -> str:
    """Return the numbers that characterize a mix, on one line, from the facts of a material."""
    return ", ".join(f"{name} {value}" for name, value in constants_of(facts).items())
