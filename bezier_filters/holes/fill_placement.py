"""Fills in their mesh: where their vertices and faces go, and what they cut."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.fill_topology import Fill
from bezier_filters.holes.hole_detection import Hole
from bezier_filters.holes.surroundings import Surroundings
from bezier_filters.meshes.frames import unit_face_normals
from bezier_filters.meshes.half_edges import faces_at_edges
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.self_intersections import cut_faces, meeting_box

BULGE = 0.5
"""Times the diameter of a hole: how far its fill may leave the bounding box of the rim."""


@dataclass(frozen=True)
class Piece:
    """Some faces of a mesh with their vertices.

    Attributes
    ----------
    ids : (k,) int
        The vertices, by their rows in the mesh that results; one may be there several times.
    points : (k, 3) float64
        Their coordinates.
    faces : (m, 3) int32
        Places in `ids`.
    """

    ids: IntArray
    points: FloatArray
    faces: IntArray

    def chords(self, limit: int) -> set[tuple[int, int]]:
        """Edges between vertices whose ids are below a limit, the smaller one first."""
        ends = self.ids[self.faces[:, [0, 1, 1, 2, 2, 0]]].reshape(-1, 2)
        ends = ends[(ends < limit).all(axis=1)]
        return {(min(a, b), max(a, b)) for a, b in ends.tolist()}

    def renumbered(self, first: int, new_first: int) -> "Piece":
        """The same with vertices from `first` on numbered from `new_first` on."""
        return replace(self, ids=np.where(self.ids >= first, self.ids + (new_first - first), self.ids))


def piece_of_mesh(mesh: TriangleMesh, face_ids: IntArray) -> Piece:
    """Some faces of a mesh."""
    ids = mesh.faces[face_ids].ravel()
    return Piece(ids, mesh.vertices[ids], np.arange(len(ids), dtype=np.int32).reshape(-1, 3))


def placed(fill: Fill, around: Surroundings, next_vertex: int) -> Piece:
    """A fill as a part of the mesh, its new vertices numbered on from a row."""
    new = np.arange(next_vertex, next_vertex + len(fill.points) - fill.rim_count)
    return Piece(np.concatenate([around.ids[: fill.rim_count], new]), fill.points, fill.faces)


def hole_box(mesh: TriangleMesh, hole: Hole) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner of the box that a fill must not leave, each (3,)."""
    rim = mesh.vertices[np.concatenate(hole.loops)]
    return rim.min(axis=0) - BULGE * hole.diameter, rim.max(axis=0) + BULGE * hole.diameter


def problem_with(piece: Piece, low: FloatArray, high: FloatArray) -> str:
    """What is wrong with a fill by itself, given the box that it must not leave; empty if nothing is."""
    if not np.isfinite(piece.points).all():
        return "coordinates are not finite"
    if not ((piece.points >= low) & (piece.points <= high)).all():
        return "bulges too far from the rim"
    return ""


def count_cuts(piece: Piece, others: Sequence[Piece]) -> int:
    """Number of faces of a piece that cut one of the others or each other."""
    low, high = piece.points.min(axis=0), piece.points.max(axis=0)
    near = [other.faces[meeting_box(other.points, other.faces, low, high)] for other in others]
    corners = [
        (p.ids[f].ravel(), p.points[f.ravel()]) for p, f in zip((*others, piece), (*near, piece.faces), strict=True)
    ]
    ids, points = (np.concatenate(parts) for parts in zip(*corners, strict=True))
    _, first, faces = np.unique(ids, return_index=True, return_inverse=True)
    return int(np.count_nonzero(cut_faces(points[first], faces.reshape(-1, 3).astype(np.int32), len(piece.faces))))


def rim_dihedral(fill: Fill, around: Surroundings) -> float:
    """Mean angle between the faces on both sides of the rim, in degrees."""
    at_rim = fill.faces[np.count_nonzero(fill.faces < fill.rim_count, axis=1) > 1]
    normals = unit_face_normals(fill.points, at_rim)
    angles: list[float] = []
    for loop in around.loops:
        own = normals[faces_at_edges(at_rim, loop, np.roll(loop, -1))]
        half_chord = 0.5 * np.linalg.norm(own - around.normals_beyond(loop), axis=1)
        angles += (2.0 * np.arcsin(np.minimum(half_chord, 1.0))).tolist()
    return degrees(float(np.mean(angles)))
