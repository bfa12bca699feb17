"""Dense algebra for eight patches at a time.

Every quantity carries a last axis of `LANES` independent patches, so that the inner loops run
over eight contiguous numbers and become vector instructions. A symmetric matrix of order m is
stored by the m (m + 1) / 2 entries of its lower triangle, row by row.
"""

import numpy as np
from numba import njit

from bezier_filters.arrays import BoolArray, FloatArray, IntArray

LANES = 8
SMALLEST_PIVOT = 1e-6
"""A pivot below this fraction of its diagonal entry means a rank-deficient system."""


@njit(cache=True, nogil=True, error_model="numpy")
def power_products(t: FloatArray, degree: int, powers: FloatArray, out: FloatArray) -> None:
    """Bernstein polynomials without their binomial factors: out[i] = t^i (1 - t)^(degree - i).

    Parameters
    ----------
    t : (LANES,) float64
    degree : int
    powers : (2, >= degree + 1, LANES) float64
        Work space.
    out : (>= degree + 1, LANES) float64
    """
    for lane in range(LANES):
        powers[0, 0, lane] = 1.0
        powers[1, 0, lane] = 1.0
    for i in range(degree):
        for lane in range(LANES):
            powers[0, i + 1, lane] = powers[0, i, lane] * t[lane]
            powers[1, i + 1, lane] = powers[1, i, lane] * (1.0 - t[lane])
    for i in range(degree + 1):
        for lane in range(LANES):
            out[i, lane] = powers[0, i, lane] * powers[1, degree - i, lane]


@njit(cache=True, nogil=True, error_model="numpy")
def add_outer_product(a: FloatArray, b: FloatArray, size: int, out: FloatArray) -> None:
    """Add the outer products of a[:size] and b[:size] to out, row by row."""
    for i in range(size):
        for j in range(size):
            k = i * size + j
            for lane in range(LANES):
                out[k, lane] += a[i, lane] * b[j, lane]


@njit(cache=True, nogil=True, error_model="numpy")
def normal_matrix(
    moments: FloatArray, moment_index: IntArray, moment_factor: FloatArray, penalty: FloatArray, out: FloatArray
) -> None:
    """Lower triangle of A^T A + penalty from the moments of the points."""
    for k in range(moment_index.shape[0]):
        moment, factor, added = moment_index[k], moment_factor[k], penalty[k]
        for lane in range(LANES):
            out[k, lane] = factor * moments[moment, lane] + added


@njit(cache=True, nogil=True, error_model="numpy")
def cholesky_solve(matrix: FloatArray, rhs: FloatArray, order: int, inverse: FloatArray, singular: BoolArray) -> None:
    """Solve in place; matrix becomes its Cholesky factor, rhs the solution.

    Parameters
    ----------
    matrix : (order (order + 1) / 2, LANES) float64
        Lower triangle of the symmetric matrix.
    rhs : (order, LANES) float64
    order : int
    inverse : (order, LANES) float64
        Work space; receives the reciprocal diagonal of the factor.
    singular : (LANES,) bool
        Set where a pivot is too small; the solution of such a lane means nothing.
    """
    for k in range(order):
        row = k * (k + 1) // 2
        diagonal = row + k
        for lane in range(LANES):
            inverse[k, lane] = matrix[diagonal, lane]
    for lane in range(LANES):
        singular[lane] = False
    # Left-looking by columns: what has to be subtracted from an entry is summed in one go.
    for k in range(order):
        row = k * (k + 1) // 2
        pivot = matrix[row + k]
        for p in range(k):
            for lane in range(LANES):
                pivot[lane] -= matrix[row + p, lane] * matrix[row + p, lane]
        for lane in range(LANES):
            full = inverse[k, lane]
            if not pivot[lane] > SMALLEST_PIVOT * full:
                singular[lane] = True
                pivot[lane] = max(full, 1e-300)
            inverse[k, lane] = 1.0 / np.sqrt(pivot[lane])
        for i in range(k + 1, order):
            below = i * (i + 1) // 2
            entry = matrix[below + k]
            for p in range(k):
                for lane in range(LANES):
                    entry[lane] -= matrix[below + p, lane] * matrix[row + p, lane]
            for lane in range(LANES):
                entry[lane] *= inverse[k, lane]
        for p in range(k):
            for lane in range(LANES):
                rhs[k, lane] -= matrix[row + p, lane] * rhs[p, lane]
        for lane in range(LANES):
            rhs[k, lane] *= inverse[k, lane]
    for k in range(order - 1, -1, -1):
        row = k * (k + 1) // 2
        for lane in range(LANES):
            rhs[k, lane] *= inverse[k, lane]
        for p in range(k):
            for lane in range(LANES):
                rhs[p, lane] -= matrix[row + p, lane] * rhs[k, lane]
