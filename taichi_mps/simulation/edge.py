"""Which edge of the domain particles have crossed, and what enlarges it."""

import numpy as np


def crossing(rows: dict, scene) -> tuple[str, float] | None:
    """Of rows ``x`` (n, d) [m] and ``u`` (n, d) [m/s]: the edge of a scene's domain that most of those outside have
    crossed, with what enlarges it, in one line, and the largest of their speeds [m/s]. None where none is outside or
    one is no number."""
    x, (low, high) = rows["x"], np.array(scene.domain, float)
    bounded = ~np.array(scene.periodic)
    beyond = np.stack([(x < low) & bounded, (x > high) & bounded], axis=-1)  # (n, d, 2)
    if not np.all(np.isfinite(x)) or not beyond.any():
        return None
    axis, end = np.unravel_index(beyond.sum(0).argmax(), (scene.dimension, 2))
    axes = "rz" if scene.axisymmetric else {2: "xz", 3: "xyz"}[scene.dimension]
    out = beyond[:, axis, end]
    speed = float(np.linalg.norm(rows["u"][out], axis=1).max())
    remedy = scene.enlarged_by if scene.enlarged_by in scene.parameters else "the domain of the scene"
    return (
        f"{out.sum()} particles left the domain beyond {axes[axis]} = {scene.domain[end][axis]:.4g} m, its "
        f"{('lower', 'upper')[end]} end, at up to {speed:.3g} m/s; enlarge {remedy}",
        speed,
    )
