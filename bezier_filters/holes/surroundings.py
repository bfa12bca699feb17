"""The part of a mesh around a hole, as a small mesh of its own."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.lean import lean_njit


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
    def _faces_at_rim(self) -> IntArray:
        """Numbers of the faces with a vertex on the rim."""
        return np.flatnonzero((self.faces < self.rim_count).any(axis=1)).astype(np.int32)

    @cached_property
    def gaps(self) -> FloatArray:
        """Angle that is left for the hole at each rim vertex: 2 pi less those of the faces, in radians."""
        faces = self.faces[self._faces_at_rim]
        tips, left, right = (self.vertices[faces[:, [k, (k + 1) % 3, (k + 2) % 3]].T] for k in range(3))
        u, v = left - tips, right - tips
        angles = np.arctan2(np.linalg.norm(np.cross(u, v), axis=2), np.einsum("kfj,kfj->kf", u, v))
        sums = np.bincount(faces.ravel(), weights=angles.T.ravel(), minlength=len(self.ids))
        return np.asarray(2.0 * pi - sums[: self.rim_count], dtype=np.float64)

    @cached_property
    def sizes(self) -> FloatArray:
        """Edge length that is wanted at each rim vertex: the mean of its edges."""
        if self.wanted_sizes is not None:
            return self.wanted_sizes
        faces = self.faces[self._faces_at_rim]
        starts, ends = faces.ravel().astype(np.int64), faces[:, [1, 2, 0]].ravel()
        edges = np.unique(np.minimum(starts, ends) * len(self.ids) + np.maximum(starts, ends))
        ends = np.stack(np.divmod(edges, len(self.ids)), axis=1)
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
        at_rim = self._faces_at_rim
        beyond = faces_at_edges(self.faces[at_rim], np.roll(loop, -1), loop)
        normals = self.face_normals[at_rim[beyond]]
        return np.asarray(np.where((beyond >= 0)[:, np.newaxis], normals, 0.0), dtype=np.float64)


def faces_at_edges(faces: IntArray, starts: IntArray, ends: IntArray) -> IntArray:
    """Which of some faces (m, 3) runs along each edge from start to end, -1 if none does, (k,).

    Examples
    --------
    >>> faces_at_edges(np.array([[0, 1, 2], [2, 1, 3]]), np.array([2, 1, 1]), np.array([1, 2, 0]))
    array([ 1,  0, -1], dtype=int32)
    """
    if len(faces) == 0:
        return np.full(len(starts), -1, dtype=np.int32)
    n = 1 + max(int(faces.max()), int(starts.max(initial=0)), int(ends.max(initial=0)))
    keys = (faces.astype(np.int64) * n + faces[:, [1, 2, 0]]).ravel()
    order = np.argsort(keys, kind="stable")
    wanted = starts.astype(np.int64) * n + ends
    place = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
    return np.where(keys[place] == wanted, place // 3, -1).astype(np.int32)


def surroundings_of(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    loops: tuple[IntArray, ...],
    rings: int,
    joined: Mapping[int, Iterable[int]] | None = None,
    places: IntArray | None = None,
) -> Surroundings:
    """Collect some rings around loops of vertices, of which some pairs may be joined outside the mesh, too.

    `places`, -1 for every vertex of the mesh, is work space that many calls can share; it is left as it was.

    Examples
    --------
    >>> from bezier_filters.meshes.adjacency import vertex_adjacency
    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.surfaces import cylinder
    >>> tube = cylinder()
    >>> mesh = triangle_mesh(tube.vertices, tube.faces)
    >>> adjacency = vertex_adjacency(mesh)
    >>> end = np.flatnonzero(adjacency.on_boundary & (mesh.vertices[:, 2] > 0.0))
    >>> around = surroundings_of(mesh, adjacency, (end,), 2)
    >>> around.rings.max(), around.rim_count == len(end)
    (np.int32(2), True)
    """
    places = np.full(mesh.vertex_count, -1, dtype=np.int32) if places is None else places
    level = [np.unique(np.concatenate(loops)).astype(np.int32)]
    count = len(level[0])
    places[level[0]] = np.arange(count)
    neighbours, own_faces = adjacency.vertices, adjacency.faces
    for _ in range(rings):
        room = np.empty(int(neighbours.lengths_of(level[-1]).sum()), dtype=np.int32)
        reached = _reach(neighbours.indptr, neighbours.indices, level[-1], count, places, room)
        level.append(room[:reached])
        count += reached
    ids = np.concatenate(level)
    ring = np.repeat(np.arange(len(level), dtype=np.int32), [len(part) for part in level])
    inner = ids[ring < max(rings, 1)]
    room = np.empty(int(own_faces.lengths_of(inner).sum()), dtype=np.int32)
    face_ids = np.sort(room[: _first_met(own_faces.indptr, own_faces.indices, mesh.faces, inner, places, room)])
    faces = places[mesh.faces[face_ids]]
    local_loops = tuple(places[loop] for loop in loops)
    places[ids] = -1
    place_of = {vertex: k for k, vertex in enumerate(level[0].tolist())}
    pairs = frozenset(
        (k, place_of[other])
        for vertex, k in place_of.items()
        for other in (joined or {}).get(vertex, ())
        if place_of.get(other, -1) > k
    )
    return Surroundings(ids, ring, mesh.vertices[ids], faces, local_loops, pairs)


@lean_njit()
def _reach(
    indptr: IntArray, indices: IntArray, level: IntArray, count: int, places: IntArray, reached: IntArray
) -> int:
    """List the neighbours of some vertices that have no place yet, and give them the next ones from `count` on."""
    found = 0
    for i in level:
        for j in indices[indptr[i] : indptr[i + 1]]:
            if places[j] < 0:
                places[j] = count + found
                reached[found] = j
                found += 1
    return found


@lean_njit()
def _first_met(
    indptr: IntArray, indices: IntArray, faces: IntArray, ids: IntArray, places: IntArray, met: IntArray
) -> int:
    """List the faces at some vertices, each at the first of its corners."""
    found = 0
    for i in ids:
        for f in indices[indptr[i] : indptr[i + 1]]:
            if places[i] == min(places[faces[f, 0]], places[faces[f, 1]], places[faces[f, 2]]):
                met[found] = f
                found += 1
    return found
