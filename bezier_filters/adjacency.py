"""Which faces and vertices touch a vertex, as compressed rows (CSR)."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.mesh import TriangleMesh


@dataclass(frozen=True)
class Rows:
    """Compressed rows of integers: row i is ``indices[indptr[i]:indptr[i + 1]]``.

    Attributes
    ----------
    indptr : (n + 1,) int32
    indices : (indptr[n],) int32
    """

    indptr: IntArray
    indices: IntArray

    def __len__(self) -> int:
        return len(self.indptr) - 1

    def row(self, i: int) -> IntArray:
        """Entries of row i, a view."""
        return self.indices[self.indptr[i] : self.indptr[i + 1]]

    @property
    def lengths(self) -> IntArray:
        """Number of entries of every row, shape (n,)."""
        return np.diff(self.indptr)


@dataclass(frozen=True)
class Adjacency:
    """Neighbours in a mesh or a point cloud, found once and used by everything else.

    Attributes
    ----------
    faces : Rows
        Faces at every vertex, in ascending order. Faces that name a vertex twice are left out.
    vertices : Rows
        Vertices that share an edge with every vertex, in ascending order; in a point cloud, those
        that would share one in a triangulation (see `point_cloud`).
    on_boundary : (n,) bool
        Vertices on an edge of one face only, or points with a wide gap around them.
    """

    faces: Rows
    vertices: Rows
    on_boundary: BoolArray


def vertex_adjacency(mesh: TriangleMesh) -> Adjacency:
    """Faces, neighbours and boundary flag of every vertex.

    Examples
    --------
    >>> from bezier_filters.mesh import triangle_mesh
    >>> square = triangle_mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> vertex_adjacency(square).vertices.row(1)
    array([0, 2], dtype=int32)
    """
    face_ptr, face_indices = _incident_faces(mesh.faces, mesh.vertex_count)
    ptr, indices, on_boundary = _neighbours(mesh.faces, face_ptr, face_indices)
    return Adjacency(Rows(face_ptr, face_indices), Rows(ptr, indices.copy()), on_boundary)


@njit(cache=True, nogil=True)
def _incident_faces(faces: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """Rows of the faces at each of n vertices, by counting sort."""
    ptr = np.zeros(n + 1, np.int32)
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if a != b and b != c and c != a:
            ptr[a + 1] += 1
            ptr[b + 1] += 1
            ptr[c + 1] += 1
    for i in range(n):
        ptr[i + 1] += ptr[i]
    fill = ptr[:-1].copy()
    indices = np.empty(ptr[n], np.int32)
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if a != b and b != c and c != a:
            for k in range(3):
                i = faces[f, k]
                indices[fill[i]] = f
                fill[i] += 1
    return ptr, indices


@njit(cache=True, nogil=True)
def _neighbours(faces: IntArray, face_ptr: IntArray, face_indices: IntArray) -> tuple[IntArray, IntArray, BoolArray]:
    """Rows of the distinct neighbours of each vertex, and the boundary flags.

    A neighbour is met once per face on the common edge, so once at a boundary.
    """
    n = face_ptr.shape[0] - 1
    ptr = np.zeros(n + 1, np.int32)
    indices = np.empty(2 * face_indices.shape[0], np.int32)
    on_boundary = np.zeros(n, np.bool_)
    written = 0
    for i in range(n):
        begin = end = written
        for q in range(face_ptr[i], face_ptr[i + 1]):
            f = face_indices[q]
            for k in range(3):
                j = faces[f, k]
                if j != i:
                    indices[end] = j
                    end += 1
        _shell_sort(indices, begin, end)
        q = begin
        while q < end:
            j = indices[q]
            met = 0
            while q < end and indices[q] == j:
                q += 1
                met += 1
            indices[written] = j
            written += 1
            if met == 1:
                on_boundary[i] = True
        ptr[i + 1] = written
    return ptr, indices[:written], on_boundary


@njit(cache=True, nogil=True)
def _shell_sort(values: IntArray, begin: int, end: int) -> None:
    """Sort values[begin:end] in place: fast for a dozen neighbours, sound for thousands."""
    gap = 1
    while gap < (end - begin) // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for q in range(begin + gap, end):
            value = values[q]
            p = q
            while p >= begin + gap and values[p - gap] > value:
                values[p] = values[p - gap]
                p -= gap
            values[p] = value
        gap //= 3
