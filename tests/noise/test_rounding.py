"""How coordinates are rounded: steps, voxels, significant digits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters import smooth, triangle_mesh
from bezier_filters.fitting.noise_level import learn_mesh_noise
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.noise.rounded_coordinates import rounding_noise
from bezier_filters.noise.rounding import Rounding, significant_digits
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, torus
from stairs import ball_mask, terrain

SURFACE = torus(resolution=24, jitter=0.2)


def rounded(vertices, digits):
    """To so many significant decimals, by another way than the package's."""
    return np.array([float(f"{x:.{digits - 1}e}") for x in vertices.ravel()]).reshape(-1, 3)


def learned(vertices, faces):
    return learn_mesh_noise(prepare_mesh(triangle_mesh(vertices, faces)))


@given(st.integers(2, 5), st.floats(1e-6, 1e6))
def test_decimals_are_counted_and_errors_are_at_most_half_a_step(digits, size):
    exact = size * np.random.default_rng(digits).normal(size=(300, 3))
    vertices = rounded(exact, digits)
    assert significant_digits(vertices) == (10, digits)
    steps = Rounding(np.zeros(3), digits=(10, digits)).steps_of(vertices)
    assert (np.abs(vertices - exact) <= 0.5 * steps * (1.0 + 1e-6)).all()
    # errors over steps are uniform, but for numbers that were rounded up to a power of ten
    assert np.square((vertices - exact) / steps).mean() == pytest.approx(1.0 / 12.0, rel=0.15)


def test_half_precision_is_found_and_single_and_double_are_not():
    points = np.random.default_rng(0).normal(size=(400, 3))
    assert significant_digits(points.astype(np.float16).astype(np.float64)) == (2, 11)
    assert significant_digits(points.astype(np.float32).astype(np.float64)) is None
    assert significant_digits(points) is None


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (1.0, 1.0, 5.0), (0.5, 2.0, 1.0)])
def test_the_voxels_of_a_mask_are_found(spacing):
    vertices, faces = ball_mask(12, spacing)
    found = rounding_noise(prepare_mesh(triangle_mesh(vertices, faces))).rounding
    assert found.is_mask
    np.testing.assert_allclose(found.steps, spacing)
    steps = found.steps_of(vertices)
    assert ((steps > 0.0).sum(axis=1) == 1).all()
    # one of the two voxels is inside the ball, the other one outside
    ends = np.sort([np.linalg.norm(vertices + sign * steps, axis=1) for sign in (-0.5, 0.5)], axis=0)
    assert (ends[0] <= 12.0 + 1e-9).all()
    assert (ends[1] > 12.0 - 1e-9).all()


@pytest.mark.parametrize("digits", [2, 3])
def test_errors_of_digits_are_the_learned_noise(digits):
    vertices = rounded(SURFACE.vertices, digits)
    noise = learned(vertices, SURFACE.faces)
    true = np.square(((vertices - SURFACE.vertices) * SURFACE.normals).sum(axis=1)).mean()
    assert noise.rounding is not None
    assert noise.variance == pytest.approx(true, rel=0.15)


def test_larger_noise_is_not_that_of_rounding():
    heights = np.random.default_rng(0).normal(scale=0.05, size=len(SURFACE.vertices))
    noise = learned(rounded(SURFACE.vertices + heights[:, np.newaxis] * SURFACE.normals, 3), SURFACE.faces)
    assert noise.rounding is None
    assert noise.sigma == pytest.approx(0.05, rel=0.15)


@pytest.mark.parametrize("step", [0.2, pytest.param(1.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("amount", [0.3, 0.6])
def test_noise_before_rounding_is_removed_with_it(step, amount):
    """Noise of the size of the steps is not bounded by them."""
    exact, faces, _, _ = terrain(0.0)
    heights = np.random.default_rng(0).normal(scale=amount * step, size=len(exact))
    vertices = exact.copy()
    vertices[:, 2] = np.round((exact[:, 2] + heights) / step) * step
    left = smooth(vertices, faces).vertices - exact
    assert np.square(left[:, 2]).mean() < 0.15 * np.square((vertices - exact)[:, 2]).mean()


def test_exact_coordinates_of_few_digits_do_not_move():
    vertices, faces = block_with_sharp_edges(resolution=20)  # multiples of a twentieth
    assert significant_digits(vertices) is not None
    np.testing.assert_array_equal(smooth(vertices, faces).vertices, vertices)


def test_three_digits_are_smoothed_by_what_they_hide():
    surface = bumpy_star(resolution=24)
    vertices = rounded(surface.vertices + 3.0, 3)  # steps of .01
    result = smooth(vertices, surface.faces)

    def error(points):
        return np.sqrt(np.square(((points - 3.0 - surface.vertices) * surface.normals).sum(axis=1)).mean())

    assert result.noise_before == pytest.approx(error(vertices), rel=0.1)
    assert error(result.vertices) < 0.6 * error(vertices)
    assert np.abs(result.vertices - vertices).max() <= 0.005 * np.sqrt(3.0) * (1.0 + 1e-6) + 0.002
