"""Small meshes whose Laplacians are written out as matrices."""

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.meshes.adjacency import Adjacency, mean_edge, vertex_adjacency
from bezier_filters.meshes.mesh import TriangleMesh, triangle_mesh
from bezier_filters.smoothing.laplacian import Laplacian
from bezier_filters.surfaces import sphere, waves


def dense(laplacian: Laplacian) -> FloatArray:
    """The operator as a matrix, (n, n)."""
    n = len(laplacian.rates)
    matrix = np.zeros((n, n))
    start = np.repeat(np.arange(n), np.diff(laplacian.indptr))
    np.subtract.at(matrix, (start, laplacian.indices), laplacian.weights * laplacian.rates[start])
    matrix[np.arange(n), np.arange(n)] += laplacian.rates
    return matrix


def small_ball() -> tuple[TriangleMesh, Adjacency, float]:
    """A sphere as a mesh, with its adjacency and mean edge."""
    surface = sphere(resolution=6, jitter=0.2)
    mesh = triangle_mesh(surface.vertices, surface.faces)
    adjacency = vertex_adjacency(mesh)
    return mesh, adjacency, mean_edge(mesh, adjacency)


def small_sheet() -> tuple[TriangleMesh, Adjacency, float]:
    """A plane as a mesh, with its adjacency and mean edge."""
    surface = waves(resolution=12, amplitude=0.0, jitter=0.2)
    mesh = triangle_mesh(surface.vertices, surface.faces)
    adjacency = vertex_adjacency(mesh)
    return mesh, adjacency, mean_edge(mesh, adjacency)
