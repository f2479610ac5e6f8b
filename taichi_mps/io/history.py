"""Writing and reading of the history of a run, history.csv: one row a step."""

import csv
import os
from pathlib import Path

import numpy as np

from ..units import File, SceneError, regular_file, require, user_path, validated

COLUMN_MEANINGS = {
    "time_s": "time at the end of the step, or the time limit that ended the run in it [s]",
    "dt_s": "length of the step [s]",
    "slump_m": "fall of the top of the body at its axis [m]; nan where the scene measures none",
    "spread_m": "diameter of the body, mean over all directions [m]; nan where the scene measures none",
    "max_speed_m_s": "largest speed of a particle [m/s]",
    "kinetic_energy_J": "kinetic energy of the computed part of the fluid [J]; in 2-D per metre of depth [J/m]",
    "unyielded_fraction": "number of fluid particles below the yield stress over that of all [-]; of a body that "
    "stands near it the solver leaves some on either side",
    "flowing_fraction": "fraction of the volume that flows [-]: where the viscous part of the stress is over 5 % of "
    "the yield stress; 0 of a body that stands. Of a fluid without yield stress what is sheared at all",
    "outer_iterations": "augmented-Lagrangian (Uzawa) iterations of implicit, direct (Picard) iterations of the "
    "viscosity of semi-implicit, in the step [-]",
    "solver_iterations": "iterations of the linear solver in the step [-]: of the velocity solves of implicit, of the "
    "pressure of semi-implicit",
    "volume_error": "change of the volume of what has a full neighbourhood, from the packing [-]",
    "volume_error_max": "largest size of it so far, while no jet falls [-]: that is looser until it lands",
    "strain_rate_residual": "root mean square of 2|D - q| after the last outer iteration of implicit, over the rate of "
    "the scene, sqrt(g/H + U^2/H^2) [-]; nan of semi-implicit",
    "divergence_residual": "root mean square of |div u - s|, likewise [-]",
}
MEASURED = ("slump_m", "spread_m")  # columns of the scene's measures, in every run
# columns that are attributes of the step report by another name
REPORT_ATTRIBUTES = {"time_s": "time", "dt_s": "dt", "max_speed_m_s": "max_speed", "kinetic_energy_J": "kinetic_energy"}
COLUMNS = tuple(COLUMN_MEANINGS)  # of every run; more by the measures of the scene
NOTHING = "nan"  # what an empty cell stands for
MAX_BYTES = 3e8  # a million rows, in seconds


class History:
    """Writer of history.csv, one row a step, flushed as it goes.

    Measures other than slump and slump flow get columns of their own at the end, also one that appears later; where a
    measure is missing its cell is nan.

    Parameters
    ----------
    path : path-like
        File.
    kept : float, optional
        Continue an existing file up to this time [s]; a new file by default.
    """

    def __init__(self, path, kept: float | None = None):
        self.path = user_path(path)
        before = [] if kept is None or not self.path.is_file() else read_rows(path)
        rows = [row for row in before if float(row["time_s"]) <= kept * (1 + 1e-8)]  # times have nine digits
        self.empty = not rows
        self._rewrite(rows[0] if rows else COLUMNS, rows)

    def _rewrite(self, columns, rows):
        """Rewrite the file with these columns and rows, and continue behind them."""
        self.columns = tuple(dict.fromkeys(columns))
        partial = self.path.with_suffix(".partial")  # a run killed meanwhile keeps its old file
        self.file = open(partial, "w", newline="", encoding="utf-8")  # noqa: SIM115  (closed in close)
        self.rows = csv.DictWriter(self.file, self.columns, restval="nan", lineterminator="\n")
        self.rows.writeheader()
        self.rows.writerows(rows)
        self.file.flush()
        os.replace(partial, self.path)

    def add(self, row: dict) -> None:
        """Write a row and flush it.

        Parameters
        ----------
        row : dict of str to float
            Values by column.
        """
        if set(row) - set(self.columns):
            self.close()
            self._rewrite((*self.columns, *row), read_rows(self.path))
        self.rows.writerow({key: f"{v:.9g}" if isinstance(v, float) else v for key, v in row.items()})
        self.file.flush()

    def close(self) -> None:
        """Close the file."""
        self.file.close()


def history_row(sim, measures: dict) -> dict:
    """Return the row of history.csv of a simulation now.

    Parameters
    ----------
    sim : Simulation
        Simulation; before its first step only the state of the fluid is known.
    measures : dict of str to float
        Results by name.

    Returns
    -------
    dict of str to float
        Values by column.
    """
    measures = {key: value for key, value in measures.items() if key != "slump_max_m"}  # the summary's alone
    attributes = {key: REPORT_ATTRIBUTES.get(key, key) for key in COLUMNS if key not in MEASURED}
    if sim.report is not None:
        return measures | {key: getattr(sim.report, name) for key, name in attributes.items()} | {"time_s": sim.time}
    s = sim.snapshot()
    densities = np.array([m.density for m in sim.scene.materials])[s.mix]
    if sim.scene.grains:
        densities[s.grain > 0] = sim.scene.grains.density
    masses = densities * sim.scene.volumes_at(s.x)
    totals = {"max_speed_m_s": float(s.speed.max()), "kinetic_energy_J": 0.5 * float((masses * s.speed**2).sum())}
    return measures | dict.fromkeys(attributes, 0.0) | totals | {"unyielded_fraction": 1.0 - s.yielded.mean()}


def read_rows(path) -> list[dict[str, str]]:
    """Read the rows of a history.csv as text.

    Parameters
    ----------
    path : path-like
        File.

    Returns
    -------
    list of dict of str to str
        Cells by column.

    Raises
    ------
    SceneError
        For a file that is damaged, of version 0.2, or no history.
    """
    text = regular_file(str(path), path, MAX_BYTES).read_bytes().decode("utf-8", "replace")
    try:
        # a process killed while it wrote leaves an incomplete row
        columns, *rows = list(csv.reader(text.split("\n")[:-1])) or [[]]
    except csv.Error:
        columns, rows = [], []
    require("viscous_iterations" not in columns, f"{path}: of version 0.2; version 0.3.0 reads it")
    require(
        set(COLUMNS) <= set(columns),
        f"{path}: damaged or no history of a run; must have the columns {', '.join(COLUMNS)}",
    )
    wrong = next((k for k, cells in enumerate(rows, 1) if len(cells) != len(columns)), None)
    require(wrong is None, f"{path}: damaged, row {wrong} has another number of cells than there are columns")
    rows = [dict(zip(columns, cells, strict=True)) for cells in rows]
    try:
        _ = [float(cell or NOTHING) for row in rows for cell in row.values()]
    except ValueError as error:
        raise SceneError(f"{path}: damaged, {error}") from None
    return rows


@validated
def read_history(path: File) -> dict[str, np.ndarray]:
    """Read the columns of a history.csv.

    Parameters
    ----------
    path : path-like
        File.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        Values of each step by column.

    Raises
    ------
    SceneError
        If the file is missing, damaged, or no history.

    Examples
    --------
    >>> from taichi_mps.io.history import read_history
    >>> read_history("nowhere/history.csv")
    Traceback (most recent call last):
        ...
    taichi_mps.units.SceneError: run = nowhere: holds no history.csv; must be the folder of a run
    """
    require(Path(path).is_file(), f"run = {Path(path).parent}: holds no history.csv; must be the folder of a run")
    rows = read_rows(path)
    return {key: np.array([row[key] or NOTHING for row in rows], float) for key in (rows[0] if rows else COLUMNS)}
