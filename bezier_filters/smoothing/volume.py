"""Volumes of closed parts of a mesh, and how to keep them."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import face_normal
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.lean import inner_njit, lean_njit

ROUNDS = 4
"""Of Newton's method; the volume is a polynomial that is nearly linear in a small offset."""
EXACT = 1e-14
"""Relative error at which it ends early."""


@dataclass(frozen=True)
class ClosedParts:
    """Connected parts without a border.

    Attributes
    ----------
    of_vertex : (n,) int32
        Number of the closed part that a vertex belongs to, -1 for others.
    of_face : (m,) int32
        The same for faces.
    count : int
        How many there are.
    """

    of_vertex: IntArray
    of_face: IntArray
    count: int


def closed_parts(mesh: TriangleMesh, adjacency: Adjacency) -> ClosedParts:
    """Find the connected parts that enclose a volume: none if the mesh is not an oriented manifold along its edges."""
    n, faces, rows = mesh.vertex_count, mesh.faces, adjacency.vertices
    if not len(faces) or not _is_oriented(faces, adjacency.faces.indptr, adjacency.faces.indices):
        return ClosedParts(np.full(n, -1, np.int32), np.full(len(faces), -1, np.int32), 0)
    graph = csr_array((np.ones(len(rows.indices), np.int8), rows.indices, rows.indptr), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    closed = np.zeros(count, dtype=np.bool_)
    closed[label[faces[:, 0]]] = True
    closed[label[adjacency.on_boundary]] = False
    number = np.where(closed, np.cumsum(closed) - 1, -1).astype(np.int32)
    return ClosedParts(number[label], number[label[faces[:, 0]]], int(closed.sum()))


@lean_njit()
def _is_oriented(faces: IntArray, face_ptr: IntArray, face_indices: IntArray) -> bool:
    """Whether all faces have three vertices and no two of them run through an edge the same way."""
    if 3 * len(faces) != len(face_indices):
        return False
    for i in range(len(face_ptr) - 1):
        for q in range(face_ptr[i], face_ptr[i + 1]):
            for p in range(face_ptr[i], q):
                if _after(faces, face_indices[p], i) == _after(faces, face_indices[q], i):
                    return False
    return True


@inner_njit()
def _after(faces: IntArray, f: int, i: int) -> int:
    """The vertex after vertex i in face f."""
    return int(faces[f, 1] if faces[f, 0] == i else faces[f, 2] if faces[f, 1] == i else faces[f, 0])


def part_volumes(mesh: TriangleMesh, parts: ClosedParts) -> FloatArray:
    """Volume of every closed part, positive if its normals point outwards.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = triangle_mesh(*block_with_sharp_edges(resolution=4))
    >>> part_volumes(block, closed_parts(block, vertex_adjacency(block)))
    array([0.875])
    """
    result = np.zeros(parts.count)
    _add_volumes(mesh.vertices, mesh.faces, parts.of_face, np.full((parts.count, 3), np.nan), result)
    return result


def with_volumes(mesh: TriangleMesh, parts: ClosedParts, volumes: FloatArray, amounts: FloatArray) -> FloatArray:
    """Move vertices along their normals, in proportion to given amounts, so that closed parts have given volumes.

    Parameters
    ----------
    mesh : TriangleMesh
    parts : ClosedParts
        Of the same mesh.
    volumes : (parts,) float64
        What the parts are to enclose.
    amounts : (n,) float64
        At least 0. A part whose amounts are all 0 stays as it is.

    Returns
    -------
    (n, 3) float64
    """
    movable = (parts.of_vertex >= 0) & (amounts > 0.0)
    part = parts.of_vertex[movable]
    current = mesh
    for _ in range(ROUNDS):
        gradient = np.zeros_like(mesh.vertices)
        _add_gradient(current.vertices, mesh.faces, gradient)
        gradient = gradient[movable]
        length = np.sqrt(np.einsum("ij,ij->i", gradient, gradient))
        gained = np.bincount(part, weights=length * amounts[movable], minlength=parts.count)
        wanted = volumes - part_volumes(current, parts)
        if not (np.abs(wanted) > EXACT * np.abs(volumes)).any():
            break
        steps = np.divide(wanted, gained, out=np.zeros(parts.count), where=gained > 0.0)
        factors = np.divide(steps[part] * amounts[movable], length, out=np.zeros(len(part)), where=length > 0.0)
        vertices = current.vertices.copy()
        vertices[movable] += factors[:, np.newaxis] * gradient
        current = TriangleMesh(vertices, mesh.faces)
    return current.vertices


@lean_njit()
def _add_volumes(
    vertices: FloatArray, faces: IntArray, of_face: IntArray, centers: FloatArray, volumes: FloatArray
) -> None:
    """Add the tetrahedra between faces and a point of their part, so that nothing cancels out far from the origin."""
    for f in range(len(faces)):
        part = of_face[f]
        if part < 0:
            continue
        if np.isnan(centers[part, 0]):
            for axis in range(3):
                centers[part, axis] = vertices[faces[f, 0], axis]
        x, y, z = face_normal(vertices, faces, f)
        a = faces[f, 0]
        dx, dy, dz = (
            vertices[a, 0] - centers[part, 0],
            vertices[a, 1] - centers[part, 1],
            vertices[a, 2] - centers[part, 2],
        )
        volumes[part] += (dx * x + dy * y + dz * z) / 6.0


@lean_njit()
def _add_gradient(vertices: FloatArray, faces: IntArray, gradient: FloatArray) -> None:
    """Add the derivative of the volume by every vertex: a third of the vector area around it."""
    for f in range(len(faces)):
        x, y, z = face_normal(vertices, faces, f)
        for k in range(3):
            i = faces[f, k]
            gradient[i, 0] += x / 6.0
            gradient[i, 1] += y / 6.0
            gradient[i, 2] += z / 6.0
