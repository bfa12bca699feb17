"""Lengths that the edges of a new mesh shall have: one for all, or from the curvature."""

from collections.abc import Callable

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.triangles import area_vectors

LONG, SHORT = 4.0 / 3.0, 4.0 / 5.0  # lengths over the wanted ones, from which edges are split and collapsed
MAX_GROWTH = 0.3  # of the length along an edge, per length of the edge: neighbouring triangles are of similar size
Sizing = Callable[[FloatArray, IntArray, FloatArray], FloatArray]
"""Lengths (n,) for edges at vertices, given points (n, 3), faces (m, 3) and the largest absolute curvature there."""


def length_for_count(vertices: FloatArray, faces: IntArray, count: float) -> float:
    """Length of the edges of a mesh of `count` equilateral triangles with the same area."""
    area = 0.5 * float(np.linalg.norm(area_vectors(vertices, faces), axis=1).sum())
    return float(np.sqrt(area / max(count, 1.0) * 4.0 / np.sqrt(3.0)))


def uniform_sizing(length: float) -> Sizing:
    """The same length everywhere."""
    return lambda points, faces, curvatures: np.full(len(points), length)


def curvature_sizing(chord_error: float, shortest: float, longest: float) -> Sizing:
    """Lengths at which triangles stay within a distance from a surface of the curvature, within bounds.

    An equilateral triangle with corners on a sphere of curvature k is farthest from it, by e, in its centre: its edges
    are sqrt(6 e / k - 3 e^2) long (Dunyach et al., "Adaptive remeshing for real-time mesh deformation", 2013). So long
    are the longest ones that are not split.
    """

    def lengths(points: FloatArray, faces: IntArray, curvatures: FloatArray) -> FloatArray:
        radii = 1.0 / np.maximum(curvatures, 1e-300)
        errors = np.minimum(chord_error, radii)  # a triangle through the centre has the longest edges
        squared = 6.0 * errors * radii - 3.0 * errors**2
        found = np.clip(np.sqrt(np.maximum(squared, 0.0)) / LONG, shortest, longest)
        return _limit_growth(points, faces, found)

    return lengths


def _limit_growth(points: FloatArray, faces: IntArray, lengths: FloatArray) -> FloatArray:
    """Lengths that grow along edges by no more than a part of these."""
    starts, stops = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    rise = MAX_GROWTH * np.linalg.norm(points[starts] - points[stops], axis=1)
    while True:
        bound = lengths.copy()
        np.minimum.at(bound, stops, lengths[starts] + rise)
        np.minimum.at(bound, starts, lengths[stops] + rise)
        if np.array_equal(bound, lengths):
            return lengths
        lengths = bound
