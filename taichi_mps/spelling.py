"""Numbers and units as people write them: '200,5', 'Pas', 'kg m-3', 'U/min', superscripts, full-width letters."""

import re
import unicodedata
from fractions import Fraction
from functools import cache

MAX_CHARACTERS = 100  # of a number with its unit
OF_THAT_KIND = "or a unit of that kind"  # end of the message for a unit of another kind

# Known units as pint defines them: name = value = symbol = alias. Names with several sizes (ton, gallon, grad) are left
# out. An angle has a dimension, so that no percentage is read as one.
UNITS = """
mega- = 1e6 = M-
kilo- = 1e3 = k-
hecto- = 1e2 = h-
deca- = 10 = da-
deci- = 1e-1 = d-
centi- = 1e-2 = c-
milli- = 1e-3 = m-
micro- = 1e-6 = u- = mu-
nano- = 1e-9 = n-
meter = [length] = m = metre = M = mtr
millimeter_ = millimeter = MM = mms
centimeter_ = centimeter = CM = Cm = cms
decimeter_ = decimeter = DM
micrometer_ = micrometer = micron
inch = 0.0254 meter = in = inches
foot = 12 inch = ft = feet
yard = 3 foot = yd
thou = 0.001 inch
mile = 5280 foot = mi
second = [time] = s = S = sec = Sec = SEC = sek = Sek = SEK = sekunde = sekunden
minute = 60 second = min = Min = MIN = minuten
hour = 60 minute = h = H = hr = Hr = std = Std = stunde = stunden
day = 24 hour = d
mile_an_hour = mile / hour = mph
kilometer_an_hour = kilometer / hour = kph = kmh
hertz = 1 / second = Hz = HZ = hz
gram = [mass] = g = gm = gms = G
kilogram_ = kilogram = Kg = KG = kgs = Kgs
tonne = 1000 kilogram = t = T = to = metric_ton
pound = 0.45359237 kilogram = lb = lbm
ounce = pound / 16 = oz
newton = kilogram * meter / second ** 2 = N
joule = newton * meter = J
kilonewton_ = kilonewton = KN = Kn = kn
gram_force = 0.00980665 newton = gf
kilogram_force = 9.80665 newton = kp = kilopond
tonne_force = 1000 kilogram_force = tf
pound_force = 4.4482216152605 newton = lbf
kip = 1000 pound_force
dyne = 1e-5 newton = dyn
pascal = newton / meter ** 2 = Pa
kilopascal_ = kilopascal = kpa = KPa = KPA = Kpa
megapascal_ = megapascal = Mpa
bar = 1e5 pascal = Bar = BAR
atmosphere = 101325 pascal = atm
technical_atmosphere = kilogram_force / centimeter ** 2 = at
torr = atmosphere / 760 = Torr = mmHg
pound_force_per_square_inch = pound_force / inch ** 2 = psi = PSI
kip_per_square_inch = kip / inch ** 2 = ksi
pound_force_per_square_foot = pound_force / foot ** 2 = psf
pound_per_cubic_foot = pound / foot ** 3 = pcf
poise = 0.1 pascal * second = P
stokes = 1e-4 meter ** 2 / second = St
centipoise_ = centipoise = cps = cp = CP = CPS
second_to_the_n = [time_to_the_n] = sn
liter = 1e-3 meter ** 3 = l = L = litre = ltr = Ltr = lt
cubic_centimeter = centimeter ** 3 = cc = ccm
cubic_meter = meter ** 3 = cbm = cum
liter_a_minute = liter / minute = lpm = LPM
turn = [angle] = rev = revolution = rotation = cycle = U = Umdr = umdr = umdrehung = umdrehungen = r = tr = tour = giri
turn_a_minute = turn / minute = rpm = RPM = Rpm = Upm = UPM = upm
turn_a_second = turn / second = rps
degree = turn / 360 = deg = Deg = DEG
radian = 0.15915494309189533576888376337251436 turn = rad = Rad
gon = turn / 400
percent = 0.01
permille = 0.001
ppm = 1e-6
"""

