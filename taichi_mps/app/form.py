"""Inputs made from pydantic models: a text with a unit for each field, and a slider beside those of USUAL."""

from contextlib import suppress
from math import log

from nicegui import ui

from ..cli.options import allowed, choices
from ..problem.labels import in_words, what_it_is
from ..report.inputs import shown
from ..units import in_unit, unit_of, without_unit

USUAL = {  # of fresh concrete, SI units: the ends of sliders; a text may say any other
    "yield_value": (10.0, 2000.0),
    "plastic_viscosity": (1.0, 500.0),
    "density": (1000.0, 3000.0),
}
FINER, COARSER = 0.25, 2.5  # particle sizes of its slider over that of the scene


class Form:
    """Inputs for fields of pydantic models. ``values`` has those that somebody set, as text; ``changed()`` is called
    after each change. ``empty`` is what a field without a value shows, ``described``: fields are named by what they
    are."""

    def __init__(self, changed, empty="by default", described=False):
        self.changed, self.empty, self.described = changed, empty, described
        self.values: dict[str, str | bool] = {}
        self.inputs: dict[str, ui.element] = {}
        self.units: dict[str, str] = {}

    def add(self, name: str, field) -> None:
        """Put an input here for a field of a model."""
        self.units[name] = unit_of(field).strip("-")
        value = self.values.get(name, field.default)
        if field.annotation is bool:
            made = ui.switch(in_words(name), value=value)
        elif choices(field) and not unit_of(field):
            words = choices(field) if isinstance(field.default, str) else [self.empty, *choices(field)]
            made = ui.select(words, label=in_words(name), value=self.empty if value is None else value)
        else:
            made = self.text(name, field)
        self.inputs[name] = made.props(f'data-field="{name}"').classes("w-full")
        made.on_value_change(lambda event: self.set(name, event.value, field.default))
        with made:
            ui.tooltip(f"{field.description or what_it_is(name)} {allowed(field)}".strip())

    def text(self, name: str, field) -> ui.input:
        """An input for a number or a text."""
        unit = self.units[name]
        label = field.description if self.described else in_words(name)
        value = self.values.get(name, "" if field.default is None else bare(field.default, unit))
        made = ui.input(f"{label} [{unit}]" if unit else label, value=value)
        if usual(name, field):
            add_slider(made, in_words(name), unit, *usual(name, field))
        return made.props(f'debounce=300 stack-label autocomplete=off placeholder="{self.empty}"')

    def set(self, name: str, value, default) -> None:
        """Somebody has set a field."""
        self.values[name] = value.strip() if isinstance(value, str) else value
        if self.values[name] in ("", None, self.empty, default):
            del self.values[name]
        self.changed()

    def said(self, name: str) -> str:
        """A field that was set, in words."""
        value = self.values[name]
        unit = self.units[name] if without_unit(str(value)) else ""
        return f"{in_words(name)} {value} {unit}".rstrip()

    def mark(self, line: str) -> None:
        """Mark the inputs whose keys a line of what is wrong names, as 'key = value: ...'; none for an empty line."""
        wrong = {part.split(" = ")[0] for part in line.split("; ")}
        for name, made in self.inputs.items():
            made.props("error") if name in wrong else made.props(remove="error")


def add_slider(text: ui.input, name: str, unit: str, low: float, high: float) -> None:
    """Put a slider here that goes with the text of a number: from low to high in equal ratios, rounded to two
    digits."""
    slider = ui.slider(min=0.0, max=1.0, step=0.01).classes("w-full -mt-3").props(f'dense aria-label="{name}"')

    def write(event):
        text.value = bare(float(f"{low * (high / low) ** event.args:.2g}"), unit)

    def follow():
        with suppress(ValueError, ImportError):  # no number yet, or a unit and no pint
            value = float(in_unit(unit, text.value or ""))
            slider.value = min(1.0, log(max(value, low) / low) / log(high / low))

    slider.on("update:model-value", write, throttle=0.1)
    text.on_value_change(follow)
    follow()


def usual(name: str, field) -> tuple[float, float] | None:
    """Ends of the slider of a field, None where it has none: not a usual one, or without a value of its own."""
    default = field.default
    if not isinstance(default, float) or name not in (*USUAL, "spacing"):
        return None
    low, high = USUAL.get(name, (FINER * default, COARSER * default))
    return min(low, default or low), high


def bare(value, unit: str) -> str:
    """A value as people write it: small lengths in mm, other numbers without a unit, for the label has it."""
    return shown(value, unit if unit == "m" else "")
