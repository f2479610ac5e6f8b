"""Friction between the fluid and a wall, as a tribometer measures it."""

from pydantic import model_validator

from ..units import Checked, ViscousConstant, YieldValue


class Friction(Checked):
    """Friction between the fluid and a wall, as a tribometer measures it. The wall holds the fluid up to the interface
    ``yield_value`` [Pa]; beyond, it slips against the yield value plus ``viscous_constant`` [Pa s/m] times the slip
    velocity. Without a yield value this is Navier's slip, with the slip length viscosity/viscous_constant.
    """

    yield_value: YieldValue = 0.0
    viscous_constant: ViscousConstant = 0.0

    @model_validator(mode="after")
    def _holds_something(self):
        if self.yield_value == 0.0 and self.viscous_constant == 0.0:
            raise ValueError("no friction at all; must be slip = True of the wall, not Friction()")
        return self
