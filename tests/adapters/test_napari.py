"""The manifest for napari, and its commands on arrays."""

import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import bezier_filters as bf
from bezier_filters.surfaces import torus
from bezier_filters_adapters.filters import LABELS, field_names, parameters_of

MANIFEST = Path(__file__).parents[2] / "adapters" / "bezier_filters_adapters" / "napari.yaml"
SHAPE = torus(resolution=16)
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
    assert [len(shown) for shown in values] == ([len(vertices)] if field_names(name) else [])


def test_a_field_can_be_chosen():
    (*_, values), state, _ = command("curvature")((SHAPE.vertices, SHAPE.faces), field="bz_k_max", rings="2")
    assert state["name"] == "bz_k_max"
    np.testing.assert_array_equal(values, bf.estimate_vertex_geometry(SHAPE.vertices, SHAPE.faces, rings=2).k_max)


def test_holes_are_filled():
    (vertices, faces), _, _ = command("fill-holes")((SHAPE.vertices, SHAPE.faces[4:]))
    assert bf.boundary_loops(bf.triangle_mesh(vertices, faces)) == []


@pytest.mark.filterwarnings("ignore")  # those of napari and Qt
def test_widgets_run_in_napari(monkeypatch):
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    napari = pytest.importorskip("napari", reason="napari is not installed")
    from npe2 import PluginManager, PluginManifest

    PluginManager.instance().register(PluginManifest.from_file(MANIFEST))
    viewer = napari.Viewer(show=False)
    layer = viewer.add_surface((SHAPE.vertices, SHAPE.faces))
    for name, label in LABELS.items():
        _, widget = viewer.window.add_plugin_dock_widget("bezier-filters-adapters", label)
        assert {parameter.name for parameter in parameters_of(name)} <= {part.name for part in widget}
        widget(surface=layer.data)
        assert list(viewer.layers[-1].metadata) == [*field_names(name), "summary"]
    viewer.close()
