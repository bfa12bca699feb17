"""Polyharmonic fairing: interior vertices where the k-th power of the Laplacian vanishes.

With k = 2 the fill continues the tangent planes around the hole, with k = 3 the curvature, too (M. Botsch, L.
Kobbelt, "An intuitive framework for real-time freeform modeling", SIGGRAPH 2004).
"""

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, diags
from scipy.sparse.linalg import splu

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.dense_rows import FAST, add_row
from bezier_filters.meshes.triangles import cotangent_and_area
from bezier_filters.runtime.jit import inner_jit, jit

MOST_DENSE = 300  # vertices up to which matrices are dense
# share of entries from which on a matrix is solved as a dense one: around vertices of thousands of edges the power of a
# sparse one is nearly full
FULL = 0.1
# bounds of the weights: slivers do not rule, and there is always one solution, as all are positive
LEAST_COTANGENT, LARGEST_COTANGENT = 0.02, 5.0
SMALLEST_AREA = 1e-3  # of the mean, that a vertex counts with


def polyharmonic_continuation(points: FloatArray, faces: IntArray, values: FloatArray, order: int = 1) -> FloatArray:
    """Continue values (r, c) at the first r points of a mesh to all n of them, (n, c).

    At the other points the Laplacian to a power, 1, 2 or 3, the order, vanishes. With 1 the result is nowhere larger
    than the values, and what differs from one to the next dies away within an edge or two. Points themselves, continued
    from the fixed ones, are a fill: with 1 it has the least area, as a soap film does; with more it goes on smoothly
    from `order` rings around it.
    """
    first = len(values)
    if first == len(points):
        return values.copy()
    if len(points) <= MOST_DENSE:
        return _continued_densely(points, faces, values, order)
    stiffness, areas = cotangent_matrix(points, faces)
    rows = stiffness[first:]
    for _ in range(order - 1):
        rows = (rows @ diags(1.0 / areas)) @ stiffness
    columns, right = csc_matrix(rows[:, first:]), -(rows[:, :first] @ values)
    if columns.nnz > FULL * columns.shape[0] ** 2:
        return np.vstack([values, np.linalg.solve(columns.toarray(), right)])
    # Without pivoting, in an order for symmetric matrices: several times as fast as for any matrix.
    options = {"SymmetricMode": True}
    factor = splu(columns, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return np.vstack([values, factor.solve(np.ascontiguousarray(right))])


def cotangent_matrix(points: FloatArray, faces: IntArray) -> tuple[csr_matrix, FloatArray]:
    """Positive semidefinite cotangent matrix (n, n) and the areas of the vertices over their mean, all positive."""
    n = len(points)
    areas, weights = np.zeros(n), np.zeros((len(faces), 3))
    _measure(points, faces, areas, weights)
    starts, ends = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    places = np.concatenate([starts, ends]), np.concatenate([ends, starts])
    off: csr_matrix = csr_matrix((np.tile(weights.ravel(), 2), places), shape=(n, n))
    off.data = np.maximum(off.data, LEAST_COTANGENT)
    return (diags(np.asarray(off.sum(axis=1)).ravel()) - off).tocsr(), areas


def _continued_densely(points: FloatArray, faces: IntArray, values: FloatArray, order: int) -> FloatArray:
    """The same as with sparse matrices, in a tenth of the time where they are small.

    The matrix is positive definite; should rounding have made it another, the result is not finite.
    """
    n, free = len(points), len(points) - len(values)
    stiffness, areas, result = np.zeros((n, n)), np.zeros(n), np.zeros((n, values.shape[1]))
    result[: len(values)] = values
    room = np.empty((len(faces), 3)), np.empty((free, n)), np.empty(n), np.empty((free, free))
    _continue_densely(points, faces, order, stiffness, areas, result, *room)
    return result


@jit(fastmath=FAST)
def _continue_densely(
    points: FloatArray,
    faces: IntArray,
    order: int,
    stiffness: FloatArray,
    areas: FloatArray,
    result: FloatArray,
    weights: FloatArray,
    rows: FloatArray,
    weighted: FloatArray,
    matrix: FloatArray,
) -> None:
    """Solve for the last values, zero at first like the cotangent matrix (n, n) and the areas (n,).

    The last arrays, (m, 3), (u, n), (n,), and (u, u), are room.
    """
    n, free = stiffness.shape[0], rows.shape[0]
    first = n - free
    _measure(points, faces, areas, weights)
    for f in range(faces.shape[0]):
        for k in range(3):
            i, j = faces[f, k], faces[f, (k + 1) % 3]
            stiffness[i, j] -= weights[f, k]
            stiffness[j, i] -= weights[f, k]
    for f in range(faces.shape[0]):
        for k in range(3):
            i, j = faces[f, k], faces[f, (k + 1) % 3]
            stiffness[i, j] = stiffness[j, i] = min(stiffness[i, j], -LEAST_COTANGENT)
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


@inner_jit(fastmath=FAST, inline="always")
def _factorise(matrix: FloatArray) -> None:
    """Replace the lower triangle of a small matrix by Cholesky's factor."""
    for i in range(matrix.shape[0]):
        row, square = matrix[i], matrix[i, i]
        for j in range(i):
            other, total = matrix[j], row[j]
            for k in range(j):
                total -= row[k] * other[k]
            row[j] = total / other[j]
            square -= row[j] * row[j]
        row[i] = np.sqrt(square)


@inner_jit(fastmath=FAST, inline="always")
def _substitute(factor: FloatArray, result: FloatArray, first: int) -> None:
    """Solve L L^T X = B in place, for columns of B (u, c) side by side, which begin at a row of the result."""
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
def _measure(points: FloatArray, faces: IntArray, areas: FloatArray, weights: FloatArray) -> None:
    """Write the areas of the vertices over their mean, zero at first, and half the cotangents opposite their edges.

    Edge k of a face runs from its corner k to the next. Areas have any scale: the powers of this one are numbers.
    """
    for f in range(faces.shape[0]):
        for k in range(3):
            tip = faces[f, (k + 2) % 3]
            cotangent, area = cotangent_and_area(points, tip, faces[f, k], faces[f, (k + 1) % 3])
            weights[f, k] = 0.5 * min(max(cotangent, -LARGEST_COTANGENT), LARGEST_COTANGENT)
            areas[tip] += area / 3.0
    mean = 0.0
    for i in range(areas.shape[0]):
        mean += areas[i] / areas.shape[0]
    for i in range(areas.shape[0]):
        areas[i] = max(areas[i] / max(mean, 1e-300), SMALLEST_AREA)
