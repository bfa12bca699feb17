"""Fill a hole where the surface is smooth: triangles as large as those around it, on a surface that goes on."""

from collections.abc import Set as AbstractSet
from dataclasses import replace

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.contrasts import WorkSpace
from bezier_filters.holes.evening import evened
from bezier_filters.holes.fill_topology import Fill, flipped, refined
from bezier_filters.holes.implicit_surface import ImplicitSurface, fit_implicit_surface
from bezier_filters.holes.loop_triangulation import triangulate_loop
from bezier_filters.holes.surroundings import Surroundings
from bezier_filters.holes.variational_fill import shifted, without_tension
from bezier_filters.runtime.lean import lean_njit

POINTS_PER_EDGE, FEWEST_POINTS, MOST_POINTS = 3, 60, 300
"""Points that the surface is fitted to, by the number of edges of the rim."""
NEAR = 0.75
"""Share of these that the rim and the first ring may take."""
NOISY_POINTS = 350
"""The same for any rim on noisy meshes, where more points tell more."""
MOST_AT_ONCE = 200
"""Edges of a rim up to which the fill is faired at its final resolution."""
SMALLEST_GAP = 1e-4
"""Of an edge, between rim and surface, that is worth a shift: less turns no face by more than that angle."""
ROUNDS = 3
"""Of evening out the triangles on the surface."""


def first_fill(around: Surroundings, order: int = 2) -> Fill | None:
    """Triangulate, refine and fair a hole; None if no triangulation of its rim makes a manifold.

    `order` is the power of the Laplacian that vanishes: 2, or 1 where there are no faces beyond a part of the rim,
    whose tangent planes could be continued. Fills of large holes are faired coarsely and then refined.
    """
    fill = triangulated(around)
    if fill is None:
        return None
    coarse = max(1.0, around.rim_count / MOST_AT_ONCE)
    fill = replace(fill, sizes=coarse * fill.sizes)
    fill = faired(refined(fill, around.rim_edges), around, order)
    fill = refined(replace(fill, sizes=fill.sizes / coarse), around.rim_edges)
    return fill if coarse > 1.0 else faired(fill, around, order)


def triangulated(around: Surroundings) -> Fill | None:
    """Join the vertices of the rim, or join them to one more vertex if they are joined elsewhere already."""
    polygon, normals, gaps = _polygon(around)
    points = around.vertices[: around.rim_count]
    faces = triangulate_loop(points[polygon], polygon, normals, gaps, _forbidden(around, polygon))
    sizes = around.sizes
    if faces is not None and not _is_manifold(faces):  # where islands touch, two triangles may want one edge
        faces = None
    if faces is None and len(polygon) > around.rim_count:
        return None
    if faces is None:
        hub = np.full(len(polygon), around.rim_count)
        faces = np.stack([polygon, np.roll(polygon, -1), hub], axis=1).astype(np.int32)
        points = np.vstack([points, points[polygon].mean(axis=0)])
        sizes = np.append(sizes, sizes.mean())
    return Fill(points, sizes, faces, around.rim_count)


def _is_manifold(faces: IntArray) -> bool:
    """Whether no edge is run through twice in one direction and no face names a vertex twice."""
    starts, ends = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel()
    edges = np.sort(starts * (int(faces.max()) + 1) + ends)
    return bool((np.diff(edges) > 0).all() and (starts != ends).all())


def _polygon(around: Surroundings) -> tuple[IntArray, FloatArray, FloatArray]:
    """All loops as one, joined by the shortest bridges, with the normals beyond its edges and the gaps."""
    polygon = around.loops[0]
    normals = around.normals_beyond(polygon)
    for loop in around.loops[1:]:
        points = around.vertices
        distances = np.linalg.norm(points[polygon][:, np.newaxis] - points[loop], axis=2)
        i, j = np.unravel_index(np.argmin(distances), distances.shape)
        beyond = around.normals_beyond(loop)
        zero = np.zeros((1, 3))
        turned, turned_normals = np.roll(loop, -j), np.roll(beyond, -j, axis=0)
        if polygon[i] == loop[j]:  # the island touches: ..., loop[j], ..., polygon[i], ...
            polygon = np.concatenate([polygon[:i], turned, polygon[i:]])
            normals = np.vstack([normals[:i], turned_normals, normals[i:]])
            continue
        # ... polygon[i], loop[j], ..., loop[j], polygon[i], ...; the normal at a corner is that of the edge after it.
        polygon = np.concatenate([polygon[: i + 1], turned, turned[:1], polygon[i:]])
        normals = np.vstack([normals[:i], zero, turned_normals, zero, normals[i:]])
    count = np.bincount(polygon, minlength=around.rim_count)
    return polygon, normals, (around.gaps / np.maximum(count, 1))[polygon]


def _forbidden(around: Surroundings, polygon: IntArray) -> AbstractSet[tuple[int, int]]:
    """Pairs that must not be joined by a chord: those that are joined already, and the bridges."""
    corners = polygon.tolist()
    return around.rim_edges | {(min(a, b), max(a, b)) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)}


