"""Meshes with holes whose truth is known, and what every filled mesh must satisfy."""

import numpy as np
from surface_cases import border_edges, directed_edges

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.hole_filling import HoleFillingResult


def without_faces_near(vertices: FloatArray, faces: IntArray, center: FloatArray, radius: float) -> IntArray:
    """Faces whose centroid is not within a distance of a point."""
    far: BoolArray = np.linalg.norm(vertices[faces].mean(axis=1) - center, axis=1) > radius
    return faces[far]


def sheet(columns: int, rows: int) -> tuple[FloatArray, IntArray]:
    """Flat grid of unit squares, each cut in two."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    corner = (np.arange(rows)[:, np.newaxis] * (columns + 1) + np.arange(columns)).ravel()
    above = corner + columns + 1
    lower, upper = np.stack([corner, corner + 1, above + 1], 1), np.stack([corner, above + 1, above], 1)
    return vertices, np.vstack([lower, upper]).astype(np.int32)


def without_squares(vertices: FloatArray, faces: IntArray, inside: object) -> IntArray:
    """Faces of a sheet but those of squares whose centre (x, y) satisfies a condition."""
    x, y, _ = np.floor(vertices[faces].mean(axis=1).T) + 0.5
    return faces[~inside(x, y)]  # type: ignore[operator]


def assert_filled(vertices: FloatArray, faces: IntArray, result: HoleFillingResult) -> None:
    """The old part is untouched, the whole is manifold and oriented, and filled holes are closed."""
    np.testing.assert_array_equal(result.vertices[: len(vertices)], vertices)
    np.testing.assert_array_equal(result.faces[: len(faces)], faces)
    assert result.vertices.dtype == np.float64
    assert result.faces.dtype == np.int32
    assert np.isfinite(result.vertices).all()
    edges = directed_edges(result.faces)
    assert len(np.unique(edges, axis=0)) == len(edges), "an edge is passed twice in the same direction"
    open_vertices = [] if len(border_edges(result.faces)) == 0 else np.unique(border_edges(result.faces))
    left = [hole.rim for hole in result.holes if not hole.filled]
    assert set(open_vertices) == set(np.concatenate(left).tolist() if left else [])
    used = np.zeros(len(result.vertices), dtype=bool)
    used[result.faces] = True
    assert used[len(vertices) :].all()
    counts = [(len(hole.new_vertices), len(hole.new_faces)) for hole in result.holes]
    assert np.sum(counts, axis=0).tolist() == [len(result.vertices) - len(vertices), len(result.faces) - len(faces)]
    for hole in result.holes:
        assert hole.rim_error == 0.0
        assert hole.self_intersections == 0
        assert (hole.method == "") == (not hole.filled)
