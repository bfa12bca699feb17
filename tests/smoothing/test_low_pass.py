"""Laplacians, the filters made of them, and the choice among estimates."""

import numpy as np
import pytest
from numba import config
from scipy.linalg import lu_factor, lu_solve

from bezier_filters.meshes.adjacency import mean_edge, vertex_adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.smoothing.chebyshev import DEFAULT_ORDER, diffuse, low_pass
from bezier_filters.smoothing.clusters import AVERAGING_TIME, clusters_of
from bezier_filters.smoothing.laplacian import cotangent_laplacian, umbrella_laplacian
from bezier_filters.smoothing.low_pass import FILTER_ORDERS, learn_low_pass, max_strength
from bezier_filters.smoothing.mesh_parts import whole_mesh
from bezier_filters.smoothing.noise import NoisyMesh
from bezier_filters.smoothing.risk import Estimates, local_risks, local_shares, overall_risks
from bezier_filters.surfaces import bumpy_star, sphere, torus, waves


def dense(laplacian):
    """The operator as a matrix."""
    n = len(laplacian.rates)
    matrix = np.zeros((n, n))
    start = np.repeat(np.arange(n), np.diff(laplacian.indptr))
    np.subtract.at(matrix, (start, laplacian.indices), laplacian.weights * laplacian.rates[start])
    matrix[np.arange(n), np.arange(n)] += laplacian.rates
    return matrix


@pytest.fixture(scope="module")
def ball():
    """A sphere as a mesh, with its adjacency and mean edge."""
    surface = sphere(resolution=6, jitter=0.2)
    mesh = triangle_mesh(surface.vertices, surface.faces)
    adjacency = vertex_adjacency(mesh)
    return mesh, adjacency, mean_edge(mesh, adjacency)


@pytest.fixture(scope="module")
def sheet():
    """A plane as a mesh, with its adjacency and mean edge."""
    surface = waves(resolution=12, amplitude=0.0, jitter=0.2)
    mesh = triangle_mesh(surface.vertices, surface.faces)
    adjacency = vertex_adjacency(mesh)
    return mesh, adjacency, mean_edge(mesh, adjacency)


@pytest.mark.parametrize("power", [None, 0.0, 0.5, 1.0])
def test_eigenvalues_lie_within_the_bound(ball, power):
    mesh, adjacency, unit = ball
    one = umbrella_laplacian(whole_mesh(mesh, adjacency), "curve")
    laplacian = one if power is None else cotangent_laplacian(whole_mesh(mesh, adjacency), "curve", power, unit)
    eigenvalues = np.linalg.eigvals(dense(laplacian))
    assert np.abs(eigenvalues.imag).max() < 1e-5
    assert eigenvalues.real.min() > -1e-6
    assert eigenvalues.real.max() <= laplacian.bound + 1e-6


def test_cotangents_leave_linear_functions_on_a_plane(sheet):
    mesh, adjacency, unit = sheet
    laplacian = cotangent_laplacian(whole_mesh(mesh, adjacency), "fixed", 1.0, unit)
    moved = np.linalg.norm(dense(laplacian) @ mesh.vertices, axis=1)[~adjacency.on_boundary]
    assert np.median(moved) < 1e-7  # all but the few at slivers, whose weights are kept within bounds


def test_cotangents_give_twice_the_curvature_of_a_sphere(ball):
    mesh, adjacency, unit = ball
    moved = dense(cotangent_laplacian(whole_mesh(mesh, adjacency), "curve", 1.0, unit)) @ mesh.vertices
    # The rate 1 belongs to a Laplace-Beltrami operator times a squared edge over 4; that of the sphere is 2 x.
    assert np.linalg.norm(moved, axis=1).mean() == pytest.approx(2.0 * unit**2 / 4.0, rel=0.1)


@pytest.mark.parametrize("borders", ["curve", "fixed", "free"])
def test_border_vertices_follow_whom_they_should(sheet, borders):
    mesh, adjacency, _ = sheet
    laplacian = umbrella_laplacian(whole_mesh(mesh, adjacency), borders)
    for i in np.flatnonzero(adjacency.on_boundary):
        row = slice(laplacian.indptr[i], laplacian.indptr[i + 1])
        followed = laplacian.indices[row][laplacian.weights[row] * laplacian.rates[i] > 0.0]
        if borders == "free":
            assert len(followed) == row.stop - row.start
        else:
            assert len(followed) == (2 if borders == "curve" else 0)
            assert adjacency.on_boundary[followed].all()


