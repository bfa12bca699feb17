"""The manifest for napari, and its commands on arrays."""

import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from hole_cases import without_faces_near

import bezier_filters as bf
from bezier_filters.surfaces import sphere, torus
from bezier_filters_adapters.field_colors import field_colors
from bezier_filters_adapters.filters import LABELS, field_names, parameters_of

MANIFEST = Path(__file__).parents[2] / "adapters" / "bezier_filters_adapters" / "napari.yaml"
SHAPE = torus(resolution=16)
FINE = torus(resolution=24)
HOLED = (  # vertices and faces of a torus with a hole
    FINE.vertices,
    without_faces_near(FINE.vertices, FINE.faces, np.array([1.0, 0.0, 0.4]), 0.3),
)
COMMANDS = {
    title: (module, function)
    for title, module, function in re.findall(r"title: (.*)\n +python_name: (.*):(.*)", MANIFEST.read_text("utf-8"))
}


def command(name):
    module, function = COMMANDS[LABELS[name]]
    return getattr(import_module(module), function)


def test_the_manifest_is_valid():
    npe2 = pytest.importorskip("npe2", reason="npe2, which reads manifests of napari, is not installed")
    manifest = npe2.PluginManifest.from_file(MANIFEST)
    manifest.validate_imports()
    assert [widget.display_name for widget in manifest.contributions.widgets] == list(LABELS.values())


def test_every_filter_is_a_command():
    assert list(COMMANDS) == list(LABELS.values())


@pytest.mark.parametrize("name", LABELS)
def test_commands_return_a_layer(name):
    before = SHAPE.vertices.copy()
    (vertices, faces, *values), state, kind = command(name)((SHAPE.vertices, SHAPE.faces, np.ones(len(before))))
    assert kind == "surface"
    np.testing.assert_array_equal(SHAPE.vertices, before)
    assert len(vertices) == len(before)
    assert faces.shape == SHAPE.faces.shape
    assert list(state["metadata"]) == [*field_names(name), "summary"]
    assert [shown.shape for shown in values] == [(len(vertices),)]
    assert all(state["metadata"][field].shape[1:] == (3,) for field in field_names(name) if "direction" in field)


@pytest.mark.parametrize(("field", "colormap"), [("bz_mean_curvature", "Cool Warm"), ("bz_curvedness", "viridis")])
def test_layers_have_colors_and_limits(field, colormap):
    (*_, values), state, _ = command("curvature")((SHAPE.vertices, SHAPE.faces), field=field)
    chosen = state["colormap"]
    assert (chosen["name"] if isinstance(chosen, dict) else chosen) == colormap
    low, high = state["contrast_limits"]
    assert (low, high) == field_colors(field, values).limits
    assert (low == -high) == (colormap == "Cool Warm")
    assert np.mean((values >= low) & (values <= high)) > 0.95
    assert state["shading"] == "smooth"


def test_a_field_can_be_chosen():
    (*_, values), state, _ = command("curvature")((SHAPE.vertices, SHAPE.faces), field="bz_k_max", rings="2")
    assert state["name"] == "bz_k_max"
    np.testing.assert_array_equal(values, bf.estimate_vertex_geometry(SHAPE.vertices, SHAPE.faces, rings=2).k_max)


def test_a_component_of_a_vector_can_be_shown():
    (*_, values), state, _ = command("curvature")((SHAPE.vertices, SHAPE.faces), field="bz_direction_max_y")
    np.testing.assert_array_equal(values, state["metadata"]["bz_direction_max"][:, 1])


def test_holes_are_filled():
    (vertices, faces, marks), state, _ = command("fill-holes")(HOLED)
    assert bf.boundary_loops(bf.triangle_mesh(vertices, faces)) == []
    assert len(vertices) > len(HOLED[0])
    np.testing.assert_array_equal(marks, np.arange(len(vertices)) >= len(HOLED[0]))
    np.testing.assert_array_equal(state["metadata"]["bz_new"], marks)


@pytest.mark.parametrize("rows", [(), (2,)])
def test_values_go_on_into_fills(rows):
    """Also those of several times."""
    given = np.broadcast_to(HOLED[0][:, 0], (*rows, len(HOLED[0])))
    (vertices, _, values), state, _ = command("fill-holes")((*HOLED, given))
    assert state["name"] == LABELS["fill-holes"]
    np.testing.assert_array_equal(values[..., : len(HOLED[0])], given)
    np.testing.assert_allclose(values, np.broadcast_to(vertices[:, 0], values.shape), atol=0.02)


