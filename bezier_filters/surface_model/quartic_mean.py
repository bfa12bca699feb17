"""The prior mean of the terms of degree 4 given the second derivatives: on round surfaces they do not vary about zero.

Over its tangent plane, a sphere or a cylinder with second derivatives S has the quartic terms

    (x' S x) (x' S^2 x) / 8

because the height R - sqrt(R^2 - r^2) of a sphere is r^2 / (2 R) + r^4 / (8 R^3) + ... A fit without the fourth degree,
or with a prior of mean zero, mistakes part of these terms for curvature, with the same sign wherever the surface bends
to the same side. The prior mean is this quartic times a factor, which is estimated from a sample by regression. The
factor is about 1 on ellipsoids, larger on tori, and nearly 0 on most scans.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.noise.noise_model import RingNoise
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.sampling.ring_analysis import FREE_DEGREE
from bezier_filters.surface_model.variances import (
    CORRELATED_NOISE_ERROR,
    PRIOR_RANGE,
    UPPER_PRIOR_RANGE,
    posterior_mean_variance,
)

QUARTIC = 4  # the degree
MIN_QUARTIC_MEAN_RINGS = 3  # narrower rings have hardly more points than a quartic fit has coefficients
FACTOR_DEVIATION = 0.5  # prior standard deviation of the factor about 1
MIN_QUARTIC_FACTOR = 0.1  # smaller factors explain nothing, and negative ones, as of waves, are not plausible
FACTOR_ROUNDS = 3  # iterations of the second derivatives, corrected for the quartic, and the factor
# Noise along the normals of a curved surface moves the raised points out of a neighbourhood's disc. The remaining bias
# near the rim is about -x' S x x' x / 2 times (noise / radius)^2 times this; its prior standard deviation is the same.
RIM_NOISE_FACTOR = 60.0


@dataclass(frozen=True)
class QuarticMean:
    """Mean of the terms of degree 4 given the terms of degree 2, for one ring."""

    factor: float  # times the quartics of round surfaces; 0 if they explain nothing
    # (M,), length^2, zero except at degree 4:
    squares: FloatArray  # mean squares of the quartics of round surfaces,
    residual_variances: FloatArray  # variances of the terms about the mean,
    upper_variances: FloatArray  # and upper variances, for standard errors

    def variances(self, about_zero: FloatArray, factor: float, *, upper: bool = False) -> FloatArray:
        """Mean squares of the terms (M,) about the mean with another factor, given their variances about zero."""
        if self.factor == 0.0:
            return about_zero
        # the variance about the mean is at most that about zero, which other rings determine better
        about_mean = np.minimum(self.upper_variances if upper else self.residual_variances, about_zero)
        about_any = about_mean + (factor - self.factor) ** 2 * self.squares
        if factor == 0.0:
            about_any = np.maximum(about_zero, about_any)
        return np.where(self.squares > 0.0, about_any, about_zero)


def zero_quartic_mean() -> QuarticMean:
    """A prior mean of zero."""
    nothing = np.zeros(len(harmonic_basis().degrees))
    return QuarticMean(0.0, nothing, nothing, nothing)


def learn_quartic_mean(noise: RingNoise) -> QuarticMean:
    """Regress the quartic scores of neighbourhoods on the quartics of round surfaces.

    The scores of degree 4 are orthogonal to degrees 0 to 3, so that their white noise is independent of the noise of
    the second derivatives. The bias of noise near the rim is a second regressor.
    """
    analysis, basis = noise.analysis, harmonic_basis()
    if analysis.degree < QUARTIC or analysis.rings < MIN_QUARTIC_MEAN_RINGS:
        return zero_quartic_mean()
    free, below, up_to = (basis.term_count(degree) for degree in (FREE_DEGREE - 1, QUARTIC - 1, QUARTIC))
    factors, scores = analysis.factors[analysis.rows, free:up_to, free:up_to], analysis.sums.scores
    inner = below - free
    lower, corner = factors[:, :inner, :inner].copy(), factors[:, inner:, inner:]
    diagonal = np.einsum("kii->ki", lower)
    diagonal[diagonal == 0.0] = 1.0  # terms that the points do not determine: their scores are 0
    inverse = np.linalg.inv(lower).astype(np.float64, copy=False)
    to_seconds = inverse[:, basis.degrees[free:below] == FREE_DEGREE]
    plain = _product(to_seconds, scores[:, free:below])
    leak = to_seconds @ factors[:, :inner, inner:]  # second derivatives that quartic terms are mistaken for
    found, at_rim = scores[:, below:up_to], RIM_NOISE_FACTOR * noise.model.variance / analysis.radius**2
    expected, doubts = np.array([1.0, -at_rim]), np.array([FACTOR_DEVIATION, max(at_rim, np.finfo(np.float64).tiny)])
    factor, seconds = 0.0, plain
    for _ in range(FACTOR_ROUNDS):
        quartics = round_quartics(seconds, analysis.radius, analysis.reaches)
        there, rim = _product(corner, quartics), _product(corner[..., 2:], seconds)
        factor = _posterior_factor(there, rim, found, expected, doubts, analysis.independent_fraction)
        seconds = plain - factor * _product(leak, quartics)
    if not factor > MIN_QUARTIC_FACTOR:
        return zero_quartic_mean()
    groups = basis.groups[below:up_to] - basis.groups[below]
    weights = np.square(np.einsum("kii->ki", corner))
    of_noise, seen = noise.score_variances[below:up_to], (weights > 0.0).sum(axis=0)
    surplus = np.square(found - factor * there).sum(axis=0) - of_noise * seen
    errors = of_noise * np.sqrt(2.0 * seen / analysis.independent_fraction)
    unsure = CORRELATED_NOISE_ERROR * (of_noise - noise.model.white) * seen
    count = np.bincount(groups, weights=weights.sum(axis=0))
    mean_square, value, error, doubt = (
        np.bincount(groups, weights=values) / count
        for values in ((weights * quartics**2).sum(axis=0), surplus, errors, unsure)
    )
    arrays = [
        mean_square,
        *(posterior_mean_variance(value, np.hypot(error, doubt), odds) for odds in (PRIOR_RANGE, UPPER_PRIOR_RANGE)),
    ]
    if not np.isfinite(arrays).all():
        return zero_quartic_mean()
    of_terms = np.zeros((3, len(basis.degrees)))
    of_terms[:, below:up_to] = np.array(arrays)[:, groups]
    return QuarticMean(factor, *of_terms)


def _posterior_factor(
    there: FloatArray,
    rim: FloatArray,
    found: FloatArray,
    expected: FloatArray,
    doubts: FloatArray,
    independent_fraction: float,
) -> float:
    """Posterior mean of the factor of the first of two regressors with independent priors; NaN if numbers overflow."""
    # in units of the prior standard deviations, so that a certain factor leaves the equations well conditioned
    regressors = np.stack([there.ravel(), rim.ravel()]) * doubts[:, np.newaxis]
    misses = found.ravel() - (expected / doubts) @ regressors
    matrix, right = regressors @ regressors.T, regressors @ misses
    error = float(np.square(found).mean()) / independent_fraction
    scale = matrix.trace() + error
    if not (np.isfinite(scale) and np.isfinite(right).all() and scale > 0.0):
        return np.nan
    matrix[[0, 1], [0, 1]] += max(error, 1e-12 * scale)
    return float((expected + doubts * np.linalg.solve(matrix, right))[0])


def _product(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Products of k matrices and k vectors."""
    result: FloatArray = (matrices @ vectors[..., np.newaxis])[..., 0]
    return result


def round_quartics(seconds: FloatArray, radius: float, reaches: FloatArray) -> FloatArray:
    """Coefficients (N, 5) of degree 4 of round surfaces with the coefficients (N, 3) of degree 2, lengths.

    The coefficients belong to `harmonic_basis` in units of the radius. The curvature is bounded by that of a sphere
    through the farthest points, at distances `reaches` (N,).

    >>> round_quartics(np.array([[0.0, 0.0, 0.1]]), 1.0, np.ones(1))  # z = r^2 / 10 + r^4 / 1000, of radius 5
    array([[0.   , 0.   , 0.   , 0.   , 0.001]])
    """
    c, s, h = 2.0 / radius * seconds.T  # S is h + [[c, s], [s, -c]]
    bends = (np.abs(h) + np.hypot(c, s)) * reaches / radius
    c, s, h = np.array([c, s, h]) / np.maximum(bends, 1.0)
    square = c * c + s * s
    columns = (
        h * (c * c - s * s),
        2.0 * h * c * s,
        c * (3.0 * h * h + square),
        s * (3.0 * h * h + square),
        h * (h * h + 2.0 * square),
    )
    result: FloatArray = radius / 8.0 * np.column_stack(columns)
    return result
