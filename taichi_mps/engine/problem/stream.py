"""Stream: what an inlet brings where there are grains, as it stands in the hose at 0 s. Plain NumPy."""

import numpy as np


class Stream:
    """Layers of an inlet one behind the other in its hose, and the grains in them.

    Parameters
    ----------
    scene : Scene
        Scene with grains.
    inlet : Inlet
        Inlet of that scene.

    Attributes
    ----------
    x : ndarray, shape (n, d)
        Positions, of the first layer those in which it begins to leave the mouth at its ``centre`` [m].
    layer : ndarray of int, shape (n,)
        Number of the layer with which each particle enters: a grain enters whole, with its first one.
    places : tuple of ndarray
        Number of the grain of each particle, from 1, 0 of mortar; centres, radii [m] and rotations of the grains.
    """

    def __init__(self, scene, inlet):
        d, axes, origin = scene.dimension, inlet.frame, np.array(inlet.centre)
        axes[0] *= np.sign(np.linalg.det(axes))  # a rotation, for a reflection would mirror the grains
        layer, number = scene.inlet_layer(inlet), np.arange(inlet.layers(scene.spacing))
        self.step = scene.spacing * inlet.unit_direction
        self.x = (layer - number[:, None, None] * self.step).reshape(-1, d)
        self.layer = np.repeat(number, len(layer))
        self.places = np.zeros(len(self.x), int), np.zeros((0, d)), np.zeros(0), np.zeros((0, d, d))
        if scene.grains.centres is None:  # in the lattice of the hose
            of, centres, radii, turns = scene.grains.places(
                (self.x - origin) @ axes.T, scene.spacing, scene.domain, (False,) * d
            )
            self.places = (
                of,
                centres @ axes + origin,
                radii,
                axes.T @ turns @ (np.eye(d) if len(scene.grains.rows) else axes),
            )
            first = np.full(len(radii) + 1, len(number))
            np.minimum.at(first, of, self.layer)
            self.layer = np.where(of > 0, first[of], self.layer)
