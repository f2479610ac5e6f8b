"""The columns of a laboratory's list: which quantity of Measurements they hold, by the names that people write, and in
which unit."""

import re
import unicodedata
from contextlib import suppress
from functools import lru_cache

from ..spelling import in_unit
from ..units import require, suggestion, unit_of
from .calibrate import TESTS, Measurements

# by field of Measurements, beside its own name: of EN 12350, JIS A 1101, 1150 and 1116, and common ones; letters alone
NAMES = {
    "slump": "setzmass affaissement zetmaat スランプ",
    "spread": "slumpflow sf slumpflowsf slumpspread setzfliessmass étalement vloeimaat スランプフロー",
    "t500": "t50 t50cm t500mm t500time slumpflowtime slumpflowtimet500 t500zeit 50cmフロー到達時間 500mmフロー到達時間 "
    "フロー到達時間 スランプフロー到達時間",
    "mini_cone": "minislumpflow minislumpspread miniconespread miniconeflow ミニスランプフロー",
    "v_funnel": "tv vfunneltime vfunnelflowtime trichterauslaufzeit vtrichter v漏斗 v漏斗流下時間 vロート "
    "vロート流下時間",
    "yield_value": "yieldstress fliessgrenze 降伏値 降伏応力",
    "plastic_viscosity": "plastischeviskosität 塑性粘度",
    "rho": "density ρ unitweight rohdichte frischbetonrohdichte massevolumique volumiekemassa 密度 単位容積質量",
}
OTHER_TESTS = {  # names that are read as none of these, and of what they are
    "ausbreitmass": "of the flow table (EN 12350-5), no slump flow",
    "flowtable": "of the flow table (EN 12350-5), no slump flow",
}
BESIDE = {"value", "mean", "average", "avg", "measured", "test", "the", "of", "fresh", "concrete", "wert", "mittelwert"}
BESIDE |= {"diameter", "平均"}  # words beside a name that change nothing
BRACKETS = re.compile(r"[\[(]([^\])]*)[\])]")
STANDARD = re.compile(r"(?i)(en|din|jis|jsce|astm|iso|bs|nf)\b")  # in brackets
ALIKE = {"秒": "s", "sek": "s", "sek.": "s", "s": "s", "pa": "Pa", "pa s": "Pa s", "t/m3": "t/m3", "g/cm3": "g/cm3"}
UNITS = r"mm|cm|dm|m|in|inch|inches|ft|s|sec|min|kg/m\^?3|t/m\^?3|g/cm\^?3|kg/l|lb/ft\^?3|k?Pa|Pa[ .·*]?s|秒|sek\.?"
TAIL = re.compile(rf"(?i)(.+?)(?:[\s,/_]|\s+in\s+)\s*({UNITS})")  # a name and a unit without brackets


def key_of(text: str) -> str:
    """A name without what people write in several ways: its letters and digits alone, in small ones."""
    words = re.findall(r"[^\W_]+", unicodedata.normalize("NFKC", text).casefold())
    return "".join(word for word in words if word not in BESIDE).removesuffix("値")


FIELDS = {key_of(name): name for name in Measurements.model_fields}
FIELDS |= {key_of(word): field for field, words in NAMES.items() for word in words.split()}
FIELDS |= {f"{key}error": f"{field}_error" for key, field in FIELDS.items() if field in TESTS.values()}


def is_unit(text: str, fields) -> bool:
    """Whether a text in brackets is meant as a unit: no standard, no name of ours and no word beside one."""
    named = re.search(r"\w", text) and key_of(text) in ("", *fields)
    return bool(text) and not named and not STANDARD.match(text)


@lru_cache(maxsize=256)
def heading(column: str) -> tuple[str | None, str]:
    """Field of Measurements that a column holds, None for any other; and its unit, empty where the head names none.
    SceneError for a unit of another kind."""
    return quantity(column, FIELDS, lambda field: unit_of(Measurements.model_fields[field]))


def quantity(column: str, fields: dict[str, str], unit_of) -> tuple[str | None, str]:
    """What a column holds by the names of ``fields``, {key_of(name): what it is}, None for another; and its unit, empty
    where it names none. SceneError for a unit that is not of the kind of ``unit_of(what it is)``."""
    text = unicodedata.normalize("NFKC", column)
    bare, units = BRACKETS.sub(" ", text).strip(), [unit.strip() for unit in BRACKETS.findall(text)]
    found, units = fields.get(key_of(bare)), [unit for unit in units if is_unit(unit, fields)]
    if not found and (tail := TAIL.fullmatch(bare)):
        found, units = fields.get(key_of(tail[1])), [tail[2]]
    if not found or not units:
        return found, ""
    ours = unit_of(found)
    for unit in (ALIKE.get(unit.lower(), unit) for unit in reversed(units)):
        with suppress(ValueError):
            in_unit(ours, f"1 {unit}")
            return found, unit
    require(len(key_of(bare)) <= 3, f"column '{column}': its unit must be {ours} or one of that kind")
    return None, ""  # an abbreviation of something else: SF [kg/m3] is silica fume


def hint(column: str) -> str:
    """A column that is none of ours, and what may have been meant or what it is."""
    key = key_of(re.sub(r"[\[(].*", "", column))
    near = suggestion(key, FIELDS.keys() - {key}).removeprefix(", ")
    why = next((why for name, why in OTHER_TESTS.items() if key.startswith(name)), near)
    return f"'{column}'" + f" ({why})" * bool(why)
