"""A mesh cut along its sharp edges, so that patches on each side end there."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.half_edges import half_edge_pairs


@dataclass(frozen=True)
class CutMesh:
    """A mesh whose vertices on a cut have a copy for each side."""

    vertices: FloatArray  # (n + copies, 3): those of the given mesh first
    faces: IntArray  # (m, 3): in the order of the given mesh
    origin: IntArray  # (n + copies,): row of each vertex in the given mesh


def cut_mesh(vertices: FloatArray, faces: IntArray, edges: IntArray) -> CutMesh:
    """Cut faces (m, 3) between vertices (n, 3) along edges (e, 2), pairs of vertices.

    The faces around a vertex that are connected across other edges stay together. A cut that ends within the surface
    leaves its end in one piece.

    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> cut = cut_mesh(square, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.array([[0, 2]], np.int32))
    >>> cut.faces.tolist(), cut.origin.tolist()
    ([[0, 1, 2], [4, 5, 3]], [0, 1, 2, 3, 0, 2])
    """
    n = len(vertices)
    first, second = half_edge_pairs(faces, n)
    ends = np.sort(np.stack([faces.ravel()[first], np.roll(faces, -1, axis=1).ravel()[first]], axis=1), axis=1)
    cut = np.sort(np.asarray(edges, dtype=np.int64).reshape(-1, 2), axis=1)
    is_cut = np.isin(ends[:, 0].astype(np.int64) * n + ends[:, 1], cut[:, 0] * n + cut[:, 1])
    joined, other = first[~is_cut], second[~is_cut]
    # a corner of a face is 3 f + k; across an edge, corners at the same vertex are joined
    following = np.roll(np.arange(faces.size).reshape(-1, 3), -1, axis=1).ravel()
    corners = faces.ravel()
    agree = corners[joined] == corners[following[other]]
    pairs = [
        (joined, np.where(agree, following[other], other)),
        (following[joined], np.where(agree, other, following[other])),
    ]
    rows, columns = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
    graph = coo_array((np.ones(len(rows), np.bool_), (rows, columns)), shape=(faces.size, faces.size))
    group = connected_components(graph, directed=False)[1]
    # only vertices on the cut are split: the others may be non-manifold
    on_cut = np.zeros(n, dtype=np.bool_)
    on_cut[cut.ravel()] = True
    keys = np.where(on_cut[corners], group.astype(np.int64) + n, corners)
    named, place, inverse = np.unique(keys, return_index=True, return_inverse=True)
    owner = corners[place]
    is_first = np.zeros(len(named), dtype=np.bool_)
    is_first[np.unique(owner, return_index=True)[1]] = True
    rank = np.where(is_first, owner, 0)
    rank[~is_first] = n + np.arange((~is_first).sum())
    origin = np.concatenate([np.arange(n), owner[~is_first]]).astype(np.int32)
    return CutMesh(vertices[origin], rank[inverse].reshape(-1, 3).astype(np.int32), origin)
