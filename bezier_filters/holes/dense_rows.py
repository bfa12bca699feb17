"""Row operations on dense matrices, compiled with reassociated sums so that they are vectorised."""

from bezier_filters.arrays import FloatArray
from bezier_filters.runtime.jit import inner_jit

# flags of LLVM: sums may be reordered and products fused, NaN and infinity keep their meaning
FASTMATH = {"contract", "reassoc", "nsz", "arcp"}


@inner_jit(fastmath=FASTMATH, inline="always")
def add_row(total: FloatArray, factor: float, row: FloatArray) -> None:
    """Add a multiple of a row to `total`."""
    for j in range(total.shape[0]):
        total[j] += factor * row[j]


@inner_jit(fastmath=FASTMATH, inline="always")
def dot(a: FloatArray, b: FloatArray, start: int) -> float:
    """Inner product of two rows from entry `start` on."""
    total = 0.0
    for j in range(start, a.shape[0]):
        total += a[j] * b[j]
    return total
