"""Estimates the share of outliers: vertices with a large residual of a robust fit whose neighbours have small ones.

At sharp edges, and where the noise is strong, neighbouring vertices have large residuals together. Clean meshes of few
and long edges have vertices next to each other, as on walls, that lie far from the surface through others nearby.
"""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.sampling.neighbourhood_samples import NeighbourhoodSample
from bezier_filters.sampling.ring_analysis import MIN_SAMPLES, term_values

OUTLIER_RINGS, OUTLIER_DEGREE = 3, 3  # of the robust fit: the narrowest ring with enough points
OUTLIER_INNER_RINGS = 2  # rings with residuals that count: the outermost points pull the fit towards them
OUTLIER_PLACES = 150  # neighbourhoods in the sample
# standard deviations: smallest residual of an outlier, largest median residual of the inliers around it
OUTLIER_DEVIATIONS, INLIER_DEVIATIONS = 5.0, 2.0
NORMAL_MEDIAN_DEVIATION = 0.6745  # median of the absolute value of a standard normal variable
NEAREST_POINTS = 5  # neighbours of an outlier
# Part of an outlier's residual that most of its neighbours have not. Of five clean parts and models with walls on which
# outliers were found without it, two have some with 0.25, none with 0.5 and 0.75.
MIN_STANDING_PART = 0.5
STANDING_PLACES = 3000  # neighbourhoods around suspected outliers: 18 at the least share
# shares of outliers among the vertices, and of neighbourhoods with an outlier: up to these, chance or borders of noisy
# regions may be the cause
MIN_OUTLIER_SHARE, MIN_OUTLIER_PLACE_SHARE = 0.006, 0.09
# start of the tail, standard deviations, and share of white noise in it: 0.012 more than that of a normal distribution,
# because the standard deviation is estimated from few residuals
TAIL_DEVIATIONS, NORMAL_TAIL_SHARE = 2.0, 0.0575
# smallest share of outliers in the excess of the tail: with fewer the noise is heavy-tailed everywhere
MIN_TAIL_FRACTION = 0.45
MIN_POINT_FREEDOM = 0.05  # lower bound of 1 - leverage
# rounds of reweighting; standard deviations from which on the biweight is 0
BIWEIGHT_ROUNDS, BIWEIGHT_DEVIATIONS = 4, 6.0
SUSPICIOUS_DEVIATIONS = 3.0  # standard deviations of a residual from which on a neighbourhood is reweighted again
MIN_SIGMA_RADII = 3e-4  # lower bound of sigma over the radius of a neighbourhood, about 0.001 edges
BIWEIGHT_RIDGE, TINY_SIGMA = 1e-12, 1e-300  # keep matrices regular and ratios finite


@np.errstate(all="ignore")
def outlier_share(sample: NeighbourhoodSample) -> float:
    """Share of the vertices that are outliers; 0 if chance may explain so few.

    >>> import numpy as np
    >>> none = np.zeros((0, 4), dtype=np.int32)
    >>> outlier_share(NeighbourhoodSample(none[:, 0], np.zeros((0, 9, 3)), none, none > 0, none > 0, np.zeros(0)))
    0.0
    """
    rows = np.flatnonzero(sample.usable[:, OUTLIER_RINGS])[:OUTLIER_PLACES]
    if len(rows) < MIN_SAMPLES:
        return 0.0
    sizes = sample.sizes[rows, OUTLIER_RINGS]
    points = sample.points[rows, : sizes.max()]
    present = np.arange(points.shape[1]) < sizes[:, np.newaxis]
    relative = np.abs(_residuals(points, present)[1])
    inner = np.arange(points.shape[1]) < sample.sizes[rows, OUTLIER_INNER_RINGS, np.newaxis]
    outliers = inner & (relative > OUTLIER_DEVIATIONS)
    outliers[outliers] = _medians_around(outliers, points, present, relative) < INLIER_DEVIATIONS
    share, places = float(outliers.sum() / inner.sum()), float(outliers.any(axis=1).mean())
    tail = float((inner & (relative > TAIL_DEVIATIONS)).sum() / inner.sum()) - NORMAL_TAIL_SHARE
    return (
        share if share > max(MIN_OUTLIER_SHARE, MIN_TAIL_FRACTION * tail) and places > MIN_OUTLIER_PLACE_SHARE else 0.0
    )


