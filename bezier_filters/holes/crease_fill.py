"""Fill a hole that creases run into: they are continued through it, and each part is filled from its own side."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.holes.crease_curves import (
    bending_energy,
    corner_of,
    evenly_spaced,
    groupings,
    hermite_curve,
    onto_intersection,
)
from bezier_filters.holes.fill_topology import Fill
from bezier_filters.holes.flat_fill import lifted_fill
from bezier_filters.holes.implicit_surface import ImplicitSurface
from bezier_filters.holes.rim_creases import crease_ends, may_have_creases, sharp_edges
from bezier_filters.holes.smooth_fill import first_fill, meeting_rim, on_surface, surface_around
from bezier_filters.holes.sub_holes import CutHole, border, cut_hole, sub_hole
from bezier_filters.holes.surroundings import Surroundings

STRAIGHT = 0.3
"""Bending energy of a curve that is taken as it is: it turns by some 30 degrees."""
FEWEST_POINTS = 16
"""With known normals, for the surface of one side."""
FARTHEST = 0.5
"""Times the diameter of the rim: how far a curve or corner may move to the intersection of surfaces."""


@dataclass(frozen=True)
class CreaseFill:
    """A fill with creases.

    Attributes
    ----------
    fill : Fill
        Rim vertices, then those on the creases, then the others.
    creases : (e, 2) int32
        Edges of the creases.
    parts : int
        Sub-holes.
    """

    fill: Fill
    creases: IntArray
    parts: int


@dataclass(frozen=True)
class _Curve:
    """A crease in the hole.

    Attributes
    ----------
    ends : (int, int)
        Rim vertices or corners.
    start, stop : (3,) float64
        Where they are.
    points : (k, 3) float64
        Points in between.
    sides : (int, int)
        The sub-holes on its two sides.
    is_straight : bool
        Whether it bends so little that its tangents at the rim tell all of it.
    """

    ends: tuple[int, int]
    start: FloatArray
    stop: FloatArray
    points: FloatArray
    sides: tuple[int, int]
    is_straight: bool


def crease_fills(around: Surroundings, *, noisy: bool) -> Iterator[CreaseFill | str]:
    """Fills with the creases that end at the rim continued, the most likely first, or what went wrong; maybe none.

    Parameters
    ----------
    around : Surroundings
        Some rings around a hole without islands.
    noisy : bool
        Whether points are fitted rather than interpolated.
    """
    if len(around.loops) > 1 or len(around.loops[0]) > around.rim_count:
        return
    if not may_have_creases(around):
        return
    sharp = sharp_edges(around)
    ends = crease_ends(around, sharp)
    rim = around.loops[0]
    for groups in groupings(ends, around.vertices[rim[[end.position for end in ends]]]):
        joined = sorted(k for group in groups for k in group)
        chosen = [ends[k] for k in joined]
        renumbered = [tuple(joined.index(k) for k in group) for group in groups]
        yield _filled(cut_hole(around, sharp, chosen, renumbered), noisy=noisy)


def _filled(cut: CutHole, *, noisy: bool) -> CreaseFill | str:
    """Fill a hole whose creases are joined in groups of ends."""
    around = cut.around
    normals = [_side(around, cut.part_of_face == part) for part in range(cut.part_count)]
    surfaces = _surfaces(around, normals, [], noisy=noisy)
    if surfaces is None:
        return "too few faces on one side of a crease"
    corners, curves = _first_curves(cut, surfaces)
    # What bends little is taken as it is; it tells the surfaces, and these tell where the other curves run.
    limit = FARTHEST * float(np.linalg.norm(np.ptp(around.vertices[: around.rim_count], axis=0)))
    edge = float(around.sizes.mean())
    surfaces = _surfaces(around, normals, [curve for curve in curves if curve.is_straight], noisy=noisy) or surfaces
    curves = [curve if curve.is_straight else _on_surfaces(curve, surfaces, limit, edge) for curve in curves]
    surfaces = _surfaces(around, normals, curves, noisy=noisy) or surfaces
    return _with_parts(cut, corners, curves, surfaces)


def _with_parts(
    cut: CutHole, corners: FloatArray, curves: Sequence[_Curve], surfaces: Sequence[ImplicitSurface]
) -> CreaseFill | str:
    """Fill the parts between the curves, each on the surface of its side."""
    around = cut.around
    # The vertices but those inside the parts: rim, corners, points of the curves.
    points = np.vstack([around.vertices[: around.rim_count], corners, *(curve.points for curve in curves)])
    sizes = np.concatenate([around.sizes, np.full(len(points) - around.rim_count, around.sizes.mean())])
    paths = []
    first = around.rim_count + len(corners)
    for curve in curves:
        inner = range(first, first + len(curve.points))
        paths.append(np.array([curve.ends[0], *inner, curve.ends[1]], dtype=np.int32))
        first = inner.stop
    shared = len(points)
    faces: list[IntArray] = []
    taken = set(around.rim_edges)
    for part, surface in enumerate(surfaces):
        loop = border(cut, paths, part)
        if len(np.unique(loop)) < len(loop) or len(loop) < 3:
            return "creases meet before they cross the hole"
        side = sub_hole(cut, part, points, sizes, loop, taken)
        fill = lifted_fill(side) or first_fill(side, order=1)
        if fill is None:
            return "a part of the hole cannot be triangulated"
        moved = on_surface(fill, side, surface) if len(fill.points) > fill.rim_count else fill
        fill = fill if moved is None else meeting_rim(moved, side, surface)
        new = np.arange(len(points), len(points) + len(fill.points) - fill.rim_count)
        faces.append(np.concatenate([side.ids[: fill.rim_count], new])[fill.faces].astype(np.int32))
        points = np.vstack([points, fill.points[fill.rim_count :]])
        sizes = np.concatenate([sizes, fill.sizes[fill.rim_count :]])
        edges = np.sort(faces[-1][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        taken |= {(a, b) for a, b in edges[edges[:, 1] < shared].tolist()}
    creases = np.vstack([np.stack([path[:-1], path[1:]], axis=1) for path in paths])
    return CreaseFill(Fill(points, sizes, np.vstack(faces), around.rim_count), creases, cut.part_count)


def _side(around: Surroundings, faces: BoolArray) -> FloatArray:
    """Normals (b, 3) of the surroundings as if there were only some of its faces; zero elsewhere."""
    ids, local = np.unique(around.faces[faces], return_inverse=True)
    normals = np.zeros_like(around.vertices)
    if len(ids):
        geometry = estimate_vertex_geometry(around.vertices[ids], local.reshape(-1, 3), threads=1)
        normals[ids] = geometry.normals
    return normals


def _surfaces(
    around: Surroundings, sides: Sequence[FloatArray], curves: Sequence[_Curve], *, noisy: bool
) -> list[ImplicitSurface] | None:
    """The surface of each side, through the curves at it, too; None if one cannot be found."""
    result = []
    for part, normals in enumerate(sides):
        known = np.einsum("ij,ij->i", normals, normals) > 0.25
        others = np.vstack([np.empty((0, 3)), *(curve.points for curve in curves if part in curve.sides)])
        surface = None
        if np.count_nonzero(known) >= FEWEST_POINTS:
            surface = surface_around(around, normals, known, noisy=noisy, others=others)
        if surface is None:
            return None
        result.append(surface)
    return result


def _first_curves(cut: CutHole, surfaces: Sequence[ImplicitSurface]) -> tuple[FloatArray, list[_Curve]]:
    """Corners (c, 3), and cubic curves between ends, or from ends to corners."""
    around, ends, part_of_sector = cut.around, cut.ends, cut.part_of_sector
    rim = around.loops[0]
    names = [int(rim[end.position]) for end in ends]
    edge = float(around.sizes.mean())
    corners: list[FloatArray] = []
    curves: list[_Curve] = []
    for group in cut.groups:
        places = [around.vertices[names[k]] for k in group]
        if len(group) == 2:
            targets = [(group[0], names[group[1]], places[1], -ends[group[1]].tangent)]
        else:
            own = [surfaces[part] for part in sorted({part_of_sector[k] for k in group})]
            corner = corner_of(np.array(places), np.array([ends[k].tangent for k in group]), own, 0.01 * edge)
            name = around.rim_count + len(corners)
            corners.append(corner)
            targets = [(k, name, corner, _unit(corner - place)) for k, place in zip(group, places, strict=True)]
        for k, name, target, tangent in targets:
            start = around.vertices[names[k]], ends[k].tangent
            inner = hermite_curve(*start, target, tangent, edge)
            straight = bending_energy(*start, target, tangent) < STRAIGHT
            sides = part_of_sector[k - 1], part_of_sector[k]
            curves.append(_Curve((names[k], name), start[0], target, inner, sides, straight))
    return np.array(corners).reshape(-1, 3), curves


def _on_surfaces(curve: _Curve, surfaces: Sequence[ImplicitSurface], limit: float, edge: float) -> _Curve:
    """A curve where the surfaces of its two sides meet."""
    pair = [surfaces[part] for part in curve.sides]
    inner = onto_intersection(curve.points, pair, limit)
    inner = evenly_spaced(np.vstack([curve.start, inner, curve.stop]), edge)
    return replace(curve, points=onto_intersection(inner, pair, limit))


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-300), dtype=np.float64)
