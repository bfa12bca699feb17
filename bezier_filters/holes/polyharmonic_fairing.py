"""Polyharmonic fairing: interior vertices where the k-th power of the Laplacian vanishes.

With k = 2 the fill continues the tangent planes around the hole, with k = 3 the curvature, too (M. Botsch, L.
Kobbelt, "An intuitive framework for real-time freeform modeling", SIGGRAPH 2004).
"""

from typing import TypeAlias

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, diags, issparse
from scipy.sparse.linalg import splu

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.triangles import cotangent_and_area
from bezier_filters.runtime.jit import jit

Matrix: TypeAlias = FloatArray | csr_matrix

MOST_DENSE = 300  # vertices up to which matrices are dense
# share of entries from which on a matrix is solved as a dense one: around vertices of thousands of edges the power of a
# sparse one is nearly full
FULL = 0.1
# bounds of the weights: slivers do not rule, and there is always one solution, as all are positive
LEAST_COTANGENT, LARGEST_COTANGENT = 0.02, 5.0


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
    stiffness, areas = cotangent_matrix(points, faces)
    areas = areas / areas.mean()  # any scale will do; the powers of this one are numbers
    rows = stiffness[first:]
    for _ in range(order - 1):
        rows = (rows @ diags(1.0 / areas) if issparse(rows) else rows / areas) @ stiffness
    return _solve(rows, values)


def _solve(rows: Matrix, known: FloatArray) -> FloatArray:
    """The known first values (r, c) and the others, where the last rows (n - r, n) of a symmetric matrix give zero."""
    matrix, right = rows[:, len(known) :], -(rows[:, : len(known)] @ known)
    if not issparse(matrix):
        return np.vstack([known, np.linalg.solve(matrix, right)])
    columns = csc_matrix(matrix)
    if columns.nnz > FULL * columns.shape[0] ** 2:
        return np.vstack([known, np.linalg.solve(columns.toarray(), right)])
    # Without pivoting, in an order for symmetric matrices: several times as fast as for any matrix.
    options = {"SymmetricMode": True}
    factor = splu(columns, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return np.vstack([known, factor.solve(np.ascontiguousarray(right))])


def cotangent_matrix(points: FloatArray, faces: IntArray) -> tuple[Matrix, FloatArray]:
    """Positive semidefinite cotangent matrix (n, n) and the areas of the vertices (n,), all positive.

    The matrix is dense if it is small: that takes a tenth of the time then.
    """
    n = len(points)
    areas, weights = np.zeros(n), np.zeros((len(faces), 3))
    _measure(points, faces, areas, weights)
    areas = np.maximum(areas, 1e-3 * max(float(areas.mean()), 1e-300))
    starts, ends = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    places = np.concatenate([starts, ends]), np.concatenate([ends, starts])
    if n <= MOST_DENSE:
        stiffness = np.zeros((n, n))
        np.subtract.at(stiffness, places, np.tile(weights.ravel(), 2))
        stiffness[places] = np.minimum(stiffness[places], -LEAST_COTANGENT)
        stiffness[np.diag_indices(n)] -= stiffness.sum(axis=0)
        return stiffness, areas
    off: csr_matrix = csr_matrix((np.tile(weights.ravel(), 2), places), shape=(n, n))
    off.data = np.maximum(off.data, LEAST_COTANGENT)
    return (diags(np.asarray(off.sum(axis=1)).ravel()) - off).tocsr(), areas


@jit()
def _measure(points: FloatArray, faces: IntArray, areas: FloatArray, weights: FloatArray) -> None:
    """Add the areas of faces to their vertices, and write half the cotangents opposite their edges.

    Edge k of a face runs from its corner k to the next.
    """
    for f in range(faces.shape[0]):
        for k in range(3):
            tip = faces[f, (k + 2) % 3]
            cotangent, area = cotangent_and_area(points, tip, faces[f, k], faces[f, (k + 1) % 3])
            weights[f, k] = 0.5 * min(max(cotangent, -LARGEST_COTANGENT), LARGEST_COTANGENT)
            areas[tip] += area / 3.0
