"""Residuals of runs as a smooth function of the constants: a regression, which averages and estimates their scatter."""

from itertools import combinations_with_replacement

import numpy as np

WIDE = 0.4  # of the logarithm of a constant, to mixes that tell a slope; particles scatter smaller ones
NEAR = 1.5 * WIDE  # of the logarithms from a point, within which runs tell of it


class Surface:
    """Residuals near a point, quadratic in the logarithms of the constants by least squares over the runs there.

    runs: a LeastSquares with mixes that were run, ``known``; of its unknowns the constants come first, and the others,
    offsets of time, need no runs.
    """

    def __init__(self, runs, centre):
        self.runs, self.centre, self.count = runs, centre, len(runs.first)
        known = np.array(list(runs.known.values()))
        self.mixes = known[np.all(np.abs(known - centre[: self.count]) <= NEAR, axis=1)]
        self.inverse = np.linalg.pinv(self.terms(self.mixes), rcond=1e-3)

    def terms(self, mixes) -> np.ndarray:
        """Terms of the quadratic, (mixes, terms)."""
        apart = (mixes - self.centre[: self.count]).T
        products = [a * b for a, b in combinations_with_replacement(apart, 2)]
        return np.stack([np.ones(len(mixes)), *apart, *products], 1)

    def weights(self, at) -> np.ndarray:
        """Weights of the runs in the residuals at a point."""
        return (self.terms(at[None, : self.count]) @ self.inverse)[0]

    def of_runs(self, at) -> np.ndarray:
        """Residuals of the runs with the offsets of a point, (runs, points)."""
        return np.array([self.runs.residuals(np.concatenate([mix, at[self.count :]])) for mix in self.mixes])

    def residuals(self, at) -> np.ndarray:
        """Residuals at a point."""
        return self.weights(at) @ self.of_runs(at)

    def best(self) -> tuple[np.ndarray, np.ndarray]:
        """The point of the least squares, its constants within WIDE of the centre, and the slopes there."""
        room = np.where(np.arange(len(self.centre)) < self.count, WIDE, np.inf)
        ends = np.clip([self.centre - room, self.centre + room], *self.runs.bounds)
        found = self.runs.solve(self.centre, self.residuals, bounds=ends)
        return found.x, found.jac

    def scatter(self, at) -> np.ndarray:
        """Error of the residuals at a point by the scatter of runs: samples (runs, points), whose squares add up. A
        finer run that corrects the residuals scatters as much as one of the runs."""
        found = self.of_runs(at)
        apart = found - self.terms(self.mixes) @ self.inverse @ found
        freedom = max(len(self.mixes) - np.linalg.matrix_rank(self.inverse), 1)
        return apart * np.sqrt((np.sum(self.weights(at) ** 2) + bool(np.ndim(self.runs.shift))) / freedom)