def faired(fill: Fill, around: Surroundings, order: int) -> Fill:
    """Move the new vertices to where the Laplacian to a power vanishes; see `without_tension`."""
    points, faces, rings = together(fill, around, max(order - 1, 1))
    moved = without_tension(points, faces, rings, order)
    return replace(fill, points=np.vstack([fill.points[: fill.rim_count], moved[rings:]]))


def together(fill: Fill, around: Surroundings, rings: int) -> tuple[FloatArray, IntArray, int]:
    """Some rings with the new vertices and the faces of the fill after them, and how many vertices the rings have."""
    count = int(np.searchsorted(around.rings, rings, side="right"))
    shift = count - fill.rim_count
    faces = np.where(fill.faces < fill.rim_count, fill.faces, fill.faces + shift)
    own = around.faces[(around.faces < count).all(axis=1)]
    return np.vstack([around.vertices[:count], fill.points[fill.rim_count :]]), np.vstack([own, faces]), count


def surface_around(
    around: Surroundings,
    normals: FloatArray,
    known: BoolArray,
    *,
    noisy: bool,
    others: FloatArray | None = None,
    work: WorkSpace | None = None,
) -> ImplicitSurface | None:
    """Fit a surface to the points of the surroundings whose normals (b, 3) are known, and to others (k, 3)."""
    ids = fitted_points(around, known, noisy=noisy)
    step = float(around.sizes.mean())
    return fit_implicit_surface(around.vertices[ids], normals[ids], step, noisy=noisy, others=others, work=work)


def fitted_points(around: Surroundings, known: BoolArray | None = None, *, noisy: bool) -> IntArray:
    """Places of the points that a surface is fitted to, among those that are known."""
    ids = np.arange(len(around.ids)) if known is None else np.flatnonzero(known)
    most = NOISY_POINTS if noisy else int(np.clip(POINTS_PER_EDGE * around.rim_count, FEWEST_POINTS, MOST_POINTS))
    if len(ids) > most:
        near = np.flatnonzero(around.rings[ids] <= (-1 if noisy else 1)).astype(np.int32)
        ids = ids[thinned(around.vertices[ids], near, most)]
    return ids.astype(np.int32)


def thinned(points: FloatArray, near: IntArray, most: int) -> IntArray:
    """Places of `most` of some points, far from each other: first those that are near, up to a share, then all others.

    The nearest points settle how the fill joins, the others how the surface curves. Each further point is the one that
    is farthest from those taken before, so that the choice follows from where the points are, not from their order.

    Examples
    --------
    >>> line = np.arange(6.0)[:, np.newaxis] * [1.0, 0.0, 0.0]
    >>> thinned(line, np.array([0, 1], dtype=np.int32), 3)
    array([0, 1, 5], dtype=int32)
    """
    distances = np.square(points - points.mean(axis=0)).sum(axis=1)
    taken = np.zeros(len(points), dtype=np.bool_)
    _take_farthest(points, near, min(int(NEAR * most), len(near)), distances, taken)
    everywhere = np.arange(len(points), dtype=np.int32)
    _take_farthest(points, everywhere, most - int(np.count_nonzero(taken)), distances, taken)
    return np.flatnonzero(taken).astype(np.int32)


@lean_njit()
def _take_farthest(
    points: FloatArray, candidates: IntArray, count: int, distances: FloatArray, taken: BoolArray
) -> None:
    """Take some of the candidates; `distances` are those to the points taken before, squared."""
    for _ in range(count):
        farthest = -1
        for i in candidates:
            if not taken[i] and (farthest < 0 or distances[i] > distances[farthest]):
                farthest = i
        taken[farthest] = True
        for i in range(points.shape[0]):
            x, y, z = (
                points[i, 0] - points[farthest, 0],
                points[i, 1] - points[farthest, 1],
                points[i, 2] - points[farthest, 2],
            )
            distances[i] = min(distances[i], x * x + y * y + z * z)


def on_surface(fill: Fill, around: Surroundings, surface: ImplicitSurface, *, threads: int = 1) -> Fill | None:
    """Move the new vertices of a fill onto a surface and even out its triangles; None if that does not work."""
    new = slice(fill.rim_count, None)
    for round_ in range(ROUNDS + 1):
        points = fill.points.copy()
        points[new], found = surface.project(points[new], threads=threads)
        if not found.all():
            return None
        fill = replace(fill, points=points)
        if round_ < ROUNDS:
            fill = evened(flipped(fill, around.rim_edges))
    return fill


def meeting_rim(fill: Fill, around: Surroundings, surface: ImplicitSurface) -> Fill:
    """Shift a fill on a surface so that it ends at its rim, which noise may have moved off the surface."""
    rim = fill.points[: fill.rim_count]
    on_it, found = surface.project(rim)
    shift = np.where(found[:, np.newaxis], rim - on_it, 0.0)
    if np.abs(shift).max(initial=0.0) < SMALLEST_GAP * around.sizes.mean():
        return fill
    points = fill.points + shifted(fill.points, fill.faces, shift)
    points[: fill.rim_count] = rim
    return replace(fill, points=points)
