"""Fits over a plane that is not the tangent plane: the fitted function itself is known."""

import numpy as np
from scipy.spatial import Delaunay

from bezier_filters import FitStatus, triangle_mesh, vertex_adjacency
from bezier_filters.estimation.fallbacks import Attempt, fit_with_fallbacks
from bezier_filters.estimation.vertex_geometry import empty_geometry
from bezier_filters.kernels.kernel_input import FITTED, kernel_mesh
from bezier_filters.meshes.frames import TangentPlanes


def fit_over_plane_z(x, y, z, fit, rings, ids=None):
    """Fit the patches of a mesh over the plane z = 0, whatever its face normals are."""
    mesh = triangle_mesh(np.column_stack([x, y, z]), Delaunay(np.column_stack([x, y])).simplices)
    adjacency = vertex_adjacency(mesh)
    normals = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    arrays = kernel_mesh(mesh, adjacency, TangentPlanes(normals, np.full(len(x), 2.0)))
    geometry = empty_geometry(len(x))
    attempt = Attempt(FitStatus.OK, frozenset({FITTED}), rings, fit, most_turned=1.0)
    ids = np.arange(len(x), dtype=np.int32) if ids is None else ids
    fit_with_fallbacks(arrays, ids, [attempt], geometry)
    return geometry
