"""Fill a hole that creases run into: they are continued through it, and each part is filled from its own side.

Ends of creases are grouped by how little the curves between them would bend; these curves are taken to where the
surfaces of their two sides meet, which in turn go through the curves.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import combinations, islice

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.holes.crease_ends import (
    FADING,
    CreaseEnd,
    Creases,
    CutHole,
    border,
    crease_ends,
    creases_around,
    cut_hole,
    may_have_creases,
    sectors,
    sub_hole,
)
from bezier_filters.holes.implicit_surface import ImplicitSurface
from bezier_filters.holes.influence_region import InfluenceRegion, vertex_pairs
from bezier_filters.holes.planar_fill import lifted_fill
from bezier_filters.holes.refinement import Fill
from bezier_filters.holes.smooth_fill import (
    Attempt,
    first_fill,
    meet_rim,
    project_to_surface,
    smooth_attempts,
    surface_around,
)

STRAIGHT = 0.3  # bending energy of a curve that is taken as it is: it turns by some 30 degrees
FARTHEST = 0.5  # times the diameter of the rim: how far a curve or corner may move to the intersection of surfaces
NEWTON_STEPS, STEPS_TO_CORNER = 12, 60
LEAVING = "its sharp edges meet far out of the hole"
WEAKEST = 0.15  # least share of the strongest direction in which surfaces determine their intersection
# bending energy of a curve over a unit chord, from which on its ends do not belong together: half a circle has 10
LARGEST_BEND = 12.0
LARGEST_LEG_BEND = 0.5  # the same of a curve to a corner: it turns by some 20 degrees
LARGEST_FADING_BEND = 0.6  # and of one to where a crease is less sharp
BLUNTEST = -0.5  # least cosine of the angle at which ridge and valley meet where both end
# what another group must save: ends of which all meet in a point do not meet there in twos and threes
ENERGY_OF_GROUP = 0.5
MOST_ENDS = 8  # up to which every group of ends may meet in a corner


@dataclass(frozen=True)
class _Curve:
    """A crease in the hole."""

    ends: tuple[int, int]  # rim vertices or corners
    start: FloatArray  # (3,): where the first is
    stop: FloatArray  # (3,): and the second
    points: FloatArray  # (k, 3): points in between
    sides: tuple[int, int]  # the sub-holes on its two sides
    is_straight: bool  # whether it bends so little that its tangents at the rim tell all of it


def crease_attempts(
    region: InfluenceRegion, *, noisy: bool, fill_part: Callable[[InfluenceRegion], Fill | str] | None = None
) -> Iterator[Attempt]:
    """Fills with the creases that end at the rim continued, the most likely first, or what went wrong; maybe none.

    Where creases only pass by, a smooth fill of what is on this side of them.

    `fill_part` fills a part between cubic curves, or says why it cannot; by default parts and curves are taken to the
    surfaces of their sides first.
    """
    if not region.has_simple_rim or not may_have_creases(region):
        return
    creases = creases_around(region)
    ends, along_rim = crease_ends(region, creases)
    rim = region.loops[0]
    if len(ends) == 1:
        ends += _fading_end(region, ends[0])
        ends.sort(key=lambda end: end.position)
    possible = groupings(ends, region.vertices[rim[[end.position for end in ends]]])
    if not possible and fill_part is None:
        yield from _beside_creases(region, creases, along_rim, noisy=noisy)
    for groups in possible:
        joined = sorted(k for group in groups for k in group)
        chosen = [ends[k] for k in joined]
        renumbered = [tuple(joined.index(k) for k in group) for group in groups]
        cut = cut_hole(region, creases, chosen, along_rim, renumbered)
        if fill_part is None:
            yield _attempt(_fill(cut, noisy=noisy))
        corners, curves = _first_curves(cut, [])
        leaves = _leave(region, curves)
        yield _attempt(
            LEAVING if leaves else _with_parts(cut, corners, curves, [fill_part or _spanned] * len(cut.sectors))
        )


def _attempt(fill: Attempt | str) -> Attempt:
    return Attempt("creases", None, fill) if isinstance(fill, str) else fill


def _beside_creases(
    region: InfluenceRegion, creases: Creases, along_rim: frozenset[int], *, noisy: bool
) -> Iterator[Attempt]:
    """A smooth fill of a hole that creases pass by, from what is on this side of them."""
    own = sectors(region, creases, [], along_rim) >= 0  # reached from the rim without crossing a crease
    if not own.all():
        yield from islice(smooth_attempts(region, _side(region, own), noisy=noisy), 1)


def _fading_end(region: InfluenceRegion, end: CreaseEnd) -> list[CreaseEnd]:
    """The end of the less sharp crease that goes on straightest where another ends; none if all bend."""
    rim = region.vertices[region.loops[0]]
    others, _ = crease_ends(region, creases_around(region, FADING))
    both = [[end, other] for other in others if other.position != end.position]
    energies = [_energy(pair, rim[[e.position for e in pair]], 0, 1) for pair in both]
    return [both[int(np.argmin(energies))][1]] if min(energies, default=np.inf) < LARGEST_FADING_BEND else []


def _leave(region: InfluenceRegion, curves: Sequence[_Curve]) -> bool:
    """Whether curves end in a corner far away, as lines do that are nearly parallel: they have thousands of points."""
    rim = region.rim_vertices
    low, high = rim.min(axis=0), rim.max(axis=0)
    farthest = float(np.linalg.norm(high - low))
    points = np.vstack([np.empty((0, 3)), *(curve.points for curve in curves)])
    return bool(((points < low - farthest) | (points > high + farthest)).any())


def _fill(cut: CutHole, *, noisy: bool) -> Attempt | str:
    """Fill a hole whose creases are joined in groups of ends, or say why that is not possible."""
    region = cut.region
    normals = [_side(region, cut.part_of_face == part) for part in range(len(cut.sectors))]
    surfaces = _surfaces(region, normals, [], noisy=noisy)
    corners, curves = _first_curves(cut, surfaces)
    if _leave(region, curves):
        return LEAVING
    for part, surface in enumerate(surfaces):  # a strip between creases needs none
        if surface is None and sum(part in curve.sides for curve in curves) < 2:
            return "too few faces on one side of a crease"
    # What bends little is taken as it is; it tells the surfaces, and these tell where the other curves run.
    limit = FARTHEST * float(np.linalg.norm(np.ptp(region.vertices[: region.rim_count], axis=0)))
    edge = float(region.sizes.mean())
    surfaces = _surfaces(region, normals, [curve for curve in curves if curve.is_straight], noisy=noisy)
    curves = [curve if curve.is_straight else _on_surfaces(curve, surfaces, limit, edge) for curve in curves]
    surfaces = _surfaces(region, normals, curves, noisy=noisy)
    return _with_parts(cut, corners, curves, [partial(_on_surface, surface=surface) for surface in surfaces])


def _spanned(side: InfluenceRegion) -> Fill | str:
    """Fill a part by little more than its border."""
    return lifted_fill(side) or first_fill(side, order=1) or "a part of the hole cannot be triangulated"


def _on_surface(side: InfluenceRegion, surface: ImplicitSurface | None) -> Fill | str:
    """Fill a part on a surface, if there is one."""
    fill = _spanned(side)
    if isinstance(fill, str) or surface is None:
        return fill
    moved = project_to_surface(fill, side, surface) if len(fill.points) > fill.rim_count else fill
    return fill if moved is None else meet_rim(moved, side, surface)


def _with_parts(
    cut: CutHole,
    corners: FloatArray,
    curves: Sequence[_Curve],
    fillers: Sequence[Callable[[InfluenceRegion], Fill | str]],
) -> Attempt | str:
    """Fill the parts between the curves, each by a way of its own."""
    region = cut.region
    # The vertices but those inside the parts: rim, corners, points of the curves.
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
    taken, is_limited = region.rim_edges, False
    for part, fill_part in enumerate(fillers):
        loop = border(cut, paths, part)
        if len(np.unique(loop)) < len(loop) or len(loop) < 3:
            return "creases meet before they cross the hole"
        side = sub_hole(cut, part, points, sizes, loop, taken)
        fill = fill_part(side)
        if isinstance(fill, str):
            return fill
        new = np.arange(len(points), len(points) + len(fill.points) - fill.rim_count)
        is_limited |= fill.is_limited
        faces.append(np.concatenate([side.ids[: fill.rim_count], new])[fill.faces].astype(np.int32))
        points = np.vstack([points, fill.points[fill.rim_count :]])
        sizes = np.concatenate([sizes, fill.sizes[fill.rim_count :]])
        taken = np.concatenate([taken, vertex_pairs(faces[-1], shared)])
    creases = np.vstack([np.stack([path[:-1], path[1:]], axis=1) for path in paths])
    fill = Fill(points, sizes, np.vstack(faces), region.rim_count, is_limited)
    return Attempt("creases", fill, parts=len(cut.sectors), creases=creases)


def _side(region: InfluenceRegion, faces: BoolArray) -> FloatArray:
    """Normals (b, 3) of the surroundings as if there were only some of its faces; zero elsewhere."""
    ids, local = np.unique(region.faces[faces], return_inverse=True)
    normals = np.zeros_like(region.vertices)
    if len(ids):
        points = region.vertices[ids]
        # A side may be too small to be a mesh of its own; normals do not depend on its size.
        points = np.ldexp(points, -np.frexp(np.abs(points).max())[1])
        geometry = estimate_vertex_geometry(points, local.reshape(-1, 3))
        normals[ids] = geometry.normals
    return normals


def _surfaces(
    region: InfluenceRegion, sides: Sequence[FloatArray], curves: Sequence[_Curve], *, noisy: bool
) -> list[ImplicitSurface | None]:
    """The surface of each side, through the curves at it, too; None where too few faces tell it."""
    result = []
    for part, normals in enumerate(sides):
        others = np.vstack([np.empty((0, 3)), *(curve.points for curve in curves if part in curve.sides)])
        surface = surface_around(region, normals, noisy=noisy, others=others)
        result.append(None if isinstance(surface, str) else surface)
    return result


def _first_curves(cut: CutHole, surfaces: Sequence[ImplicitSurface | None]) -> tuple[FloatArray, list[_Curve]]:
    """Corners (c, 3), and cubic curves between ends, or from ends to corners; surfaces need not be known."""
    region, ends, part_of_sector = cut.region, cut.ends, cut.part_of_sector
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
            parts = sorted({int(part_of_sector[k]) for k in group}) if surfaces else []
            own = [surface for part in parts if (surface := surfaces[part]) is not None]
            corner = nearest_corner(np.array(places), np.array([ends[k].tangent for k in group]), own, 0.01 * edge)
            name = region.rim_count + len(corners)
            corners.append(corner)
            targets = [(k, name, corner, _unit(corner - place)) for k, place in zip(group, places, strict=True)]
        for k, name, target, tangent in targets:
            start = region.vertices[names[k]], ends[k].tangent
            inner = hermite_curve(*start, target, tangent, edge)
            straight = bending_energy(*start, target, tangent) < STRAIGHT
            sides = int(part_of_sector[k - 1]), int(part_of_sector[k])
            curves.append(_Curve((names[k], name), start[0], target, inner, sides, straight))
    return np.array(corners).reshape(-1, 3), curves


def _on_surfaces(curve: _Curve, surfaces: Sequence[ImplicitSurface | None], limit: float, edge: float) -> _Curve:
    """A curve where the surfaces of its two sides meet, as far as these are known."""
    pair = [surface for part in curve.sides if (surface := surfaces[part]) is not None]
    inner = onto_intersection(curve.points, pair, limit)
    inner = evenly_spaced(np.vstack([curve.start, inner, curve.stop]), edge)
    return replace(curve, points=onto_intersection(inner, pair, limit))


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-300), dtype=np.float64)


def groupings(ends: Sequence[CreaseEnd], points: FloatArray) -> list[list[tuple[int, ...]]]:
    """Ways to join the ends of creases, the best first: pairs that one curve joins, and more that meet in a corner.

    As few ends as possible are left over, and then the curves bend as little as possible. They do not cross. Corners of
    more than three are those where the creases go; three that are all there are always meet in one. Last come ways in
    which a ridge and a valley meet where both end, as at the tip of a dart.

    The ends are in the order of the rim, `points` (k, 3) is where they are. Gives the numbers of those that belong
    together; ends that are missing end in the hole.
    """
    count = len(ends)
    pairs: dict[tuple[int, ...], float] = {
        (i, j): _energy(ends, points, i, j) for i, j in combinations(range(count), 2)
    }
    tangents = np.array([end.tangent for end in ends]).reshape(-1, 3)
    # Where there are many ends, only all of them may meet.
    sizes = range(3, count + 1) if count <= MOST_ENDS else (count,)
    possible = (group for size in sizes for group in combinations(range(count), size))
    corners = {group: _corner_energy(points, tangents, list(group)) for group in possible}
    if count == 3:
        corners[0, 1, 2] = min(corners[0, 1, 2], LARGEST_BEND)
    result: list[list[tuple[int, ...]]] = []
    darts = {
        (i, j): _corner_energy(points, tangents, [i, j])
        for i, j in pairs
        if ends[i].is_convex != ends[j].is_convex and tangents[i] @ tangents[j] > BLUNTEST
    }
    for found in (_partition(count, pairs | corners), _partition(count, pairs), _partition(count, pairs | darts)):
        if found and found not in result:
            result.append(found)
    return result


def _energy(ends: Sequence[CreaseEnd], points: FloatArray, i: int, j: int) -> float:
    """Bending energy of the curve between two ends; infinite between ridge and valley, or if it bends too far."""
    if ends[i].is_convex != ends[j].is_convex:
        return float("inf")
    energy = bending_energy(points[i], ends[i].tangent, points[j], -ends[j].tangent)
    return energy if energy < LARGEST_BEND else float("inf")


def _corner_energy(points: FloatArray, tangents: FloatArray, group: list[int]) -> float:
    """Bending energies of the curves from some ends to the point nearest to their lines; infinite if one bends far."""
    starts, along = points[group], tangents[group]
    across = np.eye(3) - along[:, :, np.newaxis] * along[:, np.newaxis, :]
    corner = np.linalg.lstsq(across.sum(axis=0), np.einsum("kij,kj->i", across, starts), rcond=1e-6)[0]
    chords = corner - starts
    lengths = np.linalg.norm(chords, axis=1, keepdims=True)
    if not (lengths > 0.0).all():
        return float("inf")
    energies = [bending_energy(s, t, corner, c) for s, t, c in zip(starts, along, chords / lengths, strict=True)]
    return sum(energies) if max(energies) < LARGEST_LEG_BEND else float("inf")


def bending_energy(start: FloatArray, start_tangent: FloatArray, stop: FloatArray, stop_tangent: FloatArray) -> float:
    """Integral of the squared second derivative of the cubic curve over a unit chord; about the squared angle it turns.

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


