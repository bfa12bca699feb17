"""The add-on in Blender as a module of Python."""

import sys
from pathlib import Path

import numpy as np
import pytest

from bezier_filters_adapters.filters import LABELS, field_names, parameters_of

FOLDER = Path(__file__).parents[2] / "adapters" / "bezier_filters_blender"


def test_the_add_on_compiles():
    path = FOLDER / "__init__.py"
    compile(path.read_text(encoding="utf-8"), path, "exec")


@pytest.mark.skipif(sys.version_info < (3, 11), reason="the reader of TOML came with Python 3.11")
def test_the_manifest_has_what_blender_asks_for():
    import tomllib

    manifest = tomllib.loads((FOLDER / "blender_manifest.toml").read_text(encoding="utf-8"))
    asked = {
        "schema_version",
        "id",
        "version",
        "name",
        "tagline",
        "maintainer",
        "type",
        "blender_version_min",
        "license",
    }
    assert asked <= manifest.keys()
    assert len(manifest["tagline"]) <= 64
    assert not manifest["tagline"].endswith(".")


@pytest.fixture(scope="module")
def blender():
    bpy = pytest.importorskip("bpy", reason="Blender as a module, bpy, is not installed; it is for one Python only")
    if bpy.app.version < (5, 1):
        pytest.skip("Blender before 5.1 brings NumPy 1")
    import bezier_filters_blender

    bezier_filters_blender.register()
    yield bpy
    bezier_filters_blender.unregister()


@pytest.fixture
def mesh(blender):
    blender.ops.wm.read_factory_settings(use_empty=True)
    blender.ops.mesh.primitive_uv_sphere_add(radius=2.0, segments=24, ring_count=16)
    return blender.context.object.data


def operator(blender, name):
    return getattr(blender.ops.object, f"bezier_{name.replace('-', '_')}")


def values(mesh, column):
    found = np.empty(len(mesh.vertices), np.float32)
    mesh.attributes[column].data.foreach_get("value", found)
    return found


@pytest.mark.parametrize("name", LABELS)
def test_operators_have_parameters_and_write_attributes(blender, mesh, name):
    sizes = len(mesh.vertices), len(mesh.polygons)
    run = operator(blender, name)
    assert {parameter.name for parameter in parameters_of(name)} <= set(run.get_rna_type().properties.keys())
    for _ in range(2):
        assert run() == {"FINISHED"}
        assert set(field_names(name)) <= set(mesh.attributes.keys())
    assert (len(mesh.vertices), len(mesh.polygons)) == sizes


def test_curvature_is_that_of_the_sphere(blender, mesh):
    operator(blender, "curvature")(rings="2", robust="True")
    assert abs(np.median(values(mesh, "bz_mean_curvature")) - 0.5) < 0.01
    assert values(mesh, "bz_rings_used").min() == 2


def test_holes_are_filled_and_polygons_stay(blender, mesh):
    import bmesh

    cut = bmesh.new()
    cut.from_mesh(mesh)
    cut.faces.ensure_lookup_table()
    bmesh.ops.delete(cut, geom=[cut.faces[100]], context="FACES_ONLY")
    cut.to_mesh(mesh)
    before = [tuple(polygon.vertices) for polygon in mesh.polygons]
    operator(blender, "fill-holes")()
    after = [tuple(polygon.vertices) for polygon in mesh.polygons]
    assert after[: len(before)] == before
    assert len(after) > len(before)
    whole = bmesh.new()
    whole.from_mesh(mesh)
    assert all(len(edge.link_faces) == 2 for edge in whole.edges)


def test_smoothing_moves_vertices(blender, mesh):
    places = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", places.ravel())
    noisy = places + np.random.default_rng(0).normal(scale=0.03, size=places.shape).astype(np.float32)
    mesh.vertices.foreach_set("co", noisy.ravel())
    operator(blender, "smooth")(iterations=1)
    smoothed = np.empty_like(places)
    mesh.vertices.foreach_get("co", smoothed.ravel())
    assert np.abs(np.linalg.norm(smoothed, axis=1) - 2).mean() < np.abs(np.linalg.norm(noisy, axis=1) - 2).mean()
    assert values(mesh, "bz_displacement").max() > 0


def test_errors_are_reports(blender, mesh):
    with pytest.raises(RuntimeError, match="rings: got -3"):
        operator(blender, "curvature")(rings="-3")


def test_pymeshlab_is_not_loaded_by_the_add_on(blender):
    import bezier_filters_blender

    assert not hasattr(bezier_filters_blender, "pymeshlab")
