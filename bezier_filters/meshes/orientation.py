"""Consistent orientation of the normals of a point cloud."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.runtime.jit import allocating_jit

MIN_SHEET_NORMAL = 0.5  # length of the mean normal above which a cloud is a sheet and not a closed body
# Evidence that separates the signs of parallel normals of two neighbours, in points seen along their normals. One point
# has at most 1, so that no single plane decides; a part of some ten points is the smallest that has planes of its own.
# With 5 or 20 no sign changes on the floor and the plates of `tests/fitting/test_viewpoints.py`.
SEPARATING_EVIDENCE = 10.0


def orient_normals(
    points: FloatArray,
    normals: FloatArray,
    neighbours: Rows,
    given: FloatArray | None = None,
    views: FloatArray | None = None,
) -> FloatArray:
    """Orient normals consistently between neighbours, and outwards.

    Signs spread along the minimum spanning tree of the neighbour graph, between normals that are
    nearly parallel (Hoppe et al., "Surface reconstruction from unorganized points", SIGGRAPH 1992)
    and along edges that are nearly tangential, not from one side of a thin plate to the other. Then
    each connected part is turned as a whole: to the side of the given normals if it has any, else a
    body so that its volume is positive, and a sheet so that the largest component of its mean
    normal is, for example towards +z.

    The neighbour graph is symmetric; `given` (n, 3) are outward vectors, zero where unknown. `views` (n, 3) are unit
    vectors from which each point was seen, zero where unknown: see `_signs_of_views`.

    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    >>> path = Rows(np.array([0, 1, 3, 4], np.int32), np.array([1, 0, 2, 1], np.int32))
    >>> orient_normals(points, np.array([[0.0, 0, -1], [0, 0, 1], [0, 0, -1]]), path)[:, 2]
    array([1., 1., 1.])
    """
    n = len(points)
    if n == 0:
        return normals
    start, end = np.repeat(np.arange(n, dtype=np.int32), neighbours.lengths), neighbours.indices
    edges = points[end] - points[start]
    squares = np.einsum("ij,ij->i", edges, edges)
    heights = [np.square(np.einsum("ij,ij->i", normals[side], edges)) for side in (start, end)]
    upper = start < end
    agreement = np.abs(np.einsum("ij,ij->i", normals[start], normals[end]))
    # Zeros are missing edges in sparse graphs; an added constant avoids them and does not change the tree.
    costs = 2.0 - agreement + (heights[0] + heights[1]) / squares
    tree = minimum_spanning_tree(coo_array((costs[upper], (start[upper], end[upper])), shape=(n, n)).tocsr())
    parts, part_of = connected_components(tree, directed=False)
    order, predecessors = _walk(tree, parts, part_of)
    normals = normals * _spread_signs(normals, order, predecessors)[:, np.newaxis]
    areas = np.bincount(start, weights=squares, minlength=n) / np.maximum(neighbours.lengths, 1)
    outward = _outward(points, normals, areas, parts, part_of, np.zeros_like(points) if given is None else given)
    normals = normals * outward[part_of][:, np.newaxis]
    if views is not None:
        normals *= _signs_of_views(normals, views, order, predecessors)[:, np.newaxis]
    return np.asarray(normals)


def _walk(tree: coo_array, parts: int, part_of: IntArray) -> tuple[IntArray, IntArray]:
    """Points of a forest, each after its predecessor, and their predecessors; -1 for roots."""
    n = tree.shape[0]
    _, roots = np.unique(part_of, return_index=True)
    tree = tree.tocoo()
    # An extra node joins the roots, so that one traversal reaches all components.
    rows, columns = np.append(tree.row, np.full(parts, n)), np.append(tree.col, roots)
    joined = coo_array((np.ones(len(rows)), (rows, columns)), shape=(n + 1, n + 1)).tocsr()
    order, predecessors = breadth_first_order(joined, n, directed=False)
    predecessors[roots] = -1
    return order[1:], predecessors[:n]


@allocating_jit()
def _spread_signs(normals: FloatArray, order: IntArray, predecessors: IntArray) -> FloatArray:
    """Signs that make every normal agree with its predecessor's."""
    signs = np.ones(normals.shape[0])
    for i in order:
        j = predecessors[i]
        if j >= 0:
            agreement = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
            signs[i] = signs[j] if agreement >= 0.0 else -signs[j]
    return signs


@allocating_jit()
def _signs_of_views(normals: FloatArray, views: FloatArray, order: IntArray, predecessors: IntArray) -> FloatArray:
    """Signs of normals that agree along a forest, so that they face the views, but change only where these are strong.

    The signs s minimise the sum of |e_i| over the points where s_i contradicts the evidence e_i, the cosine between
    normal and view, and of `SEPARATING_EVIDENCE` |n_i . n_j| over the edges of the forest where s_i and s_j differ. On
    a forest sums from the leaves to the roots, and back, find the minimum (dynamic programming). Without evidence
    signs stay.
    """
    n = normals.shape[0]
    evidence, cost, signs = np.empty(n), np.zeros(n), np.ones(n)
    for i in range(n):
        evidence[i] = normals[i, 0] * views[i, 0] + normals[i, 1] * views[i, 1] + normals[i, 2] * views[i, 2]
        j = predecessors[i]
        if j >= 0:
            agreement = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
            cost[i] = SEPARATING_EVIDENCE * abs(agreement)
    for i in order[::-1]:
        if predecessors[i] >= 0:
            evidence[predecessors[i]] += min(max(evidence[i], -cost[i]), cost[i])
    for i in order:
        j = predecessors[i]
        if evidence[i] + (cost[i] * signs[j] if j >= 0 else 0.0) < 0.0:
            signs[i] = -1.0
    return signs


def _outward(
    points: FloatArray, normals: FloatArray, areas: FloatArray, parts: int, part_of: IntArray, given: FloatArray
) -> FloatArray:
    """+1 for each component whose normals point outward, else -1."""

    def total(values: FloatArray) -> FloatArray:
        return np.bincount(part_of, weights=values, minlength=parts).astype(np.float64)

    area = np.maximum(total(areas), np.finfo(np.float64).tiny)
    vector = np.column_stack([total(areas * normals[:, k]) for k in range(3)]) / area[:, np.newaxis]
    center = np.column_stack([total(areas * points[:, k]) for k in range(3)]) / area[:, np.newaxis]
    volume = total(areas * np.einsum("ij,ij->i", normals, points - center[part_of]))
    main = np.take_along_axis(vector, np.abs(vector).argmax(axis=1)[:, np.newaxis], axis=1)[:, 0]
    by_shape = np.where(np.linalg.norm(vector, axis=1) > MIN_SHEET_NORMAL, main, volume)
    votes = total(np.sign(np.einsum("ij,ij->i", normals, given)))
    return np.where(np.where(votes != 0.0, votes, by_shape) < 0.0, -1.0, 1.0)
