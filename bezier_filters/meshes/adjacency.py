"""Faces and neighbours of every vertex as compressed rows (CSR), and the closed components of a mesh."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.mesh import TriangleMesh, ensure_mesh
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.triangles import next_corner
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks, run_kernel

MAX_RANKED_FACES = 8  # faces at a vertex up to which neighbours are sorted by rank, without branches
MAX_PAIRWISE_FACES = 64  # faces at a vertex up to which all pairs are compared
NO_VERTEX = np.iinfo(np.int32).max


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

    def lengths_of(self, rows: IntArray) -> IntArray:
        """Number of entries of some rows, (k,)."""
        return self.indptr[rows + 1] - self.indptr[rows]

    def of(self, rows: IntArray) -> IntArray:
        """Entries of some rows, one row after the other."""
        lengths = self.lengths_of(rows)
        shifts = self.indptr[rows] - np.concatenate([[0], np.cumsum(lengths)[:-1]])[: len(rows)]
        return np.asarray(self.indices[np.repeat(shifts, lengths) + np.arange(lengths.sum())])

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
        Faces at every vertex, in ascending order, without faces that repeat a vertex.
    vertices : Rows
        Vertices that share an edge with every vertex, in ascending order; in a point cloud, the
        neighbours in a local triangulation (see `point_cloud`).
    on_boundary : (n,) bool
        Vertices on an edge of one face only, or points with a wide gap around them.
    """

    faces: Rows
    vertices: Rows
    on_boundary: BoolArray


def vertex_adjacency(mesh: ArrayLike | MeshLike, faces: ArrayLike | None = None) -> Adjacency:
    """Faces, neighbours and boundary flag of every vertex.

    Parameters
    ----------
    mesh : TriangleMesh or other mesh object, or (n, 3) array_like of float
        A mesh, see `mesh_arrays`, or the coordinates of its vertices.
    faces : (m, 3) array_like of int, optional
        Triangles, if `mesh` is an array.

    Examples
    --------
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> square = triangle_mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> vertex_adjacency(square).vertices.row(1)
    array([0, 2], dtype=int32)
    """
    surface = ensure_mesh(mesh, faces)
    n = surface.vertex_count
    face_ptr, fill = np.zeros(n + 1, dtype=np.int32), np.empty(n, dtype=np.int32)
    _count_faces(surface.faces, face_ptr, fill)
    around = Rows(face_ptr, np.empty(face_ptr[-1], dtype=np.int32))
    _fill_in_faces(surface.faces, fill, around.indices)
    indptr = np.zeros(n + 1, dtype=np.int32)
    on_boundary = np.zeros(n, dtype=np.bool_)
    # Each range of rows is written with room for two vertices per face; then all rows are moved together.
    roomy = np.empty(2 * len(around.indices), dtype=np.int32)
    most = int(around.lengths.max(initial=0))

    def neighbour_task() -> RangeTask:
        after, before = np.empty((2, max(most, MAX_RANKED_FACES)), dtype=np.int32)
        return lambda start, stop: _neighbours(
            surface.faces, around.indptr, around.indices, start, stop, after, before, roomy, indptr[1:], on_boundary
        )

    run_in_chunks(neighbour_task, n)
    np.cumsum(indptr, out=indptr)
    indices = np.empty(indptr[-1], dtype=np.int32)

    def move(start: int, stop: int) -> None:
        target = indices[indptr[start] : indptr[stop]]
        target[:] = roomy[2 * around.indptr[start] :][: len(target)]

    run_kernel(move, n)
    return Adjacency(around, Rows(indptr, indices), on_boundary)


def edge_lengths(mesh: TriangleMesh, adjacency: Adjacency) -> FloatArray:
    """Lengths of the edges to the neighbours of every vertex, in the order of `adjacency.vertices`."""
    rows = adjacency.vertices
    lengths = np.empty(len(rows.indices))
    run_kernel(_measure_edges, mesh.vertex_count, mesh.vertices, rows.indptr, rows.indices, lengths)
    return lengths


def umbrella_vectors(rows: Rows, points: FloatArray) -> FloatArray:
    """Umbrella vectors (n, 3): points less the mean of their neighbours."""
    n, ones = len(points), np.ones(len(rows.indices))
    sums = csr_array((ones, rows.indices, rows.indptr), shape=(n, n)) @ points
    result: FloatArray = points - sums / np.maximum(rows.lengths, 1)[:, np.newaxis]
    return result


def components(adjacency: Adjacency) -> IntArray:
    """Number of the component that each vertex belongs to, (n,)."""
    rows = adjacency.vertices
    n = len(rows.lengths)
    graph = csr_array((np.ones(len(rows.indices), np.int8), rows.indices, rows.indptr), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1])


def closed_components(mesh: TriangleMesh, adjacency: Adjacency) -> tuple[IntArray, IntArray]:
    """Number of the closed component that each vertex belongs to, -1 for none, (n,), and their first vertices, (c,).

    There are none if the mesh is not an oriented manifold along its edges.
    """
    n = mesh.vertex_count
    if not mesh.face_count or incoherent_vertices(mesh.faces, adjacency).any():
        return np.full(n, -1, dtype=np.int32), np.empty(0, dtype=np.int32)
    label = components(adjacency)
    count = int(label.max()) + 1
    first = np.full(count, n, dtype=np.int32)
    first[label[::-1]] = np.arange(n - 1, -1, -1, dtype=np.int32)
    closed = np.ones(count, dtype=np.bool_)
    closed[label[adjacency.on_boundary | (adjacency.vertices.lengths == 0)]] = False
    number = np.where(closed, np.cumsum(closed) - 1, -1).astype(np.int32)
    return number[label], first[closed]


