"""Stein's estimate of the risk, and the shares that follow from it."""

import numpy as np
import pytest
from laplacian_cases import dense, small_ball

from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.sampling.mesh_parts import whole_mesh
from bezier_filters.smoothing.clusters import clusters_of
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.risk import Estimates, local_risks, local_shares, noise_factor, overall_risks
from bezier_filters.surfaces import sphere


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
    clusters = clusters_of(whole_mesh(prepare_mesh(mesh)))
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


def test_the_estimated_risk_is_the_mean_squared_error():
    """Of low-pass filters of a known signal, over many draws of the noise, within four standard errors."""
    mesh = small_ball()
    matrix = dense(umbrella_laplacian(whole_mesh(mesh), "curve"))
    filters = [np.linalg.inv(np.eye(len(matrix)) + s * np.linalg.matrix_power(matrix, 4)) for s in (0.1, 10.0, 1000.0)]
    leverages = np.column_stack([np.diag(one) for one in filters])
    truth = 3.0 * np.prod(mesh.vertices, axis=1) / np.prod(mesh.vertices, axis=1).std()
    random, differences, errors = np.random.default_rng(2), [], []
    for _ in range(400):
        measured = truth + random.standard_normal(len(truth))
        found = np.column_stack([one @ measured for one in filters])
        errors.append(np.square(found - truth[:, np.newaxis]).mean(axis=0))
        differences.append(Estimates(measured[:, np.newaxis] - found, leverages).mean_risks() - errors[-1])
    standard_errors = np.std(differences, axis=0) / np.sqrt(len(differences))
    assert (np.abs(np.mean(differences, axis=0)) < 4.0 * standard_errors).all()
    assert (standard_errors < 0.02).all()
    means = np.mean(errors, axis=0)
    assert means[1] < 0.5 * min(means[0], means[2])  # so that they do not agree by being alike


@pytest.mark.parametrize("ratio", [0.3, 1.0, 2.0])
def test_the_noise_is_that_of_the_residuals_of_means(ratio):
    """Means of four values: the residual of each has three fourths of the variance; more noise than assumed is 1."""
    noise = ratio * np.random.default_rng(3).standard_normal((25_000, 4))
    residuals = (noise - noise.mean(axis=1, keepdims=True)).reshape(-1, 1)
    found = noise_factor(Estimates(residuals, np.full(residuals.shape, 0.25)), slice(None))
    assert found == pytest.approx(min(ratio, 1.0), rel=0.01)
