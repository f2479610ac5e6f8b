"""Inputs made from pydantic models: a text with a unit for each field, and a slider beside those of USUAL."""

from typing import Annotated

import numpy as np
from nicegui import ui
from pydantic import TypeAdapter, ValidationError

from ..cli.options import allowed, choices
from ..problem.labels import in_words, what_it_is
from ..units import unit_of

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
        self.empty, self.described = empty, described
        self.values: dict[str, str | bool] = {}
        self.inputs: dict[str, ui.element] = {}
        self.units: dict[str, str] = {}
        self._changed = changed

    def add(self, name: str, field) -> None:
        """Put an input here for a field of a model."""
        self.units[name] = unit_of(field).strip("-")
        self.inputs[name] = made = self._made(name, field)
        made.props(f'data-field="{name}"').classes("w-full")
        with made:
            ui.tooltip(f"{field.description or what_it_is(name)} {allowed(field)}".strip())

    def given(self, model) -> dict:
        """What was set of the fields of a model."""
        return {name: value for name, value in self.values.items() if name in model.model_fields}

    def put(self, name, text: str) -> None:
        """Set a field from outside, as if it had been typed."""
        self.inputs[name].value = text

    def said(self, name) -> str:
        """A field that was set, in words."""
        value = self.values[name]
        unit = self.units[name] if str(value).replace(".", "", 1).isdigit() else ""
        return f"{in_words(name)} {value} {unit}".rstrip()

    def mark(self, line: str) -> None:
        """Mark the inputs whose keys a line of what is wrong names, as 'key = value: ...'; none for an empty line."""
        wrong = {part.split(" = ")[0] for part in line.split("; ")}
        for name, made in self.inputs.items():
            made.props("error") if name in wrong else made.props(remove="error")

    def _made(self, name, field):
        if field.annotation is bool:
            made = ui.switch(in_words(name), value=self.values.get(name, field.default))
        elif choices(field) and not unit_of(field):
            none = {} if isinstance(field.default, str) else {None: self.empty}
            words = none | {word: word for word in choices(field)}
            made = ui.select(words, label=in_words(name), value=self.values.get(name, field.default))
        else:
            return self._text(name, field)
        own = field.default  # of the scene
        return made.on_value_change(lambda event: self._set(name, None if event.value == own else event.value))

    def _text(self, name, field):
        unit = self.units[name]
        words = field.description if self.described else in_words(name)
        label = f"{words} [{unit}]" if unit else words
        made = ui.input(label, value=self.values.get(name, written(field.default, unit)))
        made.props("debounce=300 stack-label autocomplete=off" + f' placeholder="{self.empty}"')
        slider = Slider(made, usual(name, field), name, field) if usual(name, field) else None

        def typed(event):
            if slider:
                slider.follow(event.value)
            self._set(name, (event.value or "").strip())

        return made.on_value_change(typed)

    def _set(self, name, value):
        self.values[name] = value
        if value is None or value == "":  # the scene's own
            del self.values[name]
        self._changed()


class Slider:
    """A slider beside the text of a number: over values of two digits, in about equal ratios."""

    def __init__(self, text, ends, name, field):
        low, high = ends
        self.text, self.unit = text, unit_of(field)
        self.values = np.array(sorted({float(f"{value:.2g}") for value in np.geomspace(low, high, 150)}))
        self.number = TypeAdapter(Annotated[(field.annotation, *field.metadata)])
        self.element = ui.slider(min=0, max=len(self.values) - 1).classes("w-full -mt-3")
        self.element.props(f'dense aria-label="{in_words(name)}"')
        self.element.on("update:model-value", lambda event: self.write(event.args), throttle=0.1)
        self.follow(text.value)

    def write(self, position) -> None:
        """The user moved it: the text follows."""
        self.text.value = written(float(self.values[int(position)]), self.unit)

    def follow(self, text) -> None:
        """Move to the value that a text means, if it means one."""
        try:
            value = max(self.number.validate_python(text), self.values[0])
        except ValidationError:
            return
        self.element.value = int(np.abs(np.log(self.values / value)).argmin())


def usual(name, field) -> tuple[float, float] | None:
    """Ends of the slider of a field, None where it has none: not a usual one, or without a value of its own."""
    if not isinstance(field.default, float):
        return None
    if name == "spacing":
        return FINER * field.default, COARSER * field.default
    if name not in USUAL:
        return None
    low, high = USUAL[name]
    return (min(low, field.default) if field.default else low), high


def written(value, unit: str) -> str:
    """A default as people write it: small lengths in mm, other numbers bare, since the label has their unit."""
    if value is None or not isinstance(value, float):
        return "" if value is None else str(value)
    return f"{float(f'{1e3 * value:.6g}'):g} mm" if unit == "m" and value < 0.1 else f"{value:g}"
