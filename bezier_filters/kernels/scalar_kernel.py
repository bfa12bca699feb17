"""The definition of a fit, one vertex at a time: the reference for `lane_kernel`, and the kernel of robust fits.

Since the patch is a height field, one right-hand side is solved; since products of monomials are
monomials, the normal matrix needs the moments of the points, not all pairs of basis functions.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from bezier_filters.arrays import BoolArray, ByteArray, FloatArray, IntArray
from bezier_filters.kernels.condition import factor_condition
from bezier_filters.kernels.kernel_input import FITTED, ILL_POSED, SMALLEST_WIDTH, KernelFit, KernelMesh
from bezier_filters.kernels.local_frames import write_axes, write_plane
from bezier_filters.kernels.uncertainty import SEEN, StandardErrors, last_corner, write_standard_errors
from bezier_filters.meshes.neighbourhoods import collect_ball, collect_ring
from bezier_filters.patches.jets import (
    GraphGeometry,
    polynomial_derivatives,
    rescale_jet,
    write_displacement,
    write_extremalities,
    write_graph_geometry,
)
from bezier_filters.runtime.dense import cholesky_solve, dot, powers
from bezier_filters.runtime.parallel import RangeTask

BIWEIGHT = 4.685
"""Scales beyond which a residual has no weight: 95 % efficient for normal residuals."""
SETTLED = 0.95
"""Reweighting goes on while the median residual falls below this share of the one before."""
NORMAL_MEDIAN = 1.4826
"""Standard deviation of normal residuals over their median size."""


class Workspace(NamedTuple):
    """Scratch arrays for one neighbourhood at a time."""

    points: FloatArray  # (3, capacity): x, y, z
    parameters: FloatArray  # (2, capacity): s, t
    distance_weights: FloatArray  # (capacity,)
    weights: FloatArray  # (capacity,): those times the weights of the residuals
    powers_s: FloatArray  # (highest power + 1, capacity)
    weighted_s: FloatArray  # powers of s times the weights
    powers_t: FloatArray
    lifted_t: FloatArray  # powers of t times z
    residual: FloatArray  # (capacity,)
    moments: FloatArray
    matrix: FloatArray
    coefficients: FloatArray
    frame: FloatArray  # (9,): x, y and z axes
    box: FloatArray  # (4,): middle and reciprocal half width of the parameter rectangle along x, then y
    jet: FloatArray  # (4, 4)
    corner: FloatArray  # of the Cholesky factor, see `last_corner`
    sensitivities: FloatArray  # (4, SEEN)
    column: FloatArray  # of an inverse factor


def scalar_task(
    mesh: KernelMesh,
    fit: KernelFit,
    ids: IntArray,
    result: GraphGeometry,
    errors: StandardErrors,
    residuals: FloatArray,
    rings_used: IntArray,
    outcomes: ByteArray,
    conditions: FloatArray | None = None,
) -> RangeTask:
    """Task for one thread: fit the vertices ids[start:stop]; write their geometry and outcomes[start:stop].

    Condition numbers are written where there is an array for them.
    """
    wanted = np.empty(0) if conditions is None else conditions
    n = len(mesh.vertices)
    visited, members = np.zeros(n, dtype=np.bool_), np.empty(n + 1, dtype=np.int32)
    return lambda start, stop: fit_vertices(
        mesh, fit, ids, start, stop, visited, members, result, errors, residuals, rings_used, outcomes, wanted
    )


@njit(cache=True, nogil=True, error_model="numpy")
def fit_vertices(
    mesh: KernelMesh,
    fit: KernelFit,
    ids: IntArray,
    start: int,
    stop: int,
    visited: BoolArray,
    members: IntArray,
    result: GraphGeometry,
    errors: StandardErrors,
    residuals: FloatArray,
    rings_used: IntArray,
    outcomes: ByteArray,
    conditions: FloatArray,
) -> None:
    """Fit the vertices ids[start:stop]; write their geometry and outcomes[start:stop].

    The condition numbers, of m rows or none at all, are written where there is room for them.
    `visited` (n,) and `members` (n + 1,) are the work space of `collect_ring`.
    """
    work = _workspace(fit, 64)
    for row in range(start, stop):
        i = ids[row]
        if fit.radius > 0.0:
            count, inner, neighbours, rings = collect_ball(
                mesh.vertices, mesh.ring_ptr, mesh.ring_indices, mesh.stops, i, fit.radius, visited, members
            )
        else:
            count, inner = collect_ring(mesh.ring_ptr, mesh.ring_indices, mesh.stops, i, fit.rings, visited, members)
            neighbours, rings = mesh.ring_ptr[i + 1] - mesh.ring_ptr[i], fit.rings
        if count > work.points.shape[1]:
            work = _workspace(fit, 2 * count)
        outcomes[row] = write_plane(mesh, fit, members, count, inner, work.frame)
        if outcomes[row] == FITTED:
            outcomes[row] = write_axes(mesh, fit, members, count, neighbours, work.frame)
        if outcomes[row] != FITTED:
            continue
        if not _project(mesh.vertices, members, count, fit.square, work) or not _fit_heights(fit, count, work):
            outcomes[row] = ILL_POSED
            continue
        i = mesh.origin[i]  # from here on the row of the results
        # Point 0 is the vertex itself.
        polynomial_derivatives(work.coefficients, fit.exponents, work.powers_s[:, 0], work.powers_t[:, 0], work.jet)
        jet, sx, sy = work.jet, work.box[1], work.box[3]
        rescale_jet(jet, sx, sy)
        zx, zy, zxx, zxy, zyy = jet[1, 0], jet[0, 1], jet[2, 0], jet[1, 1], jet[0, 2]
        write_graph_geometry(zx, zy, zxx, zxy, zyy, work.frame, i, result)
        write_displacement(jet[0, 0], work.frame, i, result)
        if fit.highest_power >= 2 * 3:  # a lower degree says nothing of third derivatives
            write_extremalities(jet, work.frame, i, result)
        if fit.normal_noise > 0.0:
            last_corner(work.matrix, fit.exponents.shape[0], work.corner)
            noise = fit.normal_noise, fit.curvature_noise
            write_standard_errors(work.corner, noise, sx, (zx, zy, zxx, zxy, zyy), work.sensitivities, i, errors)
        residuals[i] = _residual(fit, count, work)
        rings_used[i] = rings
        if len(conditions):
            conditions[i] = factor_condition(work.matrix, fit.exponents.shape[0], work.column)


@njit(cache=True, nogil=True)
def _workspace(fit: KernelFit, capacity: int) -> Workspace:
    """Scratch arrays for neighbourhoods of up to `capacity` points."""
    order = fit.exponents.shape[0]
    return Workspace(
        np.empty((3, capacity)),
        np.empty((2, capacity)),
        np.ones(capacity),
        np.ones(capacity),
        np.empty((fit.highest_power + 1, capacity)),
        np.empty((fit.highest_power + 1, capacity)),
        np.empty((fit.highest_power + 1, capacity)),
        np.empty((fit.highest_power // 2 + 1, capacity)),
        np.empty(capacity),
        np.empty(fit.moment_exponents.shape[0]),
        np.empty(order * (order + 1) // 2),
        np.empty(order),
        np.empty(9),
        np.empty(4),
        np.empty((4, 4)),
        np.empty(SEEN * (SEEN + 1) // 2),
        np.empty((4, SEEN)),
        np.empty(order),
    )


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _fit_heights(fit: KernelFit, count: int, work: Workspace) -> bool:
    """Find the coefficients; False if the normal equations are rank deficient.

    With rounds, by iteratively reweighted least squares.
    """
    powers(work.parameters[0], count, fit.highest_power, work.powers_s)
    powers(work.parameters[1], count, fit.highest_power, work.powers_t)
    if fit.weight_scale > 0.0:
        _weigh_distances(fit, count, work)
    work.weights[:count] = work.distance_weights[:count]
    if not _solve(fit, count, work):
        return False
    before = np.inf
    for _ in range(fit.rounds):
        _residual(fit, count, work)
        typical = float(np.median(np.abs(work.residual[:count])))
        if not 0.0 < typical < SETTLED * before:
            break
        before = typical
        _weigh_residuals(BIWEIGHT * NORMAL_MEDIAN * typical, count, work)
        if not _solve(fit, count, work):
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _solve(fit: KernelFit, count: int, work: Workspace) -> bool:
    """Set up and solve the normal equations for the weights; False if they are rank deficient."""
    left = work.powers_s
    if fit.weight_scale > 0.0 or fit.rounds > 0:
        left = work.weighted_s
        for k in range(fit.highest_power + 1):
            row, weighted = work.powers_s[k], work.weighted_s[k]
            for p in range(count):
                weighted[p] = row[p] * work.weights[p]
    for k in range(fit.moment_exponents.shape[0]):
        a, b = fit.moment_exponents[k, 0], fit.moment_exponents[k, 1]
        work.moments[k] = dot(left[a], work.powers_t[b], count)
    for k in range(fit.moment_place.shape[0]):
        work.matrix[k] = work.moments[fit.moment_place[k]] + fit.penalty[k]
    order = fit.exponents.shape[0]
    degree, scale = 0, 1.0
    for k in range(fit.prior.shape[0]):
        while degree < fit.prior_degree[k]:  # from units of length to those of this neighbourhood
            degree += 1
            scale *= work.box[1] * work.box[1]
        work.matrix[fit.prior_place[k]] += fit.prior[k] * scale
    for b in range(fit.highest_power // 2 + 1):
        for p in range(count):
            work.lifted_t[b, p] = work.powers_t[b, p] * work.points[2, p]
    for k in range(order):
        a, b = fit.exponents[k, 0], fit.exponents[k, 1]
        work.coefficients[k] = dot(left[a], work.lifted_t[b], count)
    return cholesky_solve(work.matrix, work.coefficients, order, fit.smallest_pivot)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _weigh_distances(fit: KernelFit, count: int, work: Workspace) -> None:
    """Set the weights of the points by their distances."""
    for p in range(count):
        x, y = work.points[0, p], work.points[1, p]
        ratio = fit.weight_scale * (x * x + y * y)
        work.distance_weights[p] = 1.0 / (1.0 + ratio**fit.weight_power)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _weigh_residuals(reach: float, count: int, work: Workspace) -> None:
    """Multiply the weights of the distances by Tukey's biweight of the residuals, 0 beyond the reach."""
    for p in range(count):
        rest = max(0.0, 1.0 - (work.residual[p] / reach) ** 2)
        work.weights[p] = work.distance_weights[p] * rest * rest


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _residual(fit: KernelFit, count: int, work: Workspace) -> float:
    """Root mean square height of the points over the fitted polynomial."""
    residual = work.residual
    for p in range(count):
        residual[p] = -work.points[2, p]
    for k in range(fit.exponents.shape[0]):
        coefficient = work.coefficients[k]
        s, t = work.powers_s[fit.exponents[k, 0]], work.powers_t[fit.exponents[k, 1]]
        for p in range(count):
            residual[p] += coefficient * s[p] * t[p]
    return float(np.sqrt(dot(residual, residual, count) / count))


