"""Volumes of closed parts of a mesh, and how to keep them."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.boundary import half_edge_twins
from bezier_filters.errors import InvalidMeshError
from bezier_filters.mesh import TriangleMesh

ROUNDS = 4
"""Of Newton's method; the volume is a polynomial that is nearly linear in a small offset."""


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


def closed_parts(mesh: TriangleMesh) -> ClosedParts:
    """Find the connected parts that enclose a volume: none if the mesh is not an oriented manifold along its edges."""
    n, faces = mesh.vertex_count, mesh.faces
    nothing = ClosedParts(np.full(n, -1, np.int32), np.full(len(faces), -1, np.int32), 0)
    try:
        twins = half_edge_twins(mesh).reshape(-1, 3)
    except InvalidMeshError:
        return nothing
    if not len(faces):
        return nothing
    edges = faces[:, [0, 1]].T, faces[:, [1, 2]].T
    start, end = (np.concatenate([edges[0][k], edges[1][k]]) for k in (0, 1))
    count, label = connected_components(coo_array((np.ones(len(start)), (start, end)), shape=(n, n)), directed=False)
    has_face, is_open = np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_)
    has_face[label[faces[:, 0]]] = True
    is_open[label[faces[(twins < 0).any(axis=1), 0]]] = True
    closed = has_face & ~is_open
    number = np.where(closed, np.cumsum(closed) - 1, -1).astype(np.int32)
    return ClosedParts(number[label], number[label[faces[:, 0]]], int(closed.sum()))


def part_volumes(mesh: TriangleMesh, parts: ClosedParts) -> FloatArray:
    """Volume of every closed part, positive if its normals point outwards.

    Examples
    --------
    >>> from bezier_filters.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import block_with_sharp_edges
    >>> block = triangle_mesh(*block_with_sharp_edges(resolution=4))
    >>> part_volumes(block, closed_parts(block))
    array([0.875])
    """
    inside = parts.of_face >= 0
    a, b, c = (mesh.vertices[mesh.faces[inside, k]] for k in range(3))
    # About a point of the part itself, so that nothing cancels out far from the origin.
    first = np.zeros((parts.count, 3))
    first[parts.of_face[inside]] = a
    center = first[parts.of_face[inside]]
    sixfold = np.einsum("ij,ij->i", a - center, np.cross(b - center, c - center))
    result: FloatArray = np.bincount(parts.of_face[inside], weights=sixfold, minlength=parts.count) / 6.0
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
        gradient = _volume_gradient(current)[movable]
        length = np.linalg.norm(gradient, axis=1)
        gained = np.bincount(part, weights=length * amounts[movable], minlength=parts.count)
        wanted = volumes - part_volumes(current, parts)
        steps = np.divide(wanted, gained, out=np.zeros(parts.count), where=gained > 0.0)
        factors = np.divide(steps[part] * amounts[movable], length, out=np.zeros(len(part)), where=length > 0.0)
        vertices = current.vertices.copy()
        vertices[movable] += factors[:, np.newaxis] * gradient
        current = TriangleMesh(vertices, mesh.faces)
    return current.vertices


def _volume_gradient(mesh: TriangleMesh) -> FloatArray:
    """Derivative of the volume by every vertex: a third of the vector area around it, (n, 3)."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a) / 6.0
    corners = mesh.faces.ravel()
    columns = [np.bincount(corners, np.repeat(areas[:, k], 3), mesh.vertex_count) for k in range(3)]
    return np.column_stack(columns)
