"""What one step did, and the error of a run that left the range where its numbers mean anything."""

import math
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class StepReport:
    """What one step did."""

    step: int
    time: float  # at the end of the step [s]
    dt: float  # [s]
    dt_limit: str  # what bounded dt: Courant, diffusion, growth, maximum, first or output
    max_speed: float  # [m/s]
    mean_speed: float  # root mean square [m/s]
    moving_speed: float  # of what moves: sqrt(sum V u^4/sum V u^2) [m/s]
    acceleration: float  # change of velocity over dt, root mean square [m/s2]; not computed by semi-implicit
    kinetic_energy: float  # [J]
    unyielded_fraction: float  # of the fluid particles [-]
    viscous_iterations: int  # augmented-Lagrangian (implicit) or direct ones for the viscosity (semi-implicit)
    pressure_iterations: int  # of the linear solver: of the velocity (implicit), of the pressure (semi-implicit)
    residual: float  # relative, of the last solve
    volume_error: float  # full over mean packing, less 1, of the particles with a full neighbourhood [-]
    flowing_fraction: float = math.nan  # of the volume: where the viscous stress is over 5 % of the yield stress [-]
    volume_error_max: float = 0.0  # largest size of it in the run so far [-]

    def _repr_html_(self):
        rows = "".join(
            f"<tr><td>{k}</td><td>{v:.6g}</td></tr>" if isinstance(v, float) else f"<tr><td>{k}</td><td>{v}</td></tr>"
            for k, v in asdict(self).items()
        )
        return f"<table>{rows}</table>"


class DivergedError(RuntimeError):
    """The run left the range where its numbers mean anything; carries the last report and what stopped it."""

    stopped_by = "diverged"

    def __init__(self, message: str, report: StepReport | None, stopped_by: str | None = None):
        super().__init__(message)
        self.report, self.stopped_by = report, stopped_by or self.stopped_by


class DomainError(DivergedError):
    """The fluid has reached an edge of the domain: says which, and what enlarges it."""

    stopped_by = "edge of the domain"


class UnmeasuredError(DivergedError):
    """A run came to its end, ``stopped_by`` as it says, and a result that it was made for is no number."""
