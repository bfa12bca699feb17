"""The patch at one vertex, for inspection."""

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.errors import InvalidParameterError, is_integer
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import farthest_direction, tangent_planes
from bezier_filters.meshes.mesh import takes_meshes, triangle_mesh
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.neighbourhoods import MAX_NEIGHBOURHOOD_RINGS, collect_ring
from bezier_filters.patches.patch import BezierPatch
from bezier_filters.patches.patch_fit import PatchFit, fit_patch
from bezier_filters.patches.smoothness import Smoothness


@takes_meshes
def vertex_patch(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None,
    vertex: int,
    *,
    rings: int = 2,
    alpha: float = 0.8,
    degree: int = 3,
    smoothness: Smoothness = "third_order",
) -> BezierPatch:
    """Fit the patch that `estimate_vertex_geometry` fits at one vertex, without its fallbacks.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    vertex : int
        Index of the vertex.
    rings, alpha, degree, smoothness
        See `estimate_vertex_geometry`; numbers only.

    Returns
    -------
    BezierPatch

    Raises
    ------
    InvalidParameterError
        If the vertex has no tangent plane or its neighbourhood does not determine a patch.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere()
    >>> patch = vertex_patch(ball.vertices, ball.faces, 7)
    >>> u, v = patch.parameters(ball.vertices[7:8])
    >>> bool(np.linalg.norm(patch.evaluate(u, v) - ball.vertices[7]) < 1e-4)
    True
    """
    mesh = triangle_mesh(vertices, faces)
    if not (is_integer(vertex) and 0 <= vertex < mesh.vertex_count):
        raise InvalidParameterError(f"vertex: got {vertex!r}, expected an integer from 0 to {mesh.vertex_count - 1}")
    if not (is_integer(rings) and 1 <= rings <= MAX_NEIGHBOURHOOD_RINGS):
        raise InvalidParameterError(f"rings: got {rings!r}, expected an integer from 1 to {MAX_NEIGHBOURHOOD_RINGS}")
    adjacency = vertex_adjacency(mesh)
    normal = tangent_planes(mesh, adjacency).normals[vertex]
    members = np.empty(mesh.vertex_count + 1, dtype=np.int32)
    rows = adjacency.vertices
    visited, barriers = np.zeros((2, mesh.vertex_count), dtype=np.bool_)
    count, _ = collect_ring(rows.indptr, rows.indices, barriers, vertex, rings, visited, members)
    valence = len(rows.row(vertex))
    x_axis = np.array(farthest_direction(mesh.vertices, members, valence, count, *normal))
    if not (normal.any() and x_axis.any()):
        raise InvalidParameterError(f"vertex: {vertex} has no tangent plane")
    axes = np.array([x_axis, np.cross(normal, x_axis), normal])
    return fit_patch(mesh.vertices[members[:count]], mesh.vertices[vertex], axes, PatchFit(degree, alpha, smoothness))
