"""Faces of a refined mesh, and the split of chosen edges at their midpoints."""

from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.half_edges import distinct_edges
from bezier_filters.meshes.mesh import TriangleMesh


@dataclass(frozen=True)
class NestedFaces:
    """Faces each of which lies in a face of another mesh."""

    faces: IntArray  # (m, 3)
    parents: IntArray  # (m,): face of the other mesh
    coordinates: FloatArray  # (m, 3, 2): of the corners in it, barycentric, of its second and third corner
    is_new: BoolArray  # (m,): whether the last split made it

    def midpoints(self) -> FloatArray:
        """Coordinates (m, 3, 2) of the midpoints of the edges from each corner to the next."""
        return 0.5 * (self.coordinates + np.roll(self.coordinates, -1, axis=1))


def nest_faces(faces: IntArray) -> NestedFaces:
    """Each face in itself."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    m = len(faces)
    return NestedFaces(faces, np.arange(m, dtype=np.int32), np.tile(corners, (m, 1, 1)), np.ones(m, dtype=np.bool_))


@dataclass(frozen=True)
class FaceEdges:
    """Distinct edges of faces."""

    ends: IntArray  # (e, 2)
    of_face: IntArray  # (m, 3): edge from each corner to the next


def face_edges(faces: IntArray, n: int) -> FaceEdges:
    """Distinct edges of faces (m, 3) between n vertices."""
    ends, edge, _ = distinct_edges(faces, n)
    return FaceEdges(ends, edge.reshape(-1, 3))


def include_longest_edges(mesh: TriangleMesh, edges: FaceEdges, chosen: BoolArray) -> BoolArray:
    """The chosen edges, and with any edge of a face its longest one.

    Splits of these alone, repeated, do not make angles smaller than half of those at the beginning (Rivara, "Algorithms
    for refining triangular grids suitable for adaptive and multigrid techniques", 1984).
    """
    lengths = np.linalg.norm(mesh.vertices[edges.ends[:, 0]] - mesh.vertices[edges.ends[:, 1]], axis=1)
    longest = edges.of_face[np.arange(len(edges.of_face)), lengths[edges.of_face].argmax(axis=1)]
    chosen = chosen.copy()
    while True:
        missing = longest[chosen[edges.of_face].any(axis=1) & ~chosen[longest]]
        if not len(missing):
            return chosen
        chosen[missing] = True


def split_edges(nested: NestedFaces, vertices: FloatArray, edges: FaceEdges, middle: IntArray) -> NestedFaces:
    """Split edges at new vertices `middle` (e,), -1 for edges that stay; the vertices (n, 3) are those before.

    A face with three split edges becomes four, one with two becomes three, by the shorter diagonal of its
    quadrilateral, and one with one becomes two.
    """
    new = middle[edges.of_face]
    count = (new >= 0).sum(axis=1)
    parts = [_rows(replace(nested, is_new=np.zeros(len(nested.faces), dtype=np.bool_)), count == 0)]
    # rotated so that edge 0 is split, and with two split ones edge 2 is not
    first = np.where(count == 2, (new < 0).argmax(axis=1) + 1, (new >= 0).argmax(axis=1)) % 3
    turn = (first[:, np.newaxis] + np.arange(3)) % 3
    row = np.arange(len(turn))[:, np.newaxis]
    corners, places = nested.faces[row, turn], nested.coordinates[row, turn]
    # three corners, then the midpoints of the edges from each to the next
    points = np.hstack([corners, new[row, turn]])
    coordinates = np.concatenate([places, 0.5 * (places + np.roll(places, -1, axis=1))], axis=1)
    position = vertices[corners]
    to_middles = position[:, [0, 1]] + position[:, [1, 2]]  # twice the first two midpoints
    diagonals = np.linalg.norm(to_middles[:, [1, 0]] - 2.0 * position[:, [0, 2]], axis=2)
    from_first = diagonals[:, 0] <= diagonals[:, 1]
    for chosen, templates in (
        (count == 1, ((0, 3, 2), (3, 1, 2))),
        ((count == 2) & from_first, ((3, 1, 4), (0, 3, 4), (0, 4, 2))),
        ((count == 2) & ~from_first, ((3, 1, 4), (0, 3, 2), (3, 4, 2))),
        (count == 3, ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))),
    ):
        rows = np.flatnonzero(chosen)
        for template in templates:
            made = np.ones(len(rows), dtype=np.bool_)
            parts.append(
                NestedFaces(points[rows][:, template], nested.parents[rows], coordinates[rows][:, template], made)
            )
    parents = np.concatenate([part.parents for part in parts])
    order = np.argsort(parents, kind="stable")
    return NestedFaces(
        np.concatenate([part.faces for part in parts])[order].astype(np.int32),
        parents[order],
        np.concatenate([part.coordinates for part in parts])[order],
        np.concatenate([part.is_new for part in parts])[order],
    )


def _rows(nested: NestedFaces, mask: BoolArray) -> NestedFaces:
    return NestedFaces(nested.faces[mask], nested.parents[mask], nested.coordinates[mask], nested.is_new[mask])
