"""The filter that compares layers of a MeshSet, its command and its colours."""

import json

import numpy as np
import pymeshlab
import pytest
from command_line import run

from bezier_filters import (
    BezierFilterError,
    compare,
    compute_deviation_by_bezier_patch_per_vertex,
    load_mesh,
    save_mesh,
)
from bezier_filters.meshlab.deviation_filter import deviation_report
from bezier_filters.surfaces import bumpy_star, sphere

SCAN, MODEL = sphere(radius=1.02, resolution=10), sphere(resolution=8)
GREY = 166


def layers():
    """The model, and the scan, which is current."""
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(MODEL.vertices, MODEL.faces), "model")
    ms.add_mesh(pymeshlab.Mesh(SCAN.vertices, SCAN.faces), "scan")
    return ms


def test_columns_and_report_are_those_of_the_array_function():
    ms = layers()
    report = compute_deviation_by_bezier_patch_per_vertex(ms, tolerance=0.03)
    found = compare(SCAN.vertices, SCAN.faces, MODEL.vertices, MODEL.faces, tolerance=0.03)
    mesh = ms.current_mesh()
    np.testing.assert_array_equal(mesh.vertex_scalar_array(), found.distances)
    np.testing.assert_array_equal(mesh.vertex_custom_scalar_attribute_array("bz_deviation_z"), found.z_scores)
    assert (mesh.vertex_custom_scalar_attribute_array("bz_deviation_grade") == 8).all()
    assert report["mean"] == found.mean
    assert report["share_within"] == 1.0
    assert json.loads(json.dumps(report)) == report


@pytest.mark.parametrize("motion", ["shift", "turn", "dent", "offset", "none"])
def test_meshes_that_are_not_registered_get_a_remark(motion):
    """Of a fifth of an edge; a dent of half an edge and a larger body get none."""
    scan, model = bumpy_star(resolution=16, jitter=0.3), bumpy_star(resolution=18, jitter=0.3, seed=1)
    edge = np.linalg.norm(np.diff(scan.vertices[scan.faces[:, :2]], axis=1), axis=2).mean()
    random = np.random.default_rng(0)
    noisy = [
        body.vertices + 0.05 * edge * random.normal(size=(len(body.vertices), 1)) * body.normals
        for body in (scan, model)
    ]
    dent = np.exp(-np.square(scan.vertices - scan.vertices[7]).sum(axis=1) / (3.0 * edge) ** 2)[:, np.newaxis]
    angle = 0.2 * edge
    moved = {
        "shift": noisy[0] + [0.2 * edge, 0.0, 0.0],
        "turn": noisy[0] @ np.array([[1.0, -angle, 0.0], [angle, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        "dent": noisy[0] - 0.5 * edge * dent * scan.normals,
        "offset": noisy[0] + 0.2 * edge * scan.normals,
        "none": noisy[0],
    }[motion]
    report = deviation_report(compare(moved, scan.faces, noisy[1], model.faces))
    expected = [f"of the deviation, {report['rigid_share']:.0%} is a rigid motion: register the meshes first"]
    assert report["remarks"] == (expected if motion in {"shift", "turn"} else [])
    assert bool(report["regions"]) == (motion != "none")


def test_colours_are_green_within_the_tolerance_and_grey_where_nothing_is_compared():
    ms = layers()
    report = compute_deviation_by_bezier_patch_per_vertex(ms, tolerance=0.03, color=True)
    red, green, blue, _ = ms.current_mesh().vertex_color_matrix()[0]
    assert green > 1.5 * max(red, blue)
    assert report["color_range"] == [-0.09, 0.09]
    compute_deviation_by_bezier_patch_per_vertex(ms, tolerance=0.015, color=True)
    red, green, blue, _ = ms.current_mesh().vertex_color_matrix()[0]
    assert min(red, green) > 2.0 * blue
    compute_deviation_by_bezier_patch_per_vertex(ms, tolerance=0.03, maxdistance=0.01, color=True)
    assert (np.round(255 * ms.current_mesh().vertex_color_matrix()[:, :3]) == GREY).all()


def test_the_reference_is_another_layer_with_faces():
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(SCAN.vertices, SCAN.faces))
    with pytest.raises(BezierFilterError, match="load the reference"):
        compute_deviation_by_bezier_patch_per_vertex(ms)
    ms = layers()
    with pytest.raises(BezierFilterError, match="expected the id of another layer: 0"):
        compute_deviation_by_bezier_patch_per_vertex(ms, refmesh=1)
    ms.compute_matrix_from_translation(traslmethod="XYZ translation", axisx=1.0, freeze=False)
    assert compute_deviation_by_bezier_patch_per_vertex(ms)["highest"]["deviation"] > 0.9
    ms.set_current_mesh(0)
    ms.compute_matrix_from_translation(traslmethod="XYZ translation", axisx=1.0, freeze=False)
    ms.set_current_mesh(1)
    assert compute_deviation_by_bezier_patch_per_vertex(ms)["highest"]["deviation"] < 0.03
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(MODEL.vertices))
    ms.add_mesh(pymeshlab.Mesh(SCAN.vertices, SCAN.faces))
    with pytest.raises(BezierFilterError, match="no faces"):
        compute_deviation_by_bezier_patch_per_vertex(ms)
    assert ms.current_mesh_id() == 1


def test_the_command_writes_mesh_picture_and_report(tmp_path):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    for name, body in (("scan.ply", SCAN), ("model.ply", MODEL)):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(body.vertices, body.faces))
        save_mesh(ms, tmp_path / name)
    scan, model, out, picture = (tmp_path / name for name in ("scan.ply", "model.ply", "out.ply", "out.png"))
    options = ["--tolerance", "0.03", "-o", out, "--picture", picture, "--view", "front"]
    done = run("compare", scan, model, *options, "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert abs(report["mean"] - 0.02) < 1e-3
    ms = load_mesh(out)
    np.testing.assert_allclose(ms.current_mesh().vertex_custom_scalar_attribute_array("bz_deviation"), 0.02, atol=1e-3)
    assert picture.stat().st_size > 1000
    plain = run("compare", scan, model, "--max-distance", "0.001")
    assert plain.returncode == 3
    assert "no vertex could be compared" in plain.stderr
