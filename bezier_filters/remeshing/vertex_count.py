"""Remeshing to a number of vertices, and the fewest that a surface can have."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.meshes.half_edges import distinct_edges
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.remeshing.edge_lengths import length_for_count, uniform_sizing
from bezier_filters.remeshing.edge_operations import collapse_edges
from bezier_filters.remeshing.isotropic import WorkingMesh, remesh_surface

COUNT_ROUNDS, COUNT_ITERATIONS = 8, 3  # corrections of the length for a number of vertices, and iterations of each
COUNT_ACCURACY = 0.01  # relative error of the number of vertices that is not corrected
# Part of the faces that may lean away from the surface by more than an angle in degrees: those of an octahedron lean by
# 55 at its corners, and those of meshes that collapse by more than 90.
MAX_LEANING, MAX_LEAN = 0.01, 75.0


def least_vertices(faces: IntArray, n: int) -> int:
    """Fewest vertices of any mesh with the topology of faces (m, 3) between n vertices.

    A closed surface of Euler characteristic x needs (7 + sqrt(49 - 24 x)) / 2 (Heawood, "Map-colour theorem", 1890;
    a triangulation with so few exists but for two surfaces); a component with a border needs three.

    >>> tetrahedron = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], dtype=np.int32)
    >>> least_vertices(tetrahedron, 4), least_vertices(tetrahedron[1:], 4)
    (4, 3)
    """
    ends, _, count = distinct_edges(faces, n)
    graph = coo_array((np.ones(len(ends), np.bool_), (ends[:, 0], ends[:, 1])), shape=(n, n))
    total, label = connected_components(graph, directed=False)
    of_edge, of_face = np.bincount(label[ends[:, 0]], minlength=total), np.bincount(label[faces[:, 0]], minlength=total)
    characteristic = np.bincount(label, minlength=total) - of_edge + of_face
    is_open = np.bincount(label[ends[count == 1, 0]], minlength=total) > 0
    least = np.ceil((7.0 + np.sqrt(np.maximum(49.0 - 24.0 * characteristic, 1.0))) / 2.0)
    return int(np.where(is_open, 3.0, least)[of_face > 0].sum())


def check_vertex_count(wanted: int, faces: IntArray, n: int) -> None:
    """Refuse fewer vertices than a mesh of the topology of faces (m, 3) has."""
    least = least_vertices(collapse_edges(faces, np.arange(n, dtype=np.int32)), n)
    if wanted < least:
        raise InvalidParameterError(
            f"vertex_count: got {wanted}, expected {least:,} or more: fewer cannot have the components, borders and "
            "handles of this surface"
        )


def remesh_to_count(mesh: WorkingMesh, wanted: int, iterations: int) -> WorkingMesh:
    """Remesh with the length that gives a number of vertices, which follows from the numbers for others.

    The mesh stays finer if edges of that length would not follow the surface.
    """
    length, given = length_for_count(mesh.points, mesh.faces, 2.0 * wanted), mesh.copy()
    least = length_for_count(mesh.points, mesh.faces, len(mesh.faces))  # that of the mesh as it is
    remesh_surface(mesh, uniform_sizing(length), iterations)
    may_grow = True
    while length > least and leaning_fraction(mesh) > MAX_LEANING:
        length, mesh, may_grow = length / np.sqrt(2.0), given.copy(), False
        remesh_surface(mesh, uniform_sizing(length), iterations)
    for _ in range(COUNT_ROUNDS):
        ratio = len(mesh.points) / wanted
        if abs(ratio - 1.0) < COUNT_ACCURACY or (ratio > 1.0 and not may_grow):
            break
        length *= float(np.clip(np.sqrt(ratio), 0.5, 2.0))
        before = mesh.copy()
        remesh_surface(mesh, uniform_sizing(length), COUNT_ITERATIONS)
        if length > least and leaning_fraction(mesh) > MAX_LEANING:
            return before
    return mesh


def leaning_fraction(mesh: WorkingMesh) -> float:
    """Part of the faces that lean away from the surface below their middles."""
    if not len(mesh.faces):
        return 0.0
    middles = mesh.points[mesh.faces].mean(axis=1)
    normals = area_vectors(mesh.points, mesh.faces)
    there = mesh.surface.query(middles, progress=mesh.progress.within).normals
    along = np.einsum("md,md->m", normals, there)
    return float(np.mean(along < np.cos(np.radians(MAX_LEAN)) * np.linalg.norm(normals, axis=1)))
