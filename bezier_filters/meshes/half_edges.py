"""Half-edges: which face runs along an edge, which one lies beyond it, and the loops of those without another face.

Half-edge 3 f + k runs from corner k of face f to the next corner. Compiled code looks them up in lists by the vertex
where they start, which takes no time to set up for the few faces of a fill. Whole meshes are sorted instead: a vertex
of a hundred thousand edges would have a list that takes a quadratic time.
"""

import numpy as np

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.errors import InvalidMeshError
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.jit import inner_jit, jit


def ends_of_half_edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Start and end of all half-edges of faces (m, 3), each (3 m,)."""
    return faces.ravel(), faces[:, [1, 2, 0]].ravel()


def half_edge_lists(faces: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """First half-edge at each of n vertices, (n,), and the next one after each half-edge, (3 m,); -1 at the end."""
    first, following = np.full(n, -1, dtype=np.int32), np.empty(faces.size, dtype=np.int32)
    _list_half_edges(faces, first, following)
    return first, following


@jit()
def _list_half_edges(faces: IntArray, first: IntArray, following: IntArray) -> None:
    for f in range(faces.shape[0] - 1, -1, -1):
        for k in range(2, -1, -1):
            start = faces[f, k]
            following[3 * f + k] = first[start]
            first[start] = 3 * f + k


@inner_jit()
def half_edge(faces: IntArray, first: IntArray, following: IntArray, start: int, end: int) -> int:
    """Number of the first half-edge from start to end, -1 if there is none."""
    found = first[start]
    while found >= 0 and faces[found // 3, (found + 1) % 3] != end:
        found = following[found]
    return int(found)


def faces_at_edges(faces: IntArray, starts: IntArray, ends: IntArray) -> IntArray:
    """Which of some faces (m, 3) runs along each edge from start to end, -1 if none does, (k,).

    >>> faces = np.array([[0, 1, 2], [2, 1, 3]], dtype=np.int32)
    >>> faces_at_edges(faces, np.array([2, 1, 1], dtype=np.int32), np.array([1, 2, 0], dtype=np.int32))
    array([ 1,  0, -1], dtype=int32)
    """
    n = 1 + max(int(faces.max(initial=0)), int(starts.max(initial=0)))
    result = np.empty(len(starts), dtype=np.int32)
    _find_faces(faces, *half_edge_lists(faces, n), starts, ends, result)
    return result


@jit()
def _find_faces(
    faces: IntArray, first: IntArray, following: IntArray, starts: IntArray, ends: IntArray, found: IntArray
) -> None:
    for q in range(starts.shape[0]):
        place = half_edge(faces, first, following, starts[q], ends[q])
        found[q] = place // 3 if place >= 0 else -1


def face_neighbours(faces: IntArray) -> IntArray:
    """Face beyond the edge from corner k to the next, -1 at the border, (m, 3), of manifold, oriented faces."""
    starts, ends = ends_of_half_edges(faces)
    return faces_at_edges(faces, ends, starts).reshape(-1, 3)


def half_edge_twins(mesh: TriangleMesh) -> IntArray:
    """Opposite half-edges, (3 m,), -1 on the boundary; an InvalidMeshError without an oriented manifold along edges."""
    start, end = (side.astype(np.int64) for side in ends_of_half_edges(mesh.faces))
    forward, backward = start * mesh.vertex_count + end, end * mesh.vertex_count + start
    order = np.argsort(forward, kind="stable")
    repeated = int(np.count_nonzero(np.diff(forward[order]) == 0))
    if repeated:
        raise InvalidMeshError(
            f"faces: {repeated} edges are run through twice in the same direction; repair non-manifold edges "
            "and orient the faces coherently first (pymeshlab: meshing_repair_non_manifold_edges, "
            "meshing_re_orient_faces_coherently)"
        )
    place = np.searchsorted(forward, backward, sorter=order)
    candidate = order[np.minimum(place, len(order) - 1)] if len(order) else order
    return np.where(forward[candidate] == backward, candidate, -1).astype(np.int32)


def border_half_edges(mesh: TriangleMesh, on_boundary: BoolArray) -> tuple[IntArray, IntArray]:
    """Start and end, each (b,), of the half-edges without another face, found among the faces at the boundary.

    `on_boundary` is that of `Adjacency`. Raises an InvalidMeshError as `half_edge_twins`, but only for these faces.
    """
    a, b, c = mesh.faces.T
    near = (on_boundary[a] | on_boundary[b] | on_boundary[c]) & (a != b) & (b != c) & (c != a)
    faces = mesh.faces[near]
    twin = half_edge_twins(TriangleMesh(mesh.vertices, faces))
    start, end = ends_of_half_edges(faces)
    # Where the other face of an edge was left out, one of its ends is not on the boundary.
    borders = (twin < 0) & on_boundary[start] & on_boundary[end]
    return start[borders], end[borders]


def boundary_loops(mesh: TriangleMesh) -> list[IntArray]:
    """Ordered boundary loops, one array of vertex indices each.

    A loop runs along its faces' own direction: counter-clockwise around the outer rim of a
    sheet seen from outside, clockwise around a hole. Loops that only touch at a vertex are
    kept apart by walking around the faces at that vertex.

    Returns
    -------
    list of (k,) int32
        Loops ordered by their smallest vertex, at which each one starts.

    Raises
    ------
    InvalidMeshError
        If an edge has more than two faces, or two faces that run through it the same way.

    Examples
    --------
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> boundary_loops(triangle_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    [array([0, 1, 2], dtype=int32)]
    """
    twin = half_edge_twins(mesh)
    start = mesh.faces.ravel()
    boundary = np.flatnonzero(twin < 0)
    order = boundary[np.argsort(start[boundary], kind="stable")].astype(np.int32)
    return [start[loop] for loop in cycles(_boundary_successors(twin), order)]


def cycles(successor: IntArray, order: IntArray) -> list[IntArray]:
    """Cycles of a permutation, given by what follows each item, in the order of items at which they begin."""
    result = []
    seen = np.zeros(len(successor), dtype=np.bool_)
    for first in order.tolist():
        path: list[int] = []
        item = first
        while not seen[item]:
            seen[item] = True
            path.append(item)
            item = int(successor[item])
        if path:
            result.append(np.array(path, dtype=np.int32))
    return result


def _boundary_successors(twin: IntArray) -> IntArray:
    """Next boundary half-edge after each boundary half-edge; other entries mean nothing."""
    following = np.arange(len(twin)).reshape(-1, 3)[:, [1, 2, 0]].ravel()
    successor = following.copy()
    # Turn around the end vertex of all half-edges at once, each within its own fan of faces.
    turning = np.flatnonzero(twin < 0)
    while len(turning):
        turning = turning[twin[successor[turning]] >= 0]
        successor[turning] = following[twin[successor[turning]]]
    return successor.astype(np.int32)
