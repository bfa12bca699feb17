"""How far estimates are from the truth that nobody knows: Stein's unbiased estimate of the risk.

If p = x + noise of variance sigma^2, an estimate f(p) of x has the expected squared error

    |f(p) - x|^2 = |f(p) - p|^2 - n sigma^2 + 2 sigma^2 (sum of the leverages df_i / dp_i)

(Stein, "Estimation of the mean of a multivariate normal distribution", Annals of Statistics
1981). Single terms of the sum are noisy; means over the surroundings of a vertex tell which of
several estimates to trust there.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.runtime.lean import lean_njit


@dataclass(frozen=True)
class Estimates:
    """Several estimates of the same vertices, in units of the standard deviation of the noise at each.

    Attributes
    ----------
    residuals : (n, s) float32
        Heights of the measured vertices over each estimate.
    leverages : (n, s) float32
        How much each estimate follows its own vertex: 1 for no smoothing at all, near 0 for much.
    """

    residuals: SingleArray
    leverages: SingleArray

    def mean_risks(self, rows: BoolArray | slice = slice(None)) -> FloatArray:
        """Mean squared error of each estimate, (s,), over all vertices or some."""
        residuals, leverages = self.residuals[rows], self.leverages[rows]
        squares = np.einsum("ns,ns->s", residuals, residuals, dtype=np.float64) / max(len(residuals), 1)
        result: FloatArray = squares + 2.0 * leverages.mean(axis=0, dtype=np.float64) - 1.0
        return result


def noise_factor(squares: FloatArray, leverages: FloatArray) -> float:
    """How much less noise there is if the estimate that predicts best leaves smaller residuals than the noise would.

    Where a surface has edges, noise is easily overestimated until something keeps them.

    Parameters
    ----------
    squares, leverages : (s,) float64
        Mean squared residual and mean leverage of some estimates.
    """
    free = 1.0 - leverages
    best = np.argmin(squares / np.maximum(free, 1e-3) ** 2)
    return max(min(float(np.sqrt(squares[best] / max(free[best], 1e-3))), 1.0), 1e-3)


@lean_njit()
def add_terms(of_vertex: IntArray, residuals: SingleArray, leverages: SingleArray, sums: FloatArray) -> None:
    """Add what the risks, plus 1, are the means of to the sums of each cluster."""
    for i in range(len(of_vertex)):
        for s in range(residuals.shape[1]):
            sums[of_vertex[i], s] += residuals[i, s] * residuals[i, s] + 2.0 * leverages[i, s]


@lean_njit()
def add_distances(of_vertex: IntArray, residuals: SingleArray, best: int, sums: FloatArray) -> None:
    """Add squared differences from one of the estimates."""
    for i in range(len(of_vertex)):
        for s in range(residuals.shape[1]):
            sums[of_vertex[i], s] += (residuals[i, s] - residuals[i, best]) ** 2
