"""Materials: what a technologist knows of the mix, in SI units."""

from .quantity import Checked, Density, StrainRate, Viscosity, YieldValue


class Bingham(Checked):
    """Fresh concrete: rigid below the yield value, flowing with the plastic viscosity above it (eqs 1-3).

    ``critical_strain_rate`` is the paper's pi_c [1/s] of the bi-viscosity law: below a shear rate of 2 pi_c the
    material is a very viscous fluid. ``None`` means a true yield value (scheme ``implicit`` only); the scheme
    ``semi-implicit`` then takes the paper's 0.1 1/s. With ``yield_value = 0`` the fluid is Newtonian and no
    yield code is compiled.
    """

    density: Density = 2300.0
    plastic_viscosity: Viscosity = 50.0
    yield_value: YieldValue = 300.0
    critical_strain_rate: StrainRate | None = None

    @property
    def newtonian(self) -> bool:
        return self.yield_value == 0.0

    @property
    def knee_stress(self) -> float:
        """Stress [Pa] at which a bi-viscosity material starts to flow: tau_y + eta 2 pi_c."""
        return self.yield_value + 2.0 * self.plastic_viscosity * (self.critical_strain_rate or 0.0)


def Newtonian(density: float = 1000.0, viscosity: float = 1e-3) -> Bingham:  # noqa: N802
    """A fluid without yield value."""
    return Bingham(density=density, plastic_viscosity=viscosity, yield_value=0.0)
