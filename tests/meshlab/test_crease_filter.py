"""Creases in a MeshSet and on the command line: what is selected, what is added, what stays."""

import json

import numpy as np
import pymeshlab
import pytest
from meshset_state import mesh_state
from typer.testing import CliRunner

from bezier_filters import estimate_vertex_geometry, find_creases
from bezier_filters.cli.commands import app
from bezier_filters.errors import CancelledError
from bezier_filters.meshlab.crease_filter import CREASE_COLUMNS, compute_selection_by_bezier_crease_per_edge
from bezier_filters.meshlab.mesh_files import load_mesh
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.surfaces import block_with_sharp_edges, ellipsoid

ALLOWED = {"vertex_selection_array", *CREASE_COLUMNS}


@pytest.fixture
def body():
    """An ellipsoid with a transform, colours and selections."""
    shape = ellipsoid(semi_axes=(1.0, 0.8, 0.5), resolution=12, jitter=0.2)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(shape.vertices, shape.faces), "body")
    ms.set_matrix(transformmatrix=np.diag([2.0, 2.0, 2.0, 1.0]), freeze=False)
    ms.compute_color_by_function_per_vertex(x="vi * 0.05", y="7", z="9")
    ms.compute_scalar_by_function_per_vertex(q="x")
    ms.compute_selection_by_condition_per_vertex(condselect="vi < 5")
    ms.compute_selection_by_condition_per_face(condselect="fi < 7")
    return ms


def test_vertices_near_the_lines_are_selected_and_the_lines_are_a_layer(body):
    mesh = body.current_mesh()
    expected = find_creases(mesh.vertex_matrix(), mesh.face_matrix())
    report = compute_selection_by_bezier_crease_per_edge(body)
    json.dumps(report)
    (ridge,) = expected.lines
    selected = body.current_mesh().vertex_selection_array()
    assert set(np.flatnonzero(selected)) == set(ridge.nearest_vertices)
    assert report["selected_vertices"] == selected.sum()
    assert report["lines"][0] | {"points": len(ridge.points)} == report["lines"][0]
    layer = body.mesh(report["polylines_id"])
    assert layer.label() == "creases"
    assert layer.edge_number() == len(ridge.points) - 1
    np.testing.assert_array_equal(layer.vertex_matrix()[layer.edge_matrix()[:, 0]], ridge.points[:-1])
    np.testing.assert_array_equal(layer.vertex_scalar_array(), ridge.strength)
    np.testing.assert_array_equal(layer.transform_matrix(), np.diag([2.0, 2.0, 2.0, 1.0]))
    assert layer.vertex_color_matrix()[:, 0].min() > 0.7


def test_nothing_else_changes(body):
    before = mesh_state(body)
    compute_selection_by_bezier_crease_per_edge(body)
    report = compute_selection_by_bezier_crease_per_edge(body, polylines=False)
    after = mesh_state(body)
    assert report["polylines_id"] is None
    own = {key for key in after if not key.startswith("1: ")}  # layer 1 holds the lines
    changed = {key for key in own if before.get(key) != after[key]}
    assert {key.split(": ")[-1].split(" ")[-1] for key in changed} == ALLOWED
    assert before.keys() <= after.keys()


def test_codes_tell_ridges_from_ravines_and_sharp_from_smooth():
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(*block_with_sharp_edges(resolution=6)))
    compute_selection_by_bezier_crease_per_edge(ms)
    codes = ms.current_mesh().vertex_custom_scalar_attribute_array("bz_crease")
    assert set(codes.tolist()) == {-2.0, 0.0, 2.0}
    vertices = ms.current_mesh().vertex_matrix()
    on_faces = (np.abs(vertices) == 0.5).sum(axis=1)
    assert (codes[on_faces >= 2] == 2.0).mean() > 0.8  # ridges but where a ravine ends
    strengths = ms.current_mesh().vertex_custom_scalar_attribute_array("bz_crease_strength")
    np.testing.assert_array_equal(strengths > 0, codes != 0)


