"""Chebyshev series of a Laplacian next to functions of its matrix."""

import numpy as np
import pytest
from laplacian_cases import dense, small_ball

from bezier_filters.sampling.mesh_parts import whole_mesh
from bezier_filters.smoothing.chebyshev import accumulate_residuals, diffuse, low_pass, low_pass_series
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.low_pass import FILTER_ORDERS


@pytest.fixture(scope="module")
def ball():
    return small_ball()


@pytest.mark.parametrize("order", FILTER_ORDERS)
def test_series_are_the_filters_that_they_stand_for(ball, order):
    mesh = ball
    laplacian = umbrella_laplacian(whole_mesh(mesh), "curve")
    matrix = dense(laplacian)
    signals = np.random.default_rng(0).standard_normal((mesh.vertex_count, 2))
    for strength in (0.0, 1.0, 100.0):
        powers = np.linalg.matrix_power(strength**0.25 * matrix, order)
        expected = np.linalg.solve(np.eye(len(matrix)) + powers, signals)
        result = low_pass(laplacian, signals, np.array([strength]), order=order)
        assert np.abs(result - expected).max() < 1e-3


def test_heat_flows_as_long_as_it_should(ball):
    mesh = ball
    laplacian = umbrella_laplacian(whole_mesh(mesh), "curve")
    values, vectors = np.linalg.eig(dense(laplacian))
    signals = np.random.default_rng(0).standard_normal((mesh.vertex_count, 2))
    heat = (vectors * np.exp(-5.0 * values)) @ np.linalg.solve(vectors, signals)
    assert np.abs(diffuse(laplacian, signals, 5.0) - heat.real).max() < 1e-6


def test_mixtures_are_taken_vertex_by_vertex(ball):
    mesh = ball
    laplacian = umbrella_laplacian(whole_mesh(mesh), "curve")
    strengths = np.array([1.0, 100.0])
    shares = np.zeros((mesh.vertex_count, 2), dtype=np.float32)
    half = mesh.vertex_count // 2
    shares[:half, 0], shares[half:, 1] = 1.0, 1.0
    mixed = low_pass(laplacian, mesh.vertices, strengths, shares)
    for rows, strength in ((slice(None, half), 1.0), (slice(half, None), 100.0)):
        assert np.allclose(mixed[rows], low_pass(laplacian, mesh.vertices, np.array([strength]))[rows], atol=1e-3)


def test_what_is_constant_stays(ball):
    mesh = ball
    laplacian = umbrella_laplacian(whole_mesh(mesh), "curve")
    constant = np.full((mesh.vertex_count, 5), 1e6)
    assert np.array_equal(low_pass(laplacian, constant, np.array([10.0])), constant)


def test_residuals_are_those_of_the_filters(ball):
    """Along given directions, and of the fourth signal times another one."""
    mesh = ball
    laplacian = umbrella_laplacian(whole_mesh(mesh), "curve")
    random, n = np.random.default_rng(1), mesh.vertex_count
    signals, directions = random.standard_normal((n, 4)), random.standard_normal((n, 4)).astype(np.float32)
    strengths = np.array([1.0, 30.0, 1000.0])
    sums, products = np.zeros((2, n, len(strengths)), dtype=np.float32)
    series = low_pass_series(strengths, laplacian.bound)
    accumulate_residuals(laplacian, signals, series, directions, sums, products)
    for k, strength in enumerate(strengths):
        removed = signals - low_pass(laplacian, signals, np.array([strength]))
        expected = np.einsum("ij,ij->i", removed[:, :3], directions[:, :3])
        np.testing.assert_allclose(sums[:, k], expected, atol=5e-3)
        np.testing.assert_allclose(products[:, k], removed[:, 3] * directions[:, 3], atol=5e-3)
