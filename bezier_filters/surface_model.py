"""What a sample of neighbourhoods says about a surface: its noise, and how fast it varies.

Over a neighbourhood the height is a polynomial plus noise of standard deviation sigma. The terms
of total degree j >= 3 count as random, with one variance tau_j^2 per degree and the
rotation-invariant weights j! / (a! b!) between the monomials x^a y^b of one degree; height, slope
and curvature are free. The variances follow from an analysis of variance: after orthogonalisation
degree by degree, what the heights hold of degree j is noise plus terms of degree j and above.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.neighbourhood_samples import NeighbourhoodSample
from bezier_filters.polynomials import total_degree_space

FREE_DEGREE = 2
"""Slope and curvature are what we are after: no prior touches them."""
MODEL_DEGREE = 8
"""Degrees of the model; those that a fit leaves out are its bias."""
SIGNIFICANT = 3.0
"""Standard errors by which a degree must rise above the noise to be believed."""
FEWEST_SAMPLES = 12
FEWEST_POINTS_PER_COEFFICIENT = 1.2


@dataclass(frozen=True)
class RingAnalysis:
    """The k-rings of a sample, orthogonalised degree by degree, in units of their radius.

    Attributes
    ----------
    rings : int
        k.
    radius : float
        Median radius of the neighbourhoods, the unit of x and y below, a length.
    degree : int
        Highest degree J that the neighbourhoods determine.
    factors : (N, m, M) float64
        Q^T A for the design matrices A of the neighbourhoods, Q being orthonormal for the m
        monomials up to degree J; upper triangular in its first m columns. The M columns are all
        monomials up to `MODEL_DEGREE`, scaled so that those of one degree have the same variance.
    mean_squares : (J + 1,) float64
        Mean squared residual of fits of each degree without prior, length^2.
    part_squares : (J + 1,) float64
        Mean sum of squares of what the heights hold of each degree, length^2.
    energies : (J + 1,) float64
        What that sum would be if the terms of the degree had the variance 1 and all others 0.
    """

    rings: int
    radius: float
    degree: int
    factors: FloatArray
    mean_squares: FloatArray
    part_squares: FloatArray
    energies: FloatArray


@dataclass(frozen=True)
class RingModel:
    """The surface as its k-rings see it.

    Attributes
    ----------
    analysis : RingAnalysis
    variances : (MODEL_DEGREE + 1,) float64
        tau_j^2 for coordinates in units of the radius, length^2; 0 for the free degrees.
    """

    analysis: RingAnalysis
    variances: FloatArray


@dataclass(frozen=True)
class SurfaceModel:
    """Noise and smoothness of a surface.

    Attributes
    ----------
    sigma : float
        Standard deviation of the noise of the heights, a length.
    by_rings : tuple of RingModel
        In ascending order of k.
    """

    sigma: float
    by_rings: tuple[RingModel, ...]


def monomial_scales() -> FloatArray:
    """sqrt(j! / (a! b!)) of the monomials x^a y^b up to `MODEL_DEGREE`, j = a + b."""
    pairs = total_degree_space(MODEL_DEGREE).exponents.tolist()
    return np.sqrt([factorial(a + b) / (factorial(a) * factorial(b)) for a, b in pairs])


def analyse_ring(sample: NeighbourhoodSample, rings: int, most: int) -> RingAnalysis | None:
    """Analyse up to `most` of the k-rings of a sample; None if too few of them are usable."""
    points, present = sample.ring(rings)
    points, present = points[:most], present[:most]
    if len(points) < FEWEST_SAMPLES:
        return None
    sizes = present.sum(axis=1)
    degree = _determined_degree(float(np.percentile(sizes, 20)))
    space = total_degree_space(MODEL_DEGREE)
    m = int((space.total_degrees <= degree).sum())
    enough = sizes > m
    points, present, sizes = points[enough], present[enough], sizes[enough]
    if len(points) < FEWEST_SAMPLES or degree <= FREE_DEGREE:
        return None
    radius = float(np.median(np.sqrt(np.square(points[..., :2]).sum(axis=2).max(axis=1))))
    if not radius > 0.0:
        return None
    design = _design(points[..., :2] / radius, space.exponents) * (monomial_scales() * present[..., np.newaxis])
    q, _ = np.linalg.qr(design[..., :m])
    transposed = q.transpose(0, 2, 1)
    heights = points[..., 2, np.newaxis]
    parts = transposed @ heights
    left = np.square(heights - q @ parts).sum()
    factors = transposed @ design
    blocks = [np.flatnonzero(space.total_degrees == j) for j in range(degree + 1)]
    part_squares = np.array([np.square(parts[:, block]).sum() for block in blocks]) / len(points)
    # Residuals of fits of degree J, J - 1, ...: what was left, and the parts given back.
    given_back = np.cumsum(np.append(0.0, part_squares[:0:-1]))[::-1]
    freedom = np.cumsum(np.append(0, np.arange(degree + 1, 1, -1)))[::-1]
    return RingAnalysis(
        rings=rings,
        radius=radius,
        degree=degree,
        factors=factors,
        mean_squares=(left / len(points) + given_back) / ((sizes - m).mean() + freedom),
        part_squares=part_squares,
        energies=np.array([np.square(factors[:, block][..., block]).sum() for block in blocks]) / len(points),
    )


def learn_noise(analyses: Sequence[RingAnalysis]) -> SurfaceModel:
    """Find the noise, and the variances that it leaves to the surface.

    The noise is the smallest residual of a fit of the highest degree: where a neighbourhood is
    wide enough for degrees beyond, they show as a larger residual. The variance of a degree takes
    in what higher degrees look like over the ring, which errs on the side of less smoothing.

    Parameters
    ----------
    analyses : sequence of RingAnalysis
        In ascending order of k, at least one.
    """
    reliable = [analysis for analysis in analyses if analysis.rings >= 3] or analyses
    noise = min(float(analysis.mean_squares[-1]) for analysis in reliable)
    models: list[RingModel] = []
    for analysis in reversed(analyses):
        known = slice(FREE_DEGREE + 1, analysis.degree + 1)
        dimensions = np.arange(analysis.degree + 1) + 1
        variances = np.zeros(MODEL_DEGREE + 1)
        surplus = analysis.part_squares - noise * dimensions
        by_chance = SIGNIFICANT * noise * np.sqrt(2.0 * dimensions / len(analysis.factors))
        variances[known] = (np.where(surplus > by_chance, surplus, 0.0) / analysis.energies)[known]
        if models:  # degrees that only wider rings determine, in the units of this one
            wider = models[-1]
            beyond = np.arange(analysis.degree + 1, MODEL_DEGREE + 1)
            variances[beyond] = wider.variances[beyond] * (analysis.radius / wider.analysis.radius) ** (2 * beyond)
        models.append(RingModel(analysis, variances))
    return SurfaceModel(float(np.sqrt(noise)), tuple(reversed(models)))


def _determined_degree(points: float) -> int:
    degree = FREE_DEGREE
    while degree < MODEL_DEGREE and FEWEST_POINTS_PER_COEFFICIENT * (degree + 2) * (degree + 3) / 2 <= points:
        degree += 1
    return degree


def _design(xy: FloatArray, exponents: IntArray) -> FloatArray:
    """Monomials (..., M) of points (..., 2)."""
    powers = np.stack([xy**k for k in range(MODEL_DEGREE + 1)], axis=-1)
    columns: FloatArray = powers[..., 0, exponents[:, 0]] * powers[..., 1, exponents[:, 1]]
    return columns
