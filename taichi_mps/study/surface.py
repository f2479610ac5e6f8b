"""Residuals of runs as a smooth function of the constants: a regression, which averages and estimates the scatter."""

from itertools import combinations_with_replacement

import numpy as np

RUN_STEP = 0.4  # of the logarithm of a constant, for slopes between runs; particles scatter more than smaller steps
RADIUS = 1.5 * RUN_STEP  # in the logarithms, within which runs enter the regression


class Surface:
    """Quadratic regression of the residuals on the logarithms of the constants, over the runs near a point.

    runs: a RunLeastSquares; of its unknowns the constants come first, and the others, offsets of time, need no runs.
    """

    def __init__(self, runs, centre):
        self.runs, self.centre, self.count = runs, centre, len(runs.initial)
        mixes = np.array(list(runs.computed.values()))
        self.mixes = mixes[np.all(np.abs(mixes - centre[: self.count]) <= RADIUS, axis=1)]
        self.inverse = np.linalg.pinv(self.terms(self.mixes), rcond=1e-3)

    def terms(self, mixes) -> np.ndarray:
        """Return the terms of the quadratic, (mixes, terms)."""
        distances = (mixes - self.centre[: self.count]).T
        products = [a * b for a, b in combinations_with_replacement(distances, 2)]
        return np.stack([np.ones(len(mixes)), *distances, *products], 1)

    def weights(self, at) -> np.ndarray:
        """Return the weights of the runs in the residuals at a point."""
        return (self.terms(at[None, : self.count]) @ self.inverse)[0]

    def run_residuals(self, at) -> np.ndarray:
        """Return the residuals of the runs with the offsets of a point, (runs, points)."""
        return np.array([self.runs.residuals(np.concatenate([mix, at[self.count :]])) for mix in self.mixes])

    def residuals(self, at) -> np.ndarray:
        """Return the residuals at a point by the regression."""
        return self.weights(at) @ self.run_residuals(at)

    def best(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the best point, its constants within RUN_STEP of the centre, and the slopes there."""
        reach = np.where(np.arange(len(self.centre)) < self.count, RUN_STEP, np.inf)
        bounds = np.clip([self.centre - reach, self.centre + reach], *self.runs.bounds)
        found = self.runs.solve(self.centre, self.residuals, bounds=bounds)
        return found.x, found.jac

    def scatter(self, at) -> np.ndarray:
        """Return errors of the residuals at a point by the scatter of runs, (runs, points), whose squares add up.

        A finer run that corrects the residuals scatters as much as one of the runs.
        """
        found = self.run_residuals(at)
        deviations = found - self.terms(self.mixes) @ self.inverse @ found
        freedom = max(len(self.mixes) - np.linalg.matrix_rank(self.inverse), 1)  # degrees of it
        return deviations * np.sqrt((np.sum(self.weights(at) ** 2) + bool(np.ndim(self.runs.correction))) / freedom)
