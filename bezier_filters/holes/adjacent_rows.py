"""Old vertices and faces next to those of fills, whose attributes new ones get where these are not continued."""

import numpy as np
from scipy.spatial import cKDTree

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.half_edges import ends_of_half_edges, faces_at_edges


def nearest_rim_vertices(vertices: FloatArray, new_faces: IntArray, old_count: int) -> IntArray:
    """For each new vertex, from `old_count` on, the nearest old one on a rim, (k,)."""
    rim = np.unique(new_faces[new_faces < old_count])
    nearest = cKDTree(vertices[rim]).query(vertices[old_count:])[1]
    return np.asarray(rim[nearest], dtype=np.int32)


def adjacent_faces(vertices: FloatArray, old_faces: IntArray, new_faces: IntArray) -> IntArray:
    """For each new face an old one that shares an edge with it, or else the nearest one at a rim, (f,)."""
    at_rim = np.zeros(len(vertices), dtype=np.bool_)
    at_rim[new_faces] = True
    near = np.flatnonzero(at_rim[old_faces].any(axis=1)).astype(np.int32)
    centers = vertices[old_faces[near]].mean(axis=1)
    found = near[cKDTree(centers).query(vertices[new_faces].mean(axis=1))[1]]
    starts, ends = ends_of_half_edges(new_faces)
    for across in faces_at_edges(old_faces[near], ends, starts).reshape(-1, 3).T:
        found = np.where(across >= 0, near[across], found)
    return np.asarray(found, dtype=np.int32)
