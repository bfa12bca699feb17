"""Clusters of neighbouring vertices: what varies slowly over a mesh need not be known at every vertex.

A cluster is a vertex and its neighbours, nine or so vertices. Neighbouring clusters exchange what they hold in
proportion to the edges between them; a unit of time on them is scaled so that things spread
as far, on average, as they do on the mesh.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from bezier_filters.arrays import FloatArray, IntArray, RealArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.lean import lean_njit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks
from bezier_filters.smoothing.laplacian import Laplacian


@dataclass(frozen=True)
class Clusters:
    """Disjoint clusters that cover a mesh, or a tile of one.

    Attributes
    ----------
    of_vertex : (n,) int32
        Number of the cluster that a vertex belongs to.
    sizes : (k,) float64
        Numbers of their vertices.
    centers : (k,) int32
        Numbers of the vertices that they have grown from, ascending, in the whole mesh.
    adjacency : Adjacency
        Of the vertices.
    """

    of_vertex: IntArray
    sizes: FloatArray
    centers: IntArray
    adjacency: Adjacency

    def means(self, values: RealArray) -> FloatArray:
        """Mean of values at vertices (n,) or (n, c) over each cluster, (k, c)."""
        sums = np.zeros((len(self.sizes), values.shape[1]))
        _add_up(self.of_vertex, values, sums)
        return sums / self.sizes[:, np.newaxis]

    def at_vertices(self, values: FloatArray, *, threads: int = 1) -> SingleArray:
        """Values on clusters (k, c) as means over each vertex and its neighbours, (n, c)."""
        single, rows = values.astype(np.float32), self.adjacency.vertices
        result = np.zeros((len(self.of_vertex), values.shape[1]), dtype=np.float32)

        def make_task() -> RangeTask:
            return lambda start, stop: _spread(rows.indptr, rows.indices, self.of_vertex, single, start, stop, result)

        run_in_chunks(make_task, len(result), threads=threads)
        return result

    def laplacian(self) -> Laplacian:
        """How values on clusters spread."""
        return self._edges()[0]

    def squared_jumps(self, mesh: TriangleMesh) -> FloatArray:
        """Squared distances to the centers of gravity around each cluster, (k,), once for each edge in between."""
        _, of_entry, to, counts = self._edges()
        columns = [np.bincount(self.of_vertex, mesh.vertices[:, k], len(self.sizes)) / self.sizes for k in range(3)]
        centers = np.column_stack(columns)
        jumps = counts * np.square(centers[to] - centers[of_entry]).sum(axis=1)
        result: FloatArray = np.bincount(of_entry, weights=jumps, minlength=len(self.sizes)).astype(np.float64)
        return result

    def _edges(self) -> tuple[Laplacian, IntArray, IntArray, FloatArray]:
        """The Laplacian, and for its entries the clusters that they join and the number of edges in between."""
        rows, count = self.adjacency.vertices, len(self.sizes)
        start = np.repeat(self.of_vertex, rows.lengths)
        # All edges between two clusters become one entry of a sparse matrix, with their number.
        ones = np.ones(len(start), np.float32)
        edges = csr_array((ones, (start, self.of_vertex[rows.indices])), shape=(count, count))
        edges.sum_duplicates()
        degrees = np.maximum(np.bincount(start, minlength=count), 1).astype(np.float64)
        of_entry = np.repeat(np.arange(count, dtype=np.int32), np.diff(edges.indptr))
        outer = np.where(edges.indices == of_entry, 0.0, edges.data)
        leaving = np.bincount(of_entry, weights=outer, minlength=count)
        weights = outer / np.maximum(leaving, 1.0)[of_entry]
        laplacian = Laplacian(
            edges.indptr.astype(np.int32),
            edges.indices.astype(np.int32),
            weights.astype(np.float32),
            (leaving / degrees).astype(np.float32),
        )
        return laplacian, of_entry, laplacian.indices, outer


def clusters_of(adjacency: Adjacency) -> Clusters:
    """Cluster a mesh.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=10)
    >>> mesh = triangle_mesh(ball.vertices, ball.faces)
    >>> clusters = clusters_of(vertex_adjacency(mesh))
    >>> bool(5.0 < clusters.sizes.mean() < 12.0), clusters.sizes.sum() == mesh.vertex_count
    (True, np.True_)
    """
    rows = adjacency.vertices
    center = np.full(len(rows), -1, dtype=np.int32)
    find_centers(rows.indptr, rows.indices, np.arange(len(rows), dtype=np.int32), center)
    join_centers(rows.indptr, rows.indices, center)
    return numbered(center, adjacency)


def numbered(center: IntArray, adjacency: Adjacency) -> Clusters:
    """The clusters of vertices whose centers are known, (n,)."""
    centers, places = np.unique(center, return_inverse=True)
    of_vertex: IntArray = places.astype(np.int32)
    sizes = np.bincount(of_vertex, minlength=len(centers)).astype(np.float64)
    return Clusters(of_vertex, sizes, centers.astype(np.int32), adjacency)


@lean_njit()
def find_centers(ptr: IntArray | NDArray[np.int64], indices: IntArray, visits: IntArray, center: IntArray) -> None:
    """Make clusters of the vertices whose neighbours are all free yet, with them, visit by visit."""
    for i in visits:
        free = center[i] < 0
        for q in range(ptr[i], ptr[i + 1]):
            free = free and center[indices[q]] < 0
        if free:
            center[i] = i
            for q in range(ptr[i], ptr[i + 1]):
                center[indices[q]] = i


@lean_njit()
def join_centers(ptr: IntArray | NDArray[np.int64], indices: IntArray, center: IntArray) -> None:
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
