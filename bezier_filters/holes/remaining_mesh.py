"""A mesh without some of its faces, and where its rows were."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh


@dataclass(frozen=True)
class RemainingMesh:
    """A mesh without some faces, and without the vertices that only these had."""

    mesh: PreparedMesh
    old_vertices: IntArray  # (n,): its vertices as rows of the whole mesh
    old_faces: IntArray  # (m,): its faces as rows of the whole mesh
    place: IntArray  # rows of the vertices of the whole mesh in it, -1 for removed ones


def remove_faces(mesh: TriangleMesh, removed: BoolArray) -> RemainingMesh:
    """Remove marked faces (m,)."""
    gone = np.zeros(mesh.vertex_count, dtype=np.bool_)
    gone[mesh.faces[removed]] = True
    gone[mesh.faces[~removed]] = False
    place = np.where(gone, -1, np.cumsum(~gone) - 1).astype(np.int32)
    old_vertices, old_faces = (np.flatnonzero(~rows).astype(np.int32) for rows in (gone, removed))
    rest = TriangleMesh(mesh.vertices[old_vertices], place[mesh.faces[old_faces]])
    return RemainingMesh(prepare_mesh(rest), old_vertices, old_faces, place)
