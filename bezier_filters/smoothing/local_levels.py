"""Local standard deviations of noise from the residuals of a filter, sharp where the noise changes abruptly.

A level is a robust mean of residuals over an area. Large areas give accurate levels, but not near steps of the noise.
So each vertex gets an area as large as its surroundings allow.
"""

import numpy as np

from bezier_filters.arrays import FloatArray, RealArray, SingleArray
from bezier_filters.smoothing.chebyshev import diffuse
from bezier_filters.smoothing.clusters import AVERAGED_VERTICES_PER_TIME, Clusters
from bezier_filters.smoothing.laplacian import Laplacian

NORMAL_MEAN_ROOT, NORMAL_ROOT_SPREAD = 0.822, 0.425  # of sqrt(|x|) for a standard normal x; the spread over the mean
# Diffusion times of the means over small areas, squared edges: 11, 44 and 180 vertices. The last mean is that of the
# clusters, over four times as many.
SMALL_AREAS = (1.5, 6.0, 25.0)
# Standard errors of the mean over a smaller area by which that over a larger one may differ from it: up to this it
# replaces the smaller one, from sqrt(2) times this on it does not. With 0.5 or 2 noise on a tenth of a sphere leaves
# 0.023 or 0.090 edges in place of 0.023, and 20 other meshes with varying noise 0.99 or 1.11 times as much.
MAX_DISAGREEMENT = 1.0
# Standard deviation of the weight by which clusters are averaged, over the difference of the logarithms of their mean
# roots: a third of the level. With 0.075 or 0.3 these meshes keep 1.00 times as much of their noise.
STEP_WIDTH = 0.15


def local_levels(roots: SingleArray, clusters: Clusters, laplacian: Laplacian) -> FloatArray:
    """Local standard deviations of noise, (n,), from the roots of the absolute values of residuals, (n,).

    Starting from a small area, the mean over the next larger one replaces the one before if both agree
    (Belomestny and Spokoiny, "Spatial aggregation of local likelihood estimates with applications to classification",
    Annals of Statistics 35, 2007). The largest mean joins only clusters of similar levels.
    """
    columns = roots[:, np.newaxis].astype(np.float64)
    means = [diffuse(laplacian, columns, time)[:, 0] for time in SMALL_AREAS]
    errors = NORMAL_ROOT_SPREAD / np.sqrt(AVERAGED_VERTICES_PER_TIME * np.array(SMALL_AREAS))
    found = _logarithms(means[0])
    for wider, error in zip(means[1:], errors[:-1], strict=True):
        found = _aggregate(found, wider, error)
    joined = clusters.separate(found, STEP_WIDTH).average([roots])[:, 0].astype(np.float64)
    return levels_of_roots(np.exp(_aggregate(found, joined, errors[-1])))


def levels_of_roots(roots: RealArray) -> FloatArray:
    """Standard deviations of normal noise, (n,), whose absolute values have roots of these means, (n,)."""
    result: FloatArray = np.square(roots.astype(np.float64) / NORMAL_MEAN_ROOT)
    return result


def _aggregate(found: FloatArray, means: FloatArray, error: float) -> FloatArray:
    """Logarithms of means over larger areas in place of those found before where they agree within an error."""
    apart = _logarithms(means) - found
    share = np.clip(2.0 - np.square(apart / (MAX_DISAGREEMENT * error)), 0.0, 1.0)
    return np.asarray(found + share * apart)


def _logarithms(means: FloatArray) -> FloatArray:
    return np.asarray(np.log(np.maximum(means, np.finfo(np.float32).tiny)))
