"""Small meshes whose Laplacians are written out as matrices."""

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
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


def small_ball() -> PreparedMesh:
    """A sphere as a mesh."""
    surface = sphere(resolution=6, jitter=0.2)
    return prepare_mesh(triangle_mesh(surface.vertices, surface.faces))


def small_sheet() -> PreparedMesh:
    """A plane as a mesh."""
    surface = waves(resolution=12, amplitude=0.0, jitter=0.2)
    return prepare_mesh(triangle_mesh(surface.vertices, surface.faces))
