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
from bezier_filters.smoothing.clusters import Clusters

WIDTH = 100.0
"""Squared edges over which risks are averaged around a vertex,"""
VERTICES = 7.26 * WIDTH
"""so many vertices that is, on a regular mesh: the reciprocal of the sum of their squared weights."""
DOUBT = 2.0
"""Times its variance: up to that squared deviation from the mesh as a whole, a local risk is not believed."""
TEMPERATURE = 0.3
"""Times sigma^2, divided by the square root of the number of vertices: difference of risks at which the larger one's
share is exp(-1) times the other's. The overall difference of two risks is known about that well."""


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

    def rescaled(self) -> "Estimates":
        """With less noise, if the estimate that predicts best leaves smaller residuals than the noise would.

        Where a surface has edges, noise is easily overestimated until something keeps them.
        """
        squares = np.einsum("ns,ns->s", self.residuals, self.residuals, dtype=np.float64) / len(self.residuals)
        free = 1.0 - self.leverages.mean(axis=0, dtype=np.float64)
        best = np.argmin(squares / np.maximum(free, 1e-3) ** 2)
        factor = min(float(np.sqrt(squares[best] / max(free[best], 1e-3))), 1.0)
        return Estimates(self.residuals / np.float32(max(factor, 1e-3)), self.leverages)


def local_risks(estimates: Estimates, clusters: Clusters, *, threads: int = 1) -> FloatArray:
    """Risk of every estimate around every cluster, less that of the one that is best for the mesh as a whole, (k, s).

    Where the local difference deviates from the overall one by no more than noise may make it do, the latter is taken
    (after James and Stein).

    Parameters
    ----------
    estimates : Estimates
    clusters : Clusters
        Of the mesh, along which to average.
    threads : int
        Number of threads.
    """
    shape = len(clusters.sizes), estimates.residuals.shape[1]
    terms, distances = np.zeros(shape), np.zeros(shape)
    _add_terms(clusters.of_vertex, estimates.residuals, estimates.leverages, terms)
    terms /= clusters.sizes[:, np.newaxis]
    best = int(clusters.mean_over_all(terms).argmin())
    # A difference of squared residuals has four times the variance of the difference of the estimates.
    _add_distances(clusters.of_vertex, estimates.residuals, best, distances)
    distances /= clusters.sizes[:, np.newaxis]
    differences = terms - terms[:, [best]]
    overall = clusters.mean_over_all(differences)
    local = clusters.diffused(differences, WIDTH, threads=threads) - overall
    variances = np.maximum(4.0 / VERTICES * clusters.diffused(distances, WIDTH, threads=threads), 0.0)
    squares = np.square(local)
    believed = np.divide(
        np.maximum(squares - DOUBT * variances, 0.0), squares, out=np.zeros_like(squares), where=squares > 0.0
    )
    result: FloatArray = overall + believed * local
    return result


def local_shares(risks: FloatArray, clusters: Clusters, *, threads: int = 1) -> SingleArray:
    """Share of every estimate at every vertex, (n, s), by their risks around it."""
    temperature = TEMPERATURE / np.sqrt(max(len(clusters.of_vertex), 1))
    shares: FloatArray = np.exp(-(risks - risks.min(axis=1, keepdims=True)) / temperature)
    shares /= shares.sum(axis=1, keepdims=True)
    return clusters.at_vertices(shares, threads=threads)


@lean_njit()
def _add_terms(of_vertex: IntArray, residuals: SingleArray, leverages: SingleArray, sums: FloatArray) -> None:
    """Add what the risks, plus 1, are the means of to the sums of each cluster."""
    for i in range(len(of_vertex)):
        for s in range(residuals.shape[1]):
            sums[of_vertex[i], s] += residuals[i, s] * residuals[i, s] + 2.0 * leverages[i, s]


@lean_njit()
def _add_distances(of_vertex: IntArray, residuals: SingleArray, best: int, sums: FloatArray) -> None:
    """Add squared differences from one of the estimates."""
    for i in range(len(of_vertex)):
        for s in range(residuals.shape[1]):
            sums[of_vertex[i], s] += (residuals[i, s] - residuals[i, best]) ** 2
