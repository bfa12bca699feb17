"""Triangles that face the wrong way or have no area, and how to have no more of them."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import face_normal, tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.triangles import longest_squared
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import run_kernel

THINNEST = 1e-7  # twice the area over the squared longest edge, from which down a triangle counts as degenerate
MOST_ROUNDS = 60  # after which no more is tried; far more than there have ever been on meshes without many wrong faces
# edges from a face that is wrong to vertices that may be the cause; what happens to a vertex depends on a few times
# as many rings around it
REACH = 4
WORSE = 4  # how many faces that stay wrong weigh as much as one that becomes wrong


class BadFaces(NamedTuple):
    """Faces that are wrong."""

    flipped: BoolArray  # (m,): more than 90 degrees away from the mean normal of the faces around
    degenerate: BoolArray  # (m,): without area, practically

    def new_since(self, before: "BadFaces") -> BoolArray:
        """Faces that are wrong in a way in which they were not before, (m,)."""
        result: BoolArray = (self.flipped & ~before.flipped) | (self.degenerate & ~before.degenerate)
        return result


def bad_faces(mesh: TriangleMesh, adjacency: Adjacency) -> BadFaces:
    """Find the wrong faces of a mesh.

    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> sliver = triangle_mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    >>> bad_faces(sliver, vertex_adjacency(sliver)).degenerate
    array([ True])
    """
    normals = tangent_planes(mesh, adjacency).normals
    bad = BadFaces(*np.zeros((2, mesh.face_count), dtype=np.bool_))
    run_kernel(_find, mesh.face_count, mesh.vertices, mesh.faces, normals, bad)
    return bad


@jit()
def _find(vertices: FloatArray, faces: IntArray, around: FloatArray, bad: BadFaces, start: int, stop: int) -> None:
    """Mark the wrong ones of faces start .. stop-1."""
    for f in range(start, stop):
        x, y, z = face_normal(vertices, faces, f)
        against = 0.0
        for k in range(3):
            i = faces[f, k]
            against += x * around[i, 0] + y * around[i, 1] + z * around[i, 2]
        bad.degenerate[f] = np.sqrt(x * x + y * y + z * z) <= THINNEST * longest_squared(vertices, faces, f)
        bad.flipped[f] = against < 0.0 and not bad.degenerate[f]


def repair_flipped_faces(mesh: TriangleMesh, adjacency: Adjacency, points: FloatArray) -> FloatArray:
    """Take back as much of the moves of vertices to points (n, 3) as makes faces of the mesh wrong that were not.

    Returns where the vertices end. Where strong noise has turned faces everywhere, taking back moves turns others: it
    stops where the faces that are wrong, those that were not before weighed `WORSE` + 1 times, are fewest, and
    they are never more than before.
    """
    before = bad_faces(mesh, adjacency)
    rows, share, result = adjacency.vertices, np.ones(mesh.vertex_count), points
    best, fewest = mesh.vertices, int(np.count_nonzero(before.flipped | before.degenerate))
    for _ in range(MOST_ROUNDS):
        bad = bad_faces(TriangleMesh(result, mesh.faces), adjacency)
        new = bad.new_since(before)
        count = WORSE * int(np.count_nonzero(new)) + int(np.count_nonzero(bad.flipped | bad.degenerate))
        if count <= fewest:
            best, fewest = result, count
        if not new.any():
            break
        chosen = np.zeros(mesh.vertex_count, dtype=np.bool_)
        chosen[mesh.faces[new]] = True
        # A face whose corners are back where they were is turned by those around it: on through vertices that are
        # back to the first that are not.
        spent = np.zeros(mesh.vertex_count, dtype=np.bool_)
        spent[mesh.faces[new & ~share[mesh.faces].any(axis=1)]] = True
        for _ in range(REACH):
            spent[rows.indices[np.repeat(spent & (share == 0.0), rows.lengths)]] = True
        chosen |= spent
        share[chosen] = np.where(share[chosen] < 0.1, 0.0, 0.5 * share[chosen])
        result = mesh.vertices + share[:, np.newaxis] * (points - mesh.vertices)
    return best
