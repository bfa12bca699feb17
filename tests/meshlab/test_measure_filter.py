"""The filter that measures the current mesh, and its command."""

import json

import numpy as np
import pymeshlab
import pytest
from command_line import run
from full_meshset import full_meshset
from meshset_state import mesh_state

from bezier_filters import BezierFilterError, get_surface_measures_by_bezier_patch, measure, save_mesh
from bezier_filters.surfaces import sphere

BALL = sphere(resolution=8, jitter=0.2)


def ball():
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(BALL.vertices, BALL.faces))
    return ms


def test_the_report_is_that_of_the_array_function():
    report = get_surface_measures_by_bezier_patch(ball(), repeats=0)
    assert report["whole"]["values"] == vars(measure(BALL.vertices, BALL.faces, repeats=0).whole.values)
    assert json.loads(json.dumps(report)) == report


def test_selections_and_labels_are_parts():
    ms = ball()
    ms.compute_selection_by_condition_per_face(condselect="z0 + z1 + z2 > 0")
    selected = np.array(ms.current_mesh().face_selection_array())
    report = get_surface_measures_by_bezier_patch(ms, onselected=True, repeats=0)
    found = measure(BALL.vertices, BALL.faces, face_labels=selected, repeats=0)
    assert report["parts"][1]["values"] == vars(found.parts[1].values)
    ms.current_mesh().add_face_custom_scalar_attribute(selected + 4.0, "piece")
    by_name = get_surface_measures_by_bezier_patch(ms, labels="piece", repeats=0)
    assert [part["label"] for part in by_name["parts"]] == [4, 5]
    assert by_name["parts"][1]["values"] == report["parts"][1]["values"]
    ms.compute_scalar_by_function_per_vertex(q="x")
    for wrong in ("other", "quality"):
        with pytest.raises(BezierFilterError, match="labels"):
            get_surface_measures_by_bezier_patch(ms, labels=wrong)


def test_nothing_in_a_meshset_changes():
    ms = full_meshset()
    before = mesh_state(ms)
    get_surface_measures_by_bezier_patch(ms, repeats=0)
    assert str(mesh_state(ms)) == str(before)


def test_the_command_prints_integrals_and_their_errors(tmp_path):
    path = tmp_path / "ball.ply"
    save_mesh(ball(), path)
    done = run("measure", path, "--repeats", "2")
    assert done.returncode == 0, done.stderr
    assert "total gaussian curvature" in done.stdout
    assert "2 pi x 2 (Euler characteristic" in " ".join(done.stdout.split())
    report = json.loads(run("measure", path, "--repeats", "0", "--json").stdout)
    assert abs(report["whole"]["values"]["area"] - 4.0 * np.pi) < 1e-5
