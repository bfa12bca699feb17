"""Reduces moves of vertices that would make faces intersect."""

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.meshes.intersecting_faces import intersecting_faces
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.smoothing.flipped_faces import LEAST_SHARE, MAX_REPAIR_ROUNDS, repair_flipped_faces


def reduce_intersections(mesh: PreparedMesh, points: FloatArray) -> tuple[FloatArray, int]:
    """Reduce the moves of vertices to points (n, 3) where they make faces intersect and none did before.

    Where faces intersected before, as noise makes them, smoothing removes most intersections and moves some. No face is
    newly flipped or degenerate in return. Returns the final points, those with the fewest new intersecting faces, and
    the number of these faces.
    """
    other = intersecting_faces(mesh.move(points))
    if other.max(initial=-1) < 0:
        return points, 0
    intersected = np.zeros(mesh.vertex_count, dtype=np.bool_)
    intersected[mesh.faces[intersecting_faces(mesh) >= 0]] = True
    moves, share = points - mesh.vertices, np.ones(mesh.vertex_count)
    best, fewest = points, mesh.face_count
    for _ in range(MAX_REPAIR_ROUNDS):
        new = np.flatnonzero((other >= 0) & ~intersected[mesh.faces].any(axis=1))
        if len(new) < fewest:
            best, fewest = points, len(new)
        if len(new) == 0:
            break
        near = np.zeros(mesh.vertex_count, dtype=np.bool_)
        near[mesh.faces[np.concatenate([new, other[new]])]] = True
        share[near] = np.where(share[near] < LEAST_SHARE, 0.0, 0.5 * share[near])
        points = repair_flipped_faces(mesh, mesh.vertices + share[:, np.newaxis] * moves)
        other = intersecting_faces(mesh.move(points))
    return best, fewest
