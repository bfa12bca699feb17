"""The influence region of a hole: some rings of the mesh around it, as a small mesh, with normals and noise there.

The fill of a hole depends on nothing else. Points that an implicit surface is fitted to are a farthest-point sample of
the region.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import pi

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.estimation.estimate import geometry_where
from bezier_filters.fitting.noise_level import is_noisy
from bezier_filters.meshes.frames import unit_face_normals
from bezier_filters.meshes.half_edges import HalfEdgeLists, face_at_edge, half_edge_lists, normals_along
from bezier_filters.meshes.neighbourhoods import rings_around, search_workspace
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.triangles import angle_parts, edge_length
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.runtime.jit import jit, short_jit

INFLUENCE_RINGS = 5  # rings around a hole that determine its fill
# Standard deviation of the noise, in edges, from which points are smoothed. With noise of 0.005 edges fills of holes of
# 8 and 15 edges are 0.9 and 3.7 times the noise from a ball; with 0.01 they are interpolated, and 2.2 and 8.9 times.
MIN_SMOOTHED_NOISE = 0.001
# number of points that a surface is fitted to: proportional to the rim, within bounds
POINTS_PER_RIM_EDGE, MIN_SURFACE_POINTS, MAX_SURFACE_POINTS = 3, 60, 300
NOISY_SURFACE_POINTS = 350  # the same on noisy meshes, for any rim: averaging needs more points
MAX_NEAR_FRACTION = 0.75  # of these points that lie on the rim and the first ring


@dataclass(frozen=True)
class InfluenceRegion:
    """Some rings of a mesh around a hole. All index arrays except `ids` refer to rows of `ids`."""

    ids: IntArray  # (b,): vertices of the mesh, ordered by ring, the rim first
    rings: IntArray  # (b,): ring of each vertex, its graph distance to the rim
    vertices: FloatArray  # (b, 3): their coordinates
    faces: IntArray  # (m, 3): faces with a vertex inside the outermost ring
    # each (k,): the rims of the hole and of its islands, in the direction of the faces that fill it
    loops: tuple[IntArray, ...]
    # (p, 2): pairs of rim vertices that the fill of another hole joins by an edge
    joined: IntArray = field(default_factory=lambda: np.empty((0, 2), dtype=np.int32))
    # (r,): target edge lengths at the rim vertices; by default those of the faces
    target_sizes: FloatArray | None = None
    is_band: bool = False  # whether its fill is a band between two loops, which need not lie in one plane
    noise_free: FloatArray | None = None  # (b, 3): denoised coordinates, if noise hides the sharp edges

    @property
    def crease_vertices(self) -> FloatArray:
        """Coordinates on which sharp edges are detected, (b, 3): the denoised ones, if there are any."""
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
        """Existing edges between rim vertices, (p, 2), and pairs in one place; a fill must not have such edges."""
        existing = vertex_pairs(self.faces, self.rim_count)
        return np.concatenate([self.joined, existing, _coincident_pairs(self.rim_vertices)])

    @cached_property
    def _half_edges(self) -> HalfEdgeLists:
        return half_edge_lists(self.faces, len(self.ids))

    @cached_property
    def _rim_measures(self) -> tuple[FloatArray, FloatArray]:
        """Gap angle and mean edge length at each rim vertex, (r,) each."""
        gaps, sizes = np.full(self.rim_count, 2.0 * pi), np.zeros(self.rim_count)
        _measure_rim(self.vertices, self.faces, self._half_edges, gaps, sizes, np.zeros(self.rim_count))
        return gaps, sizes

    @property
    def gaps(self) -> FloatArray:
        """Gap angle of the hole at each rim vertex: 2 pi minus the angles of the faces, in radians."""
        return self._rim_measures[0]

    @property
    def sizes(self) -> FloatArray:
        """Target edge length at each rim vertex: by default the mean length of its edges."""
        return self._rim_measures[1] if self.target_sizes is None else self.target_sizes

    @cached_property
    def face_normals(self) -> FloatArray:
        """Unit normals of the faces, zero for degenerate faces, (m, 3)."""
        return unit_face_normals(self.vertices, self.faces)

    def rim_face_normals(self, loop: IntArray) -> FloatArray:
        """Unit normals of the faces at the edges of a loop, by first vertex; zero where there is no face, (k, 3)."""
        return normals_along(self.vertices, self.faces, self._half_edges, loop, beyond=True)

    def is_noisy(self, noise: float | None) -> bool:
        """Whether noise with this standard deviation, a length, requires smoothing."""
        return noise is not None and noise > MIN_SMOOTHED_NOISE * float(self.sizes.mean())

    def add_joined_pairs(self, joined: IntArray) -> "InfluenceRegion":
        """The region with further pairs of mesh vertices, (p, 2), that an edge joins outside its faces."""
        rim = self.ids[: self.rim_count]
        pairs = joined[np.isin(joined, rim).all(axis=1)]
        by_id = np.argsort(rim)
        places = by_id[np.searchsorted(rim, pairs, sorter=by_id)].astype(np.int32)
        return replace(self, joined=places) if len(pairs) else self


def influence_regions(
    mesh: PreparedMesh, holes: Sequence[tuple[IntArray, ...]], rings: int = INFLUENCE_RINGS
) -> list[InfluenceRegion]:
    """Collect rings of the mesh, at least one, around the loops of each hole."""
    # The scratch arrays have the size of the mesh, but only the entries of the regions are touched.
    scratch, place = search_workspace(mesh.vertex_count), np.empty(mesh.vertex_count, dtype=np.int32)
    is_found, found = np.zeros(mesh.face_count, dtype=np.bool_), np.empty(mesh.face_count, dtype=np.int32)
    at_vertex, regions = mesh.adjacency.faces, []
    for loops in holes:
        ids, ring = rings_around(mesh.adjacency.vertices, np.unique(np.concatenate(loops)), rings, scratch)
        count = _collect_faces(at_vertex.indptr, at_vertex.indices, ids[ring < rings], is_found, found)
        place[ids] = np.arange(len(ids), dtype=np.int32)
        faces, own = place[mesh.faces[np.sort(found[:count])]], tuple(place[loop] for loop in loops)
        regions.append(InfluenceRegion(ids, ring, mesh.vertices[ids], faces, own))
    return regions


@jit()
def _collect_faces(
    indptr: IntArray, indices: IntArray, vertices: IntArray, is_found: BoolArray, found: IntArray
) -> int:
    """Write the faces at vertices, each once; return their number. `is_found` is False before and after the call."""
    count = 0
    for i in vertices:
        for q in range(indptr[i], indptr[i + 1]):
            if not is_found[indices[q]]:
                is_found[indices[q]] = True
                found[count] = indices[q]
                count += 1
    for k in range(count):
        is_found[found[k]] = False
    return count


def _coincident_pairs(points: FloatArray) -> IntArray:
    """Pairs of points (n, 3) in one place, (p, 2)."""
    order = np.lexsort(points.T)
    place = np.cumsum(np.r_[0, (np.diff(points[order], axis=0) != 0.0).any(axis=1)])
    pairs = [np.empty((0, 2), dtype=np.int32)]
    for apart in range(1, int(np.bincount(place).max(initial=1))):  # all of three or more in one place
        same = np.flatnonzero(place[apart:] == place[:-apart])
        pairs.append(np.column_stack([order[same], order[same + apart]]).astype(np.int32))
    return np.concatenate(pairs)


def vertex_pairs(faces: IntArray, limit: int) -> IntArray:
    """Edges of faces (m, 3) between vertices below a limit, (p, 2); an edge of two faces occurs twice."""
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
    """Subtract face angles from the gaps of the rim vertices; write the mean lengths of their edges into `sizes`."""
    for f in range(faces.shape[0]):
        for k in range(3):
            here, after, before = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            if here >= gaps.shape[0]:
                continue
            cosine, sine = angle_parts(points, here, after, before)
            gaps[here] -= np.arctan2(sine, cosine)
            # Each edge counts once: as the outgoing edge of this corner, or as the incoming one at the border.
            sizes[here] += edge_length(points, here, after)
            edges[here] += 1.0
            if face_at_edge(faces, lists, here, before) < 0:
                sizes[here] += edge_length(points, here, before)
                edges[here] += 1.0
    for i in range(sizes.shape[0]):
        sizes[i] /= max(edges[i], 1.0)


@dataclass(frozen=True)
class HoleSurroundings:
    """Estimates of normals and noise around the holes of a mesh."""

    normals: FloatArray  # (n, 3): normals of Bezier patches at the points that surfaces are fitted to, zero elsewhere
    noise: float | None  # standard deviation of the noise, a length; None if it could not be estimated
    regions: list[InfluenceRegion]  # with denoised coordinates, if noise hides sharp edges
    is_smooth: bool = False  # whether noise makes angles like those of sharp edges, and the surface without it has none


def hole_surroundings(mesh: PreparedMesh, regions: list[InfluenceRegion], noise: float | None) -> HoleSurroundings:
    """Estimate normals around the holes, and the noise if it is not given."""
    if not regions:
        return HoleSurroundings(np.zeros_like(mesh.vertices), noise, regions)
    fitted: list[IntArray] = []

    def select(learned: float | None) -> BoolArray:
        sigma = learned if noise is None else noise
        fitted.extend(region.ids[select_surface_points(region, noisy=region.is_noisy(sigma))] for region in regions)
        selected = np.zeros(mesh.vertex_count, dtype=np.bool_)
        selected[np.concatenate(fitted)] = True
        return selected

    geometry = geometry_where(mesh, select)
    normals = np.zeros_like(mesh.vertices)
    for ids in fitted:
        normals[ids] = geometry.normals[ids]
    shape = geometry.noise_free
    if shape is not None:
        regions = [replace(region, noise_free=shape[region.ids]) for region in regions]
    is_smooth = shape is None and is_noisy(mesh, geometry.noise_sigma)
    return HoleSurroundings(normals, geometry.noise_sigma if noise is None else noise, regions, is_smooth)


def select_surface_points(region: InfluenceRegion, known: BoolArray | None = None, *, noisy: bool) -> IntArray:
    """Rows of the points that a surface is fitted to, chosen among the rows where `known` is True."""
    ids = np.arange(len(region.ids)) if known is None else np.flatnonzero(known)
    most = (
        NOISY_SURFACE_POINTS
        if noisy
        else min(max(POINTS_PER_RIM_EDGE * region.rim_count, MIN_SURFACE_POINTS), MAX_SURFACE_POINTS)
    )
    if len(ids) > most:
        ids = ids[farthest_point_sample(region.vertices[ids], region.rings[ids] <= (-1 if noisy else 1), most)]
    return ids.astype(np.int32)


def farthest_point_sample(points: FloatArray, near: BoolArray, most: int) -> IntArray:
    """Rows of a farthest-point sample of `most` points: first near points, up to a fraction, then all others.

    Near points determine the junction of the fill with the mesh, the others the curvature. Each point is the farthest
    from all points before it, so that the sample depends on the coordinates and not on their order.

    >>> line = np.arange(6.0)[:, np.newaxis] * [1.0, 0.0, 0.0]
    >>> farthest_point_sample(line, np.arange(6) < 2, 3)
    array([0, 1, 5], dtype=int32)
    """
    distances, chosen = np.square(points - points.mean(axis=0)).sum(axis=1), np.zeros(len(points), dtype=np.bool_)
    _sample_farthest(points, near, int(MAX_NEAR_FRACTION * most), most, distances, chosen)
    return np.flatnonzero(chosen).astype(np.int32)


@jit()
def _sample_farthest(
    points: FloatArray, near: BoolArray, most_near: int, most: int, distances: FloatArray, chosen: BoolArray
) -> None:
    """Mark the chosen points. `distances` are squared, at first to the mean, then to the nearest chosen point."""
    count = 0
    while count < most:
        farthest = -1
        for i in range(points.shape[0]):  # ties go to the first
            if not chosen[i] and (near[i] or count >= most_near):
                farthest = i if farthest < 0 or distances[i] > distances[farthest] else farthest
        if farthest < 0:  # no near point remains
            most_near = 0
            continue
        chosen[farthest], count = True, count + 1
        for i in range(points.shape[0]):
            x, y, z = (
                points[i, 0] - points[farthest, 0],
                points[i, 1] - points[farthest, 1],
                points[i, 2] - points[farthest, 2],
            )
            distances[i] = min(distances[i], x * x + y * y + z * z)
