"""Colour maps: what they promise about order, zero, colour blindness, and that every way to use one agrees."""

import re

import numpy as np
import pymeshlab
import pytest
from matplotlib.colors import to_rgb

import bezier_filters as bf
from bezier_filters.display import PALETTES, matplotlib_colormap
from bezier_filters.meshlab.mesh_colors import COLOR_MAP_NAMES
from bezier_filters.meshlab.meshset import BezierFilterError

VALUES = np.linspace(0.0, 1.0, 101)

# Machado, Oliveira, Fernandes (2009), linear RGB, full severity: no red, no green, no blue cones.
BLINDNESS = {
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def linear(rgb):
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    """CIELAB of linear RGB (D65), shape (n, 3)."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = np.clip(rgb, 0.0, 1.0) @ to_xyz.T / to_xyz.sum(axis=1)
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


def colors(name):
    return matplotlib_colormap(name)(VALUES)[:, :3]


@pytest.mark.parametrize("blindness", [None, *BLINDNESS])
@pytest.mark.parametrize("name", ["Cool Warm", "Viridis"])
def test_the_defaults_are_told_apart_with_any_kind_of_colour_vision(name, blindness):
    """Steps of a tenth differ by five just noticeable differences or more, and both signs by twenty."""
    seen = linear(colors(name))
    if blindness:
        seen = seen @ np.array(BLINDNESS[blindness]).T
    places = lab(seen)
    steps = np.linalg.norm(places[10:] - places[:-10], axis=1)
    assert steps.min() > 5.0
    mirrored = np.linalg.norm(places - places[::-1], axis=1)
    assert mirrored[VALUES <= 0.3].min() > 20.0


def test_zero_is_neutral_and_the_lightest_colour_of_the_diverging_map():
    lightness, a, b = lab(linear(colors("Cool Warm"))).T
    assert lightness.argmax() == 50
    assert np.hypot(a[50], b[50]) < 1.0
    assert (np.diff(lightness[:51]) > 0).all()
    assert (np.diff(lightness[50:]) < 0).all()


def test_the_palettes_of_the_paper():
    """From low to high: Figure 6, the torsion, and Figure 5, the curvatures."""
    assert [to_rgb(name) for name in ("lime", "blue", "red")] == list(PALETTES["Paper"])
    assert [to_rgb(name) for name in ("blue", "lime", "red")] == list(PALETTES["Paper Curvature"])


def test_the_default_depends_on_the_sign():
    assert matplotlib_colormap("auto", signed=True).name == "Cool Warm"
    assert matplotlib_colormap("auto", signed=False).name == "viridis"
    assert matplotlib_colormap("TURBO").name == "turbo"
    with pytest.raises(KeyError):
        matplotlib_colormap("turbos")


def ramp(low=0.0, high=1.0):
    ms = pymeshlab.MeshSet()
    values = low + (high - low) * VALUES
    ms.add_mesh(pymeshlab.Mesh(np.zeros((len(VALUES), 3)), v_scalar_array=values))
    return ms


@pytest.mark.parametrize("name", ["Cool Warm", "paper"])
def test_pictures_and_meshes_have_the_same_colours(name):
    """Of pymeshlab's own maps that would not hold: its Viridis and Turbo have fewer nodes than matplotlib's."""
    ms = ramp(-3.0, 5.0)
    bf.color_by_quality(ms, -3.0, 5.0, name)
    np.testing.assert_allclose(ms.current_mesh().vertex_color_matrix()[:, :3], colors(name), atol=2.5 / 255)


@pytest.mark.parametrize("name", [name for name in COLOR_MAP_NAMES if not name.startswith("Saw")])
def test_quality_map_files_have_the_colours_of_the_mesh(name, tmp_path):
    """Read by MeshLab itself. Saw maps jump, and nodes have the same place only up to a step."""
    path = tmp_path / "colors.qmap"
    bf.save_quality_map(path, -3.0, 5.0, name)
    ms, expected = ramp(-3.0, 5.0), ramp(-3.0, 5.0)
    bf.color_by_quality(expected, -3.0, 5.0, name)
    ms.compute_color_from_scalar_using_transfer_function_per_vertex(
        minqualityval=-3.0, maxqualityval=5.0, tfslist="Custom Transfer Function File", csvfilename=str(path)
    )
    got, wanted = (m.current_mesh().vertex_color_matrix() for m in (ms, expected))
    np.testing.assert_allclose(got, wanted, atol=1.5 / 255)
    assert path.read_text().splitlines()[-1] == "-3;0.5;5;1;"


def test_quality_maps_need_a_range_and_a_known_map(tmp_path):
    with pytest.raises(BezierFilterError, match="colour range"):
        bf.save_quality_map(tmp_path / "a.qmap", 1.0, 1.0)
    with pytest.raises(BezierFilterError, match=re.escape("colormap: got 'jet', expected one of auto, RGB")):
        bf.save_quality_map(tmp_path / "a.qmap", 0.0, 1.0, "jet")
    assert not list(tmp_path.iterdir())


class TestFilters:
    def test_the_map_follows_the_field(self):
        ms = pymeshlab.MeshSet()
        ms.create_torus(hsubdiv=36, vsubdiv=18)
        assert bf.compute_curvature_by_bezier_patch_per_vertex(ms, color=True)["colormap"] == "Cool Warm"
        assert bf.compute_torsion_by_bezier_patch_per_vertex(ms, color=True)["colormap"] == "Viridis"

    def test_a_given_range(self):
        ms = pymeshlab.MeshSet()
        ms.create_torus(hsubdiv=36, vsubdiv=18)
        report = bf.compute_torsion_by_bezier_patch_per_vertex(ms, color=True, colormap="Paper", colorrange=(0.2, 0.6))
        assert report["color_range"] == [0.2, 0.6]
        torsion = ms.current_mesh().vertex_scalar_array()
        shown = ms.current_mesh().vertex_color_matrix()[:, :3]
        np.testing.assert_allclose(shown[torsion > 0.61], [[1.0, 0.0, 0.0]] * np.sum(torsion > 0.61), atol=0.01)
        middle = np.interp(torsion, [0.2, 0.4, 0.6], [0.0, 1.0, 0.0])
        np.testing.assert_allclose(shown[:, 2], middle, atol=0.02)

    def test_an_empty_range_is_refused(self):
        ms = pymeshlab.MeshSet()
        ms.create_torus()
        with pytest.raises(BezierFilterError, match="colour range: got 2"):
            bf.compute_torsion_by_bezier_patch_per_vertex(ms, color=True, colorrange=(2.0, 1.0))
