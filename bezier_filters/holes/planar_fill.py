"""Height-field fills: the Delaunay triangulation of a rim that projects injectively to a plane, lifted to a surface.

The paper (Li, Barsky, Jin, IEEE SMI 2009) fits one bicubic Bezier patch to the influence area around the hole, in a
local frame. The rim polygon is triangulated in the parameter plane and its vertices are lifted to the patch. A
displacement makes the patch pass through the rim: see docs/decisions/2026-11-21-border-correction.md.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.holes.influence_region import InfluenceRegion
from bezier_filters.holes.loops import is_simple, plane_axes, triangulate_loop, vector_area
from bezier_filters.holes.polyharmonic_fairing import polyharmonic_continuation
from bezier_filters.holes.refinement import Fill, flip_edges, refine
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.patches.patch_fit import PatchFit, fit_patch

MIN_UPRIGHT_AREA = 1e-12  # rounding error of twice the area of a triangle, over the square of an edge
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


def harmonic_planar_fill(region: InfluenceRegion) -> Fill | None:
    """Delaunay triangulation in the plane of the vector area of the hole, with harmonic heights; None if that fails.

    It fails if the rim does not project injectively.
    """
    rim = region.vertices[region.loops[0]]
    normal = vector_area(rim)
    if not normal.any():
        return None
    origin, axes = rim.mean(axis=0), plane_axes(normal)
    fill = _planar_fill(region, origin, axes)
    return None if isinstance(fill, str) else _displace_to_rim(fill, fill.points @ axes + origin, region)


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
    rim = region.loops[0]
    angles = _interior_angles(flat[rim])
    if not is_simple(flat[rim, :2]) or not angles.sum() < np.pi * (len(rim) - 1):
        return "the rim does not project injectively to the plane of its surroundings"
    faces = triangulate_loop(flat[rim], rim, np.zeros((len(rim), 3)), angles, region.rim_edges)
    if faces is None or not _are_upright(flat, faces).all():
        return "the rim cannot be triangulated in the plane of its surroundings"
    # At straight pieces of the rim, triangles may be degenerate; splitting them would place vertices on the rim.
    fill = flip_edges(Fill(flat, region.sizes, faces, region.rim_count), region.rim_edges)
    return refine(fill, region.rim_edges) if refined else fill


def _interior_angles(polygon: FloatArray) -> FloatArray:
    """Interior angles of a planar polygon (k, 3); their sum is pi (k - 2) if it runs counter-clockwise."""
    ahead, behind = np.roll(polygon, -1, axis=0) - polygon, np.roll(polygon, 1, axis=0) - polygon
    sine = ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]
    cosine = np.einsum("ij,ij->i", ahead, behind)
    return np.asarray(np.arctan2(sine, cosine) % (2.0 * np.pi), dtype=np.float64)


def _are_upright(flat: FloatArray, faces: IntArray) -> BoolArray:
    """Whether each triangle of the plane has positive orientation, up to rounding, (m,)."""
    sides = flat[faces[:, 1]] - flat[faces[:, 0]]
    return np.asarray(area_vectors(flat, faces)[:, 2] > -MIN_UPRIGHT_AREA * np.square(sides).sum(axis=1))