@njit(cache=True, nogil=True, error_model="numpy")
def _project(vertices: FloatArray, members: IntArray, count: int, square: bool, work: Workspace) -> bool:
    """Local coordinates and parameters of the points; False if the parameter rectangle has no area."""
    i, frame, points, box = members[0], work.frame, work.points, work.box
    low_x, high_x, low_y, high_y, radius = 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(count):
        j = members[a]
        dx, dy, dz = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        x = dx * frame[0] + dy * frame[1] + dz * frame[2]
        y = dx * frame[3] + dy * frame[4] + dz * frame[5]
        points[0, a] = x
        points[1, a] = y
        points[2, a] = dx * frame[6] + dy * frame[7] + dz * frame[8]
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
        radius = max(radius, x * x + y * y)
    if square:
        radius = np.sqrt(radius)
        low_x, high_x, low_y, high_y = -radius, radius, -radius, radius
    width, height = high_x - low_x, high_y - low_y
    if not (width > SMALLEST_WIDTH and height > SMALLEST_WIDTH):
        return False
    box[0], box[1] = 0.5 * (low_x + high_x), 2.0 / width
    box[2], box[3] = 0.5 * (low_y + high_y), 2.0 / height
    for a in range(count):
        work.parameters[0, a] = (points[0, a] - box[0]) * box[1]
        work.parameters[1, a] = (points[1, a] - box[2]) * box[3]
    return True
