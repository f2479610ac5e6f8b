"""Quantities with units and allowed ranges, and the one place where bad input becomes one clear line."""

import difflib
import errno
import inspect
import os
from collections.abc import Callable
from contextlib import contextmanager
from functools import cache, partial, wraps
from importlib.util import find_spec
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    ValidationError,
    create_model,
    model_validator,
)

from .spelling import MAX_CHARACTERS, OF_THAT_KIND, in_unit, without_unit

T = TypeVar("T")


class SceneError(ValueError):
    """Error of bad input, raised before any allocation.

    The message is one line that names the key, the value with its unit and what is allowed.

    Parameters
    ----------
    message : str or dict of str to str
        Message, which begins with its key, as 'key = value: ...', or one for each key; the text is their join.

    Attributes
    ----------
    by_key : dict of str to str
        Messages by their keys; '' for one that belongs to none.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.Bingham(yield_value=-1.0)
    Traceback (most recent call last):
        ...
    taichi_mps.units.SceneError: yield_value = -1.0 Pa: must be greater than or equal to 0 Pa
    """

    def __init__(self, message: str | dict[str, str] = ""):
        found = message if isinstance(message, dict) else {leading_key(str(message)): message}
        # one line each, whatever the value holds
        self.by_key = {key: " ".join(str(text).splitlines()) for key, text in found.items()}
        super().__init__("; ".join(self.by_key.values()))


def leading_key(message: str) -> str:
    """Return the key with which a message 'key = value: ...' begins, or ''."""
    key, equals, _ = message.partition(" = ")
    return key if equals and key.isidentifier() else ""


def require(holds, message: str) -> None:
    """Raise SceneError with this message unless what is required holds."""
    if not holds:
        raise SceneError(message)


def require_package(name: str, what: str, extra: str, instead: str = "") -> None:
    """Raise SceneError, which says ``what`` needs it, unless a package of an ``extra`` of this one is installed."""
    require(find_spec(name.replace("-", "_")), f"{what} {name}: pip install 'taichi-mps[{extra}]'{instead}")


def user_path(path) -> Path:
    """Return the path that a user wrote, a leading ~ expanded to the home folder.

    A path that still begins with ~, as ./~/x does, is made absolute, since some libraries expand it again.
    """
    found = Path(os.path.expanduser(path))
    return found.absolute() if str(found).startswith("~") else found


