"""Whether the noise of a mesh varies from place to place, and how."""

import numpy as np

from bezier_filters.arrays import FloatArray, RealArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.chebyshev import low_pass
from bezier_filters.smoothing.clusters import Clusters
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.probes import other_white_noise

WEAK, STRONGER = np.array([1.0]), np.array([10.0])
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


def local_sigma(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    clusters: Clusters,
    sigma: float,
    unit: float,
    least: float,
    detail: float,
    *,
    threads: int = 1,
) -> FloatArray:
    """Standard deviation of the noise around every vertex, (n,): sigma, unless it clearly varies.

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
    least : float
        The lowest level that there may be, a length, before
    detail : float
        the standard deviation of the relief is taken off it, a shorter length.
    threads : int
        Number of threads.
    """
    laplacian = umbrella_laplacian(mesh, adjacency, "free", threads=threads)
    signals = np.hstack([mesh.vertices, other_white_noise(mesh.vertex_count)])
    taken = signals - low_pass(laplacian, signals, WEAK, threads=threads)
    smooth = low_pass(laplacian, mesh.vertices, STRONGER, threads=threads)
    normals = tangent_planes(TriangleMesh(smooth, mesh.faces), adjacency, threads=threads).normals
    residuals = np.abs(np.einsum("ij,ij->i", taken[:, :3], normals))
    share = float(np.sqrt(np.square(taken[:, 3]).mean()))
    means = clusters.means(np.sqrt(residuals / share)[:, np.newaxis])
    roots = clusters.at_vertices(clusters.diffuse(means, WIDTH, threads=threads), threads=threads)[:, 0]
    roots = np.maximum(roots, np.float32(0.0))
    low, high = np.quantile(_levels(roots), (0.1, 0.9))
    if high < NO_CREASES * unit or high < SPREAD * low:
        levels = np.full(len(roots), sigma)
    else:
        levels = np.maximum(_levels(roots), LEAST * high)
    result: FloatArray = np.sqrt(np.maximum(levels, least) ** 2 - detail**2)
    return result


def _levels(roots: RealArray) -> FloatArray:
    result: FloatArray = np.square(roots.astype(np.float64) / MEAN_ROOT)
    return result
