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
def powers(t: FloatArray, highest: int, out: FloatArray) -> None:
    """Powers out[k] = t^k for k up to `highest`; t is (LANES,), out (highest + 1, LANES)."""
    for lane in range(LANES):
        out[0, lane] = 1.0
    for k in range(highest):
        for lane in range(LANES):
            out[k + 1, lane] = out[k, lane] * t[lane]


@njit(cache=True, nogil=True, error_model="numpy")
def add_products(a: FloatArray, b: FloatArray, exponents: IntArray, out: FloatArray) -> None:
    """Add a[i] b[j] to out[k] for every row k = (i, j) of `exponents`."""
    for k in range(exponents.shape[0]):
        i, j = exponents[k, 0], exponents[k, 1]
        for lane in range(LANES):
            out[k, lane] += a[i, lane] * b[j, lane]


@njit(cache=True, nogil=True, error_model="numpy")
def normal_matrix(moments: FloatArray, place: IntArray, penalty: FloatArray, out: FloatArray) -> None:
    """Lower triangle of A^T A + penalty: entry k of A^T A is the moment place[k]."""
    for k in range(place.shape[0]):
        moment, added = place[k], penalty[k]
        for lane in range(LANES):
            out[k, lane] = moments[moment, lane] + added


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
    for lane in range(LANES):
        singular[lane] = False
    for k in range(order):
        row = k * (k + 1) // 2
        pivot = matrix[row + k]
        for lane in range(LANES):
            inverse[k, lane] = pivot[lane]
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
