"""Studies: many runs of a scene, and what they answer. ``sweep``, ``calibrate``; docs/studies.md."""

from .calibrate import calibrate
from .sweep import sweep

__all__ = ["calibrate", "sweep"]