@pytest.mark.filterwarnings("ignore")  # those of napari
def test_filled_layers_keep_their_colors():
    layers = pytest.importorskip("napari.layers", reason="napari is not installed")
    layer = layers.Surface((*HOLED, HOLED[0][:, 0]), colormap="magma", contrast_limits=(-3.0, 5.0))
    data, state, _ = command("fill-holes")(layer)
    made = layers.Surface(data, **state)
    assert made.colormap.name == "magma"
    assert made.contrast_limits == [-3.0, 5.0]


def ball_in_voxels(layer_class, scale):
    """A ball of radius 10, as it comes out of an image with voxels of some size, in micrometres."""
    ball = sphere(radius=10.0, resolution=12)
    faces = ball.faces if np.prod(scale) > 0.0 else ball.faces[:, ::-1]  # outwards in the image
    return layer_class((ball.vertices / scale, faces), scale=scale, translate=(1.0, 2.0, 3.0), units=("um", "um", "um"))


@pytest.mark.filterwarnings("ignore")  # those of napari
@pytest.mark.parametrize("scale", [(2.0, 0.5, 0.25), (0.1, 0.1, 0.1), (-2.0, 0.5, 0.25)])
def test_layers_are_computed_in_the_world(scale):
    """Curvature is that of the ball that is seen, and what comes out lies where it came from."""
    layers = pytest.importorskip("napari.layers", reason="napari is not installed")
    layer = ball_in_voxels(layers.Surface, scale)
    for name in ("curvature", "smooth"):
        (vertices, faces, values), state, _ = command(name)(layer)
        made = layers.Surface((vertices, faces, values), **state)
        np.testing.assert_array_equal(faces, layer.faces)
        np.testing.assert_allclose(bf.mesh_arrays(made)[0], bf.mesh_arrays(layer)[0], atol=1e-6)
        assert (made.units, tuple(made.scale), tuple(made.translate)) == (layer.units, scale, (1.0, 2.0, 3.0))
        if name == "curvature":
            np.testing.assert_allclose(made.metadata["bz_mean_curvature"], 0.1, rtol=0.01)
            np.testing.assert_array_equal(vertices, layer.vertices)


@pytest.mark.filterwarnings("ignore")  # those of napari
def test_fills_continue_the_surface_in_the_world():
    layers = pytest.importorskip("napari.layers", reason="napari is not installed")
    whole = ball_in_voxels(layers.Surface, (2.0, -0.5, 0.25))
    cap = (np.abs(bf.mesh_arrays(whole)[0] - [11.0, 2.0, 3.0]).max(axis=1) < 3.0)[whole.faces].any(axis=1)
    layer = layers.Surface((whole.vertices, whole.faces[~cap]), scale=whole.scale, translate=whole.translate)
    (vertices, faces, _), state, _ = command("fill-holes")(layer)
    np.testing.assert_array_equal(vertices[: len(layer.vertices)], layer.vertices)
    np.testing.assert_array_equal(faces[: len(layer.faces)], layer.faces)
    report = bf.inspect_mesh(vertices, faces)
    assert report.boundary_edges == report.incoherent_edges == 0
    filled = bf.mesh_arrays(layers.Surface((vertices, faces), **state))[0][len(layer.vertices) :]
    np.testing.assert_allclose(np.linalg.norm(filled - [1.0, 2.0, 3.0], axis=1), 10.0, atol=0.02)


@pytest.mark.filterwarnings("ignore")  # those of napari and Qt
def test_widgets_run_in_napari(monkeypatch):
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    pytest.importorskip("qtpy", reason="there is no Qt", exc_type=Exception)
    napari = pytest.importorskip("napari", reason="napari is not installed")
    from npe2 import PluginManager, PluginManifest

    PluginManager.instance().register(PluginManifest.from_file(MANIFEST))
    viewer = napari.Viewer(show=False)
    layer = viewer.add_surface((SHAPE.vertices, SHAPE.faces))
    for name, label in LABELS.items():
        _, widget = viewer.window.add_plugin_dock_widget("bezier-filters-adapters", label)
        assert {parameter.name for parameter in parameters_of(name)} <= {part.name for part in widget}
        widget(surface=layer)
        made = viewer.layers[-1]
        assert list(made.metadata) == [*field_names(name), "summary"]
        assert tuple(made.contrast_limits) == field_colors(made.name, made.vertex_values).limits
        assert made.shading == "smooth"
    viewer.close()
