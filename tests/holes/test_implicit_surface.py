import numpy as np
import pytest

from bezier_filters.holes import implicit_surface
from bezier_filters.holes.implicit_surface import INTERPOLATION_RATIO, fit_implicit_surface
from bezier_filters.surfaces import ellipsoid, sphere, torus


def test_quadrics_are_reproduced():
    """A quadric is the zero set of a quadratic, here with gradients of about one: only the offsets are not exact."""
    shape = ellipsoid(resolution=6)
    fit = fit_implicit_surface(shape.vertices, shape.normals, 1e-3, noisy=False)
    away = shape.vertices + 0.05 * shape.normals
    on_it, found = fit.project(away)
    assert found.all()
    assert np.linalg.norm(on_it - shape.vertices, axis=1).max() < 1e-3


def test_points_are_interpolated_and_gradients_point_outward():
    shape = torus(resolution=12)
    fit = fit_implicit_surface(shape.vertices, shape.normals, 0.05, noisy=False)
    values, gradients = fit.values_and_gradients(shape.vertices)
    assert np.abs(values).max() < 1e-8
    assert (np.einsum("ij,ij->i", gradients, shape.normals) > 0.9).all()
    assert fit.noise_ratio == INTERPOLATION_RATIO


def test_gradients_are_the_derivatives_of_the_values():
    shape = torus(resolution=8)
    rng = np.random.default_rng(0)
    for noisy in (False, True):
        noise = rng.normal(scale=0.02 * noisy, size=len(shape.vertices))[:, np.newaxis] * shape.normals
        fit = fit_implicit_surface(shape.vertices + noise, shape.normals, 0.1, noisy=noisy)
        x, step = shape.vertices[::40] + rng.uniform(-0.1, 0.1, shape.vertices[::40].shape), 1e-5
        _, gradients = fit.values_and_gradients(x)
        for axis in range(3):
            ahead, _ = fit.values_and_gradients(x + step * np.eye(3)[axis])
            behind, _ = fit.values_and_gradients(x - step * np.eye(3)[axis])
            np.testing.assert_allclose(gradients[:, axis], (ahead - behind) / (2 * step), rtol=1e-4, atol=1e-6)


def test_noise_is_fitted_not_followed():
    shape = ellipsoid(resolution=5)
    noise = np.random.default_rng(1).normal(scale=0.02, size=len(shape.vertices))
    points = shape.vertices + noise[:, np.newaxis] * shape.normals
    fit = fit_implicit_surface(points, shape.normals, 0.1, noisy=True)
    on_it, found = fit.project(shape.vertices)
    error = np.einsum("ij,ij->i", on_it - shape.vertices, shape.normals)
    assert found.all()
    assert error.std() < 0.75 * noise.std()


def test_fit_moves_with_the_points():
    shape = torus(resolution=8)
    rotation = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    x = shape.vertices[:20] + 0.1 * shape.normals[:20]
    still = fit_implicit_surface(shape.vertices, shape.normals, 0.1, noisy=False)
    moved = fit_implicit_surface(
        5.0 * shape.vertices @ rotation.T + [7, 8, 9], shape.normals @ rotation.T, 0.5, noisy=False
    )
    np.testing.assert_allclose(
        moved.values_and_gradients(5.0 * x @ rotation.T + [7, 8, 9])[0],
        5.0 * still.values_and_gradients(x)[0],
        atol=1e-6,
    )


@pytest.mark.parametrize("points", [np.zeros((20, 3)), np.eye(3), np.linspace(0, 1, 60).reshape(-1, 1) * np.ones(3)])
def test_points_that_determine_no_surface_give_none(points):
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    assert fit_implicit_surface(points, normals, 0.1, noisy=False) is None


@pytest.mark.parametrize("roughness", [0.0, 1e-4, 1e-3, 1e-2])
def test_a_third_of_the_points_tells_the_power_that_all_of_them_tell(monkeypatch, roughness):
    shape = sphere(resolution=5)
    rng = np.random.default_rng(3)
    points = (shape.vertices + roughness * rng.normal(size=shape.vertices.shape))[rng.permutation(len(shape.vertices))]
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    by_pilot = fit_implicit_surface(points, normals, 0.1, noisy=False)
    monkeypatch.setattr(implicit_surface, "PILOT_STRIDE", len(points))  # too few points to tell anything
    by_all = fit_implicit_surface(points, normals, 0.1, noisy=False)
    assert by_pilot.power == by_all.power
    np.testing.assert_array_equal(by_pilot.weights, by_all.weights)
