"""Joining holes of a mesh in a MeshSet: what is added, what stays, what is refused."""

import json

import numpy as np
import pymeshlab
import pytest
from command_line import run
from full_meshset import full_meshset
from meshset_state import changed, mesh_state

from bezier_filters import load_mesh
from bezier_filters.errors import CancelledError
from bezier_filters.holes.bridging import bridge_holes
from bezier_filters.meshlab.bridge_filter import meshing_bridge_holes_by_bezier_patch
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.surfaces import torus
from open_ends import plate


def ring_with_gap():
    """A torus without a piece."""
    ring = torus(resolution=24, jitter=0.1)
    gap = (np.abs(np.arctan2(ring.vertices[:, 1], ring.vertices[:, 0])) < 0.25)[ring.faces].any(axis=1)
    used, faces = np.unique(ring.faces[~gap], return_inverse=True)
    return ring.vertices[used], faces.reshape(-1, 3).astype(np.int32)


def test_the_mesh_is_that_of_the_array_function_and_all_old_stays():
    vertices, faces = ring_with_gap()
    ms = full_meshset(vertices, faces)
    before = mesh_state(ms)
    report = meshing_bridge_holes_by_bezier_patch(ms, pairs="0 1")
    expected = bridge_holes(vertices, faces, [(0, 1)])
    mesh = ms.current_mesh()
    np.testing.assert_array_equal(mesh.vertex_matrix(), expected.vertices)
    np.testing.assert_array_equal(mesh.face_matrix(), expected.faces)
    assert report["bridged_pairs"] == 1
    assert report["bands"][0]["pair"] == [0, 1]
    assert report["bands"][0]["method"] == "surface"
    assert [hole["edge_count"] for hole in report["holes"]] == [24, 24]
    assert report["topology_before"]["boundary_loops"] == 2
    assert report["topology_after"]["boundary_loops"] == 0
    assert report["topology_after"]["genus"] == 1
    json.dumps(report)
    after, n = mesh_state(ms), len(vertices)
    assert after["script"] == before["script"]
    np.testing.assert_array_equal(mesh.vertex_scalar_array()[:n], vertices[:, 0])  # the quality is x
    np.testing.assert_allclose(mesh.vertex_scalar_array()[n:], mesh.vertex_matrix()[n:, 0], atol=0.25)
    assert len(mesh.vertex_custom_scalar_attribute_array("mine")) == mesh.vertex_number()


def test_pairs_are_given_as_text():
    vertices, faces = plate(bottom=True, bolt_walls=False)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    report = meshing_bridge_holes_by_bezier_patch(ms, pairs="0 1,  6 7", newfaceselected=True)
    assert [band["pair"] for band in report["bands"]] == [[0, 1], [6, 7]]
    assert {band["method"] for band in report["bands"]} == {"straight"}
    assert ms.current_mesh().face_selection_array().sum() == report["new_faces"]
    assert report["topology_after"]["boundary_loops"] == 6


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pairs": "all"}, "pairs: got 'all', expected auto, or pairs of numbers"),
        ({"pairs": "0 1 2"}, "pairs: got '0 1 2', expected auto"),
        ({"pairs": ""}, "pairs: got ''"),
        ({"pairs": "0 7"}, "expected two numbers from 0 to 1, for 2 holes"),
        ({"pairs": "0 0"}, "pairs: hole 0 occurs 2 times"),
        ({"noise": -1.0}, "noise: got -1.0"),
    ],
)
def test_refusals_change_nothing(options, message):
    ms = full_meshset(*ring_with_gap())
    before = mesh_state(ms)
    with pytest.raises(BezierFilterError, match=message):
        meshing_bridge_holes_by_bezier_patch(ms, **options)
    assert changed(before, mesh_state(ms)) == set()


def test_cancelling_and_joining_nothing_change_nothing():
    ms = full_meshset()
    before = mesh_state(ms)
    report = meshing_bridge_holes_by_bezier_patch(ms)
    assert report["bridged_pairs"] == 0
    assert any("no two holes face each other" in remark for remark in report["remarks"])
    assert changed(before, mesh_state(ms)) == set()
    with pytest.raises(CancelledError):
        meshing_bridge_holes_by_bezier_patch(ms, pairs="0 1", progress=lambda done, total: False)
    assert changed(before, mesh_state(ms)) == set()


def test_the_command_joins_and_lists_holes(tmp_path):
    vertices, faces = plate(bottom=True, bolt_walls=False)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    ms.save_current_mesh(str(tmp_path / "plate.ply"))
    result = run("bridge", tmp_path / "plate.ply", tmp_path / "joined.ply")
    assert result.returncode == 0, result.stderr
    assert "5 pairs joined" in result.stdout
    assert result.stdout.count("straight") == 10
    joined = load_mesh(tmp_path / "joined.ply")
    assert joined.get_topological_measures()["boundary_edges"] == 0
    result = run("bridge", tmp_path / "plate.ply", tmp_path / "a.ply", "--pairs", "0 2")
    assert result.returncode == 3
    assert "0 pairs joined with 0 faces, 1 left open" in result.stdout
    assert "1 of the pairs of holes, which could not be joined" in result.stderr
    assert run("bridge", tmp_path / "plate.ply", tmp_path / "a.ply", "--pairs", "0 99").returncode == 2
