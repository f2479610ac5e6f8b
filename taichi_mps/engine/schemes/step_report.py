"""Report of one step, and the errors of a run whose results are invalid."""

import math
from dataclasses import asdict, dataclass

DOUBTFUL_VOLUME_ERROR = 0.02  # volume error at any time beyond which a result is doubtful [-]


@dataclass(frozen=True)
class StepReport:
    """Report of one time step, as ``Simulation.step`` returns it.

    Parameters
    ----------
    step : int
        Number of the step.
    time : float
        Time at its end [s].
    dt : float
        Length [s].
    dt_limit : str
        What bounded it: Courant, diffusion, growth, maximum, first or end (where a prescribed motion or inflow
        changes).
    max_speed : float
        Largest speed of a particle [m/s].
    mean_speed : float
        Root mean square of the speed [m/s].
    moving_speed : float
        Speed of the moving part, sqrt(sum V u^4/sum V u^2) [m/s].
    acceleration : float
        Root mean square of the change of velocity over dt [m/s2]; not computed by ``semi-implicit``.
    kinetic_energy : float
        Kinetic energy of the computed part [J], in two dimensions [J/m].
    unyielded_fraction : float
        Fraction of the fluid particles below the yield stress [-].
    outer_iterations : int
        Augmented-Lagrangian (Uzawa) iterations of ``implicit``, direct (Picard) iterations of the viscosity of
        ``semi-implicit``.
    solver_iterations : int
        Iterations of the linear solver, for the velocity (``implicit``) or the pressure (``semi-implicit``).
    residual : float
        Relative residual of the last solve [-].
    volume_error : float
        Packing of a full lattice over the mean of the particles with a full neighbourhood, less 1 [-].
    flowing_fraction : float, optional
        Fraction of the volume where the viscous stress is over 5 % of the yield stress [-].
    volume_error_max : float, optional
        Largest magnitude of ``volume_error`` in the run so far, while no jet falls [-].
    strain_rate_residual, divergence_residual : float, optional
        Root mean squares of 2|D - q| and |div u - s| after the last outer iteration of ``implicit``, over
        sqrt(g/H + U^2/H^2) [-]; nan of ``semi-implicit``.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> numbers = dict.fromkeys(("time", "dt", "max_speed", "mean_speed", "moving_speed", "acceleration"), 0.0)
    >>> numbers |= dict.fromkeys(("kinetic_energy", "unyielded_fraction", "residual", "volume_error"), 0.0)
    >>> report = mps.StepReport(step=1, dt_limit="Courant", outer_iterations=6, solver_iterations=40, **numbers)
    >>> report.outer_iterations
    6
    """

    step: int
    time: float
    dt: float
    dt_limit: str
    max_speed: float
    mean_speed: float
    moving_speed: float
    acceleration: float
    kinetic_energy: float
    unyielded_fraction: float
    outer_iterations: int
    solver_iterations: int
    residual: float
    volume_error: float
    flowing_fraction: float = math.nan
    volume_error_max: float = 0.0
    strain_rate_residual: float = math.nan
    divergence_residual: float = math.nan

    def _repr_html_(self):
        rows = "".join(
            f"<tr><td>{k}</td><td>{v:.6g}</td></tr>" if isinstance(v, float) else f"<tr><td>{k}</td><td>{v}</td></tr>"
            for k, v in asdict(self).items()
        )
        return f"<table>{rows}</table>"


class DivergedError(RuntimeError):
    """Error of a run whose results are invalid from some step on.

    Parameters
    ----------
    message : str
        What happened, when, and what helps.
    report : StepReport or None
        Last good step.
    stopped_by : str, optional
        What stopped the run, 'diverged' by default.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> error = mps.DivergedError("diverged at t = 0.1 s", report=None)
    >>> error.stopped_by
    'diverged'
    """

    stopped_by = "diverged"

    def __init__(self, message: str, report: StepReport | None, stopped_by: str | None = None):
        super().__init__(message)
        self.report, self.stopped_by = report, stopped_by or self.stopped_by


class DomainError(DivergedError):
    """Error of a run whose fluid has reached an edge of the domain.

    The message says which edge, and what enlarges the domain.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.DomainError("left at x", report=None).stopped_by
    'edge of the domain'
    """

    stopped_by = "edge of the domain"


class UnmeasuredError(DivergedError):
    """Error of a run that ended without a number for a result that it was made for.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> mps.UnmeasuredError("slump_m is nan", report=None, stopped_by="rest").stopped_by
    'rest'
    """
