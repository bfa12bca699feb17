"""The hot loop: fit a patch to the neighbourhood of each vertex and read its geometry off.

Eight vertices are fitted at a time (see `lanes`). Since the patch is a height field, one
right-hand side is solved; since a product of two Bernstein polynomials of degree d is one of
degree 2d, the normal matrix needs (2d + 1)^2 moments of the points, not all pairs of basis
functions.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.frames import farthest_direction, folds, mean_normal
from bezier_filters.jets import (
    GraphGeometry,
    add_squared_residuals,
    basis_derivatives,
    height_derivatives,
    write_graph_geometry,
)
from bezier_filters.lanes import LANES, add_outer_product, cholesky_solve, normal_matrix, power_products
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
    """How to fit: see `fitting.PatchFit`; the tables come from there."""

    rings: int
    degree: int
    fewest_points: int
    square: bool
    mean_plane: bool
    allow_folds: bool
    penalty: FloatArray
    moment_index: IntArray
    moment_factor: FloatArray
    basis_factor: FloatArray
    derivative_factor: FloatArray


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
    size = fit.degree + 1
    order = size * size
    moment_size = 2 * fit.degree + 1
    capacity = 64
    points = np.zeros((3, capacity, LANES))
    weights = np.zeros((capacity, LANES))
    counts = np.zeros(LANES, np.int64)
    frames = np.zeros((9, LANES))
    box = np.ones((4, LANES))
    u = np.zeros(LANES)
    v = np.zeros(LANES)
    powers = np.zeros((2, moment_size, LANES))
    basis_u = np.zeros((moment_size, LANES))
    basis_v = np.zeros((moment_size, LANES))
    moments = np.zeros((moment_size * moment_size, LANES))
    matrix = np.zeros((order * (order + 1) // 2, LANES))
    heights = np.zeros((order, LANES))
    inverse = np.zeros((order, LANES))
    singular = np.zeros(LANES, np.bool_)
    derivatives = np.zeros((2, 3, size, LANES))
    jet = np.zeros((3, 3, LANES))
    residual = np.zeros(LANES)

    for first in range(start, stop, LANES):
        used = min(LANES, stop - first)
        longest = 0
        for lane in range(LANES):
            counts[lane] = 0
            if lane >= used:
                continue
            i = ids[first + lane]
            count, inner = collect_ring(mesh.ring_ptr, mesh.ring_indices, i, fit.rings, visited, members)
            outcomes[first + lane] = _frame(mesh, fit, members, count, inner, frames[:, lane])
            if outcomes[first + lane] != FITTED:
                continue
            while count > capacity:
                capacity *= 2
                points = _grown(points, capacity)
                weights = np.zeros((capacity, LANES))
            if not _project(mesh.vertices, members, count, fit.square, frames[:, lane], points, lane, box[:, lane]):
                outcomes[first + lane] = ILL_POSED
                continue
            counts[lane] = count
            longest = max(longest, count)
        for lane in range(LANES):  # points without weight must be finite all the same
            points[:, counts[lane] : longest, lane] = 0.0

        moments[:] = 0.0
        heights[:] = 0.0
        for a in range(longest):
            for lane in range(LANES):
                weight = 1.0 if a < counts[lane] else 0.0
                weights[a, lane] = weight
                u[lane] = (points[0, a, lane] - box[0, lane]) * box[1, lane]
                v[lane] = (points[1, a, lane] - box[2, lane]) * box[3, lane]
            power_products(u, 2 * fit.degree, powers, basis_u)
            power_products(v, 2 * fit.degree, powers, basis_v)
            for k in range(moment_size):
                for lane in range(LANES):
                    basis_u[k, lane] *= weights[a, lane]
            add_outer_product(basis_u, basis_v, moment_size, moments)
            power_products(u, fit.degree, powers, basis_u)
            power_products(v, fit.degree, powers, basis_v)
            for k in range(size):
                for lane in range(LANES):
                    basis_u[k, lane] *= weights[a, lane] * points[2, a, lane]
            add_outer_product(basis_u, basis_v, size, heights)
        for k in range(order):
            for lane in range(LANES):
                heights[k, lane] *= fit.basis_factor[k]
        normal_matrix(moments, fit.moment_index, fit.moment_factor, fit.penalty, matrix)
        cholesky_solve(matrix, heights, order, inverse, singular)

        for lane in range(LANES):
            u[lane] = -box[0, lane] * box[1, lane]
            v[lane] = -box[2, lane] * box[3, lane]
        basis_derivatives(u, fit.degree, fit.derivative_factor, powers, basis_u, derivatives[0])
        basis_derivatives(v, fit.degree, fit.derivative_factor, powers, basis_u, derivatives[1])
        height_derivatives(heights, derivatives, size, jet)

        for k in range(order):
            for lane in range(LANES):
                heights[k, lane] *= fit.basis_factor[k]
        residual[:] = 0.0
        for a in range(longest):
            for lane in range(LANES):
                u[lane] = (points[0, a, lane] - box[0, lane]) * box[1, lane]
                v[lane] = (points[1, a, lane] - box[2, lane]) * box[3, lane]
            power_products(u, fit.degree, powers, basis_u)
            power_products(v, fit.degree, powers, basis_v)
            add_squared_residuals(heights, basis_u, basis_v, size, points[2, a], weights[a], residual)

        for lane in range(used):
            if outcomes[first + lane] != FITTED:
                continue
            if singular[lane]:
                outcomes[first + lane] = ILL_POSED
                continue
            i = ids[first + lane]
            sx, sy = box[1, lane], box[3, lane]
            write_graph_geometry(
                jet[1, 0, lane] * sx,
                jet[0, 1, lane] * sy,
                jet[2, 0, lane] * sx * sx,
                jet[1, 1, lane] * sx * sy,
                jet[0, 2, lane] * sy * sy,
                frames[:, lane],
                i,
                result,
            )
            residuals[i] = np.sqrt(residual[lane] / counts[lane])


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
    lane: int,
    box: FloatArray,
) -> bool:
    """Write local coordinates into points[:, :count, lane] and the parameter rectangle.

    box is (x, 1 / width, y, 1 / height). Returns False where the rectangle has no area.
    """
    i = members[0]
    low_x, high_x, low_y, high_y, radius = 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(count):
        j = members[a]
        dx, dy, dz = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        x = dx * frame[0] + dy * frame[1] + dz * frame[2]
        y = dx * frame[3] + dy * frame[4] + dz * frame[5]
        points[0, a, lane] = x
        points[1, a, lane] = y
        points[2, a, lane] = dx * frame[6] + dy * frame[7] + dz * frame[8]
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
        radius = max(radius, x * x + y * y)
    if square:
        radius = np.sqrt(radius)
        low_x, high_x, low_y, high_y = -radius, radius, -radius, radius
    width, height = high_x - low_x, high_y - low_y
    if not (width > 0.0 and height > 0.0):
        return False
    box[0], box[1], box[2], box[3] = low_x, 1.0 / width, low_y, 1.0 / height
    return True


@njit(cache=True, nogil=True)
def _grown(points: FloatArray, capacity: int) -> FloatArray:
    """Copy of the points with room for `capacity` of them."""
    larger = np.zeros((3, capacity, LANES))
    larger[:, : points.shape[1]] = points
    return larger
