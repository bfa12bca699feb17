"""Small dense algebra for the kernel: everything is a dot product of contiguous numbers.

That is what the compiler turns into vector instructions. A symmetric matrix of order m is stored
by the m (m + 1) / 2 entries of its lower triangle, row by row.
"""

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.runtime.lean import lean_njit


@lean_njit(fastmath={"contract", "reassoc"})
def dot(a: FloatArray, b: FloatArray, count: int) -> float:
    """Sum of a[k] b[k] over the first `count` entries."""
    total = 0.0
    for k in range(count):
        total += a[k] * b[k]
    return total


@lean_njit()
def powers(t: FloatArray, count: int, highest: int, out: FloatArray) -> None:
    """Powers out[k, :count] = t[:count]^k for k up to `highest`."""
    for a in range(count):
        out[0, a] = 1.0
    for k in range(highest):
        for a in range(count):
            out[k + 1, a] = out[k, a] * t[a]


@lean_njit(fastmath={"contract", "reassoc"})
def cholesky_solve(matrix: FloatArray, rhs: FloatArray, order: int, smallest_pivot: float) -> bool:
    """Solve in place; matrix becomes its Cholesky factor with reciprocal diagonal, rhs the solution.

    Parameters
    ----------
    matrix : (order (order + 1) / 2,) float64
        Lower triangle of the symmetric matrix.
    rhs : (order,) float64
    order : int
    smallest_pivot : float
        A pivot below this fraction of its diagonal entry means a rank-deficient system.

    Returns
    -------
    bool
        False for a rank-deficient system; the solution then means nothing.
    """
    for i in range(order):
        row = matrix[i * (i + 1) // 2 :]
        for k in range(i):
            other = matrix[k * (k + 1) // 2 :]
            row[k] = (row[k] - dot(row, other, k)) * other[k]
        pivot = row[i] - dot(row, row, i)
        if not pivot > smallest_pivot * row[i]:
            return False
        row[i] = 1.0 / np.sqrt(pivot)
        rhs[i] = (rhs[i] - dot(row, rhs, i)) * row[i]
    for i in range(order - 1, -1, -1):
        row = matrix[i * (i + 1) // 2 :]
        rhs[i] *= row[i]
        for k in range(i):
            rhs[k] -= row[k] * rhs[i]
    return True
