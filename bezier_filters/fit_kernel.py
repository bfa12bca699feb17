"""The hot loop: fit a patch to the neighbourhood of each vertex and read its geometry off.

Eight vertices are fitted at a time (see `lanes`). Since the patch is a height field, one
right-hand side is solved; since products of monomials are monomials, the normal matrix needs the
moments of the points, not all pairs of basis functions.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.frames import farthest_direction, folds, mean_normal
from bezier_filters.jets import GraphGeometry, polynomial_derivatives, write_graph_geometry
from bezier_filters.lanes import LANES, add_products, cholesky_solve, normal_matrix, powers
from bezier_filters.neighbourhoods import collect_ring

FITTED, NO_FRAME, FOLDED, ILL_POSED = 0, 1, 2, 3
"""Outcomes of one attempt at one vertex."""


class KernelMesh(NamedTuple):
    """The arrays of a mesh that the kernel reads."""

    vertices: FloatArray
    faces: IntArray
    face_ptr: IntArray
    face_indices: IntArray
    ring_ptr: IntArray
    ring_indices: IntArray
    normals: FloatArray
    safe_cosine: FloatArray


class KernelFit(NamedTuple):
    """How to fit: `fallbacks.Attempt` in arrays."""

    rings: int
    fewest_points: int
    square: bool
    mean_plane: bool
    allow_folds: bool
    highest_power: int
    exponents: IntArray
    moment_exponents: IntArray
    moment_place: IntArray
    penalty: FloatArray


class Workspace(NamedTuple):
    """Scratch arrays for eight vertices; the last axis is the lane."""

    counts: IntArray
    frames: FloatArray  # x, y and z axes
    box: FloatArray  # middle and reciprocal half width of the parameter rectangle along x, then y
    s: FloatArray
    t: FloatArray
    powers_s: FloatArray
    powers_t: FloatArray
    moments: FloatArray
    matrix: FloatArray
    coefficients: FloatArray
    inverse: FloatArray
    singular: BoolArray
    jet: FloatArray
    residual: FloatArray


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def fit_vertices(
    mesh: KernelMesh,
    fit: KernelFit,
    ids: IntArray,
    start: int,
    stop: int,
    visited: IntArray,
    members: IntArray,
    result: GraphGeometry,
    residuals: FloatArray,
    outcomes: IntArray,
) -> None:
    """Fit the vertices ids[start:stop]; write their geometry and outcomes[start:stop].

    `visited` (filled with -1 before its first use in an attempt) and `members`, both (n,), are
    the work space of `collect_ring`.
    """
    order = fit.exponents.shape[0]
    work = _workspace(fit)
    points = np.zeros((4, 64, LANES))
    for first in range(start, stop, LANES):
        used = min(LANES, stop - first)
        points = _gather(mesh, fit, ids, first, used, visited, members, work, points, outcomes)
        longest = work.counts.max()
        _accumulate(fit, points, longest, work)
        normal_matrix(work.moments, fit.moment_place, fit.penalty, work.matrix)
        cholesky_solve(work.matrix, work.coefficients, order, work.inverse, work.singular)
        _derivatives_at_vertices(fit, work)
        _residuals(fit, points, longest, work)
        for lane in range(used):
            if outcomes[first + lane] != FITTED:
                continue
            if work.singular[lane]:
                outcomes[first + lane] = ILL_POSED
                continue
            i = ids[first + lane]
            jet, sx, sy = work.jet[:, :, lane], work.box[1, lane], work.box[3, lane]
            write_graph_geometry(
                jet[1, 0] * sx,
                jet[0, 1] * sy,
                jet[2, 0] * sx * sx,
                jet[1, 1] * sx * sy,
                jet[0, 2] * sy * sy,
                work.frames[:, lane],
                i,
                result,
            )
            residuals[i] = np.sqrt(work.residual[lane] / work.counts[lane])


@njit(cache=True, nogil=True)
def _workspace(fit: KernelFit) -> Workspace:
    """Scratch arrays that fit the polynomial space."""
    order = fit.exponents.shape[0]
    return Workspace(
        np.zeros(LANES, np.int32),
        np.zeros((9, LANES)),
        np.ones((4, LANES)),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros((fit.highest_power + 1, LANES)),
        np.zeros((fit.highest_power + 1, LANES)),
        np.zeros((fit.moment_exponents.shape[0], LANES)),
        np.zeros((order * (order + 1) // 2, LANES)),
        np.zeros((order, LANES)),
        np.zeros((order, LANES)),
        np.zeros(LANES, np.bool_),
        np.zeros((3, 3, LANES)),
        np.zeros(LANES),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(
    mesh: KernelMesh,
    fit: KernelFit,
    ids: IntArray,
    first: int,
    used: int,
    visited: IntArray,
    members: IntArray,
    work: Workspace,
    points: FloatArray,
    outcomes: IntArray,
) -> FloatArray:
    """Neighbourhoods of ids[first : first + used] as points[:, a, lane] = (x, y, z, weight).

    Lanes without a neighbourhood get the count 0. Returns the points, which may have grown.
    """
    for lane in range(LANES):
        work.counts[lane] = 0
        if lane >= used:
            continue
        i = ids[first + lane]
        count, inner = collect_ring(mesh.ring_ptr, mesh.ring_indices, i, fit.rings, visited, members)
        frame = work.frames[:, lane]
        outcomes[first + lane] = _frame(mesh, fit, members, count, inner, frame)
        if outcomes[first + lane] != FITTED:
            continue
        while count > points.shape[1]:
            points = np.concatenate((points, np.zeros_like(points)), axis=1)
        if _project(mesh.vertices, members, count, fit.square, frame, points[:, :, lane], work.box[:, lane]):
            work.counts[lane] = count
        else:
            outcomes[first + lane] = ILL_POSED
    longest = work.counts.max()
    for lane in range(LANES):
        points[:, work.counts[lane] : longest, lane] = 0.0
    return points


@njit(cache=True, nogil=True, error_model="numpy")
def _parameters(points: FloatArray, a: int, highest: int, work: Workspace) -> None:
    """Parameters (s, t) of point a of every lane, and their powers."""
    for lane in range(LANES):
        work.s[lane] = (points[0, a, lane] - work.box[0, lane]) * work.box[1, lane]
        work.t[lane] = (points[1, a, lane] - work.box[2, lane]) * work.box[3, lane]
    powers(work.s, highest, work.powers_s)
    powers(work.t, highest, work.powers_t)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _accumulate(fit: KernelFit, points: FloatArray, longest: int, work: Workspace) -> None:
    """Moments of the points, and the right-hand side A^T z."""
    degree = fit.highest_power // 2
    work.moments[:] = 0.0
    work.coefficients[:] = 0.0
    for a in range(longest):
        _parameters(points, a, fit.highest_power, work)
        for k in range(fit.highest_power + 1):
            for lane in range(LANES):
                work.powers_s[k, lane] *= points[3, a, lane]
        add_products(work.powers_s, work.powers_t, fit.moment_exponents, work.moments)
        for k in range(degree + 1):
            for lane in range(LANES):
                work.powers_t[k, lane] *= points[2, a, lane]
        add_products(work.powers_s, work.powers_t, fit.exponents, work.coefficients)


@njit(cache=True, nogil=True, error_model="numpy")
def _derivatives_at_vertices(fit: KernelFit, work: Workspace) -> None:
    """Derivatives by (s, t) at the vertices themselves, the origins of their frames."""
    for lane in range(LANES):
        work.s[lane] = -work.box[0, lane] * work.box[1, lane]
        work.t[lane] = -work.box[2, lane] * work.box[3, lane]
    powers(work.s, fit.highest_power // 2, work.powers_s)
    powers(work.t, fit.highest_power // 2, work.powers_t)
    polynomial_derivatives(work.coefficients, fit.exponents, work.powers_s, work.powers_t, work.jet)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _residuals(fit: KernelFit, points: FloatArray, longest: int, work: Workspace) -> None:
    """Weighted sums of the squared heights of the points over their patches."""
    work.residual[:] = 0.0
    for a in range(longest):
        _parameters(points, a, fit.highest_power // 2, work)
        difference = work.s
        for lane in range(LANES):
            difference[lane] = -points[2, a, lane]
        for k in range(fit.exponents.shape[0]):
            i, j = fit.exponents[k, 0], fit.exponents[k, 1]
            for lane in range(LANES):
                difference[lane] += work.coefficients[k, lane] * work.powers_s[i, lane] * work.powers_t[j, lane]
        for lane in range(LANES):
            work.residual[lane] += points[3, a, lane] * difference[lane] * difference[lane]


@njit(cache=True, nogil=True, error_model="numpy")
def _frame(mesh: KernelMesh, fit: KernelFit, members: IntArray, count: int, inner: int, frame: FloatArray) -> int:
    """Write the x, y and z axes of the frame into frame (9,); return the outcome so far."""
    i = members[0]
    nx, ny, nz = mesh.normals[i, 0], mesh.normals[i, 1], mesh.normals[i, 2]
    if fit.mean_plane:
        nx, ny, nz = mean_normal(mesh.normals, members, count)
    if nx == 0.0 and ny == 0.0 and nz == 0.0:
        return NO_FRAME
    if count < fit.fewest_points:
        return ILL_POSED
    if not fit.allow_folds and folds(
        mesh.vertices,
        mesh.faces,
        mesh.face_ptr,
        mesh.face_indices,
        mesh.normals,
        mesh.safe_cosine,
        members,
        inner,
        nx,
        ny,
        nz,
    ):
        return FOLDED
    valence = mesh.ring_ptr[i + 1] - mesh.ring_ptr[i]
    xx, xy, xz = farthest_direction(mesh.vertices, members, valence, count, nx, ny, nz)
    if xx == 0.0 and xy == 0.0 and xz == 0.0:
        return ILL_POSED
    frame[0], frame[1], frame[2] = xx, xy, xz
    frame[3], frame[4], frame[5] = ny * xz - nz * xy, nz * xx - nx * xz, nx * xy - ny * xx
    frame[6], frame[7], frame[8] = nx, ny, nz
    return FITTED


@njit(cache=True, nogil=True, error_model="numpy")
def _project(
    vertices: FloatArray,
    members: IntArray,
    count: int,
    square: bool,
    frame: FloatArray,
    points: FloatArray,
    box: FloatArray,
) -> bool:
    """Write local coordinates and weights into points[:, :count], and the parameter rectangle.

    box is (middle, 1 / half width) along x, then along y. Returns False where the rectangle has
    no area.
    """
    i = members[0]
    low_x, high_x, low_y, high_y, radius = 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(count):
        j = members[a]
        dx, dy, dz = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        x = dx * frame[0] + dy * frame[1] + dz * frame[2]
        y = dx * frame[3] + dy * frame[4] + dz * frame[5]
        points[0, a] = x
        points[1, a] = y
        points[2, a] = dx * frame[6] + dy * frame[7] + dz * frame[8]
        points[3, a] = 1.0
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
        radius = max(radius, x * x + y * y)
    if square:
        radius = np.sqrt(radius)
        low_x, high_x, low_y, high_y = -radius, radius, -radius, radius
    width, height = high_x - low_x, high_y - low_y
    if not (width > 0.0 and height > 0.0):
        return False
    box[0], box[1] = 0.5 * (low_x + high_x), 2.0 / width
    box[2], box[3] = 0.5 * (low_y + high_y), 2.0 / height
    return True
