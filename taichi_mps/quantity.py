"""Alias of ``units``, for scenes that import their annotations from here. It goes in version 0.3."""

import warnings

from .units import *  # noqa: F403

warnings.warn("taichi_mps.quantity goes in version 0.3: import from taichi_mps.units", DeprecationWarning, stacklevel=2)
