"""Remeshing of a mesh in a MeshSet: everything on it is interpolated, and seams and selections stay."""

import json

import numpy as np
import pymeshlab
import pytest
from command_line import run
from full_meshset import full_meshset
from meshset_state import changed, mesh_state

from bezier_filters import load_mesh
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.remeshing_filter import meshing_remeshing_by_bezier_patch
from bezier_filters.surfaces import sphere, torus


def test_attributes_are_those_below():
    ring = torus(resolution=16, jitter=0.1)
    ms = full_meshset(ring.vertices, ring.faces)
    script = mesh_state(ms)["script"]
    report = meshing_remeshing_by_bezier_patch(ms)
    json.dumps(report)
    mesh = ms.current_mesh()
    assert (mesh.vertex_number(), mesh.face_number()) == (report["vertices"], report["faces"])
    assert mesh_state(ms)["script"] == script
    edge = np.linalg.norm(np.diff(ring.vertices[ring.faces[:, :2]], axis=1), axis=2).max()
    # the quality is x
    np.testing.assert_allclose(mesh.vertex_scalar_array(), mesh.vertex_matrix()[:, 0], atol=0.2 * edge)
    assert len(mesh.vertex_custom_scalar_attribute_array("mine")) == mesh.vertex_number()


def test_the_border_of_a_selection_stays():
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=4)
    ms.compute_selection_by_condition_per_face(condselect="z0 + z1 + z2 > 1.5")

    def area():
        mesh = ms.current_mesh()
        corners = mesh.vertex_matrix()[mesh.face_matrix()[mesh.face_selection_array()]]
        return (
            0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
        )

    before = area()
    meshing_remeshing_by_bezier_patch(ms, vertexcount=4000)
    assert abs(area() / before - 1.0) < 0.01


def test_refused_filters_change_nothing():
    ball = sphere(resolution=6)
    ms = full_meshset(ball.vertices, ball.faces)
    before = mesh_state(ms)
    with pytest.raises(BezierFilterError, match="vertexcount"):
        meshing_remeshing_by_bezier_patch(ms, vertexcount=2)
    assert not changed(before, mesh_state(ms))


def test_the_command_decimates_to_a_tolerance(tmp_path):
    ball = sphere(resolution=16)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(ball.vertices, ball.faces))
    ms.save_current_mesh(str(tmp_path / "ball.ply"))
    done = run("remesh", tmp_path / "ball.ply", tmp_path / "light.ply", "--tolerance", "1%", "--json")
    report = json.loads(done.stdout)
    assert report["faces"] < 0.3 * report["old_faces"]
    assert report["chord_error"] < 0.05
    assert load_mesh(tmp_path / "light.ply").current_mesh().face_number() == report["faces"]
