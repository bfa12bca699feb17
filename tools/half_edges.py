"""Half-edges: walk round the vertices of a manifold mesh while it changes."""

from typing import NamedTuple

import numpy as np
from numba import njit


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