@pytest.mark.parametrize("order", FILTER_ORDERS)
def test_series_are_the_filters_that_they_stand_for(ball, order):
    mesh, adjacency, _ = ball
    laplacian = umbrella_laplacian(whole_mesh(mesh, adjacency), "curve")
    matrix = dense(laplacian)
    signals = np.random.default_rng(0).standard_normal((mesh.vertex_count, 2))
    for strength in (0.0, 1.0, 100.0):
        powers = np.linalg.matrix_power(strength**0.25 * matrix, order)
        expected = np.linalg.solve(np.eye(len(matrix)) + powers, signals)
        result = low_pass(laplacian, signals, np.array([strength]), order=order)
        assert np.abs(result - expected).max() < 1e-3


@pytest.mark.parametrize("power", [None, 0.0, 1.0])
@pytest.mark.parametrize("length", [2.5, 4.0, 8.0, 16.0])
def test_the_strongest_filter_leaves_half_of_a_wave(power, length):
    """On triangles of one size, whatever the Laplacian and the order; a stronger filter leaves less."""
    i, j = np.indices((90, 90)).reshape(2, -1)
    first = np.flatnonzero((i < 89) & (j < 89))
    faces = np.concatenate([first + np.array([[0], [90], [1]]), first + np.array([[90], [91], [1]])], axis=1).T
    plane = np.column_stack([i + 0.5 * j, np.sqrt(0.75) * j])
    mesh = triangle_mesh(np.column_stack([plane, np.zeros(len(i))]), faces)
    adjacency, inside = vertex_adjacency(mesh), (np.minimum(i, j) > 30) & (np.maximum(i, j) < 59)
    umbrella = umbrella_laplacian(whole_mesh(mesh, adjacency), "curve")
    laplacian = umbrella if power is None else cotangent_laplacian(whole_mesh(mesh, adjacency), "curve", power, 1.0)
    for angle in (0.0, 0.5):
        wave = np.sin(2.0 * np.pi / length * plane @ [np.cos(angle), np.sin(angle)])[:, np.newaxis]
        for order in FILTER_ORDERS:
            for times in (1.0, 3.0):
                left = low_pass(laplacian, wave, np.array([times * max_strength(length)]), order=order)
                share = (left * wave)[inside].sum() / np.square(wave[inside]).sum()
                assert share == pytest.approx(1.0 / (1.0 + times ** (order / 4)), abs=0.02)


def test_heat_flows_as_long_as_it_should(ball):
    mesh, adjacency, _ = ball
    laplacian = umbrella_laplacian(whole_mesh(mesh, adjacency), "curve")
    values, vectors = np.linalg.eig(dense(laplacian))
    signals = np.random.default_rng(0).standard_normal((mesh.vertex_count, 2))
    heat = (vectors * np.exp(-5.0 * values)) @ np.linalg.solve(vectors, signals)
    assert np.abs(diffuse(laplacian, signals, 5.0) - heat.real).max() < 1e-6


def test_mixtures_are_taken_vertex_by_vertex(ball):
    mesh, adjacency, _ = ball
    laplacian = umbrella_laplacian(whole_mesh(mesh, adjacency), "curve")
    strengths = np.array([1.0, 100.0])
    shares = np.zeros((mesh.vertex_count, 2), dtype=np.float32)
    half = mesh.vertex_count // 2
    shares[:half, 0], shares[half:, 1] = 1.0, 1.0
    mixed = low_pass(laplacian, mesh.vertices, strengths, shares)
    for rows, strength in ((slice(None, half), 1.0), (slice(half, None), 100.0)):
        assert np.allclose(mixed[rows], low_pass(laplacian, mesh.vertices, np.array([strength]))[rows], atol=1e-3)


@pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")
def test_the_order_suits_the_detail():
    ring = torus(resolution=30, jitter=0.2)  # whose detail ends at some size
    assert chosen_order(ring.vertices, ring.normals, ring.faces) > DEFAULT_ORDER
    ball = sphere(resolution=20)  # with detail of all sizes, whose spectrum x^-4 Wiener's filter of order 4 suits best
    mesh = triangle_mesh(ball.vertices, ball.faces)
    laplacian = umbrella_laplacian(whole_mesh(mesh, vertex_adjacency(mesh)), "curve")
    roughness = np.random.default_rng(1).standard_normal((mesh.vertex_count, 1))
    factors = lu_factor(dense(laplacian) + 0.01 * np.eye(mesh.vertex_count))
    for _ in range(2):  # over x + 0.01 twice, so that even the largest detail is finite
        roughness = lu_solve(factors, roughness)
    rough = ball.vertices * (1.0 + 0.02 * roughness / roughness.std())
    assert chosen_order(rough, ball.normals, ball.faces) == DEFAULT_ORDER


def chosen_order(vertices, normals, faces):
    """The order of the filter that noise of a fifth of the mean edge leads to."""
    clean = triangle_mesh(vertices, faces)
    adjacency = vertex_adjacency(clean)
    unit = mean_edge(clean, adjacency)
    heights = 0.2 * unit * np.random.default_rng(0).standard_normal(len(vertices))
    noisy = triangle_mesh(vertices + heights[:, np.newaxis] * normals, faces)
    part = whole_mesh(noisy, adjacency)
    noisy = NoisyMesh(part, clusters_of(part), np.full(len(vertices), 0.2 * unit))
    return learn_low_pass(noisy, "curve", unit)[0].order


def test_what_is_constant_stays(ball):
    mesh, adjacency, _ = ball
    laplacian = umbrella_laplacian(whole_mesh(mesh, adjacency), "curve")
    constant = np.full((mesh.vertex_count, 5), 1e6)
    assert np.array_equal(low_pass(laplacian, constant, np.array([10.0])), constant)


def test_clusters_spread_values_as_far_as_the_mesh_does():
    surface = bumpy_star(resolution=30, jitter=0.25)
    mesh = triangle_mesh(surface.vertices, surface.faces)
    adjacency = vertex_adjacency(mesh)
    clusters = clusters_of(whole_mesh(mesh, adjacency))
    values = np.random.default_rng(0).standard_normal((mesh.vertex_count, 3))
    on_mesh = diffuse(umbrella_laplacian(whole_mesh(mesh, adjacency), "free"), values, AVERAGING_TIME)
    means = clusters.diffuse(clusters.means(values.T))
    on_clusters = clusters.spread_to_vertices(means)
    assert on_clusters.std() == pytest.approx(on_mesh.std(), rel=0.15)
    assert np.corrcoef(on_mesh.ravel(), on_clusters.ravel())[0, 1] > 0.95


def test_clusters_cover_what_is_not_connected():
    square = triangle_mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 5]], [[0, 1, 2], [0, 2, 3]])
    clusters = clusters_of(whole_mesh(square, vertex_adjacency(square)))
    assert sorted(clusters.sizes) == [1.0, 4.0]
    assert np.allclose(clusters.means([np.arange(5.0)])[:, 0], [1.5, 4.0])
    assert np.isfinite(clusters.diffuse(np.ones((2, 1)))).all()


def test_risks_are_those_of_known_estimates():
    rng = np.random.default_rng(0)
    n = 100_000
    noise = rng.standard_normal(n)
    shrunk = 0.3 * noise  # the truth being 0, and the estimate 0.3 times what is measured
    estimates = Estimates(
        np.column_stack([noise - shrunk, 0.0 * noise]), np.column_stack([np.full(n, 0.3), np.ones(n)])
    )
    assert estimates.mean_risks() == pytest.approx([0.09, 1.0], abs=0.02)


def test_the_better_estimate_is_taken_where_it_is_better():
    surface = sphere(resolution=30)
    mesh = triangle_mesh(surface.vertices, surface.faces)
    clusters = clusters_of(whole_mesh(mesh, vertex_adjacency(mesh)))
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(mesh.vertex_count)
    north = mesh.vertices[:, 2] > 0.0
    wrong = np.where(north[:, np.newaxis], [0.0, 0.5], [0.5, 0.0])
    estimates = Estimates(noise[:, np.newaxis] - wrong, np.zeros((mesh.vertex_count, 2)))
    shares = local_shares(
        clusters, local_risks(clusters, estimates, overall_risks(estimates, slice(None))), mesh.vertex_count
    )
    far = np.abs(mesh.vertices[:, 2]) > 0.6
    assert shares[far & north, 0].mean() > 0.9
    assert shares[far & ~north, 1].mean() > 0.9