def _partition(count: int, energies: Mapping[tuple[int, ...], float]) -> list[tuple[int, ...]]:
    """Groups that do not cross, with as few ends left over as possible, and then with the least energy."""

    @cache
    def best(first: int, stop: int) -> tuple[int, float, tuple[tuple[int, ...], ...]]:
        if stop - first < 2:
            return max(stop - first, 0), 0.0, ()
        rest = best(first + 1, stop)
        options = [(rest[0] + 1, rest[1], rest[2])]
        for group, energy in energies.items():
            if group[0] == first and group[-1] < stop and energy < float("inf"):
                between = [best(a + 1, b) for a, b in zip(group, (*group[1:], stop), strict=True)]
                found = (group, *(part for option in between for part in option[2]))
                options.append(
                    (sum(o[0] for o in between), ENERGY_OF_GROUP + energy + sum(o[1] for o in between), found)
                )
        # Of equals the first: leaving the first end over comes before joining it.
        return min(options, key=lambda option: option[:2])

    return list(best(0, count)[2])


def nearest_corner(
    points: FloatArray, tangents: FloatArray, surfaces: Sequence[ImplicitSurface], tolerance: float
) -> FloatArray:
    """The point with the least sum of distances to lines through points (k, 3) along tangents, and to surfaces.

    Sums of distances, not of squares: a crease that bends on its way, or a surface that is continued badly, does not
    pull the corner away from where the others meet. Found by least squares with weights from the distances.
    """
    across = np.eye(3) - tangents[:, :, np.newaxis] * tangents[:, np.newaxis, :]
    corner = points.mean(axis=0)
    line_weights, surface_weights = np.ones(len(points)), np.zeros(len(surfaces))
    for _ in range(STEPS_TO_CORNER):
        values, gradients = _values(surfaces, corner[np.newaxis])
        values, gradients = values[0], gradients[0]
        system = 1e-6 * np.eye(3) + np.einsum("k,kij->ij", line_weights, across)
        system += np.einsum("k,ki,kj->ij", surface_weights, gradients, gradients)
        target = np.einsum("k,kij,kj->i", line_weights, across, points - corner)
        target -= np.einsum("k,k,ki->i", surface_weights, values, gradients)
        corner = corner + np.linalg.solve(system, target)
        distances = np.linalg.norm(np.einsum("kij,kj->ki", across, points - corner), axis=1)
        line_weights = 1.0 / np.maximum(distances, tolerance)
        surface_weights = 1.0 / np.maximum(np.abs(_values(surfaces, corner[np.newaxis])[0][0]), tolerance)
    return np.asarray(corner, dtype=np.float64)


