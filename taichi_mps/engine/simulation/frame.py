"""A frame: a body at one instant, as the outputs of a run show it, computed or read back."""

from dataclasses import dataclass, replace

import numpy as np

from ..problem.loads import load_results
from ..problem.measures import Snapshot
from ..problem.scene import Scene
from ..schemes.step_report import StepReport


@dataclass(frozen=True)
class Frame:
    """Body of a scene at one instant.

    Parameters
    ----------
    scene : Scene
        Scene of the run.
    state : Snapshot
        Fluid at this instant.
    report : StepReport, optional
        What the step did in which it lies; None before the first one and of a frame that was read back.

    Examples
    --------
    >>> import taichi_mps as mps
    >>> from taichi_mps.engine.simulation.frame import Frame
    >>> scene = mps.slump_cone(model="axisymmetric", spacing=0.05)
    >>> Frame(scene, mps.measure.still(scene.fluid, scene.spacing)).time
    0.0
    """

    scene: Scene
    state: Snapshot
    report: StepReport | None = None

    @property
    def time(self) -> float:
        """Time of the frame [s]."""
        return self.state.time

    def snapshot(self) -> Snapshot:
        """Return the fluid at this instant.

        Returns
        -------
        Snapshot
            Computed part.
        """
        return self.state

    def measures(self) -> dict[str, float]:
        """Return what the scene measures of the whole body, and loads on the walls where they were asked for.

        Returns
        -------
        dict of str to float
            Results by name.
        """
        whole = self.scene.unfold(self.state)
        found = self.scene.measure(whole) if self.scene.measure else {}
        return found | load_results(whole, self.scene.mirrors, self.scene.axisymmetric)


def frame_between(earlier: Frame, later: Frame, time: float) -> Frame:
    """Interpolate two frames at a ``time`` [s]: places and velocities on a line, all else as of the later one.

    Particles that came in since the earlier one have moved at their present velocity.
    """
    first, last, count = earlier.state, later.state, len(earlier.state.x)
    back, span = time - last.time, last.time - first.time
    way = np.vstack([last.x[:count] - first.x, span * last.u[count:]])
    gain = np.vstack([last.u[:count] - first.u, 0.0 * last.u[count:]])
    low, high = np.array(later.scene.domain, float)
    # across a periodic axis the shorter way
    way -= later.scene.periodic * (high - low) * np.round(way / (high - low))
    part = back / span
    return replace(later, state=replace(last, time=time, x=last.x + part * way, u=last.u + part * gain))
