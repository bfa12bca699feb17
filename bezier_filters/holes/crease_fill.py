"""Fill a hole that creases run into: continue the creases through it and fill each sub-hole from its own side.

Crease ends are joined by a non-crossing partition with the least bending energy. Two ends are joined by a cubic Hermite
curve; three or more meet in a corner, the point with the least sum of distances to their tangent lines. Each side of a
crease has an implicit surface of its own. Curves are projected to the intersection of the surfaces of their two sides
by Newton's method with minimum-norm steps, and the surfaces are then fitted again through the curves.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import combinations, islice

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.holes.crease_ends import (
    MIN_FADING_ANGLE,
    CreaseEnd,
    CutHole,
    SharpEdgeGraph,
    crease_ends,
    cut_hole,
    face_sectors,
    may_have_creases,
    sharp_edge_graph,
    sub_hole_border,
    sub_hole_region,
)
from bezier_filters.holes.implicit_surface import ImplicitSurface
from bezier_filters.holes.influence_region import InfluenceRegion, vertex_pairs
from bezier_filters.holes.planar_fill import flat_fill
from bezier_filters.holes.refinement import Fill
from bezier_filters.holes.smooth_fill import (
    Attempt,
    attach_to_rim,
    fit_surrounding_surface,
    initial_fill,
    project_to_surface,
    smooth_attempts,
)

# Bending energies are those of a curve over a unit chord, see `bending_energy`: about the squared angle that it turns.
MAX_STRAIGHT_ENERGY = 0.3  # of a curve that is not projected to surfaces: it turns by some 30 degrees
MAX_CURVE_ENERGY = 12.0  # of a curve that joins two ends: a half circle has 10
MAX_CORNER_CURVE_ENERGY = 0.5  # of a curve from an end to a corner: it turns by some 20 degrees
MAX_FADING_ENERGY = 0.6  # of a curve to the end of a less sharp crease
GROUP_ENERGY = 0.5  # penalty per group: ends that all meet in one point are not split into pairs and triples
MAX_CURVE_SHIFT = 0.5  # of a point that is projected to the intersection of surfaces, in diameters of the rim
MAX_INTERSECTION_STEPS, CORNER_STEPS = 12, 60  # iterations
FAR_CORNER = "its sharp edges meet far out of the hole"
MIN_SINGULAR_VALUE_RATIO = 0.15  # of the stacked gradients: directions below it do not move a point to an intersection
MIN_DART_COSINE = -0.5  # between the tangents of a ridge and a valley that end in one point
MAX_CORNER_ENDS = 8  # number of ends up to which every subset of three or more may meet in a corner


@dataclass(frozen=True)
class _Curve:
    """A crease across the hole."""

    ends: tuple[int, int]  # rows of its end points: rim vertices or corners
    start: FloatArray  # (3,): coordinates of the first end
    stop: FloatArray  # (3,): coordinates of the second end
    points: FloatArray  # (k, 3): points in between
    sides: tuple[int, int]  # numbers of the sub-holes on its two sides
    is_straight: bool  # whether its bending energy is so small that its end tangents determine it


def crease_attempts(
    region: InfluenceRegion, *, noisy: bool, fill_sub_hole: Callable[[InfluenceRegion], Fill | str] | None = None
) -> Iterator[Attempt]:
    """Fills that continue the creases at the rim, the most likely first; none without creases at the rim or near it.

    An attempt holds a fill or the reason for its failure. If creases only pass by, the hole is filled smoothly from
    the faces on its own side of them.

    `fill_sub_hole` fills a sub-hole between cubic curves, or returns the reason for a failure. By default, curves and
    sub-holes are first projected to the surfaces of their sides.
    """
    if not region.has_simple_rim or not may_have_creases(region):
        return
    graph = sharp_edge_graph(region)
    ends, along_rim = crease_ends(region, graph)
    rim = region.loops[0]
    if len(ends) == 1:
        ends += _fading_end(region, ends[0])
        ends.sort(key=lambda end: end.position)
    possible = crease_partitions(ends, region.vertices[rim[[end.position for end in ends]]])
    if not possible and fill_sub_hole is None:
        yield from _one_sided_attempt(region, graph, along_rim, noisy=noisy)
    for groups in possible:
        joined = sorted(k for group in groups for k in group)
        chosen = [ends[k] for k in joined]
        renumbered = [tuple(joined.index(k) for k in group) for group in groups]
        cut = cut_hole(region, graph, chosen, along_rim, renumbered)
        if fill_sub_hole is None:
            yield _attempt(_fill_cut_hole(cut, noisy=noisy))
        corners, curves = _initial_curves(cut, [])
        fillers = [fill_sub_hole or _membrane_fill] * len(cut.sectors)
        is_far = _has_far_corner(region, curves)
        yield _attempt(FAR_CORNER if is_far else _fill_sub_holes(cut, corners, curves, fillers))


def _attempt(fill: Attempt | str) -> Attempt:
    return Attempt("creases", None, fill) if isinstance(fill, str) else fill


def _one_sided_attempt(
    region: InfluenceRegion, graph: SharpEdgeGraph, along_rim: frozenset[int], *, noisy: bool
) -> Iterator[Attempt]:
    """A smooth fill of a hole that creases pass by, from the faces on its own side of them."""
    own = face_sectors(region, graph, [], along_rim) >= 0  # reached from the rim without crossing a crease
    if not own.all():
        yield from islice(smooth_attempts(region, _one_sided_normals(region, own), noisy=noisy), 1)


def _fading_end(region: InfluenceRegion, end: CreaseEnd) -> list[CreaseEnd]:
    """End of the less sharp crease that continues a given one with the least bending energy; empty without one."""
    rim = region.vertices[region.loops[0]]
    others, _ = crease_ends(region, sharp_edge_graph(region, MIN_FADING_ANGLE))
    both = [[end, other] for other in others if other.position != end.position]
    energies = [_pair_energy(pair, rim[[e.position for e in pair]], 0, 1) for pair in both]
    return [both[int(np.argmin(energies))][1]] if min(energies, default=np.inf) < MAX_FADING_ENERGY else []


def _has_far_corner(region: InfluenceRegion, curves: Sequence[_Curve]) -> bool:
    """Whether curves reach far beyond the rim: nearly parallel lines meet far away, over thousands of points."""
    rim = region.rim_vertices
    low, high = rim.min(axis=0), rim.max(axis=0)
    farthest = float(np.linalg.norm(high - low))
    points = np.vstack([np.empty((0, 3)), *(curve.points for curve in curves)])
    return bool(((points < low - farthest) | (points > high + farthest)).any())


def _fill_cut_hole(cut: CutHole, *, noisy: bool) -> Attempt | str:
    """Fill a hole that creases cut into sub-holes, or return the reason for a failure."""
    region = cut.region
    normals = [_one_sided_normals(region, cut.sub_hole_of_face == number) for number in range(len(cut.sectors))]
    surfaces = _fit_sides(region, normals, [], noisy=noisy)
    corners, curves = _initial_curves(cut, surfaces)
    if _has_far_corner(region, curves):
        return FAR_CORNER
    for number, surface in enumerate(surfaces):  # a strip between two creases needs no surface
        if surface is None and sum(number in curve.sides for curve in curves) < 2:
            return "too few faces on one side of a crease"
    # Nearly straight curves are kept and constrain the surfaces, to which the other curves are then projected.
    limit = MAX_CURVE_SHIFT * float(np.linalg.norm(np.ptp(region.vertices[: region.rim_count], axis=0)))
    edge = float(region.sizes.mean())
    surfaces = _fit_sides(region, normals, [curve for curve in curves if curve.is_straight], noisy=noisy)
    curves = [curve if curve.is_straight else _project_curve(curve, surfaces, limit, edge) for curve in curves]
    surfaces = _fit_sides(region, normals, curves, noisy=noisy)
    return _fill_sub_holes(cut, corners, curves, [partial(_fill_on_surface, surface=surface) for surface in surfaces])


def _membrane_fill(side: InfluenceRegion) -> Fill | str:
    """Fill a sub-hole from its border alone: harmonic over a plane, or the membrane (Laplace) surface."""
    fill = flat_fill(side)
    if isinstance(fill, str):
        return initial_fill(side, order=1) or "a part of the hole cannot be triangulated"
    return fill


def _fill_on_surface(side: InfluenceRegion, surface: ImplicitSurface | None) -> Fill | str:
    """Fill a sub-hole on the surface of its side, if there is one."""
    fill = _membrane_fill(side)
    if isinstance(fill, str) or surface is None:
        return fill
    moved = project_to_surface(fill, side, surface) if len(fill.points) > fill.rim_count else fill
    return fill if isinstance(moved, str) else attach_to_rim(moved, side, surface)


def _fill_sub_holes(
    cut: CutHole,
    corners: FloatArray,
    curves: Sequence[_Curve],
    fillers: Sequence[Callable[[InfluenceRegion], Fill | str]],
) -> Attempt | str:
    """Fill the sub-holes between the curves, each by its own function."""
    region = cut.region
    # All vertices on borders of sub-holes: rim, corners, points of the curves.
    points = np.vstack([region.vertices[: region.rim_count], corners, *(curve.points for curve in curves)])
    sizes = np.concatenate([region.sizes, np.full(len(points) - region.rim_count, region.sizes.mean())])
    paths = []
    first = region.rim_count + len(corners)
    for curve in curves:
        inner = range(first, first + len(curve.points))
        paths.append(np.array([curve.ends[0], *inner, curve.ends[1]], dtype=np.int32))
        first = inner.stop
    shared = len(points)
    faces: list[IntArray] = []
    existing, is_limited = region.rim_edges, False
    for number, fill_sub_hole in enumerate(fillers):
        loop = sub_hole_border(cut, paths, number)
        if len(np.unique(loop)) < len(loop) or len(loop) < 3:
            return "creases meet before they cross the hole"
        side = sub_hole_region(cut, number, points, sizes, loop, existing)
        fill = fill_sub_hole(side)
        if isinstance(fill, str):
            return fill
        new = np.arange(len(points), len(points) + len(fill.points) - fill.rim_count)
        is_limited |= fill.is_limited
        faces.append(np.concatenate([side.ids[: fill.rim_count], new])[fill.faces].astype(np.int32))
        points = np.vstack([points, fill.points[fill.rim_count :]])
        sizes = np.concatenate([sizes, fill.sizes[fill.rim_count :]])
        existing = np.concatenate([existing, vertex_pairs(faces[-1], shared)])
    creases = np.vstack([np.stack([path[:-1], path[1:]], axis=1) for path in paths])
    fill = Fill(points, sizes, np.vstack(faces), region.rim_count, is_limited)
    return Attempt("creases", fill, sub_hole_count=len(cut.sectors), creases=creases)


def _one_sided_normals(region: InfluenceRegion, faces: BoolArray) -> FloatArray:
    """Vertex normals (b, 3) of the sub-mesh of some faces; zero at other vertices."""
    ids, local = np.unique(region.faces[faces], return_inverse=True)
    normals = np.zeros_like(region.vertices)
    if len(ids):
        points = region.vertices[ids]
        # Normals do not depend on the scale; a side may be too small for the arithmetic of an estimate.
        points = np.ldexp(points, -np.frexp(np.abs(points).max())[1])
        geometry = estimate_vertex_geometry(points, local.reshape(-1, 3))
        normals[ids] = geometry.normals
    return normals


def _fit_sides(
    region: InfluenceRegion, sides: Sequence[FloatArray], curves: Sequence[_Curve], *, noisy: bool
) -> list[ImplicitSurface | None]:
    """Implicit surface of each side, through the curves on its border; None where too few points determine it."""
    result = []
    for number, normals in enumerate(sides):
        others = np.vstack([np.empty((0, 3)), *(curve.points for curve in curves if number in curve.sides)])
        surface = fit_surrounding_surface(region, normals, noisy=noisy, others=others)
        result.append(None if isinstance(surface, str) else surface)
    return result


def _initial_curves(cut: CutHole, surfaces: Sequence[ImplicitSurface | None]) -> tuple[FloatArray, list[_Curve]]:
    """Corners (c, 3), and the cubic curves between two ends, or from ends to corners; surfaces are optional."""
    region, ends, sub_hole_of_sector = cut.region, cut.ends, cut.sub_hole_of_sector
    rim = region.loops[0]
    names = [int(rim[end.position]) for end in ends]
    edge = float(region.sizes.mean())
    corners: list[FloatArray] = []
    curves: list[_Curve] = []
    for group in cut.groups:
        places = [region.vertices[names[k]] for k in group]
        if len(group) == 2 and ends[group[0]].is_convex == ends[group[1]].is_convex:
            targets = [(group[0], names[group[1]], places[1], -ends[group[1]].tangent)]
        else:
            numbers = sorted({int(sub_hole_of_sector[k]) for k in group}) if surfaces else []
            own = [surface for number in numbers if (surface := surfaces[number]) is not None]
            corner = nearest_corner(np.array(places), np.array([ends[k].tangent for k in group]), own, 0.01 * edge)
            name = region.rim_count + len(corners)
            corners.append(corner)
            targets = [(k, name, corner, _normalize(corner - place)) for k, place in zip(group, places, strict=True)]
        for k, name, target, tangent in targets:
            start = region.vertices[names[k]], ends[k].tangent
            inner = hermite_curve(*start, target, tangent, edge)
            straight = bending_energy(*start, target, tangent) < MAX_STRAIGHT_ENERGY
            sides = int(sub_hole_of_sector[k - 1]), int(sub_hole_of_sector[k])
            curves.append(_Curve((names[k], name), start[0], target, inner, sides, straight))
    return np.array(corners).reshape(-1, 3), curves


def _project_curve(curve: _Curve, surfaces: Sequence[ImplicitSurface | None], limit: float, edge: float) -> _Curve:
    """Project a curve to the intersection of the surfaces of its two sides, or to the only one that is known."""
    pair = [surface for number in curve.sides if (surface := surfaces[number]) is not None]
    inner = project_to_intersection(curve.points, pair, limit)
    inner = resample_polyline(np.vstack([curve.start, inner, curve.stop]), edge)
    return replace(curve, points=project_to_intersection(inner, pair, limit))


def _normalize(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-300), dtype=np.float64)


def crease_partitions(ends: Sequence[CreaseEnd], points: FloatArray) -> list[list[tuple[int, ...]]]:
    """Partitions of the crease ends, the best first: pairs joined by a curve, larger groups that meet in a corner.

    Partitions do not cross. They leave as few ends unmatched as possible, and then have the least bending energy. Ends
    meet in a corner if their tangent lines pass near one point; exactly three ends always do. The last partitions also
    pair a ridge with a valley that meet in one point, as at the tip of a dart.

    Ends are given in the order of the rim, with their points (k, 3). A partition is a list of groups of end numbers;
    creases without a group end inside the hole.
    """
    count = len(ends)
    pairs: dict[tuple[int, ...], float] = {
        (i, j): _pair_energy(ends, points, i, j) for i, j in combinations(range(count), 2)
    }
    tangents = np.array([end.tangent for end in ends]).reshape(-1, 3)
    # The number of subsets is exponential: of many ends only all may meet in a corner.
    sizes = range(3, count + 1) if count <= MAX_CORNER_ENDS else (count,)
    possible = (group for size in sizes for group in combinations(range(count), size))
    corners = {group: _corner_energy(points, tangents, list(group)) for group in possible}
    if count == 3:
        corners[0, 1, 2] = min(corners[0, 1, 2], MAX_CURVE_ENERGY)
    result: list[list[tuple[int, ...]]] = []
    darts = {
        (i, j): _corner_energy(points, tangents, [i, j])
        for i, j in pairs
        if ends[i].is_convex != ends[j].is_convex and tangents[i] @ tangents[j] > MIN_DART_COSINE
    }
    for found in (
        _best_partition(count, pairs | corners),
        _best_partition(count, pairs),
        _best_partition(count, pairs | darts),
    ):
        if found and found not in result:
            result.append(found)
    return result


def _pair_energy(ends: Sequence[CreaseEnd], points: FloatArray, i: int, j: int) -> float:
    """Bending energy of the curve between two ends; infinite between ridge and valley, or beyond the limit."""
    if ends[i].is_convex != ends[j].is_convex:
        return float("inf")
    energy = bending_energy(points[i], ends[i].tangent, points[j], -ends[j].tangent)
    return energy if energy < MAX_CURVE_ENERGY else float("inf")


def _corner_energy(points: FloatArray, tangents: FloatArray, group: list[int]) -> float:
    """Sum of the bending energies from ends to the point nearest to their lines; infinite if one exceeds the limit."""
    starts, along = points[group], tangents[group]
    across = np.eye(3) - along[:, :, np.newaxis] * along[:, np.newaxis, :]
    corner = np.linalg.lstsq(across.sum(axis=0), np.einsum("kij,kj->i", across, starts), rcond=1e-6)[0]
    chords = corner - starts
    lengths = np.linalg.norm(chords, axis=1, keepdims=True)
    if not (lengths > 0.0).all():
        return float("inf")
    energies = [bending_energy(s, t, corner, c) for s, t, c in zip(starts, along, chords / lengths, strict=True)]
    return sum(energies) if max(energies) < MAX_CORNER_CURVE_ENERGY else float("inf")


def bending_energy(start: FloatArray, start_tangent: FloatArray, stop: FloatArray, stop_tangent: FloatArray) -> float:
    """Bending energy of the cubic Hermite curve c over a unit chord: the integral of |c''(t)|^2 for t in [0, 1].

    It is about the squared angle that the curve turns.

    >>> right = np.array([1.0, 0.0, 0.0])
    >>> bending_energy(0 * right, right, 5 * right, right)
    0.0
    """
    length = float(np.linalg.norm(stop - start))
    if not length > 0.0:
        return float("inf")
    chord = (stop - start) / length
    a = 6.0 * chord - 4.0 * start_tangent - 2.0 * stop_tangent
    b = -6.0 * chord + 2.0 * start_tangent + 4.0 * stop_tangent
    return float(a @ a + a @ b + b @ b) / 3.0


def _best_partition(count: int, energies: Mapping[tuple[int, ...], float]) -> list[tuple[int, ...]]:
    """Non-crossing partition with the fewest unmatched ends, then the least energy; by dynamic programming."""

    @cache
    def best(first: int, stop: int) -> tuple[int, float, tuple[tuple[int, ...], ...]]:
        if stop - first < 2:
            return max(stop - first, 0), 0.0, ()
        rest = best(first + 1, stop)
        options = [(rest[0] + 1, rest[1], rest[2])]
        for group, energy in energies.items():
            if group[0] == first and group[-1] < stop and energy < float("inf"):
                between = [best(a + 1, b) for a, b in zip(group, (*group[1:], stop), strict=True)]
                found = (group, *(inner for option in between for inner in option[2]))
                options.append((sum(o[0] for o in between), GROUP_ENERGY + energy + sum(o[1] for o in between), found))
        # Ties go to the first option, which leaves the first end unmatched.
        return min(options, key=lambda option: option[:2])

    return list(best(0, count)[2])


def nearest_corner(
    points: FloatArray, tangents: FloatArray, surfaces: Sequence[ImplicitSurface], tolerance: float
) -> FloatArray:
    """Point with the least sum of distances to lines, given by points (k, 3) and unit tangents, and to surfaces.

    An L1 fit by iteratively reweighted least squares. Unlike a sum of squares, it is robust to one crease that bends
    on its way, or to one surface that is extrapolated badly.
    """
    across = np.eye(3) - tangents[:, :, np.newaxis] * tangents[:, np.newaxis, :]
    corner = points.mean(axis=0)
    line_weights, surface_weights = np.ones(len(points)), np.zeros(len(surfaces))
    for _ in range(CORNER_STEPS):
        values, gradients = _values_and_gradients(surfaces, corner[np.newaxis])
        values, gradients = values[0], gradients[0]
        system = 1e-6 * np.eye(3) + np.einsum("k,kij->ij", line_weights, across)
        system += np.einsum("k,ki,kj->ij", surface_weights, gradients, gradients)
        target = np.einsum("k,kij,kj->i", line_weights, across, points - corner)
        target -= np.einsum("k,k,ki->i", surface_weights, values, gradients)
        corner = corner + np.linalg.solve(system, target)
        distances = np.linalg.norm(np.einsum("kij,kj->ki", across, points - corner), axis=1)
        line_weights = 1.0 / np.maximum(distances, tolerance)
        surface_weights = 1.0 / np.maximum(np.abs(_values_and_gradients(surfaces, corner[np.newaxis])[0][0]), tolerance)
    return np.asarray(corner, dtype=np.float64)


def _values_and_gradients(surfaces: Sequence[ImplicitSurface], points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (n, k) and gradients (n, k, 3) of k surfaces."""
    found = [surface.values_and_gradients(points) for surface in surfaces]
    values = np.array([value for value, _ in found]).reshape(len(surfaces), len(points))
    gradients = np.array([gradient for _, gradient in found]).reshape(len(surfaces), len(points), 3)
    return values.T, gradients.swapaxes(0, 1)


