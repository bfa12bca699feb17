import numpy as np
import pytest

from bezier_filters.holes import polyharmonic_fairing as module
from bezier_filters.holes.polyharmonic_fairing import cotangent_matrix, polyharmonic_continuation
from bezier_filters.surfaces import sphere


@pytest.mark.parametrize("full", [0.01, 1.0])
def test_dense_and_sparse_matrices_give_the_same_fill(monkeypatch, full):
    """Also where a sparse one is so full that it is solved as a dense one."""
    ball = sphere(resolution=5)
    free = np.flatnonzero(ball.vertices[:, 2] > 0.6)
    order = np.concatenate([np.flatnonzero(ball.vertices[:, 2] <= 0.6), free])
    points = ball.vertices[order]
    faces = np.argsort(order)[ball.faces].astype(np.int32)
    first = len(points) - len(free)
    shift = np.random.default_rng(0).standard_normal((first, 3))
    assert len(points) <= module.MOST_DENSE
    dense = (
        cotangent_matrix(points, faces),
        [polyharmonic_continuation(points, faces, points[:first], k) for k in (1, 2, 3)],
    )
    dense_shift = polyharmonic_continuation(points, faces, shift)
    monkeypatch.setattr(module, "MOST_DENSE", 0)
    monkeypatch.setattr(module, "FULL", full)
    (matrix, areas), fills = (
        cotangent_matrix(points, faces),
        [polyharmonic_continuation(points, faces, points[:first], k) for k in (1, 2, 3)],
    )
    np.testing.assert_allclose(dense[0][0], matrix.toarray(), atol=1e-12)
    np.testing.assert_array_equal(dense[0][1], areas)
    np.testing.assert_allclose(dense[1], fills, atol=1e-9)
    np.testing.assert_allclose(dense_shift, polyharmonic_continuation(points, faces, shift), atol=1e-9)


def test_areas_of_a_closed_mesh_sum_up_to_its_area():
    ball = sphere(resolution=5)
    matrix, areas = cotangent_matrix(ball.vertices, ball.faces)
    a, b, c = ball.vertices[ball.faces].transpose(1, 0, 2)
    assert areas.sum() == pytest.approx(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    # The matrix is the gradient of the area with fixed angles: x^T L x is twice the area.
    energy = np.einsum("ik,ij,jk->", ball.vertices, matrix, ball.vertices)
    assert energy == pytest.approx(2.0 * areas.sum())
