"""Polyharmonic fairing: coordinates of the interior vertices that solve Delta^k x = 0.

Delta = M^-1 L with the cotangent matrix L and the vertex areas M. With k = 1 the fill is a membrane, with k = 2 it
continues the tangent planes around the hole, with k = 3 the curvature, too (M. Botsch, L. Kobbelt, "An intuitive
framework for real-time freeform modeling", SIGGRAPH 2004).
"""

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, diags
from scipy.sparse.linalg import splu

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.dense_rows import FASTMATH, add_row
from bezier_filters.meshes.triangles import cotangent_and_area
from bezier_filters.runtime.jit import inner_jit, jit

MAX_DENSE_VERTICES = 300  # vertices of a mesh whose matrices are dense
# fraction of non-zero entries of a matrix that is solved by sparse factorisation: around vertices of very high valence
# the power of a sparse matrix is nearly dense
MAX_SPARSE_DENSITY = 0.1
# Entries of a power of the matrix, 12 bytes each: 75,000 vertices of a regular mesh have so many with order 3. Those of
# very high valence give more, and get a lower order. Half as many or twice as many change the memory by as much.
MAX_POWER_ENTRIES = 10_000_000
# Clamped weights bound the influence of slivers and are positive, so that there is always one solution.
MIN_FAIRING_WEIGHT, MAX_FAIRING_COTANGENT = 0.02, 5.0
MIN_FAIRING_AREA = 1e-3  # in mean vertex areas