def hermite_curve(
    start: FloatArray, start_tangent: FloatArray, stop: FloatArray, stop_tangent: FloatArray, edge: float
) -> FloatArray:
    """Inner points of a cubic Hermite curve, about one edge length apart, (k, 3); tangents are unit vectors."""
    length = float(np.linalg.norm(stop - start))
    t = np.linspace(0.0, 1.0, 200)[:, np.newaxis]
    curve = (
        (1 + 2 * t) * (1 - t) ** 2 * start
        + t * (1 - t) ** 2 * length * start_tangent
        + t**2 * (3 - 2 * t) * stop
        - t**2 * (1 - t) * length * stop_tangent
    )
    return resample_polyline(curve, edge)


def resample_polyline(curve: FloatArray, edge: float) -> FloatArray:
    """Inner points of a polyline (n, 3) at equal arc lengths of about one edge, without its ends."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    count = max(round(float(lengths[-1]) / edge), 1)
    at = np.linspace(0.0, lengths[-1], count + 1)[1:-1]
    return np.stack([np.interp(at, lengths, curve[:, k]) for k in range(3)], axis=1)


def project_to_intersection(points: FloatArray, surfaces: Sequence[ImplicitSurface], limit: float) -> FloatArray:
    """Move points (n, 3) to the common zeros of surfaces, by Newton's method with minimum-norm steps.

    The pseudo-inverse of the gradients drops directions that nearly tangent surfaces do not determine. Points that
    would move farther than a limit keep their coordinates.
    """
    result, longest = points.copy(), max(0.2 * limit, 1e-300)
    for _ in range(MAX_INTERSECTION_STEPS):
        values, gradients = _values_and_gradients(surfaces, result)
        steps = np.einsum("nij,nj->ni", np.linalg.pinv(gradients, rcond=MIN_SINGULAR_VALUE_RATIO), values)
        lengths = np.linalg.norm(steps, axis=1, keepdims=True)
        result = result - steps * (longest / np.maximum(lengths, longest))
    is_near = np.linalg.norm(result - points, axis=1) <= limit
    return np.where((is_near & np.isfinite(result).all(axis=1))[:, np.newaxis], result, points)
