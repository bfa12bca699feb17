"""Robust weights against outliers, and what they cost without any."""

from functools import cache

import numpy as np
import pytest
from high_precision import neighbourhood

from bezier_filters import FitStatus, PatchFit, estimate_vertex_geometry, vertex_patch
from bezier_filters.surfaces import ellipsoid, height_field, torus

SURFACES = {
    "ellipsoid": cache(lambda: ellipsoid(resolution=14, jitter=0.3)),
    "torus": cache(lambda: torus(resolution=36, jitter=0.3)),
}
OPTIONS = {"automatic": {}, "rings": {"rings": 5}, "radius": {"radius": 0.3}, "fixed": {"rings": 3, "alpha": 0.8}}
LEFT = {"automatic": 0.87, "rings": 0.7, "radius": 0.6, "fixed": 0.7}
"""What may be left of the errors."""
each_surface = pytest.mark.parametrize("name", SURFACES)
each_option = pytest.mark.parametrize("mode", OPTIONS)


def measured(surface, outliers, seed=0):
    """Vertices with noise of a fiftieth of an edge along the normals, some displaced by 5 to 20 times as much."""
    rng = np.random.default_rng(seed)
    n = len(surface.vertices)
    a, b, _ = surface.vertices[surface.faces].transpose(1, 0, 2)
    sigma = 0.02 * np.linalg.norm(a - b, axis=1).mean()
    heights = rng.standard_normal(n)
    far = rng.random(n) < outliers
    heights[far] += rng.choice([-1, 1], far.sum()) * rng.uniform(5, 20, far.sum())
    return surface.vertices + (sigma * heights)[:, None] * surface.normals


def errors(surface, vertices, **options):
    """Root mean square errors of the normal and of the mean curvature."""
    geometry = estimate_vertex_geometry(vertices, surface.faces, **options)
    normal = np.linalg.norm(geometry.normals - surface.normals, axis=1)
    return np.sqrt(np.mean([normal**2, (geometry.mean_curvature - surface.mean_curvature) ** 2], axis=1))


@each_surface
@pytest.mark.parametrize(
    "mode", ["automatic", *(pytest.param(m, marks=pytest.mark.slow) for m in OPTIONS if m != "automatic")]
)
def test_outliers_do_less_harm(name, mode):
    surface = SURFACES[name]()
    draws = [measured(surface, 0.05, seed) for seed in range(2)]
    robust, plain = (
        np.square([errors(surface, draw, robust=option, **OPTIONS[mode]) for draw in draws]).mean(axis=0)
        for option in (True, False)
    )
    assert (np.sqrt(robust / plain) < LEFT[mode]).all()


@each_surface
@each_option
def test_the_loss_without_outliers_is_small(name, mode):
    surface = SURFACES[name]()
    vertices, options = measured(surface, 0.0), OPTIONS[mode]
    assert (errors(surface, vertices, robust=True, **options) < 1.12 * errors(surface, vertices, **options)).all()


@pytest.mark.parametrize("rings", [3, 4])
def test_one_far_outlier_on_a_plane_is_ignored_also_at_itself(rings):
    plane = height_field(lambda x, y: [0 * x, 0, 0, 0, 0, 0], resolution=20, jitter=0.2)
    vertices = plane.vertices.copy()
    vertices[:, 2] += 1e-6 * np.random.default_rng(0).standard_normal(len(vertices))
    clean = estimate_vertex_geometry(vertices, plane.faces, rings=rings, alpha=0.8)
    middle = np.argmin(np.linalg.norm(vertices, axis=1))
    vertices[middle, 2] += 0.01
    near = np.linalg.norm(vertices[:, :2], axis=1) < 0.3
    plain, robust = (
        estimate_vertex_geometry(vertices, plane.faces, rings=rings, alpha=0.8, robust=robust)
        for robust in (False, True)
    )
    worst = np.abs(clean.mean_curvature[near]).max()
    assert np.abs(plain.mean_curvature[near]).max() > 100 * worst
    assert np.abs(robust.mean_curvature[near]).max() < 3 * worst
    assert robust.residual[middle] > 1e-3  # it still counts as a point of the neighbourhood


def test_exact_data_are_fitted_exactly():
    plane = height_field(lambda x, y: [0 * x + 0.3 * y, 0, 0.3, 0, 0, 0], resolution=20, jitter=0.2)
    geometry = estimate_vertex_geometry(plane.vertices, plane.faces, robust=True)
    assert np.abs(geometry.k_max).max() < 1e-9
    np.testing.assert_allclose(geometry.normals, plane.normals, atol=1e-12)


def reweighted(vertices, faces, vertex):
    """Displacement and residual by dense reweighted least squares over the 3-ring, up to five rounds."""
    patch, fit = vertex_patch(vertices, faces, vertex, rings=3), PatchFit()
    points = vertices[neighbourhood(faces, vertex, 3)]
    design, heights = patch.design_matrix(*patch.parameters(points)), patch.to_local(points)[:, 2]
    weights, before, left = np.ones(len(points)), np.inf, None
    for rounds in range(6):
        rows = fit.alpha * np.sqrt(weights)[:, None] * design
        stacked = np.vstack([rows, (1.0 - fit.alpha) * fit.smoothness_rows])
        side = np.append(fit.alpha * np.sqrt(weights) * heights, np.zeros(len(fit.smoothness_rows)))
        left = design @ np.linalg.lstsq(stacked, side, rcond=None)[0] - heights
        median = np.median(np.abs(left))
        if rounds == 5 or median >= 0.95 * before:
            break
        before = median
        weights = np.maximum(0.0, 1.0 - (left / (4.685 * 1.4826 * median)) ** 2) ** 2
    return left[0] * patch.axes[2], np.sqrt(np.mean(left**2))


def test_weights_are_those_of_a_dense_reference():
    surface = SURFACES["torus"]()
    vertices = measured(surface, 0.05)
    geometry = estimate_vertex_geometry(vertices, surface.faces, rings=3, alpha=0.8, robust=True)
    plain = estimate_vertex_geometry(vertices, surface.faces, rings=3, alpha=0.8)
    size = np.linalg.norm(plain.displacements, axis=1).max()
    assert np.abs(geometry.displacements - plain.displacements).max() > 0.1 * size
    for vertex in np.flatnonzero(geometry.status == FitStatus.OK)[::40]:
        displacement, residual = reweighted(vertices, surface.faces, vertex)
        np.testing.assert_allclose(geometry.displacements[vertex], displacement, atol=1e-7 * size)
        assert geometry.residual[vertex] == pytest.approx(residual, rel=1e-7)
