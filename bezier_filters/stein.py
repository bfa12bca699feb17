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

DIFFUSION = 100.0
"""Squared edges: a vertex listens to some 700 around it."""
LOCAL = 0.55
"""Weight of the surroundings, against the mesh as a whole."""
TEMPERATURE = 0.003
"""Times sigma^2: difference of risks at which the larger one's share is exp(-1) times the other's."""
NEAR_DIFFUSION = 4.0
"""Squared edges over which leverages, which are known from one or few probes, are averaged beforehand."""


@dataclass(frozen=True)
class Estimates:
    """Several estimates of the same vertices.

    Attributes
    ----------
    residuals : (n, s) float64
        Heights of the measured vertices over each estimate, a length.
    leverages : (n, s) float64
        How much each estimate follows its own vertex: 1 for no smoothing at all, near 0 for much.
    """

    residuals: FloatArray
    leverages: FloatArray

    def risks(self, sigma: float) -> FloatArray:
        """Mean squared error of each estimate, (s,), length^2."""
        result: FloatArray = _terms(self, sigma).mean(axis=0) - sigma**2
        return result

    def sigma(self) -> float:
        """Standard deviation of the noise, as the residuals of the estimate that predicts best show it."""
        squares, free = np.square(self.residuals).mean(axis=0), 1.0 - self.leverages.mean(axis=0)
        known = np.flatnonzero(free > 0.0)
        if not len(known):
            return 0.0
        best = known[np.argmin(squares[known] / free[known] ** 2)]
        return float(np.sqrt(squares[best] / free[best]))

    def only(self, columns: slice) -> "Estimates":
        """Some of the estimates."""
        return Estimates(self.residuals[:, columns], self.leverages[:, columns])


def local_shares(estimates: Estimates, sigma: float, umbrella: Laplacian, *, threads: int = 1) -> FloatArray:
    """Share of every estimate at every vertex, (n, s), by their risks around it.

    Parameters
    ----------
    estimates : Estimates
    sigma : float
        Standard deviation of the noise, a positive length.
    umbrella : Laplacian
        Along which to average.
    threads : int
        Number of threads.
    """
    leverages = diffused(umbrella, estimates.leverages, NEAR_DIFFUSION, threads=threads)
    terms = _terms(Estimates(estimates.residuals, leverages), sigma)
    risks = LOCAL * diffused(umbrella, terms, DIFFUSION, threads=threads) + (1.0 - LOCAL) * terms.mean(axis=0)
    exponents = (risks - risks.min(axis=1, keepdims=True)) / (TEMPERATURE * sigma**2)
    shares: FloatArray = np.exp(-exponents)
    shares /= shares.sum(axis=1, keepdims=True)
    return shares


def _terms(estimates: Estimates, sigma: float) -> FloatArray:
    result: FloatArray = np.square(estimates.residuals) + 2.0 * sigma**2 * estimates.leverages
    return result
