"""What the page knows of tests: the fields of their forms, and the words of the command line that these stand for."""

from ..cli.case_file import keywords
from ..cli.options import GROUPS, allowed, choices, group_of
from ..problem import catalogue
from ..problem.labels import in_words, what_it_is
from ..problem.numerics import NUMERICS
from ..report.inputs import option, shown
from ..study.calibrate import Measurements
from ..units import unit_of

FIRST = ("yield_value", "plastic_viscosity", "density", "spacing", "model", "accuracy")  # of their groups
NOT_ASKED = {"renderer"}  # goes
SLIDERS = {"yield_value": (10.0, 2000.0), "plastic_viscosity": (1.0, 500.0)}  # ends for usual concrete, SI units
AROUND = 20.0  # ends of a slider over a default that is no usual one, or its inverse
SWITCH = {"no": False, "yes": True}
CHEAP = {  # tests that are previewed: what their models have, and what of the form they leave out (None)
    "slump": dict.fromkeys(("spacing", "lift_speed", "accuracy", "floor_radius")) | {"model": "axisymmetric"},
    "mini_cone": dict.fromkeys(("spacing", "lift_speed")) | {"model": "axisymmetric"},
    "film": {},
    "dam_break": {},
}


def tests() -> list[dict]:
    """Every test: its name, what it is, whether it has a preview, and its fields by scheme; slump first."""
    found = []
    for name, text in sorted(catalogue.describe().items(), key=lambda item: item[0] != "slump"):
        function = catalogue.load(name)
        fields = {scheme: fields_of(keywords(function, numerics)) for scheme, numerics in NUMERICS.items()}
        found.append({"name": name, "told": text, "preview": name in CHEAP, "fields": fields})
    return found


def fields_of(known: dict) -> list[dict]:
    """Fields by {key: (model, field)}, in the groups of --help."""

    def place(name):
        return GROUPS.index(group_of(name, known[name][0])), FIRST.index(name) if name in FIRST else len(FIRST)

    asked = sorted(known.keys() - NOT_ASKED, key=lambda name: (*place(name), list(known).index(name)))
    return [described(name, known[name][1]) | {"group": GROUPS[place(name)[0]]} for name in asked]


def measurements() -> list[dict]:
    """Fields of a calibration."""
    return [described(name, field) | {"label": field.description} for name, field in Measurements.model_fields.items()]


def described(name: str, field) -> dict:
    """A field: name, label, unit, what it is by default, its words, and ends of its slider."""
    unit, default = unit_of(field).strip("-"), field.default
    words = list(SWITCH) if field.annotation is bool else choices(field)
    ends = SLIDERS.get(name) if isinstance(default, float) else None
    if ends and not 2.0 * ends[0] <= default <= 0.5 * ends[1]:
        ends = default / AROUND, default * AROUND
    return {
        "name": name,
        "label": in_words(name),
        "unit": unit,
        "usual": "" if default is None else shown(default, unit if unit == "m" else ""),
        "default": default,
        "told": f"{field.description or what_it_is(name)} {allowed(field)}".strip(),
        "words": words if not unit else [],
        "ends": ends,
    }


def options(values: dict[str, str]) -> list[str]:
    """The words of the command line that texts of fields stand for."""
    return [option(key, SWITCH.get(text, text)) for key, text in values.items()]
