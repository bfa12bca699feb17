"""Half-edges: walk round the vertices of a manifold mesh while it changes."""

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


class HalfEdges(NamedTuple):
    """A manifold mesh; half-edge 3 f + k goes from corner k of face f to corner k + 1."""

    faces: np.ndarray  # (m, 3) int32; -1 for faces that are gone
    twin: np.ndarray  # (3 m,) int32: the half-edge in the other direction, -1 at borders
    out: np.ndarray  # (n,) int32: a half-edge from every vertex, -1 for vertices without


def half_edges(faces: np.ndarray, vertex_count: int) -> HalfEdges:
    """Half-edges of an oriented manifold."""
    start = faces.ravel().astype(np.int64)
    end = np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    there, back = start * vertex_count + end, end * vertex_count + start
    order = np.argsort(there)
    if (np.diff(there[order]) == 0).any():
        raise ValueError("an edge has more than two faces, or two that are oriented differently")
    place = np.minimum(np.searchsorted(there[order], back), len(order) - 1)
    twin = np.where(there[order[place]] == back, order[place], -1).astype(np.int32)
    out = np.full(vertex_count, -1, dtype=np.int32)
    out[start] = np.arange(len(start), dtype=np.int32)
    mesh = HalfEdges(faces.astype(np.int32).copy(), twin, out)
    star = np.empty(len(faces), dtype=np.int32)
    degree = np.array([vertex_star(mesh, v, star)[0] if out[v] >= 0 else 0 for v in range(vertex_count)])
    if (degree != np.bincount(start, minlength=vertex_count)).any():
        raise ValueError("the faces at a vertex are not one fan")
    return mesh


def cut_to_manifold(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces cut open where edges do not have two faces of one orientation, or a vertex has several fans.

    Faces with equal corners are dropped, and so are vertices without faces. An edge that keeps more than two faces, as
    in a strip with one side, is left.
    """
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)].astype(np.int64)
    corners, ends = np.arange(faces.size).reshape(-1, 3), np.roll(faces, -1, axis=1)
    there, back = faces * len(vertices) + ends, ends * len(vertices) + faces
    keys, first, counts = np.unique(there.ravel(), return_index=True, return_counts=True)
    own, twin = (np.minimum(np.searchsorted(keys, one), len(keys) - 1) for one in (there, back))
    joined = (keys[twin] == back) & (counts[own] == 1) & (counts[twin] == 1)
    # a half-edge starts where its twin ends
    pairs = corners[joined], np.roll(corners, -1, axis=1).ravel()[first[twin[joined]]]
    labels = connected_components(coo_array((np.ones(len(pairs[0])), pairs), shape=(faces.size, faces.size)))[1]
    return vertices[faces.ravel()[np.unique(labels, return_index=True)[1]]], labels.reshape(-1, 3).astype(np.int32)


@njit(cache=True)
def next_edge(h: int) -> int:
    return h - 2 if h % 3 == 2 else h + 1


@njit(cache=True)
def previous_edge(h: int) -> int:
    return h + 2 if h % 3 == 0 else h - 1


@njit(cache=True)
def origin(mesh: HalfEdges, h: int) -> int:
    return mesh.faces[h // 3, h % 3]


@njit(cache=True)
def vertex_star(mesh: HalfEdges, v: int, star: np.ndarray) -> tuple[int, bool]:
    """Write the half-edges from v counter-clockwise into `star`; return their number and whether v is on a border.

    The first half-edge at a border has no twin.
    """
    first = h = mesh.out[v]
    border = False
    while True:
        if mesh.twin[h] < 0:
            border = True
            break
        h = next_edge(mesh.twin[h])
        if h == first:
            break
    count = 0
    first = h
    while True:
        star[count] = h
        count += 1
        h = mesh.twin[previous_edge(h)]
        if h < 0 or h == first:
            return count, border