SPACES = "\u00a0\u2007\u2009\u202f"  # non-breaking and thin spaces, which group the digits of a number
ALIKE = {  # {plain text: characters that are read as it}
    "-": "\u2010\u2011\u2012\u2013\u2014\u2015\u2212\u02d7",
    "*": "·•∙⋅×∗‧・",
    "/": "⁄∕÷",
    "'": "′’‘´`ʹ",
    '"': "″”“„ʺ",
    "°": "º˚",
    "u": "µμ",
    "^": "ˆ",
    "": "{}",
    "s": "秒",
    "min": "分",
}
ALIKE = {ord(character): to for to, others in ALIKE.items() for character in others}

NUMBER = re.compile(  # sign, digits, exponent after e, exponent of 10
    r"(?a)([-+]?)(\d+(?:[.,'_]\d+)*[.,]?|[.,]\d+)"
    r"(?:[eE]([-+]?\d{1,3})(?!\d)|\s*[xX*]\s*10(?:\^|\*\*)\(?([-+]?\d{1,3})\)?)?"
)

REWRITES = [  # patterns in a unit and their replacements, in order; names, '^' before a digit, '*', '/', '()' remain
    (r"(?i)\br\. ?p\. ?m\b\.?", "rpm"),
    (r"%", " percent "),
    (r"‰", " permille "),
    (r"°", " degree "),
    (r"\b(?:pa|PA)(s?)\b", r"Pa\1"),
    (r"\bU(?=min)", "U "),  # a turn, not a millionth
    (r"\"|''", " inch "),
    (r"'", " foot "),
    (r"\bper\b", "/"),
    (r"\*\*", "^"),
    (r"\^\s*\(\s*([-+]?\w)\s*\)", r"^\1"),
    (r"(?<=[a-zA-Z])-(?=[a-zA-Z])", " "),
    (r"(?:\b|(?<=[aN]))s\s*\^?\s*n\b", " sn"),
    (r"\b(?:[A-Z][a-z]{3,}|[A-Z]{4,})\b", lambda word: word[0].lower()),
    (r"(?<=[a-zA-Z])\s*\^\s*\+?(?=-?\d)", "^"),
    (r"(?<=[a-zA-Z])\^?(-?\d)", r"^\1 "),
    (r"\.(?!\d)", " "),
    (r"\b(\w{0,2}Pa|\w{0,2}N)(s?)(m?)\b", lambda word: " ".join(filter(None, word.groups()))),  # Pas, Ns/m2, Nm-2
    (r"\bkgm\b", "kg m"),
    (r"\b(?:cubic|cu) +(\w+)", r"\1^3"),
    (r"\b(?:square +|sq *)(\w+)", r"\1^2"),
    (r"[\s*]*/[\s*]*", "/"),
    (r"[\s*]+(?=\))|(?<=\()[\s*]+", ""),
    (r"^\(([^()]*)\)$", r"\1"),
    (r"^/", "1/"),
]
FACTOR = r"[a-zA-Z_]+(?:\^-?[1-9])?"
FACTORS = rf"{FACTOR}(?:[*/]{FACTOR})*"
PART = rf"(?:{FACTOR}|\({FACTORS}\))"
UNIT = re.compile(rf"(?:1/)?{PART}(?:[*/]{PART})*|")  # text that pint may get: it evaluates expressions


class AmbiguousError(ValueError):
    """Digits that may be read as two different numbers."""


@cache
def registry():
    """Registry of UNITS (pint), with exact factors; made when a number first has a unit."""
    import pint

    return pint.UnitRegistry(UNITS.splitlines(), non_int_type=Fraction)


def normalised(text: str) -> str:
    """Return a text in plain characters: superscripts as '^2', one kind of minus, dot, quotation mark and space."""
    text = re.sub(rf"(?<=\d)[{SPACES}](?=\d{{3}}(?!\d))", "_", text)
    text = re.sub("[⁰¹²³⁴-⁹⁺⁻ⁿ]+", r"^\g<0>", text).translate(ALIKE)
    text = unicodedata.normalize("NFKC", text).translate(ALIKE)
    return "".join(c for c in text if unicodedata.category(c) != "Cf").strip()  # without invisible characters