def test_a_mesh_without_creases_gets_no_layer_and_no_selection():
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=4)
    report = compute_selection_by_bezier_crease_per_edge(ms)
    assert report["lines"] == []
    assert report["polylines_id"] is None
    assert report["selected_vertices"] == 0
    assert len(list(ms)) == 1


@pytest.mark.parametrize("options", [{"angle": 0}, {"minstrength": -1}, {"rings": 0}, {"alpha": 2.0}])
def test_refused_parameters_change_nothing(body, options):
    before = mesh_state(body)
    with pytest.raises(BezierFilterError, match=next(iter(options)).replace("minstrength", "min_strength")):
        compute_selection_by_bezier_crease_per_edge(body, **options)
    assert mesh_state(body) == before


def test_point_clouds_and_cancelling(body):
    before = mesh_state(body)
    with pytest.raises(CancelledError):
        compute_selection_by_bezier_crease_per_edge(body, progress=lambda done, total: False)
    assert mesh_state(body) == before
    cloud = pymeshlab.MeshSet()
    cloud.add_mesh(pymeshlab.Mesh(body.current_mesh().vertex_matrix()))
    with pytest.raises(BezierFilterError, match="need a mesh"):
        compute_selection_by_bezier_crease_per_edge(cloud)


class TestCommand:
    def run(self, *arguments):
        return CliRunner().invoke(app, ["creases", *map(str, arguments)])

    @pytest.fixture
    def source(self, tmp_path):
        shape = ellipsoid(semi_axes=(1.0, 0.8, 0.5), resolution=10, jitter=0.2)
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(shape.vertices, shape.faces))
        ms.save_current_mesh(str(tmp_path / "body.ply"))
        return tmp_path / "body.ply"

    @pytest.mark.parametrize("suffix", [".ply", ".obj"])
    def test_lines_open_in_meshlab(self, source, suffix):
        target = source.with_name(f"lines{suffix}")
        result = self.run(source, target, "--json")
        assert result.exit_code == 0, result.output
        report = json.loads(result.stdout)
        (line,) = report["lines"]
        ms = load_mesh(target)
        mesh = ms.current_mesh()
        assert mesh.edge_number() == line["points"] - 1
        a, b = mesh.vertex_matrix()[mesh.edge_matrix()].swapaxes(0, 1)
        assert np.linalg.norm(b - a, axis=1).sum() == pytest.approx(line["length"])
        if suffix == ".ply":
            np.testing.assert_array_equal(mesh.vertex_scalar_array(), line["strength"])

    @pytest.mark.usefixtures("quick_pictures")
    def test_text_and_picture(self, source):
        result = self.run(source, source.with_name("l.ply"), "--picture", source.with_name("p.png"), "--view", "iso")
        assert result.exit_code == 0, result.output
        assert "ridges" in result.stdout
        assert source.with_name("p.png").stat().st_size > 10_000

    def test_other_formats_are_refused(self, source):
        result = self.run(source, source.with_name("lines.stl"))
        assert "lines can be saved as .ply, .obj, .vtp files only" in str(result.exception)
        assert not source.with_name("lines.stl").exists()


def test_a_known_scale_may_be_asked_for():
    """With a radius the finest creases go: the geometry is that of larger neighbourhoods."""
    shape = ellipsoid(semi_axes=(1.0, 0.8, 0.5), resolution=16)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(shape.vertices, shape.faces))
    report = compute_selection_by_bezier_crease_per_edge(ms, radius=pymeshlab.PercentageValue(20), polylines=False)
    radius = 0.2 * np.linalg.norm(np.ptp(shape.vertices, axis=0))
    geometry = estimate_vertex_geometry(shape.vertices, shape.faces, radius=radius)
    expected = find_creases(shape.vertices, shape.faces, geometry).lines
    assert [line["strength"] for line in report["lines"]] == [line.strength for line in expected]
