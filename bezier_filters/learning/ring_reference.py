"""Analysis of variance of neighbourhoods, one by one: what `ring_lanes` computes, and its place without a compiler."""

import numpy as np
from numpy.polynomial.polynomial import polyvander

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.learning.ring_lanes import UNSEEN, RingSums
from bezier_filters.patches.harmonics import HIGHEST_DEGREE, harmonic_basis
from bezier_filters.patches.polynomials import total_degree_space


def analyse_one_by_one(
    points: FloatArray, sizes: IntArray, scale: float, start: int, stop: int, sums: RingSums
) -> None:
    """Fill rows start .. stop-1 of `sums`, as `analyse_in_lanes` does."""
    for row in range(start, stop):
        x, y, heights = points[row, : sizes[row]].T
        _analyse(term_values(scale * x, scale * y), heights, row, sums)


def term_values(x: FloatArray, y: FloatArray) -> FloatArray:
    """Values of the terms of `harmonic_basis` at points of any shape (...), (..., M)."""
    exponents = total_degree_space(HIGHEST_DEGREE).exponents
    powers_x, powers_y = (polyvander(axis, HIGHEST_DEGREE) for axis in (x, y))
    monomials = powers_x[..., exponents[:, 0]] * powers_y[..., exponents[:, 1]]
    result: FloatArray = monomials @ harmonic_basis().monomials
    return result


def _analyse(columns: FloatArray, heights: FloatArray, row: int, sums: RingSums) -> None:
    basis, m = harmonic_basis(), sums.parts.shape[1]
    factors, parts, seen = np.zeros((m, len(basis.degrees))), sums.parts[row], np.zeros(m, dtype=np.bool_)
    parts[:] = 0.0
    orthonormal = np.zeros((len(heights), m))
    for t in range(m):
        column = columns[:, t].copy()
        for _ in range(2):  # the second time removes what rounding left
            column -= orthonormal @ (orthonormal.T @ column)
        length = np.linalg.norm(column)
        seen[t] = length > UNSEEN * np.linalg.norm(columns[:, t])
        if seen[t]:
            orthonormal[:, t] = column / length
            factors[t, t:] = orthonormal[:, t] @ columns[:, t:]
            parts[t] = orthonormal[:, t] @ heights
    beyond = columns[:, m:] - orthonormal @ factors[:, m:]
    sums.unexplained[row, :m], sums.unexplained[row, m:] = 0.0, np.square(beyond).sum(axis=0)
    if row < len(sums.factors):
        sums.factors[row] = factors
    for degree in range(sums.residuals.shape[1]):
        kept = seen & (basis.degrees[:m] <= degree)
        left = heights - orthonormal[:, kept] @ parts[kept]
        sums.residuals[row, degree] = left @ left
        sums.freedom[row, degree] = len(heights) - kept.sum()
        inverse = np.asarray(np.linalg.inv(factors[np.ix_(kept, np.flatnonzero(kept))]), dtype=np.float64)
        _sum_up(degree, kept, inverse, row, sums)


def _sum_up(degree: int, kept: BoolArray, inverse: FloatArray, row: int, sums: RingSums) -> None:
    """The coefficients of the fit of one degree, from the inverse factor of the terms that are kept."""
    weights = 1.0 / np.square(inverse).sum(axis=1)
    squares = weights * np.square(inverse @ sums.parts[row, kept])
    groups = harmonic_basis().groups[: len(kept)][kept]
    for target, values in (
        (sums.term_squares, squares),
        (sums.term_weights, weights),
        (sums.term_counts, np.ones(len(groups))),
    ):
        target[row, degree] = np.bincount(groups, values, minlength=target.shape[2])