def _values(surfaces: Sequence[ImplicitSurface], points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (n, k) and gradients (n, k, 3) of k surfaces."""
    found = [surface.values_and_gradients(points) for surface in surfaces]
    values = np.array([value for value, _ in found]).reshape(len(surfaces), len(points))
    gradients = np.array([gradient for _, gradient in found]).reshape(len(surfaces), len(points), 3)
    return values.T, gradients.swapaxes(0, 1)


def hermite_curve(
    start: FloatArray, start_tangent: FloatArray, stop: FloatArray, stop_tangent: FloatArray, edge: float
) -> FloatArray:
    """Points inside a cubic curve about one edge apart, (k, 3); tangents are unit vectors along the curve."""
    length = float(np.linalg.norm(stop - start))
    t = np.linspace(0.0, 1.0, 200)[:, np.newaxis]
    curve = (
        (1 + 2 * t) * (1 - t) ** 2 * start
        + t * (1 - t) ** 2 * length * start_tangent
        + t**2 * (3 - 2 * t) * stop
        - t**2 * (1 - t) * length * stop_tangent
    )
    return evenly_spaced(curve, edge)


def evenly_spaced(curve: FloatArray, edge: float) -> FloatArray:
    """Points inside a polyline (n, 3) about one edge apart, without its ends."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    count = max(round(float(lengths[-1]) / edge), 1)
    at = np.linspace(0.0, lengths[-1], count + 1)[1:-1]
    return np.stack([np.interp(at, lengths, curve[:, k]) for k in range(3)], axis=1)


def onto_intersection(points: FloatArray, surfaces: Sequence[ImplicitSurface], limit: float) -> FloatArray:
    """Move points (n, 3) to where all surfaces are zero, by Newton's method with the shortest steps.

    Points that would go farther than a limit stay where they are; so they do in directions that surfaces
    nearly tangent to each other do not determine.
    """
    result, longest = points.copy(), max(0.2 * limit, 1e-300)
    for _ in range(NEWTON_STEPS):
        values, gradients = _values(surfaces, result)
        steps = np.einsum("nij,nj->ni", np.linalg.pinv(gradients, rcond=WEAKEST), values)
        lengths = np.linalg.norm(steps, axis=1, keepdims=True)
        result = result - steps * (longest / np.maximum(lengths, longest))
    moved = np.linalg.norm(result - points, axis=1) <= limit
    return np.where((moved & np.isfinite(result).all(axis=1))[:, np.newaxis], result, points)
