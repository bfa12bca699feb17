"""Finds flipped and degenerate faces, and reduces moves of vertices that would create them."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.frames import face_normal
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.triangles import longest_squared
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import run_kernel

DEGENERATE_AREA_RATIO = 1e-7  # twice the area over the squared longest edge of a degenerate triangle
MAX_REPAIR_ROUNDS = 60  # far more than any mesh without many bad faces needs
# rings around a bad face whose vertices may be the cause; the result at a vertex depends on a few times as many rings
REPAIR_RINGS = 4
LEAST_SHARE = 0.1  # of a move, below which its vertex stays
NEW_BAD_FACE_WEIGHT = 4  # extra weight of a new bad face over one that was bad before


class BadFaces(NamedTuple):
    """Masks of the bad faces of a mesh."""

    flipped: BoolArray  # (m,): more than 90 degrees away from the mean normal of the faces around
    degenerate: BoolArray  # (m,): without area, practically

    def new_since(self, before: "BadFaces") -> BoolArray:
        """Faces that are newly flipped or newly degenerate, (m,)."""
        result: BoolArray = (self.flipped & ~before.flipped) | (self.degenerate & ~before.degenerate)
        return result


def bad_faces(mesh: PreparedMesh) -> BadFaces:
    """Find the flipped and degenerate faces of a mesh.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.meshes.prepared_mesh import prepare_mesh
    >>> sliver = triangle_mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    >>> bad_faces(prepare_mesh(sliver)).degenerate
    array([ True])
    """
    bad = BadFaces(*np.zeros((2, mesh.face_count), dtype=np.bool_))
    run_kernel(_find, mesh.face_count, mesh.vertices, mesh.faces, mesh.planes.normals, bad)
    return bad


@jit()
def _find(vertices: FloatArray, faces: IntArray, around: FloatArray, bad: BadFaces, start: int, stop: int) -> None:
    """Mark the bad ones among faces start .. stop-1."""
    for f in range(start, stop):
        x, y, z = face_normal(vertices, faces, f)
        against = 0.0
        for k in range(3):
            i = faces[f, k]
            against += x * around[i, 0] + y * around[i, 1] + z * around[i, 2]
        bad.degenerate[f] = np.sqrt(x * x + y * y + z * z) <= DEGENERATE_AREA_RATIO * longest_squared(
            vertices, faces, f
        )
        bad.flipped[f] = against < 0.0 and not bad.degenerate[f]


def repair_flipped_faces(mesh: PreparedMesh, points: FloatArray) -> FloatArray:
    """Reduce the moves of vertices to points (n, 3) where they make bad faces that were good before.

    Returns the final points. Where strong noise has flipped faces everywhere, smaller moves flip other faces: the
    result is the state with the smallest number of bad faces, in which new ones count `NEW_BAD_FACE_WEIGHT` + 1 times;
    it never exceeds the number before.
    """
    before = bad_faces(mesh)
    rows, share, result = mesh.adjacency.vertices, np.ones(mesh.vertex_count), points
    best, fewest = mesh.vertices, int(np.count_nonzero(before.flipped | before.degenerate))
    for _ in range(MAX_REPAIR_ROUNDS):
        bad = bad_faces(mesh.move(result))
        new = bad.new_since(before)
        count = NEW_BAD_FACE_WEIGHT * int(np.count_nonzero(new)) + int(np.count_nonzero(bad.flipped | bad.degenerate))
        if count <= fewest:
            best, fewest = result, count
        if not new.any():
            break
        chosen = np.zeros(mesh.vertex_count, dtype=np.bool_)
        chosen[mesh.faces[new]] = True
        # A bad face whose corners are back at their old positions is flipped by its neighbours: continue through
        # vertices without a move to the first ones with a move.
        spent = np.zeros(mesh.vertex_count, dtype=np.bool_)
        spent[mesh.faces[new & ~share[mesh.faces].any(axis=1)]] = True
        for _ in range(REPAIR_RINGS):
            spent[rows.indices[np.repeat(spent & (share == 0.0), rows.lengths)]] = True
        chosen |= spent
        share[chosen] = np.where(share[chosen] < LEAST_SHARE, 0.0, 0.5 * share[chosen])
        result = mesh.vertices + share[:, np.newaxis] * (points - mesh.vertices)
    return best
