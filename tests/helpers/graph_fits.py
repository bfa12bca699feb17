"""Geometry of known functions: of their derivatives, and fitted over a plane that is not the tangent plane."""

from types import SimpleNamespace

import numpy as np
from compiled import from_python
from scipy.spatial import Delaunay

from bezier_filters import FitStatus, triangle_mesh, vertex_adjacency
from bezier_filters.fitting.fallbacks import FitAttempt, fit_with_fallbacks
from bezier_filters.fitting.vertex_geometry import empty_geometry
from bezier_filters.kernels import fit_workspace as places
from bezier_filters.kernels import graph_geometry as kernel
from bezier_filters.kernels.kernel_input import UNTRIED, kernel_mesh
from bezier_filters.meshes.frames import TangentPlanes
from bezier_filters.runtime.lanes import LANES, lane_array


def fit_over_plane_z(x, y, z, fit, rings, ids=None, noise=(0.0, 0.0, 0.0)):
    """Fit the patches of a mesh over the plane z = 0, whatever its face normals are."""
    mesh = triangle_mesh(np.column_stack([x, y, z]), Delaunay(np.column_stack([x, y])).simplices)
    adjacency = vertex_adjacency(mesh)
    normals = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    arrays = kernel_mesh(mesh, adjacency, TangentPlanes(normals, np.full(len(x), 2.0)))
    geometry = empty_geometry(len(x))
    attempt = FitAttempt(FitStatus.OK, frozenset({UNTRIED}), rings, fit, max_flipped_fraction=1.0, noise=noise)
    ids = np.arange(len(x), dtype=np.int32) if ids is None else ids
    fit_with_fallbacks(arrays, ids, [attempt], geometry)
    return geometry


def geometry_of_graph(jet):
    """What the kernel makes of the derivatives jet[r, q], r times by x and q times by y, at one point of a graph."""
    jets, frame, outputs = (np.zeros((count, LANES)) for count in (16, 9, places.OUTPUT_COUNT))
    jets[:] = np.reshape(jet, (16, 1))
    frame[[0, 4, 8]] = 1.0
    flat = [lane_array(len(table)) for table in (jets, frame, outputs)]
    for target, table in zip(flat, (jets, frame, outputs), strict=True):
        target[:] = table.ravel()
    from_python(kernel.graph_geometry)(*flat[:2], True, flat[2])
    found = flat[2][::LANES]
    return SimpleNamespace(
        normal=found[places.OUT_NORMAL : places.OUT_NORMAL + 3],
        k_min=found[places.OUT_K_MIN],
        k_max=found[places.OUT_K_MAX],
        direction_min=found[places.OUT_DIRECTION_MIN : places.OUT_DIRECTION_MIN + 3],
        direction_max=found[places.OUT_DIRECTION_MAX : places.OUT_DIRECTION_MAX + 3],
        extremality_min=found[places.OUT_EXTREMALITY_MIN],
        extremality_max=found[places.OUT_EXTREMALITY_MAX],
    )
