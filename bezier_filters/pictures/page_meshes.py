"""Meshes of a page: around a centre, in units of a length, with few faces, as text."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from bezier_filters.arrays import FloatArray, IntArray, Report
from bezier_filters.holes.hole_filling import HoleFillingResult
from bezier_filters.meshlab.meshset import Mesh, MeshSet, current_mesh, one_at_a_time
from bezier_filters.pictures.page_fields import encode_array


@dataclass(frozen=True)
class Frame:
    """How a mesh is drawn: around a centre (3,), in units of a length."""

    center: FloatArray
    radius: float

    def pack(self, points: FloatArray, indices: IntArray, **more: object) -> Report:
        """Points (k, 3) with faces (m, 3) or edges (e, 2), as the page takes them."""
        around = (points - self.center) / self.radius
        return {
            "points": encode_array(around, "<f4"),
            "indices": encode_array(indices, "<u4"),
            "new_from": None,
            **more,
        }

    def pack_fills(self, result: HoleFillingResult, points: FloatArray, triangles: IntArray) -> Report:
        """The mesh with filled holes: the points and triangles that are drawn of the old mesh, then all new faces."""
        used, corners = np.unique(result.faces[len(result.old_faces) :], return_inverse=True)
        new = corners.reshape(-1, 3).astype(np.int32) + np.int32(len(points))
        all_points, all_faces = np.vstack([points, result.vertices[used]]), np.vstack([triangles, new])
        return self.pack(all_points, all_faces, new_from=triangles.size)


def frame_of(vertices: FloatArray) -> Frame:
    """Frame in which the bounding box of vertices (n, 3) has a half diagonal of 1."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return Frame(0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) or 1.0)


def decimate(vertices: FloatArray, faces: IntArray, most: int) -> tuple[FloatArray, IntArray, IntArray]:
    """Reduce a mesh to a number of faces, or points; also returns the nearest old vertex of each new one."""
    if not len(faces):
        rows = np.arange(0, len(vertices), 1 + (len(vertices) - 1) // most, dtype=np.int32)
        return vertices[rows], faces, rows
    if len(faces) <= most:
        return vertices, faces, np.arange(len(vertices), dtype=np.int32)
    with one_at_a_time():
        ms = MeshSet()
        ms.add_mesh(Mesh(vertices, faces))
        ms.meshing_decimation_quadric_edge_collapse(targetfacenum=most, preserveboundary=True, selected=False)
        mesh = current_mesh(ms)
        points, triangles = np.array(mesh.vertex_matrix()), np.array(mesh.face_matrix(), dtype=np.int32)
    return points, triangles, cKDTree(vertices).query(points)[1].astype(np.int32)
