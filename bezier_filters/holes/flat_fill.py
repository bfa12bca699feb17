"""Delaunay triangulations of a hole in a plane to which its rim projects injectively."""

from dataclasses import replace

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.fill_topology import Fill, flipped, refined
from bezier_filters.holes.loop_geometry import area_vector, is_simple, plane_axes
from bezier_filters.holes.loop_triangulation import triangulate_loop
from bezier_filters.holes.surroundings import Surroundings
from bezier_filters.holes.variational_fill import shifted

FLATTEST = 1e-12
"""Area of a triangle, over the square of an edge, that rounding may make of none."""


def flat_fill(around: Surroundings, origin: FloatArray, axes: FloatArray) -> Fill | str:
    """Triangulate and refine a hole in a plane.

    Parameters
    ----------
    around : Surroundings
        Of a hole with one loop that passes no vertex twice.
    origin, axes : (3,) float64, (3, 3) float64
        A point of the plane, and rows: its x and y axes and its normal.

    Returns
    -------
    Fill or str
        With local coordinates (x, y, 0), or why it is not possible.
    """
    flat = (around.vertices[: around.rim_count] - origin) @ axes.T
    flat[:, 2] = 0.0
    rim = around.loops[0]
    angles = _angles(flat[rim])
    if not is_simple(flat[rim, :2]) or not angles.sum() < np.pi * (len(rim) - 1):
        return "the rim does not project injectively to the plane of its surroundings"
    faces = triangulate_loop(flat[rim], rim, np.zeros((len(rim), 3)), angles, around.rim_edges)
    if faces is None or not _upright(flat, faces).all():
        return "the rim cannot be triangulated in the plane of its surroundings"
    # Where the rim is straight there may be triangles without area; split, they would put vertices onto it.
    fill = flipped(Fill(flat, around.sizes, faces, around.rim_count), around.rim_edges)
    return refined(fill, around.rim_edges)


def lifted_fill(around: Surroundings) -> Fill | None:
    """The Delaunay triangulation in the plane across which the hole has the largest area, lifted to meet the rim.

    Heights are harmonic. None if the rim does not project injectively.
    """
    rim = around.vertices[around.loops[0]]
    normal = area_vector(rim)
    if not normal.any():
        return None
    origin, axes = rim.mean(axis=0), plane_axes(normal)
    fill = flat_fill(around, origin, axes)
    if isinstance(fill, str):
        return None
    points = fill.points @ axes + origin
    known = around.vertices[: around.rim_count]
    points = points + shifted(fill.points, fill.faces, known - points[: around.rim_count])
    points[: around.rim_count] = known
    return replace(fill, points=points)


def _angles(polygon: FloatArray) -> FloatArray:
    """Angles inside a flat polygon (k, 3) at its corners: in all pi (k - 2) if it runs counter-clockwise."""
    ahead, behind = np.roll(polygon, -1, axis=0) - polygon, np.roll(polygon, 1, axis=0) - polygon
    sine = ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]
    cosine = np.einsum("ij,ij->i", ahead, behind)
    return np.asarray(np.arctan2(sine, cosine) % (2.0 * np.pi), dtype=np.float64)


def _upright(flat: FloatArray, faces: IntArray) -> BoolArray:
    """Which triangles in the plane are not turned over."""
    a, b, c = (flat[faces[:, k], :2] for k in range(3))
    u, v = b - a, c - a
    result: BoolArray = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > -FLATTEST * np.square(u).sum(axis=1)
    return result
