"""What second derivatives let expect of the fourth degree: on round surfaces, its terms do not vary about zero.

A surface that goes on from its second derivatives S as a sphere or a cylinder does has the fourth degree

    (x' S x) (x' S^2 x) / 8

over its tangent plane: the height R - sqrt(R^2 - r^2) of a sphere is r^2 / (2 R) + r^4 / (8 R^3) + ... A fit that
leaves the fourth degree out, or holds it back, takes part of it for curvature, with the same sign wherever the surface
bends alike. How much of it there is, a factor, follows from a sample by regression: it is about 1 on ellipsoids, more
on tori, and next to nothing on most scans.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.learning.noise_model import RingNoise
from bezier_filters.learning.ring_analysis import FREE_DEGREE
from bezier_filters.learning.variances import CAUTIOUS_RANGE, PRIOR_RANGE, UNSURE, expected_variance
from bezier_filters.patches.harmonics import harmonic_basis

QUARTIC = 4  # the degree
FEWEST_RINGS = 3  # fewer hold too few points beyond those that fits of this degree need
DOUBT = 0.5  # beforehand the factor is 1, as on round surfaces, give or take this much
LEAST = 0.1  # smaller factors explain nothing, and negative ones, of waves, are not believed
ROUNDS = 3  # second derivatives are found without the fourth degree, which they then determine
# Noise along the normals of a bent surface moves those points out of a neighbourhood's disc that it raises there. What
# stays near the rim looks like minus x' S x x' x / 2 times (noise / radius)^2 times this, give or take as much.
RIM = 60.0


@dataclass(frozen=True)
class QuarticMean:
    """Mean of the terms of degree 4, given those of degree 2, as one ring sees them."""

    factor: float  # what round surfaces have is multiplied by this; 0 if that explains nothing
    # (M,), length^2, and 0 but for degree 4:
    squares: FloatArray  # mean square of what round surfaces have of each term,
    left: FloatArray  # variances about the mean,
    cautious: FloatArray  # and for standard errors

    def variances(self, about_zero: FloatArray, factor: float, *, cautious: bool = False) -> FloatArray:
        """Variances of the terms (M,) about the mean with any factor, given those about zero."""
        if self.factor == 0.0:
            return about_zero
        # terms scatter no more about their mean than about zero, of which more is known, from other rings
        about_mean = np.minimum(self.cautious if cautious else self.left, about_zero)
        about_any = about_mean + (factor - self.factor) ** 2 * self.squares
        if factor == 0.0:
            about_any = np.maximum(about_zero, about_any)
        return np.where(self.squares > 0.0, about_any, about_zero)


def no_mean() -> QuarticMean:
    """Terms of degree 4 that vary about zero."""
    nothing = np.zeros(len(harmonic_basis().degrees))
    return QuarticMean(0.0, nothing, nothing, nothing)


def learn_quartic_mean(noise: RingNoise) -> QuarticMean:
    """Regress the fourth degree of neighbourhoods on what round surfaces have there.

    Both are compared by what they contribute to heights beyond the third degree, to which white noise contributes
    independently of what it does to second derivatives; what it does near the rim is a second regressor.
    """
    analysis, basis = noise.analysis, harmonic_basis()
    if analysis.degree < QUARTIC or analysis.rings < FEWEST_RINGS:
        return no_mean()
    free, below, up_to = (basis.term_count(degree) for degree in (FREE_DEGREE - 1, QUARTIC - 1, QUARTIC))
    factors, parts = analysis.factors[analysis.rows, free:up_to, free:up_to], analysis.sums.parts
    inner = below - free
    lower, corner = factors[:, :inner, :inner].copy(), factors[:, inner:, inner:]
    diagonal = np.einsum("kii->ki", lower)
    diagonal[diagonal == 0.0] = 1.0  # terms that the points do not see: their parts are 0
    inverse = np.linalg.inv(lower).astype(np.float64, copy=False)
    to_seconds = inverse[:, basis.degrees[free:below] == FREE_DEGREE]
    plain = _product(to_seconds, parts[:, free:below])
    leak = to_seconds @ factors[:, :inner, inner:]  # what the fourth degree is taken for
    found, at_rim = parts[:, below:up_to], RIM * noise.model.variance / analysis.radius**2
    expected, doubts = np.array([1.0, -at_rim]), np.array([DOUBT, max(at_rim, np.finfo(np.float64).tiny)])
    factor, seconds = 0.0, plain
    for _ in range(ROUNDS):
        quartics = round_quartics(seconds, analysis.radius, analysis.reaches)
        there, rim = _product(corner, quartics), _product(corner[..., 2:], seconds)
        factor = _posterior(there, rim, found, expected, doubts, analysis.independent)
        seconds = plain - factor * _product(leak, quartics)
    if not factor > LEAST:
        return no_mean()
    groups = basis.groups[below:up_to] - basis.groups[below]
    weights = np.square(np.einsum("kii->ki", corner))
    of_noise, seen = noise.parts[below:up_to], (weights > 0.0).sum(axis=0)
    surplus = np.square(found - factor * there).sum(axis=0) - of_noise * seen
    errors = of_noise * np.sqrt(2.0 * seen / analysis.independent)
    unsure = UNSURE * (of_noise - noise.model.white) * seen
    count = np.bincount(groups, weights=weights.sum(axis=0))
    mean_square, value, error, doubt = (
        np.bincount(groups, weights=values) / count
        for values in ((weights * quartics**2).sum(axis=0), surplus, errors, unsure)
    )
    arrays = [
        mean_square,
        *(expected_variance(value, np.hypot(error, doubt), odds) for odds in (PRIOR_RANGE, CAUTIOUS_RANGE)),
    ]
    if not np.isfinite(arrays).all():
        return no_mean()
    of_terms = np.zeros((3, len(basis.degrees)))
    of_terms[:, below:up_to] = np.array(arrays)[:, groups]
    return QuarticMean(factor, *of_terms)


def _posterior(
    there: FloatArray, rim: FloatArray, found: FloatArray, expected: FloatArray, doubts: FloatArray, independent: float
) -> float:
    """The likeliest factor of the first of two regressors, given what both are beforehand; NaN if numbers overflow."""
    # relative to their doubts, so that a factor that is certain leaves the equations well conditioned
    regressors = np.stack([there.ravel(), rim.ravel()]) * doubts[:, np.newaxis]
    misses = found.ravel() - (expected / doubts) @ regressors
    matrix, right = regressors @ regressors.T, regressors @ misses
    error = float(np.square(found).mean()) / independent
    scale = matrix.trace() + error
    if not (np.isfinite(scale) and np.isfinite(right).all() and scale > 0.0):
        return np.nan
    matrix[[0, 1], [0, 1]] += max(error, 1e-12 * scale)
    return float((expected + doubts * np.linalg.solve(matrix, right))[0])


def _product(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Of k matrices and k vectors."""
    result: FloatArray = (matrices @ vectors[..., np.newaxis])[..., 0]
    return result


def round_quartics(seconds: FloatArray, radius: float, reaches: FloatArray) -> FloatArray:
    """Coefficients (N, 5) of the terms of degree 4 of round surfaces, for those of degree 2, (N, 3), lengths.

    The terms are those of `harmonic_basis` in units of the radius. Surfaces bend as much as spheres through the
    farthest points, at distances `reaches` (N,), at most.

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
