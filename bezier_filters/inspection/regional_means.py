"""Means of deviations over the neighbourhood of every vertex, and their standard errors.

The position of a patch at a vertex is a weighted sum of the points around it, and so are those of its neighbours: their
errors are correlated. The weights of a sum are about 1 (a constant height is fitted exactly), for each patch and, on a
mesh whose points are spread evenly, for each point. So the sum of the errors of many positions is that of the errors of
as many points: the mean of n positions has the variance sigma^2 / n of the mean of n points. With the variance s^2 of a
single position, it is between the two

    s^2 S / (S + (n - 1) s^2),   S = sigma^2 (1 + 2 pi l^2 / a),

where noise of range l, see `NoiseModel`, counts as often as it repeats, with the area a per vertex. Where the error of
a position exceeds the noise, it is one of the shape, and does not average out. Nor do the patches of the reference that
are blended at a place, where they differ by more than their standard error: the mean variance of that is added.
"""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.neighbourhoods import collect_ring
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks


def ring_of_size(vertices: int) -> int:
    """Number of rings that have about so many vertices on a regular mesh, 3 r (r + 1) + 1.

    >>> ring_of_size(200), ring_of_size(1)
    (8, 0)
    """
    return round(0.5 * (float(np.sqrt(max(4.0 * vertices - 1.0, 3.0) / 3.0)) - 1.0))


def regional_means(
    values: FloatArray, valid: BoolArray, adjacency: Adjacency, rings: int
) -> tuple[FloatArray, FloatArray]:
    """Mean of the valid values (n,) within some rings of every vertex, and their number, both (n,)."""
    n, rows = len(values), adjacency.vertices
    means, counts = np.zeros(n), np.zeros(n)

    def task() -> RangeTask:
        visited, members = np.zeros(n, dtype=np.bool_), np.empty(n + 1, dtype=np.int32)
        barriers = np.zeros(n, dtype=np.bool_)

        def run(start: int, stop: int) -> None:
            average_rings(
                rows.indptr, rows.indices, barriers, values, valid, rings, start, stop, visited, members, means, counts
            )

        return run

    run_in_chunks(task, n)
    return means, counts


@jit()
def average_rings(
    indptr: IntArray,
    indices: IntArray,
    barriers: BoolArray,
    values: FloatArray,
    valid: BoolArray,
    rings: int,
    start: int,
    stop: int,
    visited: BoolArray,
    members: IntArray,
    means: FloatArray,
    counts: FloatArray,
) -> None:
    """Average the valid values within some rings of the vertices start .. stop-1."""
    for i in range(start, stop):
        found, _ = collect_ring(indptr, indices, barriers, i, rings, visited, members)
        total, count = 0.0, 0
        for q in range(found):
            j = members[q]
            if valid[j]:
                total += values[j]
                count += 1
        counts[i] = count
        means[i] = total / count if count else 0.0


def mean_variance(variances: FloatArray, noise: FloatArray, counts: FloatArray) -> FloatArray:
    """Variance of the mean of n positions around each vertex, (n,).

    Arguments are the variances of the single positions, s^2, the variance S of the noise, inflated if it is correlated,
    and the number of positions, all (n,).

    >>> mean_variance(np.array([0.1]), np.array([1.0]), np.array([91.0]))
    array([0.01])
    """
    totals = noise + np.maximum(counts - 1.0, 0.0) * variances
    averaged = noise * variances / np.where(totals > 0.0, totals, 1.0)  # 0 without noise, as where variances are 0
    return np.where(noise < variances, variances, averaged)
