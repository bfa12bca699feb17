"""Clusters of neighbouring vertices, a coarse mesh for slowly varying quantities.

A cluster is a vertex and its neighbours, about nine vertices. Values diffuse between neighbouring clusters in
proportion to the edges between them. The time is scaled so that the diffusion length is that of the mesh.

Clusters form in a random order of the vertices, hashes of their numbers in the whole mesh. So the centers depend only
on a few rings around a vertex (on short chains of earlier vertices), and a tile has the clusters of the mesh except
near its cut. In the order of the vertex numbers a center would depend on all vertices before.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from bezier_filters.arrays import FloatArray, IntArray, RealArray, SingleArray
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import run_kernel
from bezier_filters.sampling.mesh_parts import MeshPart
from bezier_filters.smoothing.chebyshev import diffuse
from bezier_filters.smoothing.laplacian import Laplacian
from bezier_filters.smoothing.random_noise import random_bits

AVERAGING_TIME = 100.0  # diffusion time, squared edges, over which noise, rates and risks are averaged
# effective number of vertices in a local mean on a regular mesh, the reciprocal of the sum of the squared weights, over
# the diffusion time
AVERAGED_VERTICES_PER_TIME = 7.26
CLUSTER_STREAM = 100  # stream of the vertex hashes that order the clusters


@dataclass(frozen=True)
class Clusters:
    """Disjoint clusters that cover a mesh, or a tile of one."""

    of_vertex: IntArray  # (n,): number of the cluster that a vertex belongs to
    sizes: IntArray  # (k,): numbers of their vertices
    neighbours: Rows  # of the vertices
    laplacian: Laplacian  # diffusion between clusters
    time_scale: float  # diffusion time on clusters over that on the mesh for the same length

    def separate(self, values: FloatArray, width: float) -> "Clusters":
        """The same clusters with less diffusion between those whose mean values, from (n,), are far apart.

        Weights are multiplied by exp(-d^2 / 2) for a difference of d widths.
        """
        at, laplacian = self.means([values])[:, 0], self.laplacian
        lengths = np.diff(laplacian.indptr)
        apart = (at[laplacian.indices] - np.repeat(at, lengths)) / width
        weights = laplacian.weights * np.exp(-0.5 * np.square(apart))
        of_entry = np.repeat(np.arange(len(at)), lengths)
        kept = np.bincount(of_entry, weights, len(at))
        weights /= np.where(kept > 0.0, kept, 1.0)[of_entry]
        rates = laplacian.rates * kept
        single = laplacian._replace(weights=weights.astype(np.float32), rates=rates.astype(np.float32))
        return replace(self, laplacian=single)

    def means(self, columns: Iterable[RealArray]) -> FloatArray:
        """Means of columns of values at vertices, each (n,), over each cluster, (k, c)."""
        sums = [np.bincount(self.of_vertex, column, len(self.sizes)) for column in columns]
        return np.column_stack(sums) / self.sizes[:, np.newaxis]

    def diffuse(self, values: FloatArray) -> FloatArray:
        """Values on clusters (k, c) after diffusion by `AVERAGING_TIME`."""
        return diffuse(self.laplacian, values, AVERAGING_TIME * self.time_scale)

    def spread_to_vertices(self, values: FloatArray) -> SingleArray:
        """Values on clusters (k, c) as means over each vertex and its neighbours, (n, c)."""
        single, rows = values.astype(np.float32), self.neighbours
        result = np.zeros((len(self.of_vertex), values.shape[1]), dtype=np.float32)
        of_mesh = rows.indptr, rows.indices, self.of_vertex
        run_kernel(_spread_kernel, len(result), *of_mesh, single, result)
        return result

    def average(self, columns: Iterable[RealArray]) -> SingleArray:
        """Local means (n, c) of columns of values at vertices, each (n,), by diffusion over `AVERAGING_TIME`."""
        return self.spread_to_vertices(self.diffuse(self.means(columns)))


def clusters_of(part: MeshPart, time_scale: float | None = None) -> Clusters:
    """Cluster a mesh, with the time scale of the whole mesh or, by default, of this part.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.meshes.prepared_mesh import prepare_mesh
    >>> from bezier_filters.sampling.mesh_parts import whole_mesh
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=10)
    >>> mesh = prepare_mesh(triangle_mesh(ball.vertices, ball.faces))
    >>> clusters = clusters_of(whole_mesh(mesh))
    >>> bool(5.0 < clusters.sizes.mean() < 12.0), clusters.sizes.sum() == mesh.vertex_count
    (True, np.True_)
    """
    mesh, rows = part.mesh, part.mesh.adjacency.vertices
    visits = np.argsort(random_bits(part.ids, CLUSTER_STREAM)).astype(np.int32)
    rank = np.empty_like(visits)
    rank[visits] = np.arange(len(visits), dtype=np.int32)
    center = np.full(len(rows), -1, dtype=np.int32)
    _find_centers(rows.indptr, rows.indices, visits, center)
    _join_centers(rows.indptr, rows.indices, rank, center)
    number = np.cumsum(center == np.arange(len(center)), dtype=np.int32) - np.int32(1)
    of_vertex, count = number[center], int(number[-1]) + 1 if len(number) else 0
    sizes = np.bincount(of_vertex, minlength=count).astype(np.int32)
    # All edges between two clusters become one entry of a sparse matrix, with their number.
    ones, start = np.ones(len(rows.indices), np.float32), np.repeat(of_vertex, rows.lengths)
    edges = csr_array((ones, (start, of_vertex[rows.indices])), shape=(count, count))
    del start, ones
    of_entry = np.repeat(np.arange(count, dtype=np.int32), np.diff(edges.indptr))
    outer = np.where(edges.indices == of_entry, 0.0, edges.data)
    leaving = np.bincount(of_entry, weights=outer, minlength=count)
    laplacian = Laplacian(
        edges.indptr.astype(np.int32),
        edges.indices.astype(np.int32),
        (outer / np.maximum(leaving, 1.0)[of_entry]).astype(np.float32),
        (leaving / np.maximum(edges.sum(axis=1), 1.0)).astype(np.float32),
    )
    if time_scale is None:
        time_scale = _time_scale(mesh, rows, of_vertex, sizes, edges)
    return Clusters(of_vertex, sizes, rows, laplacian, time_scale)


def _time_scale(mesh: TriangleMesh, rows: Rows, of_vertex: IntArray, sizes: IntArray, joined: csr_array) -> float:
    """Time scale: the mean squared distance of neighbouring vertices over that of neighbouring cluster centroids."""
    start = np.repeat(np.arange(len(rows), dtype=np.int32), rows.lengths)
    squares = np.square(mesh.vertices[rows.indices] - mesh.vertices[start]).sum()
    middles = np.column_stack([np.bincount(of_vertex, mesh.vertices[:, k], len(sizes)) / sizes for k in range(3)])
    of_entry = np.repeat(np.arange(len(sizes)), np.diff(joined.indptr))
    across = joined.data @ np.square(middles[joined.indices] - middles[of_entry]).sum(axis=1)
    return float(squares / across) if across > 0.0 else 1.0


@jit()
def _find_centers(ptr: IntArray, indices: IntArray, visits: IntArray, center: IntArray) -> None:
    """Make a cluster of each visited vertex whose neighbours are all free."""
    for i in visits:
        free = center[i] < 0
        for q in range(ptr[i], ptr[i + 1]):
            free = free and center[indices[q]] < 0
        if free:
            center[i] = i
            for q in range(ptr[i], ptr[i + 1]):
                center[indices[q]] = i


@jit()
def _join_centers(ptr: IntArray, indices: IntArray, rank: IntArray, center: IntArray) -> None:
    """Let the other vertices join the earliest cluster of their neighbours."""
    for i in range(len(center)):
        for q in range(ptr[i], ptr[i + 1]):
            # Vertices that joined in this loop are skipped, so that no cluster grows into a chain.
            found = center[indices[q]]
            if found >= 0 and center[i] < 0 and (center[i] == -1 or rank[found] < rank[-2 - center[i]]):
                center[i] = -2 - found
    for i in range(len(center)):
        if center[i] <= -2:
            center[i] = -2 - center[i]


@jit()
def _spread_kernel(
    ptr: IntArray,
    indices: IntArray,
    of_vertex: IntArray,
    values: SingleArray,
    result: SingleArray,
    start: int,
    stop: int,
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
