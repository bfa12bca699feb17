"""Which face runs along an edge: half-edges, listed by the vertex where they start.

Half-edge 3 f + k runs from corner k of face f to the next corner.
"""

import numpy as np

from bezier_filters.arrays import IntArray
from bezier_filters.runtime.lean import inner_njit, lean_njit


def half_edge_lists(faces: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """First half-edge at each of n vertices, (n,), and the next one after each half-edge, (3 m,); -1 at the end."""
    first, following = np.full(n, -1, dtype=np.int32), np.empty(faces.size, dtype=np.int32)
    _list_half_edges(faces, first, following)
    return first, following


def faces_at_edges(faces: IntArray, starts: IntArray, ends: IntArray) -> IntArray:
    """Which of some faces (m, 3) runs along each edge from start to end, -1 if none does, (k,).

    Examples
    --------
    >>> faces = np.array([[0, 1, 2], [2, 1, 3]], dtype=np.int32)
    >>> faces_at_edges(faces, np.array([2, 1, 1], dtype=np.int32), np.array([1, 2, 0], dtype=np.int32))
    array([ 1,  0, -1], dtype=int32)
    """
    n = 1 + max(int(faces.max(initial=0)), int(starts.max(initial=0)))
    result = np.empty(len(starts), dtype=np.int32)
    _find_faces(faces, *half_edge_lists(faces, n), starts, ends, result)
    return result


@inner_njit()
def half_edge(faces: IntArray, first: IntArray, following: IntArray, start: int, end: int) -> int:
    """Number of the first half-edge from start to end, -1 if there is none."""
    found = first[start]
    while found >= 0 and faces[found // 3, (found + 1) % 3] != end:
        found = following[found]
    return int(found)


@lean_njit()
def _list_half_edges(faces: IntArray, first: IntArray, following: IntArray) -> None:
    for f in range(faces.shape[0] - 1, -1, -1):
        for k in range(2, -1, -1):
            start = faces[f, k]
            following[3 * f + k] = first[start]
            first[start] = 3 * f + k


@lean_njit()
def _find_faces(
    faces: IntArray, first: IntArray, following: IntArray, starts: IntArray, ends: IntArray, found: IntArray
) -> None:
    for q in range(starts.shape[0]):
        place = half_edge(faces, first, following, starts[q], ends[q])
        found[q] = place // 3 if place >= 0 else -1
