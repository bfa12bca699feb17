"""Sums that do not depend on the order of what is added up: they are carried with twice the digits, and rounded once.

Only if the exact sum is within 2^-100 of half-way between two numbers may the order tell which of them it becomes.
"""

import math

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray, RealArray
from bezier_filters.runtime.lean import inner_njit, lean_njit


def column_sums(values: RealArray, rows: IntArray | None = None, *, squared: bool = False) -> FloatArray:
    """Sums of columns (n, c), or of their squares, over all or some rows: the sum and what rounding took off, (2, c).

    Every addition keeps its rounding error (Knuth, "The art of computer programming", vol. 2, 4.2.2).

    Examples
    --------
    >>> column_sums(np.array([[1.0], [1e20], [-1e20]]))[:, 0].sum()
    np.float64(1.0)
    """
    if values.ndim == 1:
        values = values[:, np.newaxis]
    result = np.zeros((2, values.shape[1]))
    if rows is None:
        _add_all(values, squared, result)
    else:
        _add_some(values, rows, squared, result)
    return result


def total(sums: FloatArray) -> FloatArray:
    """Round sums of some tiles, (tiles, 2, c), to those of the whole, (c,): the same whatever the tiles."""
    return np.array([math.fsum(sums[:, :, k].ravel()) for k in range(sums.shape[2])])


def exact_sum(values: RealArray, *, squared: bool = False) -> float:
    """Sum of values (n,)."""
    return float(total(column_sums(values, squared=squared)[np.newaxis])[0])


def sums_by_part(parts: IntArray, values: FloatArray, count: int) -> FloatArray:
    """Sums of values (n,) over each of some parts, -1 for none, as of columns, (2, count)."""
    result = np.zeros((2, count))
    _add_by_part(parts, values, result)
    return result


@inner_njit()
def _add(sums: FloatArray, k: int, x: float) -> None:
    high = sums[0, k] + x
    rest = high - sums[0, k]
    sums[1, k] += (sums[0, k] - (high - rest)) + (x - rest)
    sums[0, k] = high


@lean_njit()
def _add_all(values: RealArray, squared: bool, sums: FloatArray) -> None:
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            x = np.float64(values[i, k])
            _add(sums, k, x * x if squared else x)


@lean_njit()
def _add_some(values: RealArray, rows: IntArray, squared: bool, sums: FloatArray) -> None:
    for i in rows:
        for k in range(values.shape[1]):
            x = np.float64(values[i, k])
            _add(sums, k, x * x if squared else x)


@lean_njit()
def _add_by_part(parts: IntArray, values: FloatArray, sums: FloatArray) -> None:
    for i in range(parts.shape[0]):
        if parts[i] >= 0:
            _add(sums, parts[i], values[i])
