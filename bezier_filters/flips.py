"""Triangles that face the wrong way or have no area, and how to have no more of them."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.adjacency import Adjacency
from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.frames import tangent_planes
from bezier_filters.mesh import TriangleMesh

THINNEST = 1e-7
"""Twice the area over the squared longest edge, from which down a triangle counts as degenerate."""
ROUNDS = 40


@dataclass(frozen=True)
class BadFaces:
    """Faces that are wrong.

    Attributes
    ----------
    flipped : (m,) bool
        More than 90 degrees away from the mean normal of the faces around.
    degenerate : (m,) bool
        Without area, practically.
    """

    flipped: BoolArray
    degenerate: BoolArray

    def new_since(self, before: "BadFaces") -> BoolArray:
        """Faces that are wrong in a way in which they were not before, (m,)."""
        result: BoolArray = (self.flipped & ~before.flipped) | (self.degenerate & ~before.degenerate)
        return result


def bad_faces(mesh: TriangleMesh, adjacency: Adjacency, *, threads: int = 1) -> BadFaces:
    """Find the wrong faces of a mesh.

    Examples
    --------
    >>> from bezier_filters.adjacency import vertex_adjacency
    >>> from bezier_filters.mesh import triangle_mesh
    >>> sliver = triangle_mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    >>> bad_faces(sliver, vertex_adjacency(sliver)).degenerate
    array([ True])
    """
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    longest = np.max([np.square(b - a).sum(axis=1), np.square(c - b).sum(axis=1), np.square(a - c).sum(axis=1)], axis=0)
    degenerate = np.linalg.norm(normals, axis=1) <= THINNEST * longest
    around = tangent_planes(mesh, adjacency, threads=threads).normals[mesh.faces].sum(axis=1)
    flipped = (np.einsum("ij,ij->i", normals, around) < 0.0) & ~degenerate
    return BadFaces(flipped, degenerate)


def without_new_flips(
    mesh: TriangleMesh, adjacency: Adjacency, moved: FloatArray, before: BadFaces, *, threads: int = 1
) -> FloatArray:
    """Take back as much of the moves of vertices (n, 3) as makes faces wrong that were not; return where they end."""
    share = np.ones(mesh.vertex_count)
    result = moved
    for _ in range(ROUNDS):
        now = bad_faces(TriangleMesh(result, mesh.faces), adjacency, threads=threads)
        new = now.new_since(before)
        if not new.any():
            break
        corners = np.unique(mesh.faces[new])
        share[corners] = np.where(share[corners] < 0.1, 0.0, 0.5 * share[corners])
        result = mesh.vertices + share[:, np.newaxis] * (moved - mesh.vertices)
    return result
