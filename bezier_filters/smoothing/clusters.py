"""Clusters of neighbouring vertices: what varies slowly over a mesh need not be known at every vertex.

A cluster is a vertex and its neighbours, nine or so vertices. Neighbouring clusters exchange what they hold in
proportion to the edges between them; a unit of time on them is scaled so that things spread
as far, on average, as they do on the mesh.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from bezier_filters.arrays import FloatArray, IntArray, RealArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.lean import lean_njit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks
from bezier_filters.smoothing.chebyshev import diffuse
from bezier_filters.smoothing.laplacian import Laplacian


@dataclass(frozen=True)
class Clusters:
    """Disjoint clusters that cover a mesh.

    Attributes
    ----------
    of_vertex : (n,) int32
        Number of the cluster that a vertex belongs to.
    centers : (k,) int32
        The vertices that they have grown from, ascending.
    sizes : (k,) float64
        Numbers of their vertices.
    adjacency : Adjacency
        Of the vertices.
    laplacian : Laplacian
        How values on clusters spread,
    pace : float
        and how much time that takes, per time on the mesh.
    """

    of_vertex: IntArray
    centers: IntArray
    sizes: FloatArray
    adjacency: Adjacency
    laplacian: Laplacian
    pace: float

    def means(self, values: RealArray) -> FloatArray:
        """Mean of values at vertices (n, c) over each cluster, (k, c)."""
        sums = np.zeros((len(self.sizes), values.shape[1]))
        _add_up(self.of_vertex, values, sums)
        return sums / self.sizes[:, np.newaxis]

    def diffuse(self, values: FloatArray, time: float, *, threads: int = 1) -> FloatArray:
        """Values on clusters (k, c), averaged over some `time` squared edges around them."""
        return diffuse(self.laplacian, values, time * self.pace, threads=threads)

    def at_vertices(self, values: FloatArray, *, threads: int = 1) -> SingleArray:
        """Values on clusters (k, c) as means over each vertex and its neighbours, (n, c)."""
        single, rows = values.astype(np.float32), self.adjacency.vertices
        result = np.zeros((len(self.of_vertex), values.shape[1]), dtype=np.float32)

        def make_task() -> RangeTask:
            return lambda start, stop: _spread(rows.indptr, rows.indices, self.of_vertex, single, start, stop, result)

        run_in_chunks(make_task, len(result), threads=threads)
        return result


def clusters_of(mesh: TriangleMesh, adjacency: Adjacency) -> Clusters:
    """Cluster a mesh.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=10)
    >>> mesh = triangle_mesh(ball.vertices, ball.faces)
    >>> clusters = clusters_of(mesh, vertex_adjacency(mesh))
    >>> bool(5.0 < clusters.sizes.mean() < 12.0), clusters.sizes.sum() == mesh.vertex_count
    (True, np.True_)
    """
    rows = adjacency.vertices
    center = np.full(len(rows), -1, dtype=np.int32)
    _find_centers(rows.indptr, rows.indices, center)
    _join_centers(rows.indptr, rows.indices, center)
    centers, places = np.unique(center, return_inverse=True)
    of_vertex: IntArray = places.astype(np.int32)
    count = len(centers)
    sizes = np.bincount(of_vertex, minlength=count).astype(np.float64)
    # All edges between two clusters become one entry of a sparse matrix, with their number.
    start = np.repeat(of_vertex, rows.lengths)
    ones = np.ones(len(start), np.float32)
    edges = csr_array((ones, (start, of_vertex[rows.indices])), shape=(count, count))
    edges.sum_duplicates()
    degrees = np.maximum(np.bincount(start, minlength=count), 1).astype(np.float64)
    del start, ones
    of_entry = np.repeat(np.arange(count, dtype=np.int32), np.diff(edges.indptr))
    outer = np.where(edges.indices == of_entry, 0.0, edges.data)
    leaving = np.bincount(of_entry, weights=outer, minlength=count)
    rates = (leaving / degrees).astype(np.float32)
    laplacian = Laplacian(
        edges.indptr.astype(np.int32),
        edges.indices.astype(np.int32),
        (outer / np.maximum(leaving, 1.0)[of_entry]).astype(np.float32),
        rates,
        float(rates.max(initial=0.0)),
    )
    squares = np.zeros(mesh.vertex_count)
    _add_squares(rows.indptr, rows.indices, mesh.vertices, squares)
    # Centers of gravity are as far apart as things spread in a unit of time on the clusters.
    middles = np.column_stack([np.bincount(of_vertex, mesh.vertices[:, k], count) / sizes for k in range(3)])
    jumps = outer * np.square(middles[laplacian.indices] - middles[of_entry]).sum(axis=1)
    across = float(jumps.sum())
    pace = float(squares.sum()) / across if across > 0.0 else 1.0
    return Clusters(of_vertex, centers.astype(np.int32), sizes, adjacency, laplacian, pace)


@lean_njit()
def _find_centers(ptr: IntArray, indices: IntArray, center: IntArray) -> None:
    """Make clusters of the vertices whose neighbours are all free yet, with them."""
    for i in range(len(center)):
        free = center[i] < 0
        for q in range(ptr[i], ptr[i + 1]):
            free = free and center[indices[q]] < 0
        if free:
            center[i] = i
            for q in range(ptr[i], ptr[i + 1]):
                center[indices[q]] = i


@lean_njit()
def _join_centers(ptr: IntArray, indices: IntArray, center: IntArray) -> None:
    """Let the others join the cluster of their first neighbour that has one."""
    for i in range(len(center)):
        for q in range(ptr[i], ptr[i + 1]):
            # Those who came late count only as themselves, lest a cluster grow into a chain.
            if center[i] == -1 and center[indices[q]] >= 0:
                center[i] = -2 - center[indices[q]]
    for i in range(len(center)):
        if center[i] <= -2:
            center[i] = -2 - center[i]


@lean_njit()
def _add_up(of_vertex: IntArray, values: RealArray, sums: FloatArray) -> None:
    """Add the values at vertices to those of their clusters, in ascending order."""
    for i in range(len(of_vertex)):
        for c in range(values.shape[1]):
            sums[of_vertex[i], c] += values[i, c]


@lean_njit()
def _spread(
    ptr: IntArray,
    indices: IntArray,
    of_vertex: IntArray,
    values: SingleArray,
    start: int,
    stop: int,
    result: SingleArray,
) -> None:
    """Write means over vertices start .. stop-1 and their neighbours."""
    for i in range(start, stop):
        share = np.float32(1.0 / (1 + ptr[i + 1] - ptr[i]))
        for c in range(values.shape[1]):
            result[i, c] = share * values[of_vertex[i], c]
        for q in range(ptr[i], ptr[i + 1]):
            k = of_vertex[indices[q]]
            for c in range(values.shape[1]):
                result[i, c] += share * values[k, c]


@lean_njit()
def _add_squares(ptr: IntArray, indices: IntArray, vertices: FloatArray, sums: FloatArray) -> None:
    """Write the sum of the squared lengths of the edges at every vertex."""
    for i in range(len(vertices)):
        for q in range(ptr[i], ptr[i + 1]):
            j = indices[q]
            x, y, z = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
            sums[i] += x * x + y * y + z * z
