"""Volume and height between patches, against bodies whose volume is known."""

import numpy as np
import pytest

from bezier_filters.holes.removed_material import cone_volume, largest_height
from bezier_filters.surfaces import sphere


def test_the_volume_of_a_closed_body_does_not_depend_on_the_point():
    ball = sphere(resolution=40)
    for origin in ([0.0, 0.0, 0.0], [3.0, -2.0, 7.0]):
        found = cone_volume(ball.vertices, ball.faces, np.array(origin))
        assert found == pytest.approx(4.0 / 3.0 * np.pi, rel=2e-3)
    assert cone_volume(ball.vertices, ball.faces[:, ::-1], np.zeros(3)) < 0.0


def test_heights_of_random_points_over_a_sphere_are_those_of_all_faces():
    ball = sphere(resolution=10)
    rng = np.random.default_rng(0)
    for low, high in ((0.5, 0.9), (1.05, 2.0), (0.2, 3.0)):
        directions = rng.standard_normal((400, 3))
        radii = rng.uniform(low, high, 400)
        points = directions / np.linalg.norm(directions, axis=1, keepdims=True) * radii[:, np.newaxis]
        alone = [largest_height(point[np.newaxis], ball.vertices, ball.faces) for point in points]
        np.testing.assert_allclose(alone, radii - 1.0, atol=0.02)  # the faces are inside of the sphere
        assert largest_height(points, ball.vertices, ball.faces) == max(alone, key=abs)


def test_points_beside_edges_and_corners():
    square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    for point, height in [([0.5, 0.5, 0.2], 0.2), ([2.0, 0.5, 1.0], 2.0**0.5), ([-1.0, -1.0, -1.0], -(3.0**0.5))]:
        assert largest_height(np.array([point]), square, faces) == pytest.approx(height)
    assert largest_height(np.empty((0, 3)), square, faces) == 0.0
