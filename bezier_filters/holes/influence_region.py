"""The influence region of a hole: rings of the mesh around it as a small mesh of its own, and what is known there."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import pi

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.estimation.estimate import geometry_where
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.frames import unit_face_normals
from bezier_filters.meshes.half_edges import HalfEdgeLists, face_at_edge, half_edge_lists, normals_along
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.neighbourhoods import rings_around, search_room
from bezier_filters.meshes.triangles import angle_parts, edge_length
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.runtime.jit import jit, short_jit

RINGS = 5  # around a hole, from which its fill follows
# of an edge, from which on points are fitted rather than interpolated: face normals are some 4 degrees off then
NOISE = 0.05
# points that a surface is fitted to, by the number of edges of the rim
POINTS_PER_EDGE, FEWEST_POINTS, MOST_POINTS = 3, 60, 300
NOISY_POINTS = 350  # the same for any rim on noisy meshes, where more points tell more
NEAR = 0.75  # share of these that the rim and the first ring may take


@dataclass(frozen=True)
class InfluenceRegion:
    """Some rings of a mesh around a hole. All indices but `ids` are places in `ids`."""

    ids: IntArray  # (b,): vertices of the mesh, ordered by ring, the rim first
    rings: IntArray  # (b,): how many edges each vertex is away from the rim
    vertices: FloatArray  # (b, 3): their coordinates
    faces: IntArray  # (m, 3): faces with a vertex less than the largest number of rings away
    # each (k,): the rims of the hole and of its islands, in the direction of the faces that fill it
    loops: tuple[IntArray, ...]
    # (p, 2): pairs of rim vertices that are joined outside these faces, by the fill of another hole
    joined: IntArray = field(default_factory=lambda: np.empty((0, 2), dtype=np.int32))
    # (r,): edge lengths that are wanted at the rim vertices, if not those of the faces
    wanted_sizes: FloatArray | None = None
    noise_free: FloatArray | None = None  # (b, 3): the coordinates without their noise, if that hides sharp edges

    @property
    def shape(self) -> FloatArray:
        """Coordinates by which edges are sharp or not, (b, 3)."""
        return self.vertices if self.noise_free is None else self.noise_free

    @cached_property
    def rim_count(self) -> int:
        """Number of vertices of all rims."""
        return int(np.count_nonzero(self.rings == 0))

    @property
    def rim_vertices(self) -> FloatArray:
        """Coordinates of the vertices of all rims, (r, 3)."""
        return self.vertices[: self.rim_count]

    @property
    def has_simple_rim(self) -> bool:
        """Whether there is one loop, without islands, that passes no vertex twice."""
        return len(self.loops) == 1 and len(self.loops[0]) == self.rim_count

    @cached_property
    def rim_edges(self) -> IntArray:
        """Edges between rim vertices that are there already, (p, 2): no fill may join them again."""
        return np.concatenate([self.joined, vertex_pairs(self.faces, self.rim_count)])

    @cached_property
    def _half_edges(self) -> HalfEdgeLists:
        return half_edge_lists(self.faces, len(self.ids))

    @cached_property
    def _at_rim(self) -> tuple[FloatArray, FloatArray]:
        """Gap and mean length of the edges of each rim vertex."""
        gaps, sizes = np.full(self.rim_count, 2.0 * pi), np.zeros(self.rim_count)
        _measure_rim(self.vertices, self.faces, self._half_edges, gaps, sizes, np.zeros(self.rim_count))
        return gaps, sizes

    @property
    def gaps(self) -> FloatArray:
        """Angle that is left for the hole at each rim vertex: 2 pi less those of the faces, in radians."""
        return self._at_rim[0]

    @property
    def sizes(self) -> FloatArray:
        """Edge length that is wanted at each rim vertex: the mean of its edges."""
        return self._at_rim[1] if self.wanted_sizes is None else self.wanted_sizes

    @cached_property
    def face_normals(self) -> FloatArray:
        """Unit normals of the faces, zero where a face has no area, (m, 3)."""
        return unit_face_normals(self.vertices, self.faces)

    def normals_beyond(self, loop: IntArray) -> FloatArray:
        """Unit normal of the face beyond the edge that begins at each vertex of a rim, zero without one, (k, 3)."""
        return normals_along(self.vertices, self.faces, self._half_edges, loop, beyond=True)

    def is_noisy(self, noise: float | None) -> bool:
        """Whether noise of that size, a length, is so large that points around the hole are fitted."""
        return noise is not None and noise > NOISE * float(self.sizes.mean())

    def with_joined(self, joined: IntArray) -> "InfluenceRegion":
        """The same where some pairs of vertices of the mesh, (p, 2), are joined outside."""
        rim = self.ids[: self.rim_count]
        pairs = joined[np.isin(joined, rim).all(axis=1)]
        by_id = np.argsort(rim)
        places = by_id[np.searchsorted(rim, pairs, sorter=by_id)].astype(np.int32)
        return replace(self, joined=places) if len(pairs) else self


def influence_regions(
    mesh: TriangleMesh, adjacency: Adjacency, holes: Sequence[tuple[IntArray, ...]], rings: int = RINGS
) -> list[InfluenceRegion]:
    """Collect some rings, one or more, around the loops of each hole."""
    # Of work space for the whole mesh no more is touched than what the regions need.
    room, place = search_room(mesh.vertex_count), np.empty(mesh.vertex_count, dtype=np.int32)
    is_met, met = np.zeros(mesh.face_count, dtype=np.bool_), np.empty(mesh.face_count, dtype=np.int32)
    regions = []
    for loops in holes:
        ids, ring = rings_around(adjacency.vertices, np.unique(np.concatenate(loops)), rings, room)
        count = _meet_faces(adjacency.faces.indptr, adjacency.faces.indices, ids[ring < rings], is_met, met)
        place[ids] = np.arange(len(ids), dtype=np.int32)
        faces, own = place[mesh.faces[np.sort(met[:count])]], tuple(place[loop] for loop in loops)
        regions.append(InfluenceRegion(ids, ring, mesh.vertices[ids], faces, own))
    return regions


@jit()
def _meet_faces(indptr: IntArray, indices: IntArray, vertices: IntArray, is_met: BoolArray, met: IntArray) -> int:
    """Write the faces at some vertices, each once; return how many. No face is marked before and after."""
    count = 0
    for i in vertices:
        for q in range(indptr[i], indptr[i + 1]):
            if not is_met[indices[q]]:
                is_met[indices[q]] = True
                met[count] = indices[q]
                count += 1
    for k in range(count):
        is_met[met[k]] = False
    return count


def vertex_pairs(faces: IntArray, limit: int) -> IntArray:
    """Edges of faces (m, 3) between vertices below a limit, (p, 2); those of two faces are there twice."""
    pairs = np.empty((faces.size, 2), dtype=np.int32)
    return pairs[: _write_pairs(faces, limit, pairs)]


@short_jit()
def _write_pairs(faces: IntArray, limit: int, pairs: IntArray) -> int:
    count = 0
    for f in range(faces.shape[0]):
        for k in range(3):
            a, b = faces[f, k], faces[f, (k + 1) % 3]
            if a < limit and b < limit:
                pairs[count, 0], pairs[count, 1] = a, b
                count += 1
    return count


@short_jit()
def _measure_rim(
    points: FloatArray, faces: IntArray, lists: HalfEdgeLists, gaps: FloatArray, sizes: FloatArray, edges: FloatArray
) -> None:
    """Subtract the angles at the first vertices from gaps, and write the mean lengths of their edges; others are 0."""
    for f in range(faces.shape[0]):
        for k in range(3):
            here, after, before = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            if here >= gaps.shape[0]:
                continue
            cosine, sine = angle_parts(points, here, after, before)
            gaps[here] -= np.arctan2(sine, cosine)
            # Each edge is met once: as that to the corner after this one, and before it if it has no other face.
            sizes[here] += edge_length(points, here, after)
            edges[here] += 1.0
            if face_at_edge(faces, lists, here, before) < 0:
                sizes[here] += edge_length(points, here, before)
                edges[here] += 1.0
    for i in range(sizes.shape[0]):
        sizes[i] /= max(edges[i], 1.0)


@dataclass(frozen=True)
class KnownSurface:
    """What is known of a mesh around its holes."""

    normals: FloatArray  # (n, 3): of the Bezier patches at the points that surfaces are fitted to, zero elsewhere
    noise: float | None  # standard deviation of its noise, a length; None if it could not be learned
    regions: list[InfluenceRegion]  # with their shape


def known_surface(
    mesh: TriangleMesh, adjacency: Adjacency, regions: list[InfluenceRegion], noise: float | None
) -> KnownSurface:
    """Find out what is known around holes; the noise is learned if it is not given."""
    if not regions:
        return KnownSurface(np.zeros_like(mesh.vertices), noise, regions)
    fitted: list[IntArray] = []

    def select(learned: float | None) -> BoolArray:
        sigma = learned if noise is None else noise
        fitted.extend(region.ids[fitted_points(region, noisy=region.is_noisy(sigma))] for region in regions)
        selected = np.zeros(mesh.vertex_count, dtype=np.bool_)
        selected[np.concatenate(fitted)] = True
        return selected

    geometry = geometry_where(mesh, adjacency, select)
    normals = np.zeros_like(mesh.vertices)
    for ids in fitted:
        normals[ids] = geometry.normals[ids]
    shape = geometry.noise_free
    if shape is not None:
        regions = [replace(region, noise_free=shape[region.ids]) for region in regions]
    return KnownSurface(normals, geometry.noise_sigma if noise is None else noise, regions)


def fitted_points(region: InfluenceRegion, known: BoolArray | None = None, *, noisy: bool) -> IntArray:
    """Places of the points that a surface is fitted to, among those that are known."""
    ids = np.arange(len(region.ids)) if known is None else np.flatnonzero(known)
    most = NOISY_POINTS if noisy else min(max(POINTS_PER_EDGE * region.rim_count, FEWEST_POINTS), MOST_POINTS)
    if len(ids) > most:
        ids = ids[farthest_points(region.vertices[ids], region.rings[ids] <= (-1 if noisy else 1), most)]
    return ids.astype(np.int32)


def farthest_points(points: FloatArray, near: BoolArray, most: int) -> IntArray:
    """Places of `most` of some points, far from each other: first those that are near, up to a share, then all others.

    The nearest points settle how the fill joins, the others how the surface curves. Each further point is the one that
    is farthest from those taken before, so that the choice follows from where the points are, not from their order.

    >>> line = np.arange(6.0)[:, np.newaxis] * [1.0, 0.0, 0.0]
    >>> farthest_points(line, np.arange(6) < 2, 3)
    array([0, 1, 5], dtype=int32)
    """
    distances, taken = np.square(points - points.mean(axis=0)).sum(axis=1), np.zeros(len(points), dtype=np.bool_)
    _take_farthest(points, near, int(NEAR * most), most, distances, taken)
    return np.flatnonzero(taken).astype(np.int32)


@jit()
def _take_farthest(
    points: FloatArray, near: BoolArray, most_near: int, most: int, distances: FloatArray, taken: BoolArray
) -> None:
    """Take some of the points; `distances` are those to the points taken before, squared."""
    count = 0
    while count < most:
        farthest = -1
        for i in range(points.shape[0]):  # of equally far ones the first
            if not taken[i] and (near[i] or count >= most_near):
                farthest = i if farthest < 0 or distances[i] > distances[farthest] else farthest
        if farthest < 0:  # all that are near are taken
            most_near = 0
            continue
        taken[farthest], count = True, count + 1
        for i in range(points.shape[0]):
            x, y, z = (
                points[i, 0] - points[farthest, 0],
                points[i, 1] - points[farthest, 1],
                points[i, 2] - points[farthest, 2],
            )
            distances[i] = min(distances[i], x * x + y * y + z * z)
