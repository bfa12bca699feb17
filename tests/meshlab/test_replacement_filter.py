"""Replacing the selected faces of a mesh in a MeshSet: what goes, what stays, what is refused."""

import json
import re

import numpy as np
import pymeshlab
import pytest
from command_line import run
from full_meshset import add_all_attributes
from meshset_state import attributes, changed, frozen, layer_state, mesh_state

from bezier_filters import load_mesh, read_filter_script, run_filter_script
from bezier_filters.errors import CancelledError
from bezier_filters.holes.selection_replacement import replace_selection
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.replacement_filter import meshing_replace_selection_by_bezier_patch
from bezier_filters.surfaces import sphere, torus

TOP, SIDE = "z0 > 0.92 && z1 > 0.92 && z2 > 0.92", "x0 > 0.95 && x1 > 0.95 && x2 > 0.95"


def ball(resolution=20):
    """A ball with a bump on top."""
    shape = sphere(resolution=resolution, jitter=0.1)
    vertices = shape.vertices * (1.0 + 0.1 * np.maximum(shape.vertices[:, 2:] - 0.95, 0.0) / 0.05)
    return vertices, shape.faces


def meshset(vertices, faces, condition=TOP):
    """A MeshSet with everything that a mesh can carry, and some faces selected."""
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces), "ball")
    ms.create_cube()
    ms.set_current_mesh(0)
    ms.compute_texcoord_by_function_per_vertex(u="x", v="y")
    ms.compute_texcoord_by_function_per_wedge(u0="x0", u1="x1", u2="x2", v0="y0", v1="y1", v2="y2")
    add_all_attributes(ms, height=0.2, faces=50)
    ms.current_mesh().add_vertex_custom_scalar_attribute(np.ones(len(vertices)), "bz_k_min")
    ms.compute_selection_by_condition_per_face(condselect=condition)
    return ms


def thawed(value):
    kind, shape, data = value
    return np.frombuffer(data, kind).reshape(shape)


@pytest.fixture(scope="module")
def replaced():
    """A mesh before and after, to be looked at only, the result of the array function and the report."""
    before, after = meshset(*ball()), meshset(*ball())
    mesh = before.current_mesh()
    expected = replace_selection(mesh.vertex_matrix(), mesh.face_matrix(), mesh.face_selection_array())
    return before, after, expected, meshing_replace_selection_by_bezier_patch(after)


def test_the_mesh_is_that_of_the_array_function(replaced):
    before, after, expected, report = replaced
    np.testing.assert_array_equal(after.current_mesh().vertex_matrix(), expected.vertices)
    np.testing.assert_array_equal(after.current_mesh().face_matrix(), expected.faces)
    (patch,) = expected.patches
    assert report["removed_volume"] == patch.removed_volume > 0.0
    assert report["patches"][0]["removed_height"] == patch.removed_height == pytest.approx(0.1, rel=0.05)
    assert report["patches"][0]["area"] == patch.area
    assert report["removed_vertices"] == before.current_mesh().vertex_number() - len(expected.old_vertices) > 0
    assert (report["replaced_patches"], report["kept_patches"], report["warnings"]) == (1, 0, [])
    assert report["topology_after"] == report["topology_before"]
    json.dumps(report)


def test_everything_that_stays_is_the_same(replaced):
    open_one, closed_one, expected, report = replaced
    before, after = (
        layer_state(ms.current_mesh()) | {k: frozen(v) for k, v in attributes(ms).items()}
        for ms in (open_one, closed_one)
    )
    assert before.keys() == after.keys()
    assert report["lost_attributes"] == []
    n, m = open_one.current_mesh().vertex_number(), open_one.current_mesh().face_number()
    kept = {n: expected.old_vertices, m: expected.old_faces}
    kept[3 * m] = (3 * expected.old_faces[:, np.newaxis] + np.arange(3)).ravel()
    left_out = {"vertex_normal_matrix", "face_normal_matrix", "bounding_box", "face_matrix"}
    compared = 0
    for key, old in before.items():
        if old == after[key] or key in left_out:
            continue
        rows = thawed(old)[kept[len(thawed(old))]]
        np.testing.assert_array_equal(thawed(after[key])[: len(rows)], rows, err_msg=key)
        compared += 1
    assert compared > 8
    assert thawed(after["vertex_selection_array"]).any()
    assert not thawed(after["face_selection_array"]).any()
    assert mesh_state(closed_one)["script"] == mesh_state(open_one)["script"]
    others = {key: value for key, value in mesh_state(open_one).items() if key.startswith("1: ")}
    assert others.items() <= mesh_state(closed_one).items()
    assert {layer.id() for layer in closed_one} == {1, report["id"]}