def decimal_point(digits: str) -> str:
    """Return digits with points, commas, apostrophes or underscores as digits with a decimal point.

    ValueError for text that is no number; AmbiguousError for 1,000, which is 1.000 or 1000.
    """
    marks = re.sub(r"\d", "", digits)
    has_point = marks[-1:] in tuple(".,") and marks.count(marks[-1]) == 1
    whole, mark, part = digits.rpartition(marks[-1]) if has_point else (digits, "", "")
    if marks == "," and re.fullmatch(r"[1-9]\d{0,2},\d{3}", digits):
        raise AmbiguousError(f"is {whole}.{part} or {whole}{part}; must be written without a comma")
    if not re.fullmatch(r"\d*|[1-9]\d{0,2}(?:([.,'_])\d{3})(?:\1\d{3})*", whole) or (mark == "," and not part):
        raise ValueError("no number")
    return (re.sub(r"\D", "", whole) or "0") + (f".{part}" if part else "")


def canonical(unit: str) -> str:
    """Return a unit as pint reads it; ValueError for text that is no unit."""
    unit = normalised(unit).strip(" []-")
    for pattern, to in REWRITES:
        unit = re.sub(pattern, to, unit)
    unit = re.sub(r"[\s*]+", "*", unit.strip(" *"))
    if not UNIT.fullmatch(unit):
        raise ValueError("no unit")
    return unit


def converted(number: Fraction, given: str, unit: str) -> float:
    """Convert a number from the unit ``given`` to ``unit``; 1/min as a rotation speed is one turn a minute.

    The first reading of ``given`` that has the dimension of ``unit`` counts: ms is milliseconds or m s, and all or only
    the first of the units after a solidus, as in kg/m s, are in the denominator. ValueError, or an error of pint, where
    none has.
    """
    known, given = registry(), canonical(given)
    target = known.parse_units(canonical(unit))
    spelled = given, re.sub(r"\bms\b", "m*s", given)
    for text in (*spelled, *(f"{text})".replace("/", "/(", 1) for text in spelled if "/" in text)):
        found = number * known.parse_units(text)
        if target.dimensionality == known.turn_a_minute.dimensionality and found.check("1 / [time]"):
            found = found * known.turn
        if found.dimensionality == target.dimensionality:
            return float(found.to(target).magnitude)
    raise ValueError("of another kind")


def without_unit(text: str) -> bool:
    """Whether a text is a number alone."""
    return bool(NUMBER.fullmatch(normalised(text[:MAX_CHARACTERS])))


def in_unit(unit: str, value):
    """Convert a number in a text, with or without a unit ('0.5 kPa', '5mm', '200,5'), to ``unit``.

    Returns a float where the text has another unit, else the number as text that ``float`` reads. A value that does not
    begin with a number is returned unchanged. ValueError for a unit of another kind; AmbiguousError for digits that are
    two numbers, 1,000.
    """
    unit = unit.strip("-")
    found = NUMBER.match(normalised(value)) if isinstance(value, str) and len(value) <= MAX_CHARACTERS else None
    if not found:
        return value
    try:
        sign, digits, exponent, power = found.groups()
        number = sign + decimal_point(digits) + (f"e{exponent or power}" if exponent or power else "")
        given = found.string[found.end() :].strip()
        return number if given in ("", unit) else converted(Fraction(number), given, unit)
    except (AmbiguousError, ImportError):
        raise
    except OverflowError:
        return float("inf")
    except Exception as error:
        if not isinstance(error, ValueError) and not type(error).__module__.startswith("pint"):
            raise
        kind = f"in {unit} {OF_THAT_KIND}" if unit else "without a unit, or in %"
        raise ValueError(f"must be a number {kind}") from None


def size(number: float) -> str:
    """Format a number of bytes as text: 1.2 GB, 350 MB."""
    return f"{1e-9 * number:.3g} GB" if number >= 1e9 else f"{1e-6 * number:.0f} MB"
