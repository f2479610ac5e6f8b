"""The pinhole camera of the pictures, and of the lights that cast shadows."""

import numpy as np


class Camera:
    """Pinhole camera that looks along ``direction``, so near that the points given just fill ``frame`` of its picture.

    frame: left, top, right, bottom as fractions of the picture.
    """

    def __init__(self, direction, points, width, height, frame=(0.05, 0.05, 0.95, 0.95), view_angle=22.0):
        forward = np.asarray(direction, float) / np.linalg.norm(direction)
        right = np.cross(forward, (0, 0, 1) if abs(forward[2]) < 0.99 else (0, 1, 0))
        right /= np.linalg.norm(right)
        self.axes = np.array([right, np.cross(right, forward), forward])  # rows: right, up, forward
        self.width, self.height, self.view_angle = width, height, view_angle
        self.focal = 0.5 * height / np.tan(0.5 * np.radians(view_angle))  # [pixels]
        across, up, ahead = (np.asarray(points, float) @ self.axes.T).T
        left, top, right, bottom = (np.array(frame) - 0.5) * [width, height, width, height] / self.focal
        bounds = [(max(across - right * ahead), min(across - left * ahead), right - left)]
        bounds += [(max(up + top * ahead), min(up + bottom * ahead), bottom - top)]
        z = min((low - high) / room for high, low, room in bounds)  # nearest at which both directions fit
        x = 0.5 * (bounds[0][0] + bounds[0][1] + (right + left) * z)
        y = 0.5 * (bounds[1][0] + bounds[1][1] - (bottom + top) * z)
        self.eye = np.array([x, y, z]) @ self.axes
        self.middle = np.mean([np.min(points, 0), np.max(points, 0)], 0)

    def seen(self, points):
        """World points (n, 3) in the axes of the picture: to the right, down, ahead [m]."""
        return (np.asarray(points, float) - self.eye) @ (self.axes * [[1.0], [-1.0], [1.0]]).T

    def project(self, points, scale=1):
        """Columns, rows and depths [m] of world points (n, 3), in pixels of 1/scale."""
        x, y, z = self.seen(points).T
        across, down = (0.5 * size + self.focal * a / z for size, a in ((self.width, x), (self.height, y)))
        return np.column_stack([scale * across, scale * down, z])

    def rays(self, columns, rows):
        """World directions (..., 3) to places in the picture, of depth 1."""
        across, down = (columns - 0.5 * self.width) / self.focal, (rows - 0.5 * self.height) / self.focal
        return across[..., None] * self.axes[0] - down[..., None] * self.axes[1] + self.axes[2]
