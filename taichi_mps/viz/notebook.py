"""Simulation for notebooks, which display its picture."""

from ..simulation import simulation


class Simulation(simulation.Simulation):  # noqa: D101  (its docstring is that of its base)
    __doc__ = simulation.Simulation.__doc__

    def _repr_png_(self) -> bytes:
        """Return the picture of the present state as PNG."""
        from PIL import Image

        from .render import Renderer

        if not hasattr(self, "_renderer"):
            self._renderer = Renderer(self.scene, 960, 540)
        return Image.fromarray(self._renderer.draw(self.snapshot(), self.measures()))._repr_png_()