def polyharmonic_continuation(points: FloatArray, faces: IntArray, values: FloatArray, order: int = 1) -> FloatArray:
    """Continue values (r, c) at the first r points of a mesh to all n points, (n, c): Delta^order x = 0 at the others.

    The order is 1, 2 or 3. With order 1 the result obeys the maximum principle, and differences between neighbouring
    values decay within an edge or two. If the values are coordinates, the result is a fill: with order 1 a minimal
    surface to first order, with a larger one a smooth continuation of `order` rings around it. The order is reduced if
    its matrix might have more than `MAX_POWER_ENTRIES` entries.
    """
    first = len(values)
    if first == len(points):
        return values.copy()
    if len(points) <= MAX_DENSE_VERTICES:
        return _continue_densely(points, faces, values, order)
    stiffness, areas = cotangent_matrix(points, faces)
    rows = stiffness[first:]
    valences = np.diff(stiffness.indptr)
    for _ in range(order - 1):
        if valences[rows.indices].sum() > MAX_POWER_ENTRIES:  # an upper bound of the entries of the product
            break
        rows = (rows @ diags(1.0 / areas)) @ stiffness
    columns, right = csc_matrix(rows[:, first:]), -(rows[:, :first] @ values)
    if columns.nnz > MAX_SPARSE_DENSITY * columns.shape[0] ** 2:
        return np.vstack([values, np.linalg.solve(columns.toarray(), right)])
    # Symmetric ordering without pivoting: several times as fast as the defaults for general matrices.
    options = {"SymmetricMode": True}
    factor = splu(columns, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return np.vstack([values, factor.solve(np.ascontiguousarray(right))])


def cotangent_matrix(points: FloatArray, faces: IntArray) -> tuple[csr_matrix, FloatArray]:
    """Positive semidefinite cotangent matrix (n, n), and the vertex areas over their mean, all positive."""
    n = len(points)
    areas, weights = np.zeros(n), np.zeros((len(faces), 3))
    _measure_mesh(points, faces, areas, weights)
    starts, ends = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    places = np.concatenate([starts, ends]), np.concatenate([ends, starts])
    edges: csr_matrix = csr_matrix((np.tile(weights.ravel(), 2), places), shape=(n, n))
    edges.data = np.maximum(edges.data, MIN_FAIRING_WEIGHT)
    return (diags(np.asarray(edges.sum(axis=1)).ravel()) - edges).tocsr(), areas


def _continue_densely(points: FloatArray, faces: IntArray, values: FloatArray, order: int) -> FloatArray:
    """Dense solution, ten times as fast as the sparse one for small meshes.

    The matrix is positive definite; if rounding makes it indefinite, the result is not finite.
    """
    n, free = len(points), len(points) - len(values)
    stiffness, areas, result = np.zeros((n, n)), np.zeros(n), np.zeros((n, values.shape[1]))
    result[: len(values)] = values
    weights = np.empty((len(faces), 3))
    _measure_mesh(points, faces, areas, weights)
    scratch = np.empty((free, n)), np.empty(n), np.empty((free, free))
    _solve_densely(faces, weights, areas, order, stiffness, result, *scratch)
    return result


@jit(fastmath=FASTMATH)
def _solve_densely(
    faces: IntArray,
    weights: FloatArray,
    areas: FloatArray,
    order: int,
    stiffness: FloatArray,
    result: FloatArray,
    rows: FloatArray,
    weighted: FloatArray,
    matrix: FloatArray,
) -> None:
    """Solve for the last u values; they and the cotangent matrix (n, n) are zero at first.

    The last arrays, (u, n), (n,), and (u, u), are scratch.
    """
    n, free = stiffness.shape[0], rows.shape[0]
    first = n - free
    for f in range(faces.shape[0]):
        for k in range(3):
            i, j = faces[f, k], faces[f, (k + 1) % 3]
            stiffness[i, j] -= weights[f, k]
            stiffness[j, i] -= weights[f, k]
    for f in range(faces.shape[0]):
        for k in range(3):
            i, j = faces[f, k], faces[f, (k + 1) % 3]
            stiffness[i, j] = stiffness[j, i] = min(stiffness[i, j], -MIN_FAIRING_WEIGHT)
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += stiffness[i, j]
        stiffness[i, i] -= total
    for i in range(free):
        for j in range(n):
            rows[i, j] = stiffness[first + i, j]
        for _ in range(order - 1):
            for k in range(n):
                weighted[k], rows[i, k] = rows[i, k] / areas[k], 0.0
            for k in range(n):
                if weighted[k] != 0.0:
                    add_row(rows[i], weighted[k], stiffness[k])
        for j in range(free):
            matrix[i, j] = rows[i, first + j]
        for k in range(first):
            if rows[i, k] != 0.0:
                add_row(result[first + i], -rows[i, k], result[k])
    _factorise(matrix)
    _substitute(matrix, result, first)


@inner_jit(fastmath=FASTMATH, inline="always")
def _factorise(matrix: FloatArray) -> None:
    """Replace the lower triangle of a small matrix by its Cholesky factor."""
    for i in range(matrix.shape[0]):
        row, square = matrix[i], matrix[i, i]
        for j in range(i):
            other, total = matrix[j], row[j]
            for k in range(j):
                total -= row[k] * other[k]
            row[j] = total / other[j]
            square -= row[j] * row[j]
        row[i] = np.sqrt(square)


@inner_jit(fastmath=FASTMATH, inline="always")
def _substitute(factor: FloatArray, result: FloatArray, first: int) -> None:
    """Solve L L^T X = B in place; B (u, c) are the rows of `result` from `first` on."""
    count = factor.shape[0]
    for i in range(count):
        for j in range(i):
            add_row(result[first + i], -factor[i, j], result[first + j])
        for c in range(result.shape[1]):
            result[first + i, c] /= factor[i, i]
    for i in range(count - 1, -1, -1):
        for c in range(result.shape[1]):
            result[first + i, c] /= factor[i, i]
        for j in range(i):
            add_row(result[first + j], -factor[i, j], result[first + i])


@jit()
def _measure_mesh(points: FloatArray, faces: IntArray, areas: FloatArray, weights: FloatArray) -> None:
    """Write the vertex areas over their mean, zero at first, and half the clamped cotangent opposite each edge.

    Edge k of a face runs from corner k to the next. Areas are dimensionless, so that powers of Delta are, too.
    """
    for f in range(faces.shape[0]):
        for k in range(3):
            tip = faces[f, (k + 2) % 3]
            cotangent, area = cotangent_and_area(points, tip, faces[f, k], faces[f, (k + 1) % 3])
            weights[f, k] = 0.5 * min(max(cotangent, -MAX_FAIRING_COTANGENT), MAX_FAIRING_COTANGENT)
            areas[tip] += area / 3.0
    mean = 0.0
    for i in range(areas.shape[0]):
        mean += areas[i] / areas.shape[0]
    for i in range(areas.shape[0]):
        areas[i] = max(areas[i] / max(mean, 1e-300), MIN_FAIRING_AREA)
