"""Subdivision of a mesh in a MeshSet: everything on it is interpolated or stays."""

import json

import numpy as np
import pymeshlab
import pytest
from command_line import run
from full_meshset import full_meshset
from meshset_state import changed, mesh_state

from bezier_filters import load_mesh, subdivide
from bezier_filters.errors import CancelledError
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.subdivision_filter import meshing_surface_subdivision_by_bezier_patch
from bezier_filters.surfaces import sphere, torus


def test_the_mesh_is_that_of_the_array_function_with_what_was_on_it():
    ring = torus(resolution=16, jitter=0.1)
    ms = full_meshset(ring.vertices, ring.faces)
    before, old = mesh_state(ms), ms.current_mesh()
    label, colors = old.label(), np.array(old.vertex_color_matrix())
    report = meshing_surface_subdivision_by_bezier_patch(ms, noise=0.0)
    expected, mesh, n = subdivide(ring.vertices, ring.faces, noise=0.0), ms.current_mesh(), len(ring.vertices)
    np.testing.assert_array_equal(mesh.vertex_matrix(), expected.vertices)
    np.testing.assert_array_equal(mesh.face_matrix(), expected.faces)
    assert (report["old_vertices"], report["vertices"]) == (n, len(expected.vertices))
    assert report["topology_after"]["genus"] == 1
    json.dumps(report)
    assert mesh_state(ms)["script"] == before["script"]
    assert mesh.label() == label
    np.testing.assert_allclose(mesh.vertex_color_matrix()[:n], colors, atol=1e-9)
    np.testing.assert_array_equal(mesh.vertex_scalar_array()[:n], ring.vertices[:, 0])  # the quality is x
    edge = np.linalg.norm(np.diff(ring.vertices[ring.faces[:, :2]], axis=1), axis=2).max()
    np.testing.assert_allclose(mesh.vertex_scalar_array()[n:], mesh.vertex_matrix()[n:, 0], atol=0.2 * edge)
    assert len(mesh.vertex_custom_scalar_attribute_array("mine")) == mesh.vertex_number()
    np.testing.assert_allclose(np.linalg.norm(mesh.vertex_normal_matrix(), axis=1), 1.0)


def test_textures_stay_in_place(tmp_path):
    """On a sheet whose texture coordinates are x and y they are so between old vertices, too."""
    ms = pymeshlab.MeshSet()
    ms.create_grid(numvertx=6, numverty=5)
    ms.compute_texcoord_parametrization_flat_plane_per_wedge(projectionplane="XY")
    before, faces = ms.current_mesh().wedge_tex_coord_matrix().reshape(-1, 2), ms.current_mesh().face_matrix()
    slope, offset = np.polyfit(ms.current_mesh().vertex_matrix()[faces.ravel(), 0], before[:, 0], 1)
    meshing_surface_subdivision_by_bezier_patch(ms)
    mesh = ms.current_mesh()
    corners = mesh.vertex_matrix()[mesh.face_matrix().ravel()]
    found = mesh.wedge_tex_coord_matrix().reshape(-1, 2)
    np.testing.assert_allclose(found[:, 0], slope * corners[:, 0] + offset, atol=1e-6)


def test_the_selection_is_subdivided_and_stays():
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=3)
    ms.compute_selection_by_condition_per_face(condselect="z0 > 0.5")
    selected = ms.current_mesh().selected_face_number()
    report = meshing_surface_subdivision_by_bezier_patch(ms, onselected=True)
    assert ms.current_mesh().selected_face_number() == 4 * selected
    assert 3 * selected < report["faces"] - report["old_faces"] < 4 * selected


def test_estimates_are_interpolated_and_grades_are_those_of_an_end():
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=3)
    import bezier_filters as bf

    bf.compute_curvature_by_bezier_patch_per_vertex(ms)
    old = set(ms.current_mesh().vertex_custom_scalar_attribute_array("bz_fit_grade"))
    meshing_surface_subdivision_by_bezier_patch(ms)
    mesh = ms.current_mesh()
    np.testing.assert_allclose(mesh.vertex_custom_scalar_attribute_array("bz_mean_curvature"), 1.0, atol=0.01)
    assert set(mesh.vertex_custom_scalar_attribute_array("bz_fit_grade")) <= old


@pytest.mark.parametrize(
    ("options", "message"),
    [({"iterations": 0}, "iterations"), ({"onselected": True}, "onselected"), ({"tolerance": "x"}, "tolerance")],
)
def test_refused_filters_change_nothing(options, message):
    ball = sphere(resolution=6)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(ball.vertices, ball.faces))
    before = mesh_state(ms)
    with pytest.raises(BezierFilterError, match=message):
        meshing_surface_subdivision_by_bezier_patch(ms, **options)
    assert not changed(before, mesh_state(ms))


def test_a_cancelled_filter_changes_nothing():
    ball = sphere(resolution=6)
    ms = full_meshset(ball.vertices, ball.faces)
    before = mesh_state(ms)
    with pytest.raises(CancelledError):
        meshing_surface_subdivision_by_bezier_patch(ms, progress=lambda done, total: False)
    assert not changed(before, mesh_state(ms))


def test_the_command_writes_the_finer_mesh(tmp_path):
    ball = sphere(resolution=6)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(ball.vertices, ball.faces))
    ms.save_current_mesh(str(tmp_path / "ball.ply"))
    done = run("subdivide", tmp_path / "ball.ply", tmp_path / "fine.ply", "--tolerance", "0.05%", "--json")
    report = json.loads(done.stdout)
    assert report["chord_error"] <= 0.0005 * np.linalg.norm(np.ptp(ball.vertices, axis=0))
    assert load_mesh(tmp_path / "fine.ply").current_mesh().face_number() == report["faces"]
