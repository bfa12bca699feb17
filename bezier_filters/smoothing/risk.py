"""How far estimates are from the truth that nobody knows: Stein's unbiased estimate of the risk.

If p = x + noise of variance sigma^2, an estimate f(p) of x has the expected squared error

    |f(p) - x|^2 = |f(p) - p|^2 - n sigma^2 + 2 sigma^2 (sum of the leverages df_i / dp_i)

(Stein, "Estimation of the mean of a multivariate normal distribution", Annals of Statistics
1981). Single terms of the sum are noisy; means over the surroundings of a vertex tell which of
several estimates to trust there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.runtime.jit import jit
from bezier_filters.smoothing.clusters import SURROUNDINGS, Clusters

# vertices over which risks are averaged, on a regular mesh: the reciprocal of the sum of their squared weights
VERTICES = 7.26 * SURROUNDINGS
DOUBT = 1.5  # times its variance: up to that squared deviation from the mesh as a whole, a local risk is not believed
# times sigma^2, divided by the square root of the number of vertices: difference of risks at which the larger one's
# share is exp(-1) times the other's. The overall difference of two risks is known about that well.
TEMPERATURE = 0.3
LEAST_FREE = 1e-3  # of an estimate: below, it follows the data so closely that its residuals say nothing of the noise
LEAST_FACTOR = 1e-3  # by which the noise may be less than was thought


@dataclass(frozen=True)
class Estimates:
    """Several estimates of the same vertices, in units of the standard deviation of the noise at each."""

    residuals: SingleArray  # (n, s): heights of the measured vertices over each estimate
    # (n, s): how much each estimate follows its own vertex: 1 for no smoothing at all, near 0 for much
    leverages: SingleArray

    def among(self, columns: Sequence[int]) -> "Estimates":
        """Some of them."""
        return Estimates(*(np.take(values, columns, axis=1) for values in (self.residuals, self.leverages)))

    def means(self, rows: BoolArray | slice = slice(None)) -> tuple[FloatArray, FloatArray]:
        """Mean squared residual and mean leverage of each estimate, (s,), over all vertices or some."""
        residuals, leverages = self.residuals[rows], self.leverages[rows]
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


def local_risks(clusters: Clusters, estimates: Estimates, overall: FloatArray, alike: float = 1.0) -> FloatArray:
    """Risk of every estimate around every cluster, (k, s), less that of the one that is best for the mesh as a whole.

    Where the local difference deviates from the overall one, (s,) from `overall_risks`, by no more than noise may make
    it do, the latter is taken (after James and Stein). So many vertices are `alike` that they tell no more than one.
    """
    best, count = int(overall.argmin()), len(overall)
    means = np.zeros((len(clusters.sizes), 2 * count))
    _sum_risks(estimates.residuals, estimates.leverages, best, clusters.of_vertex, means)
    means /= clusters.sizes[:, np.newaxis]
    means[:, :count] -= means[:, [best]]
    around = clusters.diffuse(means)
    local = around[:, :count] - overall
    # A difference of squared residuals has four times the variance of the difference of the estimates.
    variances = np.maximum(4.0 * alike / VERTICES * around[:, count:], 0.0)
    squares = np.square(local)
    believed = np.divide(
        np.maximum(squares - DOUBT * variances, 0.0), squares, out=np.zeros_like(squares), where=squares > 0.0
    )
    result: FloatArray = overall + believed * local
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


def gain_of(clusters: Clusters, risks: FloatArray, number: int) -> float:
    """Mean of what one of several estimates gains over all others."""
    gains = np.maximum(np.delete(risks, number, axis=1).min(axis=1) - risks[:, number], 0.0)
    return float(clusters.sizes @ gains) / max(len(clusters.of_vertex), 1)


def worthwhile(clusters: Clusters, risks: FloatArray, gain: float) -> list[int]:
    """Numbers of the estimates that are left, with the first, when those go that gain no more over what is left."""
    kept = list(range(risks.shape[1]))
    while len(kept) > 1:
        gains = [gain_of(clusters, risks[:, kept], k) for k in range(1, len(kept))]
        if min(gains) > gain:
            break
        del kept[1 + int(np.argmin(gains))]
    return kept


def local_shares(clusters: Clusters, risks: FloatArray, vertex_count: int, alike: float = 1.0) -> SingleArray:
    """Share of every estimate at every vertex, (n, s), by their risks around it, in a mesh of so many vertices."""
    temperature = TEMPERATURE / np.sqrt(max(vertex_count / alike, 1.0))
    shares: FloatArray = np.exp(-(risks - risks.min(axis=1, keepdims=True)) / temperature)
    shares /= shares.sum(axis=1, keepdims=True)
    return clusters.at_vertices(shares)


def noise_factor(estimates: Estimates, rows: BoolArray | slice) -> float:
    """How much less noise there is if the estimate that predicts best leaves smaller residuals than the noise would.

    Where a surface has edges, noise is easily overestimated until something keeps them. Some of the vertices tell.
    """
    squares, leverages = estimates.means(rows)
    free = 1.0 - leverages
    best = np.argmin(squares / np.maximum(free, LEAST_FREE) ** 2)
    return max(min(float(np.sqrt(squares[best] / max(free[best], LEAST_FREE))), 1.0), LEAST_FACTOR)
