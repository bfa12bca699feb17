"""The add-on in Blender as a module of Python."""

import sys
from pathlib import Path

import numpy as np
import pytest

import bezier_filters as bf
from bezier_filters_adapters.field_colors import field_colors
from bezier_filters_adapters.filters import LABELS, field_names, parameters_of, run

FOLDER = Path(__file__).parents[2] / "adapters" / "bezier_filters_blender"


def test_the_add_on_compiles():
    for path in FOLDER.glob("*.py"):
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


def values(mesh, name):
    attribute, count = mesh.attributes[name], len(mesh.vertices)
    is_vector = attribute.data_type == "FLOAT_VECTOR"
    found = np.empty((count, 3) if is_vector else count, np.int32 if attribute.data_type == "INT" else np.float32)
    attribute.data.foreach_get("vector" if is_vector else "value", found.ravel())
    return found


@pytest.mark.parametrize("name", LABELS)
def test_operators_have_parameters_and_write_attributes(blender, mesh, name):
    sizes = len(mesh.vertices), len(mesh.polygons)
    call = operator(blender, name)
    assert {parameter.name for parameter in parameters_of(name)} <= set(call.get_rna_type().properties.keys())
    for _ in range(2):
        assert call() == {"FINISHED"}
        assert set(field_names(name)) <= set(mesh.attributes.keys())
    assert (len(mesh.vertices), len(mesh.polygons)) == sizes


def test_curvature_is_that_of_the_sphere(blender, mesh):
    operator(blender, "curvature")(rings="2", robust="True")
    assert abs(np.median(values(mesh, "bz_mean_curvature")) - 0.5) < 0.01
    assert values(mesh, "bz_rings_used").min() == 2


def test_attributes_have_the_types_of_the_fields(blender, mesh):
    """Also where an earlier version left numbers of another type."""
    mesh.attributes.new("bz_fit_grade", "FLOAT", "POINT")
    operator(blender, "curvature")()
    found = run("curvature", *bf.mesh_arrays(triangles(mesh)), {}).fields
    assert values(mesh, "bz_direction_max").shape == (len(mesh.vertices), 3)
    assert values(mesh, "bz_fit_grade").dtype == values(mesh, "bz_rings_used").dtype == np.int32
    for name, expected in found.items():
        np.testing.assert_allclose(values(mesh, name), expected, rtol=1e-6, atol=1e-7)


def test_fitted_normals_are_those_of_the_mesh(blender, mesh):
    operator(blender, "normals")()
    corners = np.empty((len(mesh.loops), 3), np.float32)
    mesh.corner_normals.foreach_get("vector", corners.ravel())
    vertices = np.array([loop.vertex_index for loop in mesh.loops])
    np.testing.assert_allclose(corners, values(mesh, "bz_normal")[vertices], atol=1e-3)


def colors(mesh):
    attribute = mesh.color_attributes[mesh.color_attributes.active_color_name]
    found = np.empty((len(mesh.vertices), 4), np.float32)
    attribute.data.foreach_get("color_srgb", found.ravel())
    return found


def test_the_first_field_is_the_color_of_views_and_renders(blender, mesh):
    """Also a second time, when the attribute is there."""
    view = next(area.spaces.active for area in blender.context.screen.areas if area.type == "VIEW_3D")
    for name, field in (("curvature", "bz_mean_curvature"), ("smooth", "bz_displacement")):
        view.shading.color_type = "MATERIAL"
        operator(blender, name)()
        assert mesh.color_attributes.active_color_name == mesh.color_attributes.default_color_name == "bz_color"
        found = values(mesh, field)
        np.testing.assert_allclose(colors(mesh)[:, :3], field_colors(field, found).rgb(found), atol=0.01)
        assert view.shading.color_type == "VERTEX"
    (material,) = mesh.materials
    (link,) = (link for link in material.node_tree.links if link.to_socket.name == "Base Color")
    assert link.from_node.layer_name == "bz_color"


def test_materials_and_settings_of_the_user_stay(blender, mesh):
    view = next(area.spaces.active for area in blender.context.screen.areas if area.type == "VIEW_3D")
    view.shading.color_type = "RANDOM"
    mesh.materials.append(blender.data.materials.new("mine"))
    operator(blender, "curvature")()
    assert [material.name for material in mesh.materials] == ["mine"]
    assert view.shading.color_type == "RANDOM"


def test_fills_continue_colors(blender, mesh):
    operator(blender, "curvature")()
    before, count = colors(mesh), len(mesh.vertices)
    remove_face(mesh, 100)
    operator(blender, "fill-holes")()
    np.testing.assert_array_equal(colors(mesh)[:count], before)
    assert (colors(mesh)[count:, 3] == 1.0).all()


def triangles(mesh):
    mesh.calc_loop_triangles()
    return [vertex.co for vertex in mesh.vertices], [triangle.vertices for triangle in mesh.loop_triangles]


def remove_face(mesh, index):
    import bmesh

    cut = bmesh.new()
    cut.from_mesh(mesh)
    cut.faces.ensure_lookup_table()
    bmesh.ops.delete(cut, geom=[cut.faces[index]], context="FACES_ONLY")
    cut.to_mesh(mesh)


def test_holes_are_filled_and_polygons_stay(blender, mesh):
    import bmesh

    remove_face(mesh, 100)
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
