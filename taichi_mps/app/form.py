"""Forms of the page: the fields of each test, and the command-line options of their values."""

from ..cli.case_file import keywords
from ..cli.options import GROUPS, allowed, choices, group_of
from ..engine import NUMERICS
from ..input import catalogue
from ..input.labels import in_words, keyword_description
from ..report.inputs import option, shown
from ..study.calibrate import Measurements
from ..units import plain, unit_of

FIRST = ("yield_value", "plastic_viscosity", "density", "spacing", "model", "accuracy")  # fields that lead their group
SLIDERS = {"yield_value": (10.0, 2000.0), "plastic_viscosity": (1.0, 500.0)}  # ranges for usual concrete, SI units
SLIDER_RATIO = 20.0  # where a default is near an end of that range or outside: ends of the slider over it, or inverse
OWN_UNIT = "m", "m3/s"  # whose defaults are shown with a unit of their own: cm, mm, l/min
SWITCH = {"no": False, "yes": True}
PREVIEW_MODELS = {  # {test with a preview: {keyword: value in the preview, None to leave out that of the form}}
    "slump": dict.fromkeys(("spacing", "lift_speed", "accuracy", "floor_radius")) | {"model": "axisymmetric"},
    "mini_cone": dict.fromkeys(("spacing", "lift_speed")) | {"model": "axisymmetric"},
    "film": {},
    "dam_break": {},
    "still_pool": {},
    "l_flow": dict.fromkeys(("spacing", "width", "sides")) | {"model": "plane"},
    "lcpc_box": dict.fromkeys(("spacing", "width", "sides")) | {"model": "plane"},
}


def wrong(error: Exception) -> dict[str, str]:
    """Messages of an error by the fields that they belong to; '' for those of none."""
    return {key: plain(text) for key, text in getattr(error, "by_key", {"": str(error)}).items()}


def tests() -> list[dict]:
    """List of all tests: name, description, keywords of its preview or None, fields by scheme; slump first."""
    descriptions = sorted(catalogue.describe().items(), key=lambda item: item[0] != "slump")
    functions = {name: catalogue.load(name) for name, _ in descriptions}
    return [
        {
            "name": name,
            "help": text,
            "preview": PREVIEW_MODELS.get(name),
            "fields": {scheme: fields_of(keywords(functions[name], numerics)) for scheme, numerics in NUMERICS.items()},
        }
        for name, text in descriptions
    ]


def fields_of(known: dict) -> list[dict]:
    """Fields of a form from {key: (model, field)}, ordered by the groups of --help."""

    def place(name):
        return GROUPS.index(group_of(name, known[name][0])), FIRST.index(name) if name in FIRST else len(FIRST)

    names = sorted(known, key=lambda name: (*place(name), list(known).index(name)))
    return [field_facts(name, known[name][1]) | {"group": GROUPS[place(name)[0]]} for name in names]


def measurements() -> list[dict]:
    """Fields of the form of a calibration."""
    return [
        field_facts(name, field) | {"label": field.description} for name, field in Measurements.model_fields.items()
    ]


def field_facts(name: str, field) -> dict:
    """Facts of a field: name, label, unit, default, help, choices ("words"), and ends of its slider."""
    unit, default = unit_of(field).strip("-"), field.default
    words = list(SWITCH) if field.annotation is bool else choices(field)
    ends = SLIDERS.get(name) if isinstance(default, float) else None
    if ends and not 2.0 * ends[0] <= default <= 0.5 * ends[1]:
        ends = default / SLIDER_RATIO, default * SLIDER_RATIO
    return {
        "name": name,
        "label": in_words(name),
        "unit": unit,
        "usual": "" if default is None else shown(default, unit if unit in OWN_UNIT else ""),
        "default": default,
        "help": f"{field.description or keyword_description(name)} {allowed(field)}".strip(),
        "words": words if not unit else [],
        "ends": ends,
    }


def options(values: dict[str, str]) -> list[str]:
    """Command-line options of the values of fields."""
    return [option(key, SWITCH.get(text, text)) for key, text in values.items()]
