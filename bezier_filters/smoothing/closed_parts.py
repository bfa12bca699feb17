"""Connected parts of a mesh that enclose a volume."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.lean import inner_njit, lean_njit


def closed_parts(mesh: TriangleMesh, adjacency: Adjacency) -> tuple[IntArray, IntArray]:
    """Number of the closed part that each vertex belongs to, -1 for none, (n,), and the first vertices, (parts,).

    There are none if the mesh is not an oriented manifold along its edges.
    """
    n, rows = mesh.vertex_count, adjacency.vertices
    if not mesh.face_count or wrongly_joined(mesh.faces, adjacency).any():
        return np.full(n, -1, dtype=np.int32), np.empty(0, dtype=np.int32)
    graph = csr_array((np.ones(len(rows.indices), np.int8), rows.indices, rows.indptr), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    first = np.full(count, n, dtype=np.int32)
    first[label[::-1]] = np.arange(n - 1, -1, -1, dtype=np.int32)
    closed = np.ones(count, dtype=np.bool_)
    closed[label[adjacency.on_boundary | (rows.lengths == 0)]] = False
    number = np.where(closed, np.cumsum(closed) - 1, -1).astype(np.int32)
    return number[label], first[closed]


def wrongly_joined(faces: IntArray, adjacency: Adjacency) -> BoolArray:
    """Vertices at a face without three corners, or with two faces that run through an edge the same way, (n,)."""
    result = np.zeros(len(adjacency.faces), dtype=np.bool_)
    _find(faces, adjacency.faces.indptr, adjacency.faces.indices, result)
    return result


@lean_njit()
def _find(faces: IntArray, face_ptr: IntArray, face_indices: IntArray, result: BoolArray) -> None:
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if a == b or b == c or c == a:
            result[a] = result[b] = result[c] = True
    for i in range(len(face_ptr) - 1):
        for q in range(face_ptr[i], face_ptr[i + 1]):
            for p in range(face_ptr[i], q):
                if _after(faces, face_indices[p], i) == _after(faces, face_indices[q], i):
                    result[i] = True


@inner_njit()
def _after(faces: IntArray, f: int, i: int) -> int:
    """The vertex after vertex i in face f."""
    return int(faces[f, 1] if faces[f, 0] == i else faces[f, 2] if faces[f, 1] == i else faces[f, 0])
