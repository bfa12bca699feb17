"""The part of a mesh around a hole, as a small mesh of its own."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import unit_face_normals
from bezier_filters.meshes.half_edges import faces_at_edges, half_edge, half_edge_lists
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.triangles import angle_parts, edge_length
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
        return np.flatnonzero(self.faces.min(axis=1, initial=self.rim_count) < self.rim_count).astype(np.int32)

    @cached_property
    def _rim_measures(self) -> tuple[FloatArray, FloatArray]:
        """Sum of the angles of the faces at each rim vertex, and the mean length of its edges, each (r,)."""
        faces, angles, lengths = self.faces[self._faces_at_rim], *np.zeros((2, self.rim_count))
        _measure_rim(self.vertices, faces, *half_edge_lists(faces, len(self.ids)), angles, lengths)
        return angles, lengths

    @property
    def gaps(self) -> FloatArray:
        """Angle that is left for the hole at each rim vertex: 2 pi less those of the faces, in radians."""
        return 2.0 * pi - self._rim_measures[0]

    @property
    def sizes(self) -> FloatArray:
        """Edge length that is wanted at each rim vertex: the mean of its edges."""
        return self._rim_measures[1] if self.wanted_sizes is None else self.wanted_sizes

    @cached_property
    def face_normals(self) -> FloatArray:
        """Unit normals of the faces, zero where a face has no area, (m, 3)."""
        return unit_face_normals(self.vertices, self.faces)

    def normals_beyond(self, loop: IntArray) -> FloatArray:
        """Unit normal of the face beyond the edge that begins at each vertex of a rim, zero without one, (k, 3)."""
        at_rim = self._faces_at_rim
        beyond = faces_at_edges(self.faces[at_rim], np.roll(loop, -1), loop)
        normals = self.face_normals[at_rim[beyond]]
        return np.asarray(np.where((beyond >= 0)[:, np.newaxis], normals, 0.0), dtype=np.float64)


def surroundings_of(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    loops: tuple[IntArray, ...],
    rings: int,
    places: IntArray | None = None,
) -> Surroundings:
    """Collect some rings around loops of vertices.

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
    return Surroundings(ids, ring, mesh.vertices[ids], faces, local_loops)


def with_joined(around: Surroundings, joined: Mapping[int, Iterable[int]]) -> Surroundings:
    """The same where some pairs of vertices of the mesh are joined outside of it; `joined` lists each both ways."""
    place_of = {vertex: k for k, vertex in enumerate(around.ids[: around.rim_count].tolist())}
    pairs = frozenset(
        (k, place_of[other])
        for vertex, k in place_of.items()
        for other in joined.get(vertex, ())
        if place_of.get(other, -1) > k
    )
    return replace(around, joined=pairs) if pairs else around


@lean_njit()
def _measure_rim(
    points: FloatArray, faces: IntArray, first: IntArray, following: IntArray, angles: FloatArray, lengths: FloatArray
) -> None:
    """Write sums of angles and mean lengths of edges at the first vertices, both zero at first."""
    for i in range(angles.shape[0]):
        count = 0
        h = first[i]
        while h >= 0:
            f, k = h // 3, h % 3
            after, before = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            cosine, sine = angle_parts(points, i, after, before)
            angles[i] += np.arctan2(sine, cosine)
            lengths[i] += edge_length(points, i, after)
            count += 1
            if half_edge(faces, first, following, i, before) < 0:  # the edge has no other face
                lengths[i] += edge_length(points, i, before)
                count += 1
            h = following[h]
        lengths[i] /= max(count, 1)


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
