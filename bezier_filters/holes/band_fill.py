"""Straight bands between two rims, where the surface arrives at an angle, as at the wall of a bolt hole.

A smooth band would have to bend by that angle at the rim. So there the rim is an edge, and the band is ruled: the zero
set of a polyharmonic spline through points of segments that connect the rims, with the normals of the triangles at
their ends. It is a cylinder between equal circles, and a cone between unequal ones.
"""

from collections.abc import Iterator

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.holes.implicit_surface import fit_implicit_surface
from bezier_filters.holes.influence_region import MAX_SURFACE_POINTS, InfluenceRegion, farthest_point_sample
from bezier_filters.holes.loops import corner_angles
from bezier_filters.holes.refinement import Fill, refine
from bezier_filters.holes.rim_triangulation import triangulate_rim
from bezier_filters.holes.smooth_fill import Attempt, attach_to_rim, project_to_surface
from bezier_filters.meshes.frames import unit_face_normals
from bezier_filters.meshes.half_edges import half_edge_lists, normals_along

# Mean cosine, along a rim, of the angle between the band and the surface beyond, below which the rim is an edge:
# 60 degrees, as for flat ends.
MIN_SMOOTH_COSINE = 0.5


def straight_attempts(region: InfluenceRegion, *, noisy: bool) -> Iterator[Attempt]:
    """Straight bands, if the surface arrives at one of the rims at an angle: on a surface, then the triangles."""
    band = triangulate_rim(region)
    if band is None or not _meets_edge(band, region):
        return
    ruled = refine(band, region.rim_edges)
    step = float(region.sizes.mean())
    points, normals = _segment_points(band, region, step)
    surface = fit_implicit_surface(points, normals, step, noisy=noisy)
    if surface is not None:
        projected = project_to_surface(ruled, region, surface)
        if not isinstance(projected, str):
            yield Attempt("straight", projected if noisy else attach_to_rim(projected, region, surface))
    yield Attempt("straight", ruled)


def _meets_edge(band: Fill, region: InfluenceRegion) -> bool:
    """Whether the angle between a band and the surface beyond one of its rims is that of an edge, in the mean."""
    lists = half_edge_lists(band.faces, len(band.points))
    for loop in region.loops:
        own = normals_along(band.points, band.faces, lists, loop, beyond=False)
        cosines = np.einsum("ij,ij->i", own, region.rim_face_normals(loop))
        if cosines.mean() < MIN_SMOOTH_COSINE:
            return True
    return False


def _segment_points(band: Fill, region: InfluenceRegion, step: float) -> tuple[FloatArray, FloatArray]:
    """Points about a step apart on the shortest connection of each rim vertex, and their unit normals, (k, 3) each."""
    is_second = np.isin(np.arange(band.rim_count), region.loops[1])
    edges = np.concatenate([band.faces[:, [k, k - 1]] for k in range(3)])
    edges = edges[is_second[edges[:, 0]] != is_second[edges[:, 1]]]
    edges = np.concatenate([edges, edges[:, ::-1]])
    lengths = np.linalg.norm(band.points[edges[:, 0]] - band.points[edges[:, 1]], axis=1)
    order = np.lexsort((lengths, edges[:, 0]))
    shortest = edges[order[np.unique(edges[order, 0], return_index=True)[1]]]
    starts, ends = np.unique(np.sort(shortest, axis=1), axis=0).T
    count = max(round(float(np.median(lengths)) / step), 1)
    share = (np.arange(1, count) / count)[:, np.newaxis, np.newaxis]
    normals = _rim_normals(band)
    points, directions = (
        np.vstack([values, ((1.0 - share) * values[starts] + share * values[ends]).reshape(-1, 3)])
        for values in (band.points, normals)
    )
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    known = lengths[:, 0] > 0.0
    points, directions = points[known], (directions / np.maximum(lengths, 1e-300))[known]
    if len(points) > MAX_SURFACE_POINTS:
        rows = farthest_point_sample(points, np.arange(len(points)) < band.rim_count, MAX_SURFACE_POINTS)
        points, directions = points[rows], directions[rows]
    return points, directions


def _rim_normals(band: Fill) -> FloatArray:
    """Unit normals at the vertices of the rims: those of the triangles, weighted by their angles, (r, 3)."""
    normals, sums = unit_face_normals(band.points, band.faces), np.zeros((band.rim_count, 3))
    for k in range(3):
        tips, lefts, rights = (band.faces[:, (k + j) % 3] for j in range(3))
        angles = corner_angles(band.points[tips], band.points[lefts], band.points[rights])
        np.add.at(sums, tips, angles[:, np.newaxis] * normals)
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300))
