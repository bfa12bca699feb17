"""Scratch arrays of the fit kernel, for one block of eight vertices."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.kernels.kernel_input import KernelFit
from bezier_filters.kernels.lane_algebra import UNROLL_FACTOR
from bezier_filters.runtime.lanes import LANES, lane_array

POWER_CHUNK = 32  # points whose powers are held at a time: they fit into the L1 cache
# Rows of the outputs of a fit, see `graph_geometry`; the first row of vectors and of the three standard errors.
OUT_NORMAL, OUT_DIRECTION_MIN, OUT_DIRECTION_MAX = 0, 3, 6
OUT_K_MIN, OUT_K_MAX, OUT_EXTREMALITY_MIN, OUT_EXTREMALITY_MAX, OUT_RESIDUAL = 9, 10, 11, 12, 13
OUT_STANDARD_ERRORS, OUT_DISPLACEMENT = 14, 17
OUTPUT_COUNT = OUT_DISPLACEMENT + 3  # compiled code does not check this bound


class FitWorkspace(NamedTuple):
    """Scratch arrays for one block; arrays without a shape are flat arrays of lanes."""

    visited: BoolArray  # (n,): marks of the search for neighbours, see `collect_ring`
    members: IntArray  # (n + 1,): vertices of the neighbourhood
    counts: FloatArray  # (1): number of points
    rings: IntArray  # (8,): number of rings of the neighbourhood
    points: FloatArray  # table with rows x, y, height, presence; then s, t, height, presence
    frame: FloatArray  # (9): x, y and z axes
    # (5): middle and reciprocal half width of the parameter rectangle along x, then y; square of the farthest distance
    box: FloatArray
    left: FloatArray  # table of the powers of s times the weights
    right: FloatArray  # table of the powers of t
    lifted: FloatArray  # table of the powers of t times the height
    moments: FloatArray
    heights: FloatArray  # moments with the height
    matrix: FloatArray
    solution: FloatArray
    coefficients: FloatArray  # the solution in lexicographic order
    is_full_rank: FloatArray  # (1): 1 or 0
    weight: FloatArray  # (1): sum of the weights
    total: FloatArray  # (1): sum of the weighted squared residuals
    origin: FloatArray  # (2): s and t of the vertex
    jets: FloatArray  # (16)
    outputs: FloatArray  # (OUTPUT_COUNT)
    one_frame: FloatArray  # (9,): of one vertex


def fit_workspace(fit: KernelFit, n: int, capacity: int) -> FitWorkspace:
    """Scratch arrays for neighbourhoods of up to `capacity` of n points."""
    order, rows = fit.exponents.shape[0], fit.highest_power + 1
    return FitWorkspace(
        np.zeros(n, np.bool_),
        np.empty(n + 1, np.int32),
        lane_array(1),
        np.zeros(LANES, np.int32),
        lane_array(4 * capacity),
        lane_array(9),
        lane_array(5),
        lane_array(rows * POWER_CHUNK),
        lane_array((rows + UNROLL_FACTOR) * POWER_CHUNK),
        lane_array((fit.highest_power // 2 + 1 + UNROLL_FACTOR) * POWER_CHUNK),
        lane_array(fit.moment_place.max() + 1 + UNROLL_FACTOR),
        lane_array(order + UNROLL_FACTOR),
        lane_array((order + 1 + UNROLL_FACTOR) * (order + 2 + UNROLL_FACTOR) // 2),
        lane_array(order),
        lane_array(order),
        lane_array(1),
        lane_array(1),
        lane_array(1),
        lane_array(2),
        lane_array(16),
        lane_array(OUTPUT_COUNT),
        np.empty(9),
    )


class RobustWorkspace(NamedTuple):
    """Further scratch arrays for reweighting by residuals."""

    residuals: FloatArray  # lanes (capacity)
    weights: FloatArray  # lanes (capacity): biweights of the points
    medians: FloatArray  # lanes (1): median absolute residual; 0 after convergence, -1 if too few points remain
    reaches: FloatArray  # lanes (1): cutoff residual, from which on weights are zero; 0 after convergence
    sizes: FloatArray  # lanes (capacity): sorted absolute residuals


def robust_workspace(capacity: int) -> RobustWorkspace:
    """Scratch arrays for neighbourhoods of up to `capacity` points."""
    return RobustWorkspace(
        lane_array(capacity), lane_array(capacity), lane_array(1), lane_array(1), lane_array(capacity)
    )
