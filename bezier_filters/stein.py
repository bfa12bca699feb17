"""How far estimates are from the truth that nobody knows: Stein's unbiased estimate of the risk.

If p = x + noise of variance sigma^2, an estimate f(p) of x has the expected squared error

    |f(p) - x|^2 = |f(p) - p|^2 - n sigma^2 + 2 sigma^2 (sum of the leverages df_i / dp_i)

(Stein, "Estimation of the mean of a multivariate normal distribution", Annals of Statistics
1981). Single terms of the sum are noisy; means over the surroundings of a vertex tell which of
several estimates to trust there.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.laplacian import Laplacian
from bezier_filters.scale_space import diffused

WIDTH = 100.0
"""Squared edges over which risks are averaged around a vertex,"""
VERTICES = 7.26 * WIDTH
"""so many vertices that is, on a regular mesh: the reciprocal of the sum of their squared weights."""
DOUBT = 2.0
"""Times its variance: up to that squared deviation from the mesh as a whole, a local risk is not believed."""
TEMPERATURE = 0.003
"""Times sigma^2: difference of risks at which the larger one's share is exp(-1) times the other's."""
NEAR = 4.0
"""Squared edges over which leverages, which are known from one or few probes, are averaged beforehand."""


@dataclass(frozen=True)
class Estimates:
    """Several estimates of the same vertices, in units of the standard deviation of the noise at each.

    Attributes
    ----------
    residuals : (n, s) float64
        Heights of the measured vertices over each estimate.
    leverages : (n, s) float64
        How much each estimate follows its own vertex: 1 for no smoothing at all, near 0 for much.
    """

    residuals: FloatArray
    leverages: FloatArray

    @property
    def risks(self) -> FloatArray:
        """Mean squared error of each estimate, (s,)."""
        result: FloatArray = self.terms.mean(axis=0) - 1.0
        return result

    @property
    def terms(self) -> FloatArray:
        """What the risks are the means of, (n, s), plus 1."""
        result: FloatArray = np.square(self.residuals) + 2.0 * self.leverages
        return result

    def rescaled(self) -> "Estimates":
        """With less noise, if the estimate that predicts best leaves smaller residuals than the noise would.

        Where a surface has edges, noise is easily overestimated until something keeps them.
        """
        squares, free = np.square(self.residuals).mean(axis=0), 1.0 - self.leverages.mean(axis=0)
        best = np.argmin(squares / np.maximum(free, 1e-3) ** 2)
        factor = min(float(np.sqrt(squares[best] / max(free[best], 1e-3))), 1.0)
        return Estimates(self.residuals / max(factor, 1e-3), self.leverages)

    def only(self, columns: slice) -> "Estimates":
        """Some of the estimates."""
        return Estimates(self.residuals[:, columns], self.leverages[:, columns])


def local_shares(estimates: Estimates, surroundings: Laplacian, *, threads: int = 1) -> FloatArray:
    """Share of every estimate at every vertex, (n, s), by their risks around it.

    A risk is compared with that of the estimate that is best for the mesh as a whole. Where the local
    difference deviates from the overall one by no more than noise may make it do, the latter is taken (after James and
    Stein).

    Parameters
    ----------
    estimates : Estimates
    surroundings : Laplacian
        Along which to average.
    threads : int
        Number of threads.
    """
    leverages = diffused(surroundings, estimates.leverages, NEAR, threads=threads)
    terms = Estimates(estimates.residuals, leverages).terms
    best = int(terms.mean(axis=0).argmin())
    differences = terms - terms[:, [best]]
    overall = differences.mean(axis=0)
    local = diffused(surroundings, differences, WIDTH, threads=threads) - overall
    # A difference of squared residuals has four times the variance of the difference of the estimates.
    distances = np.square(estimates.residuals - estimates.residuals[:, [best]])
    variances = np.maximum(4.0 / VERTICES * diffused(surroundings, distances, WIDTH, threads=threads), 0.0)
    squares = np.square(local)
    believed = np.divide(
        np.maximum(squares - DOUBT * variances, 0.0), squares, out=np.zeros_like(squares), where=squares > 0.0
    )
    risks = overall + believed * local
    shares: FloatArray = np.exp(-(risks - risks.min(axis=1, keepdims=True)) / TEMPERATURE)
    shares /= shares.sum(axis=1, keepdims=True)
    return shares