@np.errstate(all="ignore")
def stand_out(sample: NeighbourhoodSample) -> bool:
    """Whether most vertices with a large residual stand out from their neighbours in the mesh, as outliers do.

    On four surfaces with impulses of half an edge to four edges at 1 to 30 % of the vertices 91 to 100 % of them stand
    out, on clean parts for machines and prints none or one of six.
    """
    rows = np.flatnonzero(sample.usable[:, OUTLIER_RINGS])
    far, standing = 0, 0
    for some in np.split(rows, np.arange(OUTLIER_PLACES, len(rows), OUTLIER_PLACES)):
        sizes = sample.sizes[some, OUTLIER_RINGS]
        points = sample.points[some, : sizes.max(initial=0)]
        places = np.arange(points.shape[1])
        residuals, relative = _residuals(points, places < sizes[:, np.newaxis])
        is_far = np.abs(relative[:, 0]) > OUTLIER_DEVIATIONS
        is_neighbour = (places > 0) & (places < sample.sizes[some[is_far], 1, np.newaxis])
        heights = points[is_far, :1, 2] - points[is_far, :, 2]
        stands = is_neighbour & (heights / residuals[is_far, :1] > MIN_STANDING_PART)
        far += len(stands)
        standing += int((2 * stands.sum(axis=1) >= is_neighbour.sum(axis=1)).sum())
    return 2 * standing > far


def _residuals(points: FloatArray, present: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Residuals of a robust fit to each neighbourhood, lengths and over the standard deviation of its noise, (k, n).

    Iteratively reweighted least squares with Tukey's biweight (Beaton and Tukey 1974), with more rounds where some
    residuals are large: otherwise the fit would bend towards outliers and hide them.
    """
    radius = np.sqrt(np.square(points[..., :2]).sum(axis=2).max(axis=1, keepdims=True))
    design = term_values(points[..., 0] / radius, points[..., 1] / radius, OUTLIER_DEGREE)
    heights, weights = points[..., 2:], present.astype(np.float64)
    (result, relative), rows = np.zeros((2, *present.shape)), np.arange(len(points))
    for k in range(BIWEIGHT_ROUNDS + 1):
        residuals = _fit_residuals(design[rows], heights[rows], weights[rows], present[rows])
        least = np.maximum(MIN_SIGMA_RADII * radius[rows], TINY_SIGMA)
        result[rows] = residuals
        relative[rows] = residuals / np.maximum(_scales(np.abs(residuals), present[rows]), least)
        if k > 0:  # outliers may hide from the first fit
            rows = rows[(np.abs(relative[rows]) > SUSPICIOUS_DEVIATIONS).any(axis=1)]
        weights[rows] = present[rows] * np.square(
            np.maximum(1.0 - np.square(relative[rows] / BIWEIGHT_DEVIATIONS), 0.0)
        )
    return result, relative


def _fit_residuals(design: FloatArray, heights: FloatArray, weights: FloatArray, present: BoolArray) -> FloatArray:
    """Studentised residuals of weighted fits, of equal variance under white noise, lengths (k, n)."""
    weighted = weights[..., np.newaxis] * design
    transposed = weighted.transpose(0, 2, 1)
    inverse = np.linalg.inv(transposed @ design + BIWEIGHT_RIDGE * np.eye(design.shape[2]))
    left = (heights - design @ (inverse @ (transposed @ heights)))[..., 0]
    free = 1.0 - np.einsum("kni,kni->kn", weighted @ inverse, design)
    result: FloatArray = present * left / np.sqrt(np.maximum(free, MIN_POINT_FREEDOM))
    return result


def _scales(residuals: FloatArray, present: BoolArray) -> FloatArray:
    """Standard deviation of the noise in each neighbourhood by the median absolute deviation, (k, 1)."""
    ascending = np.sort(np.where(present, residuals, np.inf), axis=1)
    counts = present.sum(axis=1, keepdims=True)
    low, high = (np.take_along_axis(ascending, (counts - k) // 2, axis=1) for k in (1, 0))
    result: FloatArray = 0.5 * (low + high) / NORMAL_MEDIAN_DEVIATION
    return result


def _medians_around(chosen: BoolArray, points: FloatArray, present: BoolArray, values: FloatArray) -> FloatArray:
    """Median of the values (k, n) of the points nearest to each of the chosen points, without the point itself."""
    rows, places = np.nonzero(chosen)
    apart = np.square(points[rows, :, :2] - points[rows, places, np.newaxis, :2]).sum(axis=2)
    apart[~present[rows]] = np.inf
    apart[np.arange(len(rows)), places] = np.inf
    nearest = np.argpartition(apart, NEAREST_POINTS, axis=1)[:, :NEAREST_POINTS]
    result: FloatArray = np.median(np.take_along_axis(values[rows], nearest, axis=1), axis=1)
    return result
