"""Simulation as its users have it: with a summary in words, and a picture in notebooks."""

from .. import engine
from .summary import Summary, summary


class Simulation(engine.Simulation):  # noqa: D101  (its docstring is that of its base)
    __doc__ = engine.Simulation.__doc__

    def summary(self) -> Summary:
        """Return everything that describes the run.

        Returns
        -------
        dict
            Content of summary.json, JSON-ready; prints as a table.
        """
        return summary(self)

    def _repr_png_(self) -> bytes:
        """Return the picture of the present state as PNG."""
        from PIL import Image

        from ..viz.render import Renderer

        if not hasattr(self, "_renderer"):
            self._renderer = Renderer(self.scene, 960, 540)
        return Image.fromarray(self._renderer.draw(self.snapshot(), self.measures()))._repr_png_()
