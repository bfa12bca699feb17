"""Stein's unbiased risk estimate (SURE) of filtered meshes, locally and overall, and the shares that follow from it.

If p = x + noise of variance sigma^2, an estimate f(p) of x has the expected squared error

    |f(p) - x|^2 = |f(p) - p|^2 - n sigma^2 + 2 sigma^2 (sum of the leverages df_i / dp_i)

(Stein, "Estimation of the mean of a multivariate normal distribution", Annals of Statistics
1981). Single terms of the sum are noisy, so they are averaged around each vertex. Shares of several estimates are
proportional to exp(-risk / temperature).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.runtime.jit import jit
from bezier_filters.smoothing.clusters import AVERAGED_VERTICES_PER_TIME, AVERAGING_TIME, Clusters

AVERAGED_VERTICES = AVERAGED_VERTICES_PER_TIME * AVERAGING_TIME  # effective number of vertices in a local mean
# squared deviation of a local risk from the overall one, over its variance, up to which it is shrunk to the overall one
SHRINKAGE_THRESHOLD = 1.5
# Difference of risks, over sigma^2 / sqrt(number of vertices), at which the ratio of the shares is exp(-1): about the
# standard error of the overall difference of two risks.
MIXING_TEMPERATURE = 0.3
MIN_RESIDUAL_FREEDOM = 1e-3  # lower bound of 1 - mean leverage: interpolating estimates show no noise
MIN_NOISE_FACTOR = 1e-3  # lower bound of `noise_factor`


@dataclass(frozen=True)
class Estimates:
    """Several estimates of the same vertices, in units of the local standard deviation of the noise."""

    residuals: SingleArray  # (n, s): heights of the measured vertices over each estimate
    # (n, s): derivative of each estimate by its own vertex: 1 without smoothing, near 0 with much
    leverages: SingleArray
    # (n,): squared units of the residuals, which weight the means over vertices; None if they are equal
    weights: FloatArray | None = None

    def subset(self, columns: Sequence[int]) -> "Estimates":
        """Some of the estimates."""
        residuals, leverages = (np.take(values, columns, axis=1) for values in (self.residuals, self.leverages))
        return Estimates(residuals, leverages, self.weights)

    def means(self, rows: BoolArray | slice = slice(None)) -> tuple[FloatArray, FloatArray]:
        """Mean squared residual and mean leverage of each estimate, (s,), over all vertices or some."""
        residuals, leverages = self.residuals[rows], self.leverages[rows]
        if self.weights is not None:
            weights = self.weights[rows] / self.weights[rows].sum()
            return np.einsum("n,ns,ns->s", weights, residuals, residuals), np.einsum("n,ns->s", weights, leverages)
        squares = np.einsum("ns,ns->s", residuals, residuals, dtype=np.float64) / max(len(residuals), 1)
        return squares, leverages.mean(axis=0, dtype=np.float64)

    def mean_risks(self, rows: BoolArray | slice = slice(None)) -> FloatArray:
        """Mean squared error of each estimate, (s,), over all vertices or some."""
        squares, leverages = self.means(rows)
        return squares + 2.0 * leverages - 1.0


def overall_risks(estimates: Estimates, rows: BoolArray | slice) -> FloatArray:
    """Risk of every estimate, (s,), less that of the best one: means over some of the vertices."""
    risks = estimates.mean_risks(rows)
    result: FloatArray = risks - risks.min()
    return result


def local_risks(
    clusters: Clusters, estimates: Estimates, overall: FloatArray, variance_inflation: float = 1.0
) -> FloatArray:
    """Risk of every estimate around every cluster, (k, s), less that of the overall best one.

    The local differences are shrunk towards the overall ones, (s,) from `overall_risks`, by the positive part of
    1 - threshold * variance / deviation^2 (after James and Stein). `variance_inflation` is the number of vertices with
    correlated noise that are as informative as one with independent noise, n / n_eff.
    """
    best, count = int(overall.argmin()), len(overall)
    means = np.zeros((len(clusters.sizes), 2 * count))
    _sum_risks(estimates.residuals, estimates.leverages, best, clusters.of_vertex, means)
    means /= clusters.sizes[:, np.newaxis]
    means[:, :count] -= means[:, [best]]
    around = clusters.diffuse(means)
    local = around[:, :count] - overall
    # A difference of squared residuals has four times the variance of the difference of the estimates.
    variances = np.maximum(4.0 * variance_inflation / AVERAGED_VERTICES * around[:, count:], 0.0)
    squares = np.square(local)
    trusted_share = np.divide(
        np.maximum(squares - SHRINKAGE_THRESHOLD * variances, 0.0),
        squares,
        out=np.zeros_like(squares),
        where=squares > 0.0,
    )
    result: FloatArray = overall + trusted_share * local
    return result


@jit()
def _sum_risks(residuals: SingleArray, leverages: SingleArray, best: int, cluster: IntArray, sums: FloatArray) -> None:
    """Add up, over each cluster, the risk, plus 1, of each estimate; then its squared distance from the best one."""
    count = residuals.shape[1]
    for i in range(len(cluster)):
        k = cluster[i]
        for s in range(count):
            residual, apart = residuals[i, s], residuals[i, s] - residuals[i, best]
            sums[k, s] += residual * residual + 2.0 * leverages[i, s]
            sums[k, count + s] += apart * apart


def mean_gain(clusters: Clusters, risks: FloatArray, number: int) -> float:
    """Mean decrease of the risk by one of several estimates over the best of the others."""
    gains = np.maximum(np.delete(risks, number, axis=1).min(axis=1) - risks[:, number], 0.0)
    return float(clusters.sizes @ gains) / max(len(clusters.of_vertex), 1)


def select_estimates(clusters: Clusters, risks: FloatArray, gain: float) -> list[int]:
    """Backward elimination: numbers of the estimates that each gain more than `gain`; the first one always stays."""
    kept = list(range(risks.shape[1]))
    while len(kept) > 1:
        gains = [mean_gain(clusters, risks[:, kept], k) for k in range(1, len(kept))]
        if min(gains) > gain:
            break
        del kept[1 + int(np.argmin(gains))]
    return kept


def local_shares(
    clusters: Clusters, risks: FloatArray, vertex_count: int, variance_inflation: float = 1.0
) -> SingleArray:
    """Share of every estimate at every vertex, (n, s), by the local risks, in a mesh of `vertex_count` vertices."""
    temperature = MIXING_TEMPERATURE / np.sqrt(max(vertex_count / variance_inflation, 1.0))
    shares: FloatArray = np.exp(-(risks - risks.min(axis=1, keepdims=True)) / temperature)
    shares /= shares.sum(axis=1, keepdims=True)
    return clusters.spread_to_vertices(shares)


def noise_factor(estimates: Estimates, rows: BoolArray | slice) -> float:
    """Ratio of the actual to the assumed noise, at most 1, from the residuals of the estimate that predicts best.

    The best one minimises the generalised cross-validation score. Noise is easily overestimated on a surface with sharp
    edges until an estimate preserves them. Only `rows` are used.
    """
    squares, leverages = estimates.means(rows)
    free = 1.0 - leverages
    best = np.argmin(squares / np.maximum(free, MIN_RESIDUAL_FREEDOM) ** 2)
    return max(min(float(np.sqrt(squares[best] / max(free[best], MIN_RESIDUAL_FREEDOM))), 1.0), MIN_NOISE_FACTOR)
