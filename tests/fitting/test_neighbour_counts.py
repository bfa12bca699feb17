"""Neighbourhoods of a given number of nearest points."""

import numpy as np
import pytest
from clouds import points_on_sphere
from scipy.spatial import cKDTree

from bezier_filters import FitStatus, estimate_vertex_geometry
from bezier_filters.errors import InvalidParameterError
from bezier_filters.surfaces import sphere, waves


def fit_directly(points, count, degree):
    """Normals and mean curvatures of tensor products fitted to the nearest points by SVD, over their plane, along x."""
    _, nearest = cKDTree(points).query(points, k=count)
    normals, means = np.empty_like(points), np.empty(len(points))
    for i, rows in enumerate(nearest):
        axes = np.linalg.svd(points[rows] - points[rows].mean(axis=0))[2]
        up = axes[2] * np.sign(axes[2, 2])
        along = np.array([1.0, 0.0, 0.0]) - up[0] * up
        along /= np.linalg.norm(along)
        across = np.cross(up, along)
        x, y, z = ((points[rows] - points[i]) @ np.column_stack([along, across, up])).T
        size = np.abs([x, y]).max()
        powers = [(a, b) for a in range(degree + 1) for b in range(degree + 1)]
        design = np.column_stack([(x / size) ** a * (y / size) ** b for a, b in powers])
        c = np.linalg.lstsq(design, z, rcond=None)[0].reshape(degree + 1, degree + 1)
        zx, zy, zxx, zxy, zyy = c[1, 0], c[0, 1], 2.0 * c[2, 0], c[1, 1], 2.0 * c[0, 2]
        zx, zy, zxx, zxy, zyy = zx / size, zy / size, zxx / size**2, zxy / size**2, zyy / size**2
        normals[i] = (up - zx * along - zy * across) / np.sqrt(1.0 + zx**2 + zy**2)
        bend = (1.0 + zy**2) * zxx - 2.0 * zx * zy * zxy + (1.0 + zx**2) * zyy
        means[i] = -bend / (2.0 * (1.0 + zx**2 + zy**2) ** 1.5)
    return normals, means


@pytest.mark.parametrize(("count", "degree"), [(20, 2), (35, 2), (40, 3)])
def test_a_fit_is_that_of_the_nearest_points(count, degree):
    points = waves(resolution=20, jitter=0.3).vertices
    found = estimate_vertex_geometry(points, neighbours=count, degree=degree, alpha=1.0, x_axis=(1.0, 0.0, 0.0))
    normals, means = fit_directly(points, count, degree)
    fitted = found.status == FitStatus.OK
    assert fitted.mean() > 0.98
    np.testing.assert_allclose(found.normals[fitted], normals[fitted], atol=1e-8)
    np.testing.assert_allclose(found.mean_curvature[fitted], means[fitted], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("count", [9, 20, 60])
def test_what_the_data_choose(count):
    ball = sphere(resolution=16, jitter=0.3)
    found = estimate_vertex_geometry(ball.vertices, neighbours=count)
    assert (found.fit.neighbours, found.fit.rings, found.fit.radius) == (count, 0, None)
    assert found.status_counts() == {"OK": len(ball.vertices)}
    np.testing.assert_allclose(found.mean_curvature, 1.0, atol=0.02)


def test_standard_errors_are_those_of_the_neighbourhoods():
    ball = sphere(resolution=24, jitter=0.3)
    points = ball.vertices * (1.0 + 0.005 * np.random.default_rng(0).standard_normal((len(ball.vertices), 1)))
    errors = []
    for count in (12, 60):
        found = estimate_vertex_geometry(points, neighbours=count)
        errors.append(np.sqrt(np.mean((found.mean_curvature - 1.0) ** 2)))
        assert np.sqrt(np.mean(found.mean_curvature_std**2)) == pytest.approx(errors[-1], rel=0.25)
    assert errors[0] > 3 * errors[1]


def test_points_of_the_other_side_are_no_neighbours():
    rng = np.random.default_rng(0)
    side = np.repeat([1.0, -1.0], 1000)
    points = np.column_stack([rng.uniform(-1.0, 1.0, (2000, 2)), 0.01 * side])
    views = np.outer(side, [0.0, 0.0, 5.0])
    for given in ({"normals": views}, {"viewpoint": views}):
        found = estimate_vertex_geometry(points, neighbours=30, **given)
        np.testing.assert_allclose(found.normals[:, 2], side, atol=1e-6)


def test_coincident_points_count_as_one():
    points = points_on_sphere(500)
    once = estimate_vertex_geometry(points, neighbours=20, alpha=0.8)
    twice = estimate_vertex_geometry(np.vstack([points, points]), neighbours=20, alpha=0.8)
    np.testing.assert_allclose(twice.normals[:500], once.normals, atol=1e-9)


@pytest.mark.parametrize("n", [0, 1, 2, 5, 8, 20])
def test_more_neighbours_than_points(n):
    found = estimate_vertex_geometry(np.random.default_rng(n).normal(size=(n, 3)), neighbours=30)
    assert len(found.status) == n
    assert np.isfinite(found.k_max).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"neighbours": 5}, "neighbours: got 5, where the fit needs 6 points"),
        ({"neighbours": 15, "alpha": 1.0}, "neighbours: got 15, where the fit needs 16 points"),
        ({"neighbours": 30.5}, "neighbours: got 30.5, expected an integer"),
        ({"neighbours": 5000}, "neighbours: got 5000, expected an integer up to 1000"),
        ({"neighbours": 30, "rings": 2}, "neighbours: got 30 and rings=2; give one of them"),
        ({"neighbours": 30, "radius": 0.2}, "neighbours: got 30 and radius=0.2; give one of them"),
        ({"neighbours": 30, "detail": 0.2}, "detail: neighbours determines the size"),
        ({"neighbours": 30, "alpha": 0.5, "noise": 0.1}, "noise: neighbours and alpha are given"),
        ({"neighbours": 30, "alpha": 0.5, "fallbacks": "paper"}, "fallbacks: got 'paper' and neighbours"),
        ({"neighbours": 30, "faces": [[0, 1, 2]]}, "neighbours: got 30; that is for point clouds"),
    ],
)
def test_bad_numbers_are_refused(given, message):
    with pytest.raises(InvalidParameterError, match=message):
        estimate_vertex_geometry(points_on_sphere(50), **given)
