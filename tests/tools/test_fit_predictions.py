"""Predictions from fits are those of the surface; meshes are cut where they are not a manifold."""

import numpy as np
import pytest

import bezier_filters as bf
from bezier_filters.surfaces import ellipsoid, sphere
from fit_predictions import predict
from half_edges import cut_to_manifold, half_edges


def test_a_smooth_surface_is_predicted_between_its_vertices():
    ball = sphere(radius=2.0, resolution=16, jitter=0.2)
    geometry = bf.estimate_vertex_geometry(ball.vertices, ball.faces)
    points = ball.vertices[ball.faces[::7]].mean(axis=1)
    points *= 2.0 / np.linalg.norm(points, axis=1, keepdims=True)
    found = predict(points, ball.vertices, geometry, np.ones(len(ball.vertices), dtype=bool), 1.0)
    assert len(found.points) == len(points)
    assert np.abs(found.heights).max() < 1e-7
    assert np.abs(found.normals - points[found.points] / 2.0).max() < 1e-6
    assert np.abs(found.mean_curvatures - 0.5).max() < 1e-5


def test_predictions_need_usable_fits_within_reach():
    shape = ellipsoid(resolution=12)
    geometry = bf.estimate_vertex_geometry(shape.vertices, shape.faces)
    usable = shape.vertices[:, 2] > 0.0
    found = predict(shape.vertices, shape.vertices, geometry, usable, 1.0)
    assert 0 < len(found.points) < usable.sum()
    assert usable[found.points].all()
    assert not len(predict(shape.vertices + 9.0, shape.vertices, geometry, usable, 1.0).points)


@pytest.mark.parametrize(
    ("faces", "count"),
    [
        ([[0, 1, 2], [0, 2, 3]], 4),
        ([[0, 1, 2], [2, 3, 4]], 6),  # two fans
        ([[0, 1, 2], [0, 2, 3], [2, 0, 4], [1, 1, 3]], 9),  # three faces at an edge, and one without an area
        ([[0, 1, 2], [0, 3, 2], [0, 2, 4]], 9),  # two of them one way
        ([[0, 1, 2], [0, 1, 3]], 6),  # oriented differently
    ],
)
def test_meshes_are_cut_to_a_manifold(faces, count):
    vertices = np.random.default_rng(0).random((6, 3))
    cut, new = cut_to_manifold(vertices, np.array(faces))
    proper = [face for face in faces if len(set(face)) == 3]
    assert len(cut) == count
    assert (cut[new] == vertices[proper]).all()
    half_edges(new, len(cut))
