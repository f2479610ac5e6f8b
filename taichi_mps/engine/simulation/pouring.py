"""Pouring: the layers of particles that an inlet adds to a run, when they are due and there is room."""

import numpy as np

from ...units import INSTANT
from ..problem.inlet import buried


class Pouring:
    """Layers of particles that enter through an inlet of a scene. Layer k is due k intervals after the start, later by
    ``delay`` [s], the time for which layers before it found the mouth buried."""

    def __init__(self, scene, inlet):
        self.scene, self.spacing, self.start = scene, scene.spacing, inlet.start
        self.layer = scene.inlet_layer(inlet)  # (m, d) [m]
        self.mix = scene.mix_of(inlet)
        self.structure = scene.materials[self.mix].initial_structure
        self.inlet = inlet
        self.speed = float(np.linalg.norm(inlet.fastest(scene.spacing)))  # [m/s]
        self.layers = inlet.layers(scene.spacing)
        self.layer_volume = inlet.layer_volume(scene.spacing)  # of the whole hose [m3]
        clear = [abs(mirror.distance(np.array([inlet.centre]))[0]) >= inlet.radius for mirror in scene.mirrors]
        self.copies = 2 ** sum(clear)  # of the hose in the whole body: twice for each mirror plane that does not cut it
        self.interval = self.layer_volume / inlet.rate  # [s]
        self.entered = int(inlet.start == 0.0)  # layers; the first may be there from the beginning
        self.delay = 0.0

    @property
    def done(self) -> bool:
        return self.entered >= self.layers

    @property
    def end(self) -> float:
        """Time [s] at which the last layer is due."""
        return self.start + self.layers * self.interval + self.delay

    @property
    def to_come(self) -> int:
        """Particles that are not there at the beginning of the run."""
        return self.particles(self.layers) - self.particles(int(self.start == 0.0))

    def particles(self, layers: int) -> int:
        """Number of particles that enter with so many layers."""
        return sum(len(self.scene.entering(self.inlet, k)[0]) for k in range(layers))

    @property
    def volume(self) -> float:
        """Volume [m3] that has entered through the whole hose."""
        return self.entered * self.layer_volume

    def pour(self, time: float, particles, rigid) -> float:
        """Give the particles the layer that has to enter at this time [s], if any, and its grains to ``rigid``. The
        speed [m/s] of the jet, 0 before its first layer and after the step of its last one."""
        done = self.done
        if self.due(time):
            _, slot = self.scene.entering(self.inlet, self.entered)
            if (x := self.enter(time, particles.x.to_numpy()[: particles.number])) is not None:
                u = np.broadcast_to(self.inlet.velocity(self.spacing, time), x.shape)
                particles.append(x, u, mix=self.mix, structure=self.structure, slot=slot)
                rigid.enter(slot, x, u)
        return self.speed if self.entered and not done else 0.0

    @property
    def next(self) -> float:
        """Time [s] at which the next layer is due."""
        return self.start + self.entered * self.interval + self.delay

    def due(self, time: float) -> bool:
        """Whether a layer has to enter at this time [s]."""
        return not self.done and time >= self.next - INSTANT

    def enter(self, time: float, x: np.ndarray) -> np.ndarray | None:
        """Places (m, d) [m] of what enters with the layer that is due at this time [s], as far in front of the mouth as
        it has come since; None, and due later, if a particle that is there, of x (n, d) [m], is in its way."""
        late = max(0.0, time - self.next)
        layer = self.scene.entering(self.inlet, self.entered)[0] + self.inlet.displacement(self.next)
        layer += late * self.inlet.velocity(self.spacing, self.next)
        if buried(layer, x, self.spacing):
            self.delay += late
            return None
        self.entered += 1
        return layer