def test_what_is_new_continues_what_is_around(replaced):
    _, after, expected, _ = replaced
    mesh, n, m = after.current_mesh(), len(expected.old_vertices), len(expected.old_faces)
    where = mesh.vertex_matrix()
    np.testing.assert_allclose(mesh.vertex_scalar_array()[n:], where[n:, 0], atol=0.02)  # the quality is x
    np.testing.assert_allclose(mesh.vertex_tex_coord_matrix()[n:], where[n:, :2], atol=0.02)
    assert (mesh.vertex_custom_scalar_attribute_array("bz_k_min")[n:] == 0.0).all()
    values = mesh.face_custom_scalar_attribute_array("facemine")
    assert np.isin(values[m:], values[:m]).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.vertex_normal_matrix(), axis=1), 1.0)


def test_textures_go_on(textured):
    """Of the sample bunny, whose faces show an image."""
    textured.compute_selection_by_condition_per_face(condselect="fi == 100")
    names = list(textured.current_mesh().textures())
    wedges = textured.current_mesh().wedge_tex_coord_matrix()
    report = meshing_replace_selection_by_bezier_patch(textured, rings=1)
    assert report["replaced_patches"] == 1
    assert report["textured"]
    mesh = textured.current_mesh()
    assert list(mesh.textures()) == names
    assert np.isin(mesh.wedge_tex_coord_matrix()[: -3 * report["new_faces"]], wedges).all()
    assert len(mesh.wedge_tex_coord_matrix()) == 3 * mesh.face_number()


def test_faces_whose_vertices_are_selected_are_replaced_if_no_face_is():
    vertices, faces = ball()
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    ms.compute_selection_by_condition_per_vertex(condselect="z > 0.92")
    report = meshing_replace_selection_by_bezier_patch(ms)
    expected = replace_selection(vertices, faces, (vertices[faces][:, :, 2] > 0.92).all(axis=1))
    assert report["removed_faces"] == len(expected.patches[0].old_faces)
    np.testing.assert_array_equal(ms.current_mesh().vertex_matrix(), expected.vertices)


def test_a_condition_stands_for_the_selection_which_stays(replaced):
    _, after, _, report = replaced
    ms = meshset(*ball(), condition=SIDE)
    before = mesh_state(ms)
    given = meshing_replace_selection_by_bezier_patch(ms, condselect=TOP)
    assert {key: value for key, value in given.items() if key not in ("seconds", "id")} == {
        key: value for key, value in report.items() if key not in ("seconds", "id")
    }
    np.testing.assert_array_equal(ms.current_mesh().vertex_matrix(), after.current_mesh().vertex_matrix())
    assert ms.current_mesh().face_selection_array().sum() == thawed(before["0: face_selection_array"]).sum() > 0
    by_attribute = meshset(*ball())
    flags = by_attribute.current_mesh().face_selection_array().astype(float)
    by_attribute.current_mesh().add_face_custom_scalar_attribute(flags, "part")
    found = meshing_replace_selection_by_bezier_patch(by_attribute, condselect="part > 0.5")
    assert found["removed_faces"] == report["removed_faces"]


def test_new_faces_are_selected_on_request():
    ms = meshset(*ball())
    report = meshing_replace_selection_by_bezier_patch(ms, newfaceselected=True)
    selection = ms.current_mesh().face_selection_array()
    assert selection.sum() == report["new_faces"] == selection[-report["new_faces"] :].sum()


def test_coincident_vertices_stay_apart():
    shape = torus(resolution=24)
    vertices, faces = np.vstack([shape.vertices, shape.vertices + 0.0]), np.vstack([shape.faces, shape.faces[:, ::-1]])
    faces[len(shape.faces) :] += len(shape.vertices)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    report = meshing_replace_selection_by_bezier_patch(ms, condselect="fi == 5", rings=1, intersecting=True)
    assert report["replaced_patches"] == 1
    assert len(np.unique(ms.current_mesh().vertex_matrix(), axis=0)) < ms.current_mesh().vertex_number()


