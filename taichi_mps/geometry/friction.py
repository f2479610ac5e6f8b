"""Friction between the fluid and a wall, as a tribometer measures it."""

from pydantic import Field, model_validator

from ..units import Checked, ViscousConstant, YieldValue


class Friction(Checked):
    """Friction between the fluid and a wall, as a tribometer measures it. The wall holds the fluid up to the yield
    stress of the interface, ``yield_value`` [Pa]; beyond, it slips against that stress plus
    ``viscous_constant`` [Pa s/m] times the slip velocity. Without a yield stress this is Navier's slip, with the slip
    length viscosity/viscous_constant.
    """

    yield_value: YieldValue = Field(0.0, description="yield stress of the interface")
    viscous_constant: ViscousConstant = Field(0.0, description="viscous resistance of the interface")

    @model_validator(mode="after")
    def _holds_something(self):
        if self.yield_value == 0.0 and self.viscous_constant == 0.0:
            raise ValueError("no friction at all; must be slip = True of the wall, not Friction()")
        return self
