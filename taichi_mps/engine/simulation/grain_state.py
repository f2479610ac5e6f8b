"""Where the grains of a simulation are, and how they move."""

from dataclasses import dataclass

import numpy as np

from ..terms.rigid import Rigid


@dataclass(frozen=True, eq=False)
class GrainState:
    """Grains at the end of a step, g of them in d dimensions, those yet to enter included.

    Parameters
    ----------
    centres : ndarray, shape (g, d)
        Centres [m].
    velocities : ndarray, shape (g, d)
        Velocities of the centres [m/s].
    spins : ndarray, shape (g, 1) in two dimensions, (g, 3) in three
        Angular velocities [1/s].
    rotations : ndarray, shape (g, d, d)
        Rotations since 0 s, of clumps from their shape as given [-].
    radii : ndarray, shape (g,)
        Radii [m].

    Examples
    --------
    >>> from taichi_mps.engine.simulation.grain_state import GrainState
    >>> GrainState(*[[0.0]] * 5).radii
    [0.0]
    """

    centres: np.ndarray
    velocities: np.ndarray
    spins: np.ndarray
    rotations: np.ndarray
    radii: np.ndarray

    @classmethod
    def of(cls, rigid: Rigid) -> "GrainState":
        """Read the grains of a scheme.

        Parameters
        ----------
        rigid : Rigid
            Its grains.

        Returns
        -------
        GrainState
            Grains.
        """
        state, d = rigid.motions.read(rigid.count), rigid.dimension
        spins = state["grain_spin"][:, 2:] if d == 2 else state["grain_spin"]
        centres, velocities = (state[f"grain_{name}"][:, :d] for name in ("centre", "velocity"))
        return cls(centres, velocities, spins, state["grain_turn"][:, :d, :d], rigid.radii.copy())
