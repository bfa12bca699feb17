"""The part of a mesh around a hole, as a small mesh of its own."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np

from bezier_filters.adjacency import Adjacency
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.mesh import TriangleMesh


@dataclass(frozen=True)
class Surroundings:
    """Some rings of a mesh around a hole. All indices but `ids` are places in `ids`.

    Attributes
    ----------
    ids : (b,) int32
        Vertices of the mesh, ordered by ring, the rim first.
    rings : (b,) int32
        How many edges each vertex is away from the rim.
    vertices : (b, 3) float64
        Their coordinates.
    faces : (m, 3) int32
        Faces with a vertex less than the largest number of rings away.
    loops : tuple of (k,) int32
        The rims of the hole and of its islands, in the direction of the faces that fill it.
    joined : frozenset of (int, int)
        Pairs of rim vertices that are joined outside these faces, by the fill of another hole; the smaller first.
    wanted_sizes : (r,) float64, optional
        Edge lengths that are wanted at the rim vertices, if not those of the faces.
    """

    ids: IntArray
    rings: IntArray
    vertices: FloatArray
    faces: IntArray
    loops: tuple[IntArray, ...]
    joined: frozenset[tuple[int, int]] = frozenset()
    wanted_sizes: FloatArray | None = None

    @property
    def rim_count(self) -> int:
        """Number of vertices of all rims."""
        return int(np.count_nonzero(self.rings == 0))

    @cached_property
    def rim_edges(self) -> frozenset[tuple[int, int]]:
        """Edges between rim vertices that are there already, the smaller vertex first: no fill may join them again."""
        ends = self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        ends = np.sort(ends[(ends < self.rim_count).all(axis=1)], axis=1)
        return self.joined | {(int(a), int(b)) for a, b in ends}

    @cached_property
    def gaps(self) -> FloatArray:
        """Angle that is left for the hole at each rim vertex: 2 pi less those of the faces, in radians."""
        tips, left, right = (self.vertices[np.roll(self.faces, -k, axis=1)] for k in range(3))
        u, v = left - tips, right - tips
        angles = np.arctan2(np.linalg.norm(np.cross(u, v), axis=2), np.einsum("fkj,fkj->fk", u, v))
        sums = np.bincount(self.faces.ravel(), weights=angles.ravel(), minlength=len(self.ids))
        return np.asarray(2.0 * pi - sums[: self.rim_count], dtype=np.float64)

    @cached_property
    def sizes(self) -> FloatArray:
        """Edge length that is wanted at each rim vertex: the mean of its edges."""
        if self.wanted_sizes is not None:
            return self.wanted_sizes
        ends = self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        ends = np.unique(np.sort(ends, axis=1), axis=0)
        lengths = np.linalg.norm(self.vertices[ends[:, 0]] - self.vertices[ends[:, 1]], axis=1)
        count = np.bincount(ends.ravel(), minlength=len(self.ids))
        total = np.bincount(ends.ravel(), weights=np.repeat(lengths, 2), minlength=len(self.ids))
        return np.asarray(total / np.maximum(count, 1), dtype=np.float64)[: self.rim_count]

    @cached_property
    def face_normals(self) -> FloatArray:
        """Unit normals of the faces, zero where a face has no area, (m, 3)."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        result: FloatArray = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
        return result

    def normals_beyond(self, loop: IntArray) -> FloatArray:
        """Unit normal of the face beyond the edge that begins at each vertex of a rim, zero without one, (k, 3)."""
        at_rim = np.flatnonzero(np.count_nonzero(self.faces < self.rim_count, axis=1) > 1)
        face_of = {
            (a, b): face
            for face, (i, j, k) in zip(at_rim.tolist(), self.faces[at_rim].tolist(), strict=True)
            for a, b in ((i, j), (j, k), (k, i))
        }
        backwards = zip(np.roll(loop, -1).tolist(), loop.tolist(), strict=True)
        beyond = np.array([face_of.get(pair, -1) for pair in backwards])
        return np.asarray(np.where((beyond >= 0)[:, np.newaxis], self.face_normals[beyond], 0.0), dtype=np.float64)


def surroundings_of(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    loops: tuple[IntArray, ...],
    rings: int,
    joined: Mapping[int, Iterable[int]] | None = None,
) -> Surroundings:
    """Collect some rings around loops of vertices, of which some pairs may be joined outside the mesh, too.

    Examples
    --------
    >>> from bezier_filters.adjacency import vertex_adjacency
    >>> from bezier_filters.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import cylinder
    >>> tube = cylinder()
    >>> mesh = triangle_mesh(tube.vertices, tube.faces)
    >>> adjacency = vertex_adjacency(mesh)
    >>> end = np.flatnonzero(adjacency.on_boundary & (mesh.vertices[:, 2] > 0.0))
    >>> around = surroundings_of(mesh, adjacency, (end,), 2)
    >>> around.rings.max(), around.rim_count == len(end)
    (np.int32(2), True)
    """
    level = [np.unique(np.concatenate(loops))]
    known = level[0]
    for _ in range(rings):
        if len(level[-1]) == 0:
            break
        reached = np.unique(np.concatenate([adjacency.vertices.row(i) for i in level[-1]]))
        level.append(np.setdiff1d(reached, known, assume_unique=True))
        known = np.union1d(known, level[-1])
    ids = np.concatenate(level).astype(np.int32)
    ring = np.repeat(np.arange(len(level), dtype=np.int32), [len(part) for part in level])
    inner = ids[ring < max(rings, 1)]
    face_ids = np.unique(np.concatenate([adjacency.faces.row(i) for i in inner]))
    place, order = np.sort(ids), np.argsort(ids)

    def local(vertices: IntArray) -> IntArray:
        return order[np.searchsorted(place, vertices)].astype(np.int32)

    faces = local(mesh.faces[face_ids])
    place_of = {vertex: k for k, vertex in enumerate(level[0].tolist())}
    pairs = frozenset(
        (k, place_of[other])
        for vertex, k in place_of.items()
        for other in (joined or {}).get(vertex, ())
        if place_of.get(other, -1) > k
    )
    return Surroundings(ids, ring, mesh.vertices[ids], faces, tuple(local(loop) for loop in loops), pairs)
