"""Whether the noise of a mesh varies from place to place, and how."""

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.clusters import Clusters
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.scale_space import filtered_evenly

WEAK, STRONGER = 1.0, 10.0
"""Strengths of the filters that residuals and normals are taken from."""
WIDTH = 100.0
"""Squared edges: the residuals of some 700 vertices are averaged."""
SPREAD = 2.0
"""Ratio of high levels to low ones from which on the noise is taken to vary."""
NO_CREASES = 0.12
"""Times the mean edge: creases of a mesh without noise look like less noise than this."""
LEAST = 0.1
"""Of the highest levels, the lowest."""
MEAN_ROOT = 0.822
"""Mean of sqrt(|x|) for a standard normal x."""


def noise_levels(
    mesh: TriangleMesh, adjacency: Adjacency, clusters: Clusters, sigma: float, unit: float, *, threads: int = 1
) -> FloatArray:
    """Standard deviation of the noise around every vertex, (n,), lengths: sigma, unless it clearly varies.

    The levels are means of what a weak filter takes off, in a way that outliers, such as at edges, matter little to.

    Parameters
    ----------
    mesh : TriangleMesh
    adjacency : Adjacency
        Of the same mesh.
    clusters : Clusters
        Of the same mesh.
    sigma : float
        Standard deviation of the noise of the mesh as a whole, a length.
    unit : float
        The mean edge, a length.
    threads : int
        Number of threads.
    """
    laplacian = umbrella_laplacian(mesh, adjacency, "free", threads=threads)
    noise = np.random.default_rng(3).standard_normal((mesh.vertex_count, 1))
    signals = np.hstack([mesh.vertices, noise])
    taken = signals - filtered_evenly(laplacian, signals, WEAK, threads=threads)
    smooth = filtered_evenly(laplacian, mesh.vertices, STRONGER, threads=threads)
    normals = tangent_planes(TriangleMesh(smooth, mesh.faces), adjacency, threads=threads).normals
    share = float(np.sqrt(np.square(taken[:, 3]).mean()))
    residuals = np.abs(np.einsum("ij,ij->i", taken[:, :3], normals)) / share
    roots = clusters.diffused(clusters.means(np.sqrt(residuals)[:, np.newaxis]), WIDTH, threads=threads)
    at_vertices = clusters.at_vertices(roots, threads=threads)[:, 0].astype(np.float64)
    levels: FloatArray = np.square(np.maximum(at_vertices, 0.0) / MEAN_ROOT)
    low, high = np.quantile(levels, [0.1, 0.9])
    if high < NO_CREASES * unit or high < SPREAD * low:
        return np.full(mesh.vertex_count, sigma)
    result: FloatArray = np.maximum(levels, LEAST * high)
    return result