def test_polygons_become_triangles():
    """Half of a square is replaced; pymeshlab's own filter would leave the other half as a polygon without an end."""
    i = np.arange(8)
    x, y = (axis.ravel() for axis in np.meshgrid(i, i))
    corner = (i[:-1, np.newaxis] * 8 + i[:-1]).ravel()
    squares = np.column_stack([corner, corner + 1, corner + 9, corner + 8]).tolist()
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(np.column_stack([x, y, 0.0 * x]), face_list_of_indices=squares))
    assert meshing_replace_selection_by_bezier_patch(ms, condselect="fi == 48")["replaced_patches"] == 1
    polygons = ms.current_mesh().polygonal_face_list()
    assert len(polygons) == ms.current_mesh().face_number() == 98


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"condselect": "z0 >"}, r"condselect: got 'z0 >', expected a condition on faces in MeshLab's syntax"),
        ({"condselect": "unknown > 1"}, "Unexpected token"),
        ({"condselect": "z0 > 100"}, "condselect: no face satisfies 'z0 > 100'"),
        ({"condselect": ""}, "condselect: got ''"),
        ({"rings": -1}, "rings: got -1, expected an integer from 0 to 100"),
        ({"method": "round"}, "method: got 'round'"),
        ({"noise": -1.0}, "noise: got -1.0"),
    ],
)
def test_refusals_change_nothing(options, message):
    ms = meshset(*ball(8))
    before = mesh_state(ms)
    with pytest.raises(BezierFilterError, match=message):
        meshing_replace_selection_by_bezier_patch(ms, **options)
    assert changed(before, mesh_state(ms)) == set()


def test_nothing_selected_or_nothing_around_changes_nothing():
    ms = meshset(*ball(8), condition="0")
    ms.set_selection_none(allfaces=True, allverts=True)
    before = mesh_state(ms)
    with pytest.raises(BezierFilterError, match="no face is selected: select the faces"):
        meshing_replace_selection_by_bezier_patch(ms)
    report = meshing_replace_selection_by_bezier_patch(ms, condselect="1")
    assert report["replaced_patches"] == 0
    assert "every face of its component is selected" in report["patches"][0]["hole"]["reason"]
    assert report["warnings"]
    assert changed(before, mesh_state(ms)) == set()


def test_cancelling_and_failing_to_write_change_nothing(monkeypatch):
    ms = meshset(*ball(8), condition=SIDE)
    before = mesh_state(ms)
    with pytest.raises(CancelledError):
        meshing_replace_selection_by_bezier_patch(ms, progress=lambda done, total: False)
    assert changed(before, mesh_state(ms)) == set()

    def fail(*_):
        raise ZeroDivisionError

    monkeypatch.setattr("bezier_filters.meshlab.mesh_growth.add_attribute", fail)
    with pytest.raises(ZeroDivisionError):
        meshing_replace_selection_by_bezier_patch(ms)
    assert changed(before, mesh_state(ms)) == set()


class TestCommand:
    @pytest.fixture
    def source(self, tmp_path):
        ms = meshset(*ball())
        ms.save_current_mesh(str(tmp_path / "ball.ply"), save_face_flag=True, save_textures=False)
        return tmp_path / "ball.ply"

    def test_the_selection_of_a_file_is_replaced(self, source, tmp_path):
        result = run("replace", source, tmp_path / "round.ply")
        assert result.returncode == 0, result.stderr
        assert re.search(r"volume removed +height removed", result.stdout)
        assert "1 replaced, " in result.stdout
        vertices, faces = ball()
        expected = replace_selection(vertices, faces, (vertices[faces][:, :, 2] > 0.92).all(axis=1))
        found = load_mesh(tmp_path / "round.ply")
        np.testing.assert_allclose(found.current_mesh().vertex_matrix(), expected.vertices, atol=1e-12)

    def test_a_condition_and_a_script(self, source, tmp_path):
        result = run(
            "replace", source, tmp_path / "a.ply", "--where", TOP, "--json", "--save-script", tmp_path / "steps.mlx"
        )
        assert result.returncode == 0, result.stderr
        report = json.loads(result.stdout)
        assert report["patches"][0]["removed_height"] == pytest.approx(0.1, rel=0.05)
        ms, written = load_mesh(source), load_mesh(tmp_path / "a.ply")
        run_filter_script(ms, read_filter_script(tmp_path / "steps.mlx"))
        assert ms.current_mesh().vertex_number() == written.current_mesh().vertex_number()

    def test_refusals_name_the_option(self, source, tmp_path):
        result = run("replace", source, tmp_path / "a.ply", "--where", "z0 > 100")
        assert result.returncode == 2
        assert "--where: no face satisfies 'z0 > 100'" in result.stderr
        result = run("replace", source, tmp_path / "a.ply", "--where", "1")
        assert result.returncode == 3
        assert "could not be replaced" in result.stderr
        assert "nothing around it" in result.stdout