def incoherent_vertices(faces: IntArray, adjacency: Adjacency) -> BoolArray:
    """Vertices at a face without three corners, or with two faces that run through an edge the same way, (n,)."""
    result = np.zeros(len(adjacency.faces), dtype=np.bool_)
    _mark_incoherent(faces, adjacency.faces.indptr, adjacency.faces.indices, result)
    for i in np.flatnonzero(adjacency.faces.lengths > MAX_PAIRWISE_FACES).tolist():
        around = faces[adjacency.faces.row(i)]
        following = np.roll(around, -1, axis=1)[around == i]
        result[i] |= len(np.unique(following)) < len(following)
    return result


@jit()
def _mark_incoherent(faces: IntArray, face_ptr: IntArray, face_indices: IntArray, result: BoolArray) -> None:
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if a == b or b == c or c == a:
            result[a] = result[b] = result[c] = True
    for i in range(len(face_ptr) - 1):
        if face_ptr[i + 1] - face_ptr[i] > MAX_PAIRWISE_FACES:
            continue
        for q in range(face_ptr[i], face_ptr[i + 1]):
            for p in range(face_ptr[i], q):
                if next_corner(faces, face_indices[p], i) == next_corner(faces, face_indices[q], i):
                    result[i] = True


@jit()
def _count_faces(faces: IntArray, ptr: IntArray, starts: IntArray) -> None:
    """Write the first entry of each vertex's row of faces, and the row pointers; `ptr` starts at zero."""
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if a != b and b != c and c != a:
            ptr[a + 1] += 1
            ptr[b + 1] += 1
            ptr[c + 1] += 1
    for i in range(starts.shape[0]):
        starts[i] = ptr[i]
        ptr[i + 1] += ptr[i]


@jit()
def _fill_in_faces(faces: IntArray, fill: IntArray, indices: IntArray) -> None:
    """Append every face to the rows of its vertices; `fill` is the next free entry of each row."""
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if a != b and b != c and c != a:
            for k in range(3):
                i = faces[f, k]
                indices[fill[i]] = f
                fill[i] += 1


@jit()
def _neighbours(
    faces: IntArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    start: int,
    stop: int,
    after: IntArray,
    before: IntArray,
    roomy: IntArray,
    lengths: IntArray,
    on_boundary: BoolArray,
) -> None:
    """Distinct neighbours of vertices start .. stop-1, packed from entry 2 face_ptr[start] on, and row lengths.

    A neighbour is met once per face on the common edge, so once at a boundary. `after` and `before` are work space
    for the vertices that follow and precede a vertex in its faces, at most one entry per face.
    """
    written = 2 * face_ptr[start]
    for i in range(start, stop):
        begin, count = written, face_ptr[i + 1] - face_ptr[i]
        for q in range(MAX_RANKED_FACES):
            after[q] = before[q] = NO_VERTEX
        for q in range(count):
            f = face_indices[face_ptr[i] + q]
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            after[q] = b if a == i else c if b == i else a
            before[q] = c if a == i else a if b == i else b
        if count <= MAX_RANKED_FACES and _write_sorted(after, before, count, begin, roomy):
            written = begin + count
            lengths[i] = count
            continue
        for q in range(count):
            roomy[begin + q] = after[q]
            roomy[begin + count + q] = before[q]
        end = begin + 2 * count
        _sort(roomy, begin, end)
        q = begin
        while q < end:
            j = roomy[q]
            met = 0
            while q < end and roomy[q] == j:
                q += 1
                met += 1
            roomy[written] = j
            written += 1
            if met == 1:
                on_boundary[i] = True
        lengths[i] = written - begin


@inner_jit(inline="always")
def _write_sorted(after: IntArray, before: IntArray, count: int, begin: int, result: IntArray) -> bool:
    """Write the neighbours of an inner vertex with consistent faces, sorted, from entry `begin`; False otherwise.

    There are at most `MAX_RANKED_FACES` of them, padded with `NO_VERTEX`. The rank of an entry takes one vector
    comparison without branches; mispredicted branches are most of the cost of sorting short rows.
    """
    places, in_both = 0, True
    for q in range(count):
        smaller, same = 0, 0
        for p in range(MAX_RANKED_FACES):
            smaller += after[p] < after[q]
            same += before[p] == after[q]
        places |= 1 << smaller
        in_both &= same == 1
        result[begin + smaller] = after[q]
    return in_both and places == (1 << count) - 1


@jit()
def _measure_edges(
    vertices: FloatArray, indptr: IntArray, indices: IntArray, lengths: FloatArray, start: int, stop: int
) -> None:
    for i in range(start, stop):
        for q in range(indptr[i], indptr[i + 1]):
            j = indices[q]
            x, y, z = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
            lengths[q] = sqrt(x * x + y * y + z * z)


@inner_jit()
def _sort(values: IntArray, begin: int, end: int) -> None:
    """Sort values[begin:end] in place by Shell's method, fast for a dozen entries and acceptable for thousands."""
    gap = 1
    while gap < (end - begin) // 9:
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
