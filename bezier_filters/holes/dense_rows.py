"""Sums over rows of dense matrices, for compiled code that may add in any order."""

from bezier_filters.arrays import FloatArray
from bezier_filters.runtime.jit import inner_jit

FAST = {"contract", "reassoc", "nsz", "arcp"}  # what the compiler may do to sums; numbers that are not finite stay so


@inner_jit(fastmath=FAST, inline="always")
def add_row(total: FloatArray, factor: float, row: FloatArray) -> None:
    """Add a multiple of a row to another one."""
    for j in range(total.shape[0]):
        total[j] += factor * row[j]


@inner_jit(fastmath=FAST, inline="always")
def dot(a: FloatArray, b: FloatArray, start: int) -> float:
    """Product of what two rows have from an entry on."""
    total = 0.0
    for j in range(start, a.shape[0]):
        total += a[j] * b[j]
    return total
