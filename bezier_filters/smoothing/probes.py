"""Random numbers at the vertices of a mesh, by which leverages and what filters leave of noise are found.

They go by the numbers of the vertices in the whole mesh alone, not by their order, so a tile draws the same as the mesh
that it is a part of.
"""

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import IntArray, SingleArray

OTHER_SIGNS = 32  # column from which on random signs are others than those that chose the filters


def random_bits(ids: IntArray, stream: int) -> NDArray[np.uint64]:
    """64 random bits for every number, (n,) (the generator splitmix64 of Steele, Lea and Flood, at the place `id`).

    >>> random_bits(np.array([0, 1], dtype=np.int32), 0)
    array([16294208416658607535,  7960286522194355700], dtype=uint64)
    """
    step = np.uint64(0x9E3779B97F4A7C15)
    with np.errstate(over="ignore"):
        bits = (ids.astype(np.uint64) + np.uint64((stream << 32) + 1)) * step
        bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


def random_signs(ids: IntArray, columns: int, *, first: int = 0, stream: int = 0) -> SingleArray:
    """Random signs, (n, columns), from some column on, of which there are 64."""
    bits = random_bits(ids, stream)
    signs = [bits >> np.uint64(first + k) & np.uint64(1) for k in range(columns)]
    return np.column_stack([2.0 * sign.astype(np.float32) - 1.0 for sign in signs])


def white_noise(ids: IntArray, columns: int, *, stream: int = 1) -> SingleArray:
    """Numbers of the standard normal distribution, (n, columns), by the transform of Box and Muller."""
    result = np.empty((len(ids), columns), dtype=np.float32)
    for k in range(0, columns, 2):
        radius, angle = ((random_bits(ids, stream + k + j) >> np.uint64(11)) * 2.0**-53 for j in range(2))
        radius = np.sqrt(-2.0 * np.log1p(-radius))
        result[:, k] = radius * np.cos(2.0 * np.pi * angle)
        result[:, k + 1 : k + 2] = (radius * np.sin(2.0 * np.pi * angle))[:, np.newaxis]
    return result
