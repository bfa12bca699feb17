import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters.holes.refinement import Fill, _move_to_centroids, relaxation_workspace


def fan(count, tips):
    """A ring of vertices around the origin, and further vertices, the first of which is joined to all of them."""
    angle = 2 * np.pi * np.arange(count) / count
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    k = np.arange(count)
    faces = np.column_stack([k, np.roll(k, -1), np.full(count, count)]).astype(np.int32)
    return Fill(np.vstack([rim, tips]), np.ones(count + len(tips)), faces, count)


def relaxed_points(fill):
    points = fill.points.copy()
    _move_to_centroids(points, fill.faces, relaxation_workspace(fill), fill.rim_count)
    return points


@given(st.integers(3, 12), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_every_new_vertex_moves_to_the_mean_of_its_neighbours(count, x, y):
    """The only one of a fan moves to the mean of the rim, which stays."""
    fill = fan(count, np.array([[x, y, 0.3]]))
    relaxed = relaxed_points(fill)
    np.testing.assert_array_equal(relaxed[:count], fill.points[:count])
    np.testing.assert_allclose(relaxed[count], 0.0, atol=1e-12)


def test_vertices_move_at_the_same_time():
    """Two neighbours on a strip: each goes to the mean of where the others were."""
    points = np.array([[0.0, 0, 0], [3, 0, 0], [3, 2, 0], [0, 2, 0], [0.9, 1.1, 0], [2.2, 0.8, 0]])
    faces = np.array([[0, 1, 4], [1, 5, 4], [1, 2, 5], [2, 3, 5], [3, 4, 5], [3, 0, 4]], dtype=np.int32)
    relaxed = relaxed_points(Fill(points, np.ones(6), faces, 4))
    np.testing.assert_array_equal(relaxed[:4], points[:4])
    np.testing.assert_allclose(relaxed[4], points[[0, 1, 5, 3]].mean(axis=0))
    np.testing.assert_allclose(relaxed[5], points[[1, 2, 3, 4]].mean(axis=0))


@pytest.mark.parametrize("turned", [False, True])
def test_a_vertex_whose_move_would_turn_a_triangle_over_stays(turned):
    """The mean of a rim with a long arm lies outside of its notch, where one of the triangles is turned."""
    arm = 8.0 if turned else 1.2
    rim = np.array([[0.0, 0, 0], [arm, -1, 0], [1, 0, 0], [arm, 1, 0]])
    fill = Fill(np.vstack([rim, [[0.5, 0.0, 0.0]]]), np.ones(5), fan(4, np.zeros((1, 3))).faces, 4)
    mean = rim.mean(axis=0)
    assert (mean[0] > 1.0) == turned
    expected = fill.points[4] if turned else mean
    np.testing.assert_allclose(relaxed_points(fill)[4], expected, atol=1e-12)
