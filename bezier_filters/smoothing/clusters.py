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
from bezier_filters.smoothing.laplacian import Laplacian
from bezier_filters.smoothing.scale_space import diffused


@dataclass(frozen=True)
class Clusters:
    """Disjoint clusters that cover a mesh.

    Attributes
    ----------
    of_vertex : (n,) int32
        Number of the cluster that a vertex belongs to.
    sizes : (k,) float64
        Numbers of their vertices.
    laplacian : Laplacian
        How values on clusters spread.
    pace : float
        Time on clusters per time on the mesh.
    adjacency : Adjacency
        Of the vertices.
    """

    of_vertex: IntArray
    sizes: FloatArray
    laplacian: Laplacian
    pace: float
    adjacency: Adjacency

    def means(self, values: RealArray) -> FloatArray:
        """Mean of values at vertices (n,) or (n, c) over each cluster, (k, c)."""
        sums = np.zeros((len(self.sizes), values.shape[1]))
        _add_up(self.of_vertex, values, sums)
        return sums / self.sizes[:, np.newaxis]

    def mean_over_all(self, means: FloatArray) -> FloatArray:
        """Mean over the vertices of the mesh, (c,), of values on clusters (k, c)."""
        result: FloatArray = self.sizes @ means / self.sizes.sum()
        return result

    def diffused(self, values: FloatArray, time: float, *, threads: int = 1) -> FloatArray:
        """Values on clusters (k, c), averaged over their surroundings, some `time` edges squared wide."""
        return diffused(self.laplacian, values, time * self.pace, threads=threads)

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
    of_vertex = np.full(mesh.vertex_count, -1, dtype=np.int32)
    count = _cluster(rows.indptr, rows.indices, of_vertex)
    sizes = np.bincount(of_vertex, minlength=count).astype(np.float64)
    start = np.repeat(of_vertex, rows.lengths)
    # All edges between two clusters become one entry of a sparse matrix, with their number.
    edges = csr_array((np.ones(len(start), np.float32), (start, of_vertex[rows.indices])), shape=(count, count))
    edges.sum_duplicates()
    degrees = np.maximum(np.bincount(start, minlength=count), 1).astype(np.float64)
    of_entry = np.repeat(np.arange(count), np.diff(edges.indptr))
    inner = edges.indices == of_entry
    outer = np.where(inner, 0.0, edges.data)
    leaving = np.bincount(of_entry, weights=outer, minlength=count)
    weights = outer / np.maximum(leaving, 1.0)[of_entry]
    laplacian = Laplacian(
        edges.indptr.astype(np.int32),
        edges.indices.astype(np.int32),
        weights.astype(np.float32),
        (leaving / degrees).astype(np.float32),
    )
    columns = [np.bincount(of_vertex, mesh.vertices[:, k], count) / sizes for k in range(3)]
    centers = np.column_stack(columns)
    jumps = np.square(centers[edges.indices] - centers[of_entry]).sum(axis=1)
    across = float(outer @ jumps)
    lengths = _sum_of_squares(rows.indptr, rows.indices, mesh.vertices)
    return Clusters(of_vertex, sizes, laplacian, lengths / across if across > 0.0 else 1.0, adjacency)


@lean_njit()
def _cluster(ptr: IntArray, indices: IntArray, of_vertex: IntArray) -> int:
    """Number clusters: vertices whose neighbours are all free, with them; others join a neighbour's."""
    count = 0
    for i in range(len(of_vertex)):
        free = of_vertex[i] < 0
        for q in range(ptr[i], ptr[i + 1]):
            free = free and of_vertex[indices[q]] < 0
        if free:
            of_vertex[i] = count
            for q in range(ptr[i], ptr[i + 1]):
                of_vertex[indices[q]] = count
            count += 1
    for i in range(len(of_vertex)):
        for q in range(ptr[i], ptr[i + 1]):
            # Those who came late count only as themselves, lest a cluster grow into a chain.
            if of_vertex[i] == -1 and of_vertex[indices[q]] >= 0:
                of_vertex[i] = -2 - of_vertex[indices[q]]
    for i in range(len(of_vertex)):
        if of_vertex[i] <= -2:
            of_vertex[i] = -2 - of_vertex[i]
        elif of_vertex[i] == -1:
            of_vertex[i] = count
            count += 1
    return count


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
def _sum_of_squares(ptr: IntArray, indices: IntArray, vertices: FloatArray) -> float:
    """Sum of the squared lengths of the edges, each from both its ends."""
    total = 0.0
    for i in range(len(vertices)):
        for q in range(ptr[i], ptr[i + 1]):
            j = indices[q]
            x, y, z = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
            total += x * x + y * y + z * z
    return total