def regular_file(prefix: str, path, most: float) -> Path:
    """Return the path of an ordinary file of at most ``most`` bytes, which can be read to its end.

    SceneError that begins with ``prefix`` for a folder, a pipe, a device, or a file that is larger than it may be.
    """
    path = user_path(path)
    try:
        size = path.stat().st_size
    except FileNotFoundError:
        raise SceneError(f"{prefix}: no such file") from None
    except (OSError, ValueError) as error:
        raise SceneError(f"{prefix}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    require(path.is_file(), f"{prefix}: is a folder, a pipe or a device; must be a file")
    require(os.access(path, os.R_OK), f"{prefix}: cannot be read ({os.strerror(errno.EACCES)})")
    require(size <= most, f"{prefix}: has {1e-6 * size:.4g} MB; must have at most {1e-6 * most:g} MB")
    return path


def numbers_from(key, function, *arguments) -> np.ndarray:
    """Return the numbers that a user's function gives; SceneError naming its ``key`` where it gives none."""
    try:
        return np.asarray(function(*arguments), float)
    except Exception as error:
        raise SceneError(f"{key} = {quote(function, '')}: {type(error).__name__}: {error}; must give numbers") from None


@contextmanager
def writing(key, path, kind=""):
    """Turn the failure to write a file, or a folder by its ``kind``, into a SceneError that names its ``key``."""
    try:
        yield
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{key} = {path}: cannot be written ({reason}); choose another{kind}") from None


def array_of(value) -> np.ndarray:
    """Return a value as an array of real numbers; an array of None, without axes, if it is none or some are masked."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        return np.array(None)
    return array.astype(float) if array.dtype.kind in "iuf" and not np.ma.is_masked(value) else np.array(None)


def quote(value, unit) -> str:
    """Return a value as it was given, on one line, and its unit."""
    text = f"{value:g}" if isinstance(value, float) else " ".join(str(value).split())[:60]
    return text if isinstance(value, str) else f"{text} {unit}".rstrip()


def plain(text) -> str:
    """Return text from outside as a terminal may have it.

    Control characters, but for line ends, and what is no character are shown as codes.
    """
    whole = str(text).encode("utf-8", "backslashreplace").decode()
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in whole)


class Unit(str):
    """The unit of an annotated number, for messages and for --help; ``hint``: what one may have meant, in another."""

    def __new__(cls, unit, hint=""):
        """Make the text with its hint."""
        self = super().__new__(cls, unit)
        self.hint = hint
        return self


class Only(NamedTuple):
    """Note of a keyword that has an effect only beside these values of another one, or where that is given or not."""

    key: str
    values: tuple | bool = True

    def why_not(self, value) -> str:
        """Return what is allowed instead where the other keyword has this value, '' where all is well."""
        if isinstance(self.values, tuple):
            return "" if value in self.values else f"must be left out, or {self.key} = {' or '.join(self.values)}"
        why = f"has no effect with{'out' * self.values} {self.key}; must be left out"
        return "" if bool(value) == self.values else why


def no_number_in_disguise(value):
    """Return a value; ValueError for what Python takes for a number and is none: a truth value, bytes, an array."""
    require(
        not isinstance(value, bool | np.bool_ | bytes | bytearray)
        and not (isinstance(value, np.ndarray) and value.ndim),
        "must be a number",
    )
    return value


def possible(path: Path, named=False) -> Path:
    """Return a path; ValueError for one that no file can have, and where a name is needed for '' and '.', a folder."""
    require("\0" not in str(path) and (path.name or not named), "must be the path of a file")
    return user_path(path)


def picture(path: Path) -> Path:
    """Return the path of a picture; ValueError for a file of another kind, which might be something else."""
    require(path.suffix.lower() in (".png", ".svg", ".pdf"), "must be a picture, .png, .svg or .pdf")
    return path


def absolute(path: str) -> str:
    """Return the path of a file that a run reads, from whatever folder it is read again; '' for none."""
    return path and str(user_path(path).absolute())


def truth(value):
    """Return a truth value of NumPy as Python's, anything else as it is; ValueError for bytes."""
    require(not isinstance(value, bytes), "must be True or False")
    return bool(value) if isinstance(value, np.bool_) else value


def real(unit, hint="", **bounds):
    """Annotate one finite number in this unit, within bounds as pydantic names them."""
    checks = BeforeValidator(no_number_in_disguise), BeforeValidator(partial(in_unit, unit))
    return Annotated[(float, Field(allow_inf_nan=False, **bounds), Unit(unit, hint), *checks)]


def array(unit, *shapes, kind=np.asarray, gaps=False):
    """Annotate an array of finite numbers in this unit, of one of the shapes.

    None in a shape is any number. With ``gaps`` some may be nan.
    """
    words = " or ".join(str(tuple("n" if k is None else k for k in shape)).replace("'", "") for shape in shapes)

    def read(value):
        found = array_of(value)
        fits = any(
            len(shape) == found.ndim and all(k in (None, n) for k, n in zip(shape, found.shape, strict=True))
            for shape in shapes
        )
        numbers = found.dtype.kind != "O" and np.all(np.isfinite(found) | (gaps & np.isnan(found)))
        require(fits and numbers, f"must be finite numbers of the shape {words}")
        return value if kind is tuple and isinstance(value, tuple) else kind(found.tolist() if kind is tuple else found)

    return Annotated[Any, BeforeValidator(read), Unit(unit)]


def instance(kind, words: str, several=False):
    """Annotate an object of a class, or a tuple of ``several``, with what a message calls it."""

    def read(value):
        items = value if several else [value]
        require(isinstance(items, tuple | list) and all(isinstance(item, kind) for item in items), f"must be {words}")
        return value

    return Annotated[Any, BeforeValidator(read)]


def vector(unit):
    """Annotate a tuple of 2 or 3 finite numbers in this unit."""
    return array(unit, (2,), (3,), kind=tuple)


def points(unit):
    """Annotate rows (n, d) of finite numbers in this unit, d = 2 or 3."""
    return array(unit, (None, 2), (None, 3))


INSTANT = 1e-9  # [s]: times closer to each other are one and the same, and no step is shorter


def at_least(least: float, unit: str, value: float) -> float:
    """Return a number; ValueError for one below the least, of which bounds of pydantic would say another thing."""
    require(value >= least, f"must be at least {least:g} {unit}")
    return value


LIGHTEST, HEAVIEST = 200.0, 20000.0  # foamed concrete in the mould, and above mercury [kg/m3]
DENSITY_HINT = "2300 for 2.3 t/m3"


def no_metal(arch):
    """Refuse Metal; other values are left to those that check them."""
    require(
        arch != "metal",
        "must be cpu, cuda or vulkan; Metal has no 64-bit floats, which positions need: use cpu on a Mac",
    )
    return arch


# isort: off
if TYPE_CHECKING:  # as an editor has them: numbers in SI units; that text with a unit is taken, too, it does not know
    from builtins import (
        bool as Flag,
        float as Angle,
        float as AnyDensity,
        float as Density,
        float as Duration,
        float as FlowRate,
        float as Instant,
        float as Length,
        float as Position,
        float as RadiusRatio,
        float as Ratio,
        float as RotationSpeed,
        float as Size,
        float as Speed,
        float as Time,
        float as Viscosity,
        float as YieldValue,
        int as Count,
        str as Source,
        str as Text,
    )

    Arch = Literal["cpu", "cuda", "vulkan"]
    CriticalStrainRate = float | Literal["rational"]
    Place = str | os.PathLike[str]
    File = Place
    Picture = Place
# isort: on
else:
    # powers of a smaller length would underflow
    Size = Annotated[real("m", gt=0.0, le=1e9), AfterValidator(partial(at_least, 1e-12, "m"))]
    Time = real("s", ge=0.0, le=1e9)
    Instant = real("s", ge=-1e9, le=1e9)
    Length = real("m", gt=0.0, le=100.0)
    Position = real("m", ge=-1000.0, le=1000.0)
    Duration = Annotated[real("s", gt=0.0, le=1e6), AfterValidator(partial(at_least, INSTANT, "s"))]
    Density = real("kg/m3", DENSITY_HINT, ge=LIGHTEST, le=HEAVIEST)
    AnyDensity = real("kg/m3", gt=0.0, le=30000.0)  # also 1, of a flow without weight in numbers without dimension
    Viscosity = real("Pa s", gt=0.0, le=1e6)
    YieldValue = real("Pa", ge=0.0, le=1e6)
    Speed = real("m/s", "0.1 for 100 mm/s", gt=0.0, le=5.0)  # of a mould or a gate that is lifted
    FlowRate = real("m3/s", "a rise of 3 m/h over 1 m2 is 3 m3/h", gt=0.0, le=100.0)
    CriticalStrainRate = real("1/s", gt=0.0, le=1e4) | Literal["rational"]  # the word: materials.rational_...

    RotationSpeed = real("rpm", "turns a minute", gt=0.0, le=1e4)
    Angle = real("deg", ge=0.0, lt=90.0)
    Ratio = real("-", gt=0.0, le=1.0)
    RadiusRatio = real("-", ge=1.6, le=4.1)
    Count = Annotated[int, Field(ge=1, le=100000), Unit("-"), BeforeValidator(no_number_in_disguise)]
    Flag = Annotated[bool, BeforeValidator(truth)]
    Arch = Annotated[Literal["cpu", "cuda", "vulkan"], BeforeValidator(no_metal)]
    Text = Annotated[str, Strict()]
    Source = Annotated[str, AfterValidator(absolute)]  # file that a run reads
    Place = Annotated[Path, AfterValidator(possible)]  # of a folder or a file
    File = Annotated[Path, AfterValidator(partial(possible, named=True))]
    Picture = Annotated[File, AfterValidator(picture)]


class Checked(BaseModel):
    """A frozen record whose values are checked on construction; a violation raises SceneError."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)
    rules: ClassVar[list[tuple[str, Only]]] = []

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise SceneError(explain(error, type(self))) from None
        for name, allowed in self.without_effect(vars(self)).items():
            unit = unit_of(type(self).model_fields[name]).strip("-")
            raise SceneError(f"{name} = {quote(vars(self)[name], unit)}: {allowed}")

    @classmethod
    def without_effect(cls, values: dict) -> dict[str, str]:
        """Find the keywords that are given and have no effect beside the others, {name: what is allowed instead}."""
        default = {name: field.default for name, field in cls.model_fields.items()}
        given = default | values
        return {
            name: note.why_not(given[note.key])
            for name, note in cls.rules
            if given[name] != default[name] and note.why_not(given[note.key])
        }

    @classmethod
    def instead_of(cls, key: str) -> str:
        """Return what a message says after the name of an unknown key: which key is near, or ''."""
        return suggestion(key, cls.model_fields)

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        cls.rules = [(k, note) for k, field in cls.model_fields.items() for note in notes(field) if type(note) is Only]
        cls.__pydantic_validator__  # noqa: B018  (build now, so that a wrong declaration fails at import)

    @classmethod
    def from_values(cls, values: dict, default) -> "Checked":
        """Make the record of these values, and of those of the record ``default``, if it is one."""
        return cls(**(dict(default) if isinstance(default, Checked) else {}) | values)


def notes(field) -> list:
    """List what the declaration of a pydantic field says beside its type: bounds, unit."""
    kinds = [option for option in get_args(field.annotation) if get_origin(option) is Annotated]  # of 'Length | None'
    known = [*field.metadata, *(item for kind in kinds for item in get_args(kind)[1:])]
    return [note for item in known for note in getattr(item, "metadata", [item])]


def unit_of(field) -> Unit:
    """Return the unit of a pydantic field, '' where it has none (a choice, a flag)."""
    return next((note for note in notes(field) if isinstance(note, Unit)), Unit(""))


def suggestion(key, known) -> str:
    """Return ', did you mean ...?' with the nearest of the known keys, or ''."""
    close = difflib.get_close_matches(str(key), [str(name) for name in known], n=1)
    return f", did you mean '{close[0]}'?" if close else ""


def in_smaller_unit(number: float, most: float) -> str:
    """Return '; add a unit: 18 cm' for a length [m] beyond the largest that was meant in cm, or in mm; '' below 3.

    Millimetres are meant from 100 on, and where so many centimetres are too much as well.
    """
    unit, size = ("cm", 0.01) if number < 100.0 and number * 0.01 <= most else ("mm", 0.001)
    return f"; add a unit: {number:g} {unit}" if number >= 3.0 and number * size <= most else ""


def explain(error: ValidationError, model: type[Checked]) -> dict[str, str]:
    """Describe every violation by its key as 'key = value unit: what is allowed'.

    Alternatives of a key are joined with 'or', several violations with '; ', and those of unknown keys are of ''.
    """
    found: dict[str, str] = {}
    for item in error.errors():
        key, kind = str(item["loc"][0]) if item["loc"] else "", item["type"]
        known = unit_of(model.model_fields[key]) if key in model.model_fields else Unit("")
        unit = known.strip("-")
        allowed = item["msg"].replace("Input should be", "must be").replace("Value error, ", "")
        if kind == "float_parsing":
            allowed = "must be a number" + (f" [{unit}]" if unit else "")
        elif kind == "too_long" or (kind == "missing" and len(item["loc"]) > 1):  # of a tuple
            kind, allowed = "length", f"must be {len(get_args(model.model_fields[key].annotation))} values"
        elif kind.startswith(("greater", "less")):
            allowed += (f" {unit}" if unit else "") + (f" ({known.hint})" if known.hint else "")
            most = next((item["ctx"][key] for key in ("le", "lt") if key in item["ctx"]), -np.inf)
            allowed += (
                in_smaller_unit(float(item["input"]), most) if unit == "m" and without_unit(str(item["input"])) else ""
            )
        elif allowed.endswith(OF_THAT_KIND) and known.hint:
            allowed += f" ({known.hint})"
        shown = " ".join(str(item["input"])[:1000].split())[:MAX_CHARACTERS] or "''"  # on one line
        if not isinstance(item["input"], str) or without_unit(item["input"]) or kind == "finite_number":
            shown += f" {unit}" if unit else ""
        line = f"{key} = {shown}: {allowed}"
        if kind == "extra_forbidden":
            key, line = "", f"unknown key '{key}'{model.instead_of(key)}"
        elif kind == "missing":
            line = f"{key} is missing" + (f" [{unit}]" if unit else "")
        elif not key:  # of several keys together, which the message names
            key, line = leading_key(allowed), allowed
        elif found.get(key, "").startswith(f"{key} = {shown}: "):
            found[key] += f", or {allowed.removeprefix('must be ')}"
            continue
        found[key] = f"{found[key]}; {line}" if key in found else line
    return found


def checked(function: Callable[..., T]) -> Callable[..., T]:
    """Decorate a function of keywords, such as that of a scene, so that it checks them.

    Parameters
    ----------
    function : callable
        Function whose keywords are annotated with quantities of this module.

    Returns
    -------
    callable
        Function that validates its keywords and refuses unknown ones by name. Its ``parameters`` is the pydantic model
        of all keywords; ``at(parameters)`` is its value at parameters that were validated.

    Raises
    ------
    TypeError
        If two parameters declare the same keyword.

    Notes
    -----
    A parameter that is a ``Checked`` record, such as ``material: Bingham = Bingham(yield_value=40.0)``, or any law,
    ``material: Concrete``, stands for its fields: each is a keyword with the record's own unit, range and help, and the
    value in the default is its default. Options of the command line, parameters of a sweep and those of a checkpoint
    come from it.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> from taichi_mps.units import Length
    >>> @mps.checked
    ... def area(width: Length, height: Length = 0.5):
    ...     return width * height
    >>> area(width="20 cm")
    0.1
    >>> area(widht=0.2)
    Traceback (most recent call last):
        ...
    taichi_mps.units.SceneError: width is missing [m]; unknown key 'widht', did you mean 'width'?
    """
    require(inspect.isfunction(function), f"function = {quote(function, '')}: must be a function of keywords")
    arguments = inspect.signature(function).parameters
    records = {name: p.annotation for name, p in arguments.items() if hasattr(p.annotation, "from_values")}
    fields = {}
    for name, parameter in arguments.items():
        own = parameter.annotation, ... if parameter.default is parameter.empty else parameter.default
        new = options_of(parameter.annotation, parameter.default) if name in records else {name: own}
        if duplicates := sorted(fields.keys() & new.keys()):
            raise TypeError(f"{function.__name__}: {duplicates[0]} is declared twice")
        fields |= new

    def complete(parameters):
        for name, record in records.items():
            own = {key: getattr(parameters, key) for key in record.model_fields if key in fields}
            given = {key: value for key, value in own.items() if key in parameters.model_fields_set}
            made = record.from_values(given, arguments[name].default)
            others = own if type(made) is type(arguments[name].default) else {}  # keywords the record does not have
            vars(parameters).update({key: dict(made).get(key, others.get(key)) for key in own})
        return parameters

    model = create_model(
        function.__name__,
        __base__=Checked,
        __validators__={"complete": model_validator(mode="after")(complete)},
        **fields,
    )

    def at(parameters, **made):
        keywords = {name: getattr(parameters, name) for name in arguments if name not in records} | made
        for name, record in records.items():
            values = {key: getattr(parameters, key) for key in record.model_fields if key in fields}
            keywords.setdefault(name, record.from_values(values, arguments[name].default))
        return function(**keywords)

    @wraps(function)
    def call(**values):
        return at(model(**values))

    call.parameters, call.at = model, at
    return call


def validated(target: T) -> T:
    """Validate the arguments of a function, or of the class of a record, against their annotations.

    SceneError names the argument, its value and what is allowed, before anything is done. The default is not looked at,
    an argument without annotation neither. A whole number stays one.
    """
    if isinstance(target, type):
        target.__init__ = validated(target.__init__)
        return target
    signature = inspect.signature(target)

    @cache
    def model():
        hints = get_type_hints(target, include_extras=True)
        fields = {
            name: (tuple[hints[name], ...], ()) if p.kind is p.VAR_POSITIONAL else (hints[name], None)
            for name, p in signature.parameters.items()
            if name in hints and p.kind is not p.VAR_KEYWORD
        }
        return create_model(target.__qualname__, __base__=Checked, **fields)

    @wraps(target)
    def call(*positional, **keywords):
        try:
            bound = signature.bind(*positional, **keywords)
        except TypeError:
            return target(*positional, **keywords)  # raises the message of Python
        given = {
            key: value
            for key, value in bound.arguments.items()
            if key in model().model_fields and value is not signature.parameters[key].default
        }
        valid = model()(**given)
        bound.arguments |= {key: getattr(valid, key) for key, value in given.items() if type(value) is not int}
        return target(*bound.args, **bound.kwargs)

    call.check = lambda **given: model()(**given)  # validates some arguments alone
    return call


def options_of(record: type[Checked], default) -> dict:
    """Return the fields of a record as pydantic declares keywords, {name: (annotation, default)}.

    Values are those of the record ``default`` where there is one. A field that can only be None is left out.
    """
    hints = get_type_hints(record, include_extras=True) | getattr(record, "options", {})
    fields = {name: field for name, field in record.model_fields.items() if field.annotation is not type(None)}
    usual = dict(default) if isinstance(default, Checked) else {}
    return {
        name: (hints[name], Field(usual.get(name, field.default), description=field.description))
        for name, field in fields.items()
    }
