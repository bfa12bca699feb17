"""Height-field fills: the Delaunay triangulation of a rim that projects injectively to a plane, lifted to a surface.

The paper (Li, Barsky, Jin, IEEE SMI 2009) fits one bicubic Bezier patch to the influence area around the hole, in a
local frame. The rim polygon is triangulated in the parameter plane and its vertices are lifted to the patch. A
displacement makes the patch pass through the rim: see docs/decisions/2026-11-21-border-correction.md.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.holes.influence_region import InfluenceRegion
from bezier_filters.holes.loops import is_simple, plane_axes, simple_loops, vector_area
from bezier_filters.holes.polygon_triangulation import triangulate_polygon
from bezier_filters.holes.polyharmonic_fairing import polyharmonic_continuation
from bezier_filters.holes.refinement import Fill, flip_edges, refine
from bezier_filters.holes.rim_planes import rim_plane
from bezier_filters.patches.patch_fit import PatchFit, fit_patch

PAPER_RINGS = 2  # rings around the hole that the paper's patch is fitted to, if they have enough points
MIN_PATCH_POINTS = 32  # number of points that is enough: twice that of control points
MAX_PIECE_POINTS = 4  # rim vertices whose product of Lagrange polynomials is bicubic, like the patch

Correction = Literal["harmonic", "lagrange", "lagrange_pieces"]


def paper_fill(
    region: InfluenceRegion, alpha: float, correction: Correction = "harmonic", *, refined: bool = True
) -> Fill | str:
    """Fill a hole by the paper's method, or return the reason for a failure; `alpha` as in `PatchFit`.

    Without refinement the fill has only the vertices of the rim, so that only the plane of the patch matters.
    """
    if not region.has_simple_rim:
        return "there is an island in the hole"
    area = np.flatnonzero(region.rings <= PAPER_RINGS)
    area = area if len(area) >= MIN_PATCH_POINTS else np.arange(len(region.ids))
    fill: Fill | str = "the hole and its surroundings have no mean normal"
    for origin, axes in _frames(region):
        fill = _planar_fill(region, origin, axes, refined=refined)
        if not isinstance(fill, str):
            break
    if isinstance(fill, str):
        return fill
    try:
        patch = fit_patch(region.vertices[area], origin, axes, PatchFit(3, alpha, "paper"))
    except InvalidParameterError as error:
        return str(error)
    lifted = patch.evaluate(*patch.rectangle.parameters(fill.points[:, 0], fill.points[:, 1]))
    return _displace_to_rim(fill, lifted, region, correction)


def _frames(region: InfluenceRegion) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Candidate frames: z along the mean normal of the influence area, then of the hole; x towards a rim vertex."""
    rim = region.vertices[region.loops[0]]
    origin = rim.mean(axis=0)
    near = (region.rings[region.faces] <= PAPER_RINGS).all(axis=1)
    around = region.face_normals[near].sum(axis=0)
    for normal, least in (around, 0.1 * np.count_nonzero(near)), (vector_area(rim), 0.0):
        if not np.linalg.norm(normal) > least:
            continue
        axes = plane_axes(normal)
        x, y = axes[:2] @ (rim[0] - origin)
        length = np.hypot(x, y)
        if length > 0.0:
            turn = np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, length]]) / length
            yield origin, turn @ axes


def flat_fill(region: InfluenceRegion, noise: float | None = None) -> Fill | str:
    """Fill a hole in its plane, or return the reason for a failure.

    Where the rim leaves the plane by more than noise of this standard deviation, the heights are harmonic.
    """
    plane = rim_plane([region.vertices[loop] for loop in region.loops])
    if plane is None:
        return "the rim has no mean plane"
    fill = _planar_fill(region, plane.origin, plane.axes)
    if isinstance(fill, str):
        return fill
    points = fill.points @ plane.axes + plane.origin
    if not plane.is_flat(noise):
        return _displace_to_rim(fill, points, region)
    points[: fill.rim_count] = region.rim_vertices
    return replace(fill, points=points)


def _displace_to_rim(
    fill: Fill, points: FloatArray, region: InfluenceRegion, correction: Correction = "harmonic"
) -> Fill:
    """Displace a lifted planar fill, with new coordinates `points`, so that it passes through the rim."""
    rim = region.rim_vertices
    shift = rim - points[: len(rim)]
    if correction == "harmonic":
        points = points + polyharmonic_continuation(fill.points, fill.faces, shift)
    else:
        most = len(rim) if correction == "lagrange" else MAX_PIECE_POINTS
        points = points + lagrange_displacement(fill.points[:, :2], shift, most)
    points[: len(rim)] = rim
    return replace(fill, points=points)


@np.errstate(all="ignore")
def lagrange_displacement(flat: FloatArray, shift: FloatArray, most: int) -> FloatArray:
    """The paper's interpolation of the shifts (r, 3) of the first r points to all n points of the plane, (n, 3).

    Shift i has the weight prod_j (u - u_j) (v - v_j) / ((u_i - u_j) (v_i - v_j)) over the other rim points j, which is
    not finite if two of them share a parameter. More than `most` rim points are bisected recursively at the median, and
    each piece interpolates its own shifts.
    """
    result = np.zeros((len(flat), 3))
    pieces = [(np.arange(len(shift)), np.arange(len(flat)))]
    while pieces:
        first, all_of_it = pieces.pop()
        if len(first) > most:
            axis = int(np.ptp(flat[first], axis=0).argmax())
            middle = np.median(flat[first, axis])
            below, all_below = flat[first, axis] < middle, flat[all_of_it, axis] < middle
            if below.any():
                pieces += [(first[below], all_of_it[all_below]), (first[~below], all_of_it[~all_below])]
                continue
        for i in first.tolist():
            others = flat[first[first != i]]
            ratios = (flat[all_of_it, np.newaxis] - others) / (flat[i] - others)
            result[all_of_it] += ratios.prod(axis=(1, 2))[:, np.newaxis] * shift[i]
    return result


def _planar_fill(region: InfluenceRegion, origin: FloatArray, axes: FloatArray, *, refined: bool = True) -> Fill | str:
    """Triangulate and refine a hole in a plane through an origin (3,), or return the reason for a failure.

    Rows of `axes` are the x and y axes of the plane and its normal. Points have local coordinates (x, y, 0).
    """
    flat = (region.rim_vertices - origin) @ axes.T
    flat[:, 2] = 0.0
    parts = [part for loop in region.loops for part in simple_loops(loop)]  # of rims that touch themselves
    if not all(is_simple(flat[part, :2]) for part in parts) or not vector_area(flat[region.loops[0]])[2] > 0.0:
        return "the rim does not project injectively to the plane of its surroundings"
    faces = triangulate_polygon(flat[:, :2], region.loops, region.rim_edges)
    if faces is None:
        return "the rim cannot be triangulated in the plane of its surroundings"
    fill = flip_edges(Fill(flat, region.sizes, faces, region.rim_count), region.rim_edges)
    return refine(fill, region.rim_edges) if refined else fill
