"""A cube of triangles whose corners are ordered as seen from outside."""

import numpy as np

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
CUBE = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4]]
    + [[1, 5, 7], [1, 7, 3]]
)


def box(low=(0.0, 0.0, 0.0), high=(1.0, 1.0, 1.0)):
    """Triangles (12, 3, 3) of a box."""
    return (np.array(low) + CORNERS * np.subtract(high, low))[CUBE]
