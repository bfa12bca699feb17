"""Open patches against textbook curvatures; their holes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from surface_cases import area_vectors, assert_valid_mesh, border_edges, each_jitter

from bezier_filters import surfaces


@each_jitter
def test_monkey_saddle_has_the_textbook_curvatures(jitter: float) -> None:
    saddle = surfaces.monkey_saddle(strength=1.0, resolution=16, jitter=jitter)
    x, y, z = saddle.vertices.T
    np.testing.assert_allclose(z, x**3 - 3 * x * y**2, atol=1e-14)
    stretch = 1 + 9 * (x**2 + y**2) ** 2
    np.testing.assert_allclose(saddle.gaussian_curvature, -36 * (x**2 + y**2) / stretch**2, atol=1e-12)
    upward_textbook_mean = 27 * x * (-(x**4) + 2 * x**2 * y**2 + 3 * y**4) / stretch**1.5
    np.testing.assert_allclose(saddle.mean_curvature, -upward_textbook_mean, atol=1e-12)


def test_hills_are_positive_and_bowls_negative() -> None:
    carton = surfaces.waves(amplitude=0.1, wavelength=1.0, size=2.0, resolution=8)
    top, bottom = carton.vertices[:, 2].argmax(), carton.vertices[:, 2].argmin()
    assert carton.mean_curvature[top] == pytest.approx(0.1 * (2 * np.pi) ** 2)
    assert carton.mean_curvature[bottom] == pytest.approx(-0.1 * (2 * np.pi) ** 2)
    assert (carton.normals[:, 2] > 0).all()


def test_height_field_takes_numbers_for_constant_derivatives() -> None:
    slope = surfaces.height_field(lambda x, y: (x + y, 1, 1, 0, 0, 0), resolution=4)
    np.testing.assert_allclose(slope.normals, np.broadcast_to(np.array([-1, -1, 1]) / np.sqrt(3), (25, 3)))
    np.testing.assert_array_equal(slope.k_min, 0)
    np.testing.assert_array_equal(slope.k_max, 0)


@given(x=st.floats(-0.3, 0.3), y=st.floats(-0.3, 0.3), radius=st.floats(0.11, 0.35), jitter=st.floats(0.0, 0.34))
@settings(max_examples=25, deadline=None)
def test_every_hole_is_round_and_clean(x: float, y: float, radius: float, jitter: float) -> None:
    patch = surfaces.punched_patch(holes=[(x, y, radius)], resolution=20, jitter=jitter)
    assert_valid_mesh(patch.vertices, patch.faces, euler_characteristic=0, rims=2)
    rim = patch.vertices[np.unique(border_edges(patch.faces))]
    to_centre = np.hypot(rim[:, 0] - x, rim[:, 1] - y)
    on_square = np.isclose(np.abs(rim[:, :2]).max(axis=1), 1.0)
    np.testing.assert_allclose(to_centre[~on_square], radius)
    assert np.count_nonzero(on_square) == 4 * 20


def test_holes_of_the_punched_patch_differ_and_do_not_touch() -> None:
    patch = surfaces.punched_patch()
    open_area = 4 - np.abs(area_vectors(patch.vertices, patch.faces)[:, 2]).sum()
    # The rims are inscribed polygons, slightly smaller than the circles.
    assert open_area == pytest.approx(np.pi * (0.22**2 + 0.32**2 + 0.15**2), rel=0.01)
