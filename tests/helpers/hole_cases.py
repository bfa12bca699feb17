"""Meshes with holes whose truth is known, and what every filled mesh must satisfy."""

import numpy as np
from surface_cases import border_edges, directed_edges

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.holes.hole_filling import HoleFillingResult
from bezier_filters.holes.hole_report import HoleReport
from bezier_filters.holes.influence_region import InfluenceRegion, influence_regions
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.surfaces import block_with_sharp_edges, sphere


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


def off_the_cube(points: FloatArray) -> FloatArray:
    """Distance from the surface of the cube [-1/2, 1/2]^3 of points near it, (n,)."""
    distances: FloatArray = np.abs(np.abs(points).max(axis=1) - 0.5)
    return distances


def cube(resolution: int = 24) -> tuple[FloatArray, IntArray]:
    """A cube without the notch of the block: its corner at (-1/2, -1/2, -1/2) and what is near it."""
    return block_with_sharp_edges(resolution=resolution)


def filled_hole(result: HoleFillingResult) -> HoleReport:
    """The only hole that was filled."""
    (hole,) = [hole for hole in result.holes if hole.filled]
    return hole


def hole_around(vertices: FloatArray, faces: IntArray, rings: int = 2) -> InfluenceRegion:
    """What surrounds the first hole of a mesh that is no outer rim."""
    mesh = prepare_mesh(triangle_mesh(vertices, faces))
    hole = next(h for h in find_holes(mesh) if not h.is_outer_rim)
    (region,) = influence_regions(mesh, [hole.loops], rings)
    return region


def ball_with_rim(noise: float = 0.0, seed: int = 0) -> tuple[FloatArray, IntArray, float]:
    """A ball with a hole on top, with noise of its rim, in edges and in all directions, that folds faces there."""
    ball = sphere(resolution=24, jitter=0.1, seed=seed)
    faces = ball.faces[~(ball.vertices[ball.faces][:, :, 2] > 0.85).any(axis=1)]
    used = np.unique(faces)
    vertices, faces = ball.vertices[used], np.searchsorted(used, faces).astype(np.int32)
    rim = np.unique(border_edges(faces))
    step = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    vertices[rim] += noise * step * np.random.default_rng(seed).standard_normal((len(rim), 3))
    return vertices, faces, float(step)
