import numpy as np
import pytest
from surface_cases import area_vectors

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
    assert len(points) <= module.MAX_DENSE_VERTICES
    dense = [polyharmonic_continuation(points, faces, points[:first], k) for k in (1, 2, 3)]
    dense_shift = polyharmonic_continuation(points, faces, shift)
    monkeypatch.setattr(module, "MAX_DENSE_VERTICES", 0)
    monkeypatch.setattr(module, "MAX_SPARSE_DENSITY", full)
    sparse = [polyharmonic_continuation(points, faces, points[:first], k) for k in (1, 2, 3)]
    np.testing.assert_allclose(dense, sparse, atol=1e-9)
    np.testing.assert_allclose(dense_shift, polyharmonic_continuation(points, faces, shift), atol=1e-9)


def test_the_energy_of_a_closed_mesh_is_twice_its_area():
    """The matrix is the gradient of the area with fixed angles: x^T L x is twice the area."""
    ball = sphere(resolution=5)
    matrix, areas = cotangent_matrix(ball.vertices, ball.faces)
    of_faces = np.linalg.norm(area_vectors(ball.vertices, ball.faces), axis=1)
    of_vertices = np.bincount(ball.faces.ravel(), weights=np.repeat(of_faces / 3.0, 3))
    np.testing.assert_allclose(areas, of_vertices / of_vertices.mean())
    assert np.einsum("ik,ik->", ball.vertices, matrix @ ball.vertices) == pytest.approx(2.0 * of_faces.sum())


def test_around_a_vertex_of_very_high_valence_the_order_is_reduced():
    """The powers of its matrix are dense: they took all memory."""
    count = 4000
    angles = 2.0 * np.pi * np.arange(count) / count
    ring = np.column_stack([np.cos(angles), np.sin(angles), 0.1 * np.cos(3.0 * angles)])
    points = np.vstack([1.1 * ring, ring, np.zeros((1, 3))])
    i, j = np.arange(count), np.roll(np.arange(count), -1)
    hub = np.full(count, 2 * count)
    triples = [(i, j, j + count), (i, j + count, i + count), (i + count, j + count, hub)]
    faces = np.concatenate([np.column_stack(corners) for corners in triples]).astype(np.int32)
    membrane, reduced = (polyharmonic_continuation(points, faces, points[:count], order) for order in (1, 3))
    np.testing.assert_array_equal(reduced, membrane)
