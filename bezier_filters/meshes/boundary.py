"""Boundary loops of a triangle mesh, in order."""

import numpy as np

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.errors import InvalidMeshError
from bezier_filters.meshes.mesh import TriangleMesh


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
    successor = _boundary_successors(twin)
    order = boundary[np.argsort(start[boundary], kind="stable")]
    loops: list[IntArray] = []
    seen = np.zeros(len(start), dtype=bool)
    for first in order:
        loop: list[int] = []
        half_edge = first
        while not seen[half_edge]:
            seen[half_edge] = True
            loop.append(int(start[half_edge]))
            half_edge = successor[half_edge]
        if loop:
            loops.append(np.array(loop, dtype=np.int32))
    return loops


def border_half_edges(mesh: TriangleMesh, on_boundary: BoolArray) -> tuple[IntArray, IntArray]:
    """Start and end, each (b,), of the half-edges without another face, found among the faces at the boundary.

    Parameters
    ----------
    mesh : TriangleMesh
    on_boundary : (n,) bool
        As in `Adjacency.on_boundary`.

    Raises
    ------
    InvalidMeshError
        If one of these faces has an edge with more than two faces, or with two that run through it the same way.
    """
    a, b, c = mesh.faces.T
    near = (on_boundary[a] | on_boundary[b] | on_boundary[c]) & (a != b) & (b != c) & (c != a)
    faces = mesh.faces[near]
    twin = half_edge_twins(TriangleMesh(mesh.vertices, faces))
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    # Where the other face of an edge was left out, one of its ends is not on the boundary.
    borders = (twin < 0) & on_boundary[start] & on_boundary[end]
    return start[borders], end[borders]


def half_edge_twins(mesh: TriangleMesh) -> IntArray:
    """Opposite half-edges, shape (3 m,), -1 on the boundary.

    Half-edge 3 f + k runs from ``faces[f, k]`` to ``faces[f, (k + 1) % 3]``.

    Raises
    ------
    InvalidMeshError
        If the mesh is not an oriented manifold along its edges.
    """
    start = mesh.faces.ravel().astype(np.int64)
    end = np.roll(mesh.faces, -1, axis=1).ravel().astype(np.int64)
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
