"""The edges of a mesh, each one once, and the angles at which faces meet there."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.half_edges import distinct_edges
from bezier_filters.meshes.mesh import TriangleMesh


@dataclass(frozen=True)
class MeshEdges:
    """The distinct edges of a mesh; those of faces that name a vertex twice are left out."""

    vertices: IntArray  # (e, 2): their ends, the smaller one first; rows in ascending order
    # (m, 3): number of the edge from each corner of a face to the next; -1 where the face names a vertex twice
    of_faces: IntArray
    # (e,): angle between the normals of the two faces, in radians, 0 to pi: 0 where the surface is flat, where there
    # are not just two faces, and where a face has no area
    angles: FloatArray
    is_convex: BoolArray  # (e,): whether the faces bend away from the outside
    # (e,): length across the edge of the part of its faces that is nearer to it than to their other edges: two thirds
    # of their area over the length of the edge, a third of each height
    widths: FloatArray


def dihedral_angles(normals: FloatArray, others: FloatArray) -> FloatArray:
    """Angles between unit normals (k, 3), in radians: by their chord, which is accurate where they are nearly equal."""
    half_chord = 0.5 * np.linalg.norm(normals - others, axis=1)
    return np.asarray(2.0 * np.arcsin(np.minimum(half_chord, 1.0)), dtype=np.float64)


def mesh_edges(mesh: TriangleMesh) -> MeshEdges:
    """Find the edges of a mesh.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> ridge = triangle_mesh([[0, 0, 0], [0, 1, 0], [1, 0, -1], [-1, 0, -1]], [[0, 2, 1], [0, 1, 3]])
    >>> edges = mesh_edges(ridge)
    >>> edges.vertices[0], np.degrees(edges.angles[0]).round(), edges.is_convex[0]
    (array([0, 1], dtype=int32), np.float64(90.0), np.True_)
    """
    faces = mesh.faces
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    vertices, number, count = distinct_edges(faces[proper], mesh.vertex_count)
    of_faces = np.full((len(faces), 3), -1, dtype=np.int32)
    of_faces[proper] = number.reshape(-1, 3)

    corners = mesh.vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled_areas = np.linalg.norm(normals, axis=1)
    known = doubled_areas > 0.0
    normals[known] /= doubled_areas[known, np.newaxis]
    lengths = np.linalg.norm(mesh.vertices[vertices[:, 1]] - mesh.vertices[vertices[:, 0]], axis=1)
    area = np.bincount(number, weights=np.repeat(doubled_areas[proper], 3), minlength=len(vertices))
    widths = np.divide(area, 3.0 * lengths, out=np.zeros(len(vertices)), where=lengths > 0.0)

    # The two half-edges of each edge that has two.
    order = np.argsort(number, kind="stable")
    is_inner = count == 2
    first = order[(np.cumsum(count) - count)[is_inner]]
    second = order[(np.cumsum(count) - count)[is_inner] + 1]
    face_ids = np.flatnonzero(proper)
    own, other = face_ids[first // 3], face_ids[second // 3]
    angles, is_convex = np.zeros(len(vertices)), np.zeros(len(vertices), dtype=np.bool_)
    angles[is_inner] = np.where(known[own] & known[other], dihedral_angles(normals[own], normals[other]), 0.0)
    tips = faces[other, (second + 2) % 3]
    is_convex[is_inner] = np.einsum("ij,ij->i", mesh.vertices[tips] - corners[own, 0], normals[own]) < 0.0
    return MeshEdges(vertices, of_faces, angles, is_convex, widths)
