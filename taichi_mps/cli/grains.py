"""Grains by options of run: what they say, and what they choose."""

from typing import Annotated, get_args

from pydantic import Field

from ..engine import Grains
from ..units import Length, Ratio, SceneError, checked, require
from .options import notify

ACROSS = 4.0  # spacings across the smallest grain, where no spacing is given
LARGEST = 0.1  # diameter of a stone [m]; a larger number was meant in millimetres


@checked
def row(diameter: Annotated[Length, Field(le=LARGEST)], fraction: Ratio = 1.0) -> tuple[float, float]:
    """Diameter [m] and fraction of a word of a grading."""
    return diameter, fraction


def grains_of(options) -> Grains | None:
    """Grains that the options of a run ask for, or none."""
    if options.grains is None:
        return None
    known = options.model_dump(exclude_none=True).items()
    given = {name.removeprefix("grains_"): value for name, value in known if name.startswith("grains_")}
    require("volume" in given, "grains_volume = none: must be given beside grains, such as 0.3")
    grading = [word.split(":") for word in options.grains.split("+")]
    wrong = f"grains = {options.grains}: must be a diameter, 12mm, or diameters and fractions, 8mm:0.4+16mm:0.6"
    require(all(len(words) == (1 if len(grading) == 1 else 2) for words in grading), wrong)
    try:
        rows = [row(**dict(zip(("diameter", "fraction"), words, strict=False))) for words in grading]
    except SceneError as error:
        raise SceneError(f"{wrong} ({error})") from None
    return Grains(diameter=rows[0][0] if len(rows) == 1 else rows, volume_fraction=given.pop("volume"), **given)


def chosen_for(grains: Grains, keywords: dict, parameters) -> dict:
    """Keywords of a scene as grains need them: a quarter of the smallest grain's width as spacing, the whole body."""
    found = dict(keywords)
    if "spacing" not in found and "spacing" in parameters.model_fields:
        found["spacing"] = grains.width / ACROSS
        notify(f"spacing = {found['spacing']:g} m: a quarter of the smallest grain, if not given")
    model = parameters.model_fields.get("model")
    if model and "model" not in found and "full" in get_args(model.annotation):
        found["model"] = "full"
    return found
