"""Rows of a `PatchTable`: the polynomials that the fit kernel found, and their evaluation."""

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.kernels.fit_workspace import FitWorkspace
from bezier_filters.kernels.kernel_input import PATCH_DEGREE, PATCH_HEAD, PATCH_ORIGIN, PATCH_SQUARE, KernelFit
from bezier_filters.kernels.lane_algebra import substitute_forward
from bezier_filters.runtime.jit import inner_jit
from bezier_filters.runtime.lanes import LANES, broadcast, load, multiply_add, square_root, store

JET = 6  # numbers of a jet: height, its derivatives by x and y, then by x x, x y and y y


def row_length(total_degree: int) -> int:
    """Number of columns of a table for polynomials of that total degree."""
    return PATCH_HEAD + (total_degree + 1) * (total_degree + 2) // 2


@inner_jit()
def height_errors(fit: KernelFit, work: FitWorkspace) -> None:
    """Write the standard errors of the heights at the vertices to `work.total`, from the factor that gave the fit.

    As in `standard_errors`, the variance is sigma^2 |L^-1 g|^2, here with the monomials g at the vertex
    and the noise of heights.
    """
    matrix, order = work.matrix, fit.exponents.shape[0]
    last, total = order * (order + 1) // 2, broadcast(0.0)
    for k in range(order):
        power = broadcast(1.0)
        for _ in range(fit.exponents[k, 0]):
            power = power * load(work.origin, 0)
        for _ in range(fit.exponents[k, 1]):
            power = power * load(work.origin, 1)
        store(matrix, last + k, power)
    substitute_forward(matrix, order, order, 0)
    for k in range(order):
        total = multiply_add(load(matrix, last + k), load(matrix, last + k), total)
    store(work.total, 0, broadcast(fit.height_noise) * square_root(total))


@inner_jit()
def write_patch(fit: KernelFit, work: FitWorkspace, lane: int, origin: FloatArray, row: FloatArray) -> None:
    """Write the frame, the parameter square and the coefficients of one lane, whose vertex is at `origin`."""
    for k in range(3):
        row[PATCH_ORIGIN + k] = origin[k]
    for k in range(9):
        row[k] = work.frame[LANES * k + lane]
    for k in range(4):
        row[PATCH_SQUARE + k] = work.box[LANES * k + lane]
    row[PATCH_HEAD:] = 0.0
    space = int(np.sqrt(2.0 * (row.shape[0] - PATCH_HEAD))) - 1  # D
    begin, total = PATCH_HEAD, 0
    for a in range(fit.starts.shape[0] - 1):
        count = fit.starts[a + 1] - fit.starts[a]
        for b in range(count):
            row[begin + b] = work.coefficients[LANES * (fit.starts[a] + b) + lane]
        total = max(total, a + count - 1)
        begin += space + 1 - a
    row[PATCH_DEGREE] = total


@inner_jit()
def evaluate_patch(row: FloatArray, x: float, y: float, jet: FloatArray) -> None:
    """Write the height over (x, y) from the vertex, and its first and second derivatives, to `jet` (6,)."""
    per_x, per_y = row[PATCH_SQUARE + 1], row[PATCH_SQUARE + 3]
    s, t = (x - row[PATCH_SQUARE]) * per_x, (y - row[PATCH_SQUARE + 2]) * per_y
    space = int(np.sqrt(2.0 * (row.shape[0] - PATCH_HEAD))) - 1
    degree = int(row[PATCH_DEGREE])
    z = z_s = z_t = z_ss = z_st = z_tt = 0.0
    for a in range(degree, -1, -1):  # Horner's scheme in s, whose coefficients are polynomials in t
        begin = PATCH_HEAD + a * (space + 1) - a * (a - 1) // 2
        q = q_t = q_tt = 0.0
        for b in range(degree - a, -1, -1):
            q_tt = q_tt * t + 2.0 * q_t
            q_t = q_t * t + q
            q = q * t + row[begin + b]
        z_ss = z_ss * s + 2.0 * z_s
        z_s, z_st = z_s * s + z, z_st * s + z_t
        z, z_t, z_tt = z * s + q, z_t * s + q_t, z_tt * s + q_tt
    jet[0], jet[1], jet[2] = z, z_s * per_x, z_t * per_y
    jet[3], jet[4], jet[5] = z_ss * per_x * per_x, z_st * per_x * per_y, z_tt * per_y * per_y
