"""Colours of fields in hosts are those of the package's pictures."""

import doctest

import numpy as np
import pytest

import bezier_filters_adapters.field_colors
from bezier_filters.display import AUTO, matplotlib_colormap
from bezier_filters.pictures.field_panels import MeshFile, field_panels
from bezier_filters_adapters.field_colors import field_colors

NOISE = np.random.default_rng(0).standard_cauchy(999)


@pytest.mark.parametrize(
    ("column", "values"),
    [
        ("bz_mean_curvature", NOISE),
        ("bz_geodesic_torsion", np.abs(NOISE)),
        ("bz_displacement", np.zeros(999)),
        ("bz_normal_x", np.clip(NOISE, -1.0, 1.0)),
        ("height", NOISE),
        ("depth", np.abs(NOISE)),
    ],
)
def test_colors_are_those_of_pictures(column, values, tmp_path):
    vertices, faces = np.zeros((999, 3)), np.arange(999).reshape(-1, 3)
    file = MeshFile(tmp_path / "mesh.ply", vertices, faces, {column: values}, None)
    (panel,) = field_panels([file], column, colormap=AUTO, percentile=2.0)
    found = field_colors(column, values)
    assert found.limits == panel.limits
    drawn = matplotlib_colormap(panel.colormap, signed=panel.signed)(panel.norm()(values))
    np.testing.assert_allclose(found.rgb(values), drawn[:, :3], atol=0.025)  # Viridis has but 17 colours here


def test_values_that_are_not_finite_do_not_count():
    assert field_colors("bz_residual", np.array([0.0, 1.0, np.nan, np.inf])).limits == (0.0, 1.0)


def test_codes_of_creases_have_their_signs():
    codes = np.zeros(999, np.int32)
    codes[:3] = 2
    found = field_colors("bz_crease", codes)
    assert found.limits == (-2.0, 2.0)
    assert found.rgb(np.array([2, -2])).argmax(axis=1).tolist() == [0, 2]  # ridges red, ravines blue


def test_examples():
    assert doctest.testmod(bezier_filters_adapters.field_colors).failed == 0
