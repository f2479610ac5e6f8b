"""Alias of ``units``, for scenes that import their annotations from here."""

from .units import *  # noqa: F403
from .units import SceneError, checked  # noqa: F401
