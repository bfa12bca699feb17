"""Scratch memory of the hot loop, for one block of eight vertices."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.kernels.kernel_input import KernelFit
from bezier_filters.kernels.lane_algebra import GROUP
from bezier_filters.runtime.lanes import LANES, aligned

CHUNK = 32  # most points whose powers are held at a time: they fit into the nearest cache
# Places of what every fit gives, see `graph_geometry`; of vectors and of the three standard errors, the first.
NORMAL, ALONG_MIN, ALONG_MAX = 0, 3, 6
K_MIN, K_MAX, EXTREMALITY_MIN, EXTREMALITY_MAX, RESIDUAL = 9, 10, 11, 12, 13
STANDARD_ERRORS, DISPLACEMENT = 14, 17
OUTPUTS = DISPLACEMENT + 3  # how many numbers these are: compiled code does not notice if there is one more


class FitWorkspace(NamedTuple):
    """Scratch arrays for one block; those without a shape of their own are flat arrays of lanes."""

    visited: BoolArray  # (n,): of the search for neighbours, see `collect_ring`
    members: IntArray  # (n + 1,): what it found
    counts: FloatArray  # (1): number of points
    rings: IntArray  # (8,): how many the search went through
    points: FloatArray  # table with rows x, y, height, presence; then s, t, height, presence
    frame: FloatArray  # (9): x, y and z axes
    # (5): middle and reciprocal half width of the parameter rectangle along x, then y; square of the farthest distance
    box: FloatArray
    left: FloatArray  # table of the powers of s times the weights
    right: FloatArray  # table of the powers of t
    lifted: FloatArray  # table of those times the height
    moments: FloatArray
    heights: FloatArray  # moments with the height
    matrix: FloatArray
    solution: FloatArray
    coefficients: FloatArray  # the solution in lexicographic order
    sound: FloatArray  # (1)
    weight: FloatArray  # (1): sum of the weights
    total: FloatArray  # (1): sum of the weighted squared residuals
    origin: FloatArray  # (2): s and t of the vertex
    jets: FloatArray  # (16)
    outputs: FloatArray  # (OUTPUTS)
    one_frame: FloatArray  # (9,): of one vertex


def fit_workspace(fit: KernelFit, n: int, capacity: int) -> FitWorkspace:
    """Scratch arrays for neighbourhoods of up to `capacity` of n points."""
    order, rows = fit.exponents.shape[0], fit.highest_power + 1
    return FitWorkspace(
        np.zeros(n, np.bool_),
        np.empty(n + 1, np.int32),
        aligned(1),
        np.zeros(LANES, np.int32),
        aligned(4 * capacity),
        aligned(9),
        aligned(5),
        aligned(rows * CHUNK),
        aligned((rows + GROUP) * CHUNK),
        aligned((fit.highest_power // 2 + 1 + GROUP) * CHUNK),
        aligned(fit.moment_place.max() + 1 + GROUP),
        aligned(order + GROUP),
        aligned((order + 1 + GROUP) * (order + 2 + GROUP) // 2),
        aligned(order),
        aligned(order),
        aligned(1),
        aligned(1),
        aligned(1),
        aligned(2),
        aligned(16),
        aligned(OUTPUTS),
        np.empty(9),
    )


class RobustWorkspace(NamedTuple):
    """What reweighting by residuals needs beyond that."""

    residuals: FloatArray  # lanes (capacity)
    weights: FloatArray  # lanes (capacity): of the points, by their residuals
    medians: FloatArray  # lanes (1): of the residuals' sizes; 0 where settled, -1 where too few points are left
    reaches: FloatArray  # lanes (1): residuals from which on points weigh nothing; 0 where reweighting has ended
    sizes: FloatArray  # lanes (capacity): of the residuals, sorted


def robust_workspace(capacity: int) -> RobustWorkspace:
    """Scratch arrays for neighbourhoods of up to `capacity` points."""
    return RobustWorkspace(aligned(capacity), aligned(capacity), aligned(1), aligned(1), aligned(capacity))
