"""The body over time as a page carries it: as many outputs as fit, positions in 16 bits, colours in 8."""

import base64
from dataclasses import dataclass

import numpy as np

from ..io.vtkhdf import Trajectory
from ..problem.measures import Snapshot, embed
from ..units import SceneError

MOST_SHOWN = 16_500  # particles at a time; of more some are left out
BYTES = 7  # of a particle at a time
GOLDEN = 0.618034  # multiples of it fill 0..1 evenly: which particles are left out
FINEST, FASTEST, FLOWING = 65_535, 127, 128  # largest code of a position and of a speed; the bit of what flows


@dataclass(frozen=True)
class Film:
    """The whole body at m outputs, n particles in all of them together."""

    times: np.ndarray  # [s], (m,)
    counts: np.ndarray  # particles at each output, (m,)
    low: np.ndarray  # lowest position [m], (3,)
    step: np.ndarray  # of the codes of positions [m], (3,)
    positions: np.ndarray  # codes, uint16 (n, 3): low + step * code
    colours: np.ndarray  # code of the speed, and FLOWING added to it of what flows, uint8 (n,)
    fastest: float  # speed of the code FASTEST [m/s]
    outputs: int  # of the run, of which m are shown
    share: float  # of the particles shown [-]
    last: Snapshot  # the computed part at the last output, nothing left out

    @property
    def high(self) -> np.ndarray:
        """Highest position [m], (3,)."""
        return self.low + FINEST * self.step

    def facts(self) -> dict:
        """The film for JSON; codes as base64, low byte first."""
        return {
            "times": [round(float(t), 6) for t in self.times],
            "counts": self.counts.tolist(),
            "low": self.low.tolist(),
            "step": self.step.tolist(),
            "positions": base64.b64encode(self.positions.astype("<u2").tobytes()).decode(),
            "colours": base64.b64encode(self.colours.tobytes()).decode(),
            "fastest": self.fastest,
        }


def film(trajectory: Trajectory, scene, room: int) -> Film:
    """The outputs of a run that fit into ``room`` bytes, the first and the last among them, evenly chosen, mirrored and
    revolved to the whole body. SceneError where the run has no output yet."""
    outputs = len(trajectory.times())
    if not outputs:
        raise SceneError(f"run = {trajectory.path.parent}: run.h5 holds no output yet")
    (end,) = trajectory.replay(scene=scene, chosen=[outputs - 1])
    whole = len(scene.unfold(end.state).x)
    share = min(1.0, MOST_SHOWN / whole)
    fitting = max(2, int(room / (BYTES * share * whole)))
    chosen = np.unique(np.linspace(0, outputs - 1, min(outputs, fitting)).round().astype(int)).tolist()
    shown = [reduced(replay.state, scene, share) for replay in trajectory.replay(scene=scene, chosen=chosen)]
    x, speed, flowing = (np.concatenate(parts) for parts in zip(*shown, strict=True))
    low = x.min(0)
    step = np.maximum(x.max(0) - low, 1e-9) / FINEST
    fastest = float(speed.max()) or 1.0
    return Film(
        times=trajectory.times()[chosen],
        counts=np.array([len(part) for part, _, _ in shown]),
        low=low,
        step=step,
        positions=np.round((x - low) / step).astype(np.uint16),
        colours=np.round(FASTEST * speed / fastest).astype(np.uint8) + FLOWING * flowing.astype(np.uint8),
        fastest=fastest,
        outputs=outputs,
        share=share,
        last=end.state,
    )


def reduced(part: Snapshot, scene, share: float):
    """Positions (n, 3) [m], speeds (n,) [m/s] and what flows (n,), of a share of the whole body: of a particle
    and its mirror images all or none, and the same ones at all times."""
    whole = scene.unfold(part)
    k = np.arange(len(whole.x))
    rank = np.modf(GOLDEN * (k if scene.axisymmetric else k % len(part.x)))[0]
    kept = rank < share if share < 1.0 else slice(None)
    flows = np.array([material.flows(whole.shear_rate) for material in scene.materials])
    flowing = flows[whole.mix, np.arange(len(whole.mix))]
    return embed(whole.x)[kept], whole.speed[kept], flowing[kept]
