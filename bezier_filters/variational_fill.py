"""Fills without tension: interior vertices where the k-th power of the Laplacian vanishes.

With k = 2 the fill continues the tangent planes around the hole, with k = 3 the curvature, too (M. Botsch, L.
Kobbelt, "An intuitive framework for real-time freeform modeling", SIGGRAPH 2004).
"""

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, diags
from scipy.sparse.linalg import splu

from bezier_filters.arrays import FloatArray, IntArray

LEAST_COTANGENT, LARGEST_COTANGENT = 0.02, 5.0
"""Bounds of the weights: slivers do not rule, and there is always one solution."""


def without_tension(points: FloatArray, faces: IntArray, free: IntArray, order: int) -> FloatArray:
    """Move some vertices to where the Laplacian to a power vanishes, the others fixed.

    Parameters
    ----------
    points : (n, 3) float64
        Vertices of the fill and `order` rings around it.
    faces : (m, 3) int32
        Faces of both.
    free : (k,) int
        Vertices that move.
    order : int
        1, 2 or 3.

    Returns
    -------
    (n, 3) float64

    Examples
    --------
    >>> hub = np.array([[0.0, 0.0, 5.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    >>> wheel = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]], dtype=np.int32)
    >>> bool(np.allclose(without_tension(hub, wheel, np.array([0]), 1)[0], 0.0))
    True
    """
    if len(free) == 0:
        return points.copy()
    stiffness, areas = cotangent_matrix(points, faces)
    power = stiffness
    for _ in range(order - 1):
        power = stiffness @ diags(1.0 / areas) @ power
    rows = power.tocsr()[free]
    fixed = np.ones(len(points), dtype=np.bool_)
    fixed[free] = False
    result = points.copy()
    result[free] = solved(rows[:, free], -(rows[:, fixed] @ points[fixed]))
    return result


def shifted(points: FloatArray, faces: IntArray, shift: FloatArray) -> FloatArray:
    """Harmonic continuation of shifts (r, 3) of the first r points to all n of them, (n, 3).

    It is nowhere larger than at these points, and what differs from one to the next dies away within an edge or two.
    """
    count = len(shift)
    if len(points) == count:
        return shift.copy()
    stiffness, _ = cotangent_matrix(points, faces)
    rows = stiffness.tocsr()[count:]
    return np.vstack([shift, solved(rows[:, count:], -(rows[:, :count] @ shift))])


def solved(matrix: csr_matrix, right: FloatArray) -> FloatArray:
    """Solution (n, c) of a symmetric, positive definite sparse system with right-hand sides (n, c)."""
    # Without pivoting, in an order for symmetric matrices: several times as fast as for any matrix.
    options = {"SymmetricMode": True}
    factor = splu(csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return np.asarray(factor.solve(np.ascontiguousarray(right)), dtype=np.float64)


def cotangent_matrix(points: FloatArray, faces: IntArray) -> tuple[csc_matrix, FloatArray]:
    """Positive semidefinite cotangent matrix (n, n) and the areas of the vertices (n,), all positive."""
    n = len(points)
    starts, ends, weights = [], [], []
    areas = np.zeros(n)
    for k in range(3):
        i, j, tip = faces[:, k], faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        u, v = points[i] - points[tip], points[j] - points[tip]
        twice = np.linalg.norm(np.cross(u, v), axis=1)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # no area: clipped, and nan without edges
            cotangent = np.nan_to_num(np.einsum("ij,ij->i", u, v) / twice)
        starts += [i, j]
        ends += [j, i]
        weights += [0.5 * np.clip(cotangent, -LARGEST_COTANGENT, LARGEST_COTANGENT)] * 2
        areas += np.bincount(tip, weights=twice / 6.0, minlength=n)
    shape = (n, n)
    off = csc_matrix((np.concatenate(weights), (np.concatenate(starts), np.concatenate(ends))), shape=shape)
    off.data = np.maximum(off.data, LEAST_COTANGENT)
    total = np.asarray(off.sum(axis=1)).ravel()
    return diags(total).tocsc() - off, np.maximum(areas, 1e-3 * max(float(areas.mean()), 1e-300))
