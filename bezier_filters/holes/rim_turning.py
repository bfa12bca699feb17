"""The turning of a rim, estimated from the surface some rings away from it.

The total geodesic curvature of a border is a sum over the angles at its vertices, which noise of the border changes.
By Gauss-Bonnet, that of a closed curve around it differs from it by the curvature of the annulus between them, and has
nothing of the noise. It is extrapolated from two curves to the border.
"""

from math import pi

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import IntArray
from bezier_filters.holes.loops import angle_sums
from bezier_filters.meshes.neighbourhoods import SearchWorkspace, rings_around
from bezier_filters.meshes.prepared_mesh import PreparedMesh

# Rings between the border and the nearer curve, and between the curves. Noise of the border changes the faces of the
# first ring, and near a ragged border there may be no simple curve. Of 384 holes with noise of up to half an edge and
# borders that are ragged by up to three edges none counts as an outer rim, 12 with 4 rings at most, 46 with 2.
NEAR_RINGS, RINGS_BETWEEN = range(2, 9), 2


def smooth_turning(mesh: PreparedMesh, loop: IntArray, room: SearchWorkspace) -> float | None:
    """Total geodesic curvature of a border loop as its surface sees it, from the surface around it, in radians.

    None if no simple curve goes around it, away from other borders.
    """
    nearest = None
    for rings in NEAR_RINGS:
        near, far = (_turning_beyond(mesh, loop, k, room) for k in (rings, rings + RINGS_BETWEEN))
        if near is not None and far is not None:
            return near + (near - far) * rings / RINGS_BETWEEN
        nearest = near if nearest is None else nearest
    return nearest


def _turning_beyond(mesh: PreparedMesh, loop: IntArray, rings: int, room: SearchWorkspace) -> float | None:
    """The same of the curve so many rings away from the loop."""
    ids, distances = rings_around(mesh.adjacency.vertices, np.unique(loop), rings, room)
    inside, curve = ids[distances < rings], ids[distances == rings]
    if len(curve) == 0 or mesh.adjacency.on_boundary[curve].any():
        return None
    near = np.unique(mesh.adjacency.faces.of(inside))
    beyond = np.setdiff1d(mesh.adjacency.faces.of(curve), near)
    members, places = np.unique(mesh.faces[np.concatenate([near, beyond])], return_inverse=True)
    faces, on_curve = places.reshape(-1, 3).astype(np.int32), np.isin(members, curve)
    sides, counts = np.unique(
        np.sort(faces[: len(near), [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0, return_counts=True
    )
    edges = sides[(counts == 1) & on_curve[sides].all(axis=1)]
    ends, degrees = np.unique(edges, return_counts=True)
    if not (len(beyond) and len(ends) and (degrees == 2).all()):
        return None
    graph = csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(len(members), len(members)))
    if len(np.unique(connected_components(graph, directed=False)[1][ends])) > 1:
        return None
    angles = angle_sums(mesh.vertices[members], faces[len(near) :], len(members))
    return float(pi * len(ends) - angles[ends].sum())
