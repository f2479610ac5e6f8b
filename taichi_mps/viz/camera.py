"""The camera that all painters share, and their light."""

import numpy as np

PAPER = (0.955, 0.96, 0.965)  # background colour
SUN = np.array((0.45, -0.6, 0.72))  # where its light goes: right, up, away from the eye
SUN_TEXELS, SKY_TEXELS = 256, 72  # of the sides of the shadow maps of the sun and of the sky


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

    def matrix(self, origin, scale=1):
        """(3, 4) matrix from points relative to ``origin`` to (column depth, row depth, depth), pixels 1/scale."""
        f = self.focal * scale
        lens = np.array([[f, 0, 0.5 * self.width * scale], [0, -f, 0.5 * self.height * scale], [0, 0, 1]])
        return lens @ np.column_stack([self.axes, self.axes @ (origin - self.eye)])

    def project(self, points):
        """Columns, rows and depths of world points [m] (n, 3)."""
        q = np.asarray(points, float) @ self.matrix(np.zeros(3))[:, :3].T + self.matrix(np.zeros(3))[:, 3]
        return np.column_stack([q[:, :2] / q[:, 2:], q[:, 2]])
