"""Lines on surfaces in a MeshSet and on the command line: the layer, its attributes, files, and what stays."""

import json

import numpy as np
import pymeshlab
import pytest
from meshset_state import mesh_state
from typer.testing import CliRunner

from bezier_filters import fit_surface, trace_lines
from bezier_filters.cli.commands import app
from bezier_filters.errors import CancelledError
from bezier_filters.meshlab.line_filter import generate_polyline_by_bezier_patch_direction
from bezier_filters.meshlab.mesh_files import load_mesh, save_mesh
from bezier_filters.meshlab.meshset import BezierFilterError, PercentageValue
from bezier_filters.surfaces import ellipsoid

SHAPE = ellipsoid(semi_axes=(1.0, 0.8, 0.5), resolution=10, jitter=0.2)
COLUMNS = ("bz_curvature_along", "bz_torsion_along", "bz_direction_std", "bz_umbilic_index")


@pytest.fixture
def body():
    """An ellipsoid with a transform, colours and selections."""
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(SHAPE.vertices, SHAPE.faces), "body")
    ms.set_matrix(transformmatrix=np.diag([2.0, 2.0, 2.0, 1.0]), freeze=False)
    ms.compute_color_by_function_per_vertex(x="vi * 0.05", y="7", z="9")
    ms.compute_selection_by_condition_per_face(condselect="fi < 7")
    return ms


def test_the_lines_are_a_layer_and_nothing_else_changes(body):
    before = mesh_state(body)
    diagonal = np.linalg.norm(np.ptp(SHAPE.vertices, axis=0))
    report = generate_polyline_by_bezier_patch_direction(body, spacing=PercentageValue(10))
    json.dumps(report)
    expected = trace_lines(fit_surface(SHAPE.vertices, SHAPE.faces), spacing=0.1 * diagonal)
    layer = body.mesh(report["polylines_id"])
    points = np.vstack([line.points for line in expected.lines])
    assert layer.label() == "lines"
    assert layer.vertex_number() == len(points) + 4 * 13
    assert layer.edge_number() == len(points) - report["lines"] + 4 * 12
    np.testing.assert_array_equal(layer.vertex_matrix()[:-52], points)
    along, twist, std, index = (layer.vertex_custom_scalar_attribute_array(name) for name in COLUMNS)
    np.testing.assert_array_equal(along[:-52], np.concatenate([line.normal_curvature for line in expected.lines]))
    np.testing.assert_array_equal(layer.vertex_scalar_array(), along)
    assert np.abs(twist).max() < 1e-6
    assert (std[:-52] > 0.0).all()
    assert index.tolist() == [0.0] * len(points) + [0.5] * 52
    np.testing.assert_array_equal(layer.transform_matrix(), np.diag([2.0, 2.0, 2.0, 1.0]))
    after = mesh_state(body)
    assert {key: value for key, value in after.items() if key in before} == before
    assert all(key.startswith("1: ") for key in after.keys() - before.keys())
    assert body.current_mesh().label() == "body"


def test_lines_of_a_family_run_through_seeds(body):
    report = generate_polyline_by_bezier_patch_direction(body, family="torsion", seeds="0 0.8 0, 0 -0.8 0")
    assert report["lines"] == 4
    assert report["kinds"].keys() == {"plus", "minus"}
    layer = body.mesh(report["polylines_id"])
    distance = np.linalg.norm(layer.vertex_matrix() - [0.0, 0.8, 0.0], axis=1).min()
    assert distance < 1e-3
    twist = layer.vertex_custom_scalar_attribute_array("bz_torsion_along")
    np.testing.assert_array_equal(layer.vertex_scalar_array(), twist)
    assert {*np.sign(twist)} == {-1.0, 0.0, 1.0}  # umbilics have none


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".vtp"])
def test_saved_layers_keep_their_edges(body, tmp_path, suffix):
    """Files of `save_current_mesh` of pymeshlab lose them in PLY files."""
    report = generate_polyline_by_bezier_patch_direction(body, spacing=PercentageValue(10))
    body.set_current_mesh(report["polylines_id"])
    layer, target = body.current_mesh(), tmp_path / f"lines{suffix}"
    assert save_mesh(body, target) == ()
    if suffix == ".vtp":
        found = pytest.importorskip("pyvista").read(target)
        assert found.n_lines == layer.edge_number()
        np.testing.assert_array_equal(found["bz_umbilic_index"], layer.vertex_custom_scalar_attribute_array(COLUMNS[3]))
        return
    saved = load_mesh(target)
    found = saved.current_mesh()
    np.testing.assert_array_equal(found.edge_matrix(), layer.edge_matrix())
    np.testing.assert_array_equal(found.vertex_matrix(), layer.vertex_matrix())


def test_formats_without_edges_are_named(body, tmp_path):
    report = generate_polyline_by_bezier_patch_direction(body, spacing=PercentageValue(10))
    body.set_current_mesh(report["polylines_id"])
    (remark,) = save_mesh(body, tmp_path / "lines.off")
    assert remark.startswith(f"written without its {body.current_mesh().edge_number():,} edges")


def test_a_sphere_has_no_asymptotic_lines():
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=4)
    report = generate_polyline_by_bezier_patch_direction(ms, family="asymptotic")
    assert report["lines"] == 0
    assert report["warnings"] == [
        "there are no lines: no direction is known, none has that curvature, or all are short for the spacing"
    ]


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"family": "geodesic"}, "family"),
        ({"family": "normal"}, "normal_curvature"),
        ({"spacing": -1.0}, "spacing"),
        ({"seeds": "0 0"}, "seeds"),
        ({"maxerror": 90.0}, "max_error"),
        ({"noise": -1.0}, "noise"),
    ],
)
def test_refused_parameters_change_nothing(body, options, name):
    before = mesh_state(body)
    with pytest.raises(BezierFilterError, match=name):
        generate_polyline_by_bezier_patch_direction(body, **options)
    assert mesh_state(body) == before


def test_point_clouds_and_cancelling(body):
    before = mesh_state(body)
    with pytest.raises(CancelledError):
        generate_polyline_by_bezier_patch_direction(body, progress=lambda done, total: False)
    assert mesh_state(body) == before
    cloud = pymeshlab.MeshSet()
    cloud.add_mesh(pymeshlab.Mesh(SHAPE.vertices))
    with pytest.raises(BezierFilterError, match="need a mesh"):
        generate_polyline_by_bezier_patch_direction(cloud)


class TestCommand:
    def run(self, *arguments):
        return CliRunner().invoke(app, ["lines", *map(str, arguments)])

    @pytest.fixture
    def source(self, tmp_path):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(SHAPE.vertices, SHAPE.faces))
        ms.save_current_mesh(str(tmp_path / "body.ply"))
        return tmp_path / "body.ply"

    @pytest.mark.parametrize("suffix", [".ply", ".obj"])
    def test_lines_open_in_meshlab(self, source, suffix):
        target = source.with_name(f"lines{suffix}")
        result = self.run(source, target, "--spacing", "10%", "--json")
        assert result.exit_code == 0, result.output
        report = json.loads(result.stdout)
        ms = load_mesh(target)
        mesh = ms.current_mesh()
        a, b = mesh.vertex_matrix()[mesh.edge_matrix()].swapaxes(0, 1)
        rings = 4 * 12 * 2.0 * np.sin(np.pi / 12.0) * 0.25 * report["spacing"]
        assert np.linalg.norm(b - a, axis=1).sum() == pytest.approx(report["length"] + rings)
        if suffix == ".ply":
            assert (mesh.vertex_custom_scalar_attribute_array("bz_umbilic_index") == 0.5).sum() == 52

    def test_vtp_files_have_lines_and_columns(self, source):
        pyvista = pytest.importorskip("pyvista")
        target = source.with_name("lines.vtp")
        result = self.run(source, target, "--family", "asymptotic", "--spacing", "10%")
        assert result.exit_code == 3, result.output  # an ellipsoid has no asymptotic lines
        result = self.run(source, target, "--family", "normal", "--normal-curvature", 2, "--overwrite")
        assert result.exit_code == 0, result.output
        found = pyvista.read(target)
        assert set(COLUMNS) <= set(found.point_data.keys())
        of_lines = found["bz_umbilic_index"] == 0.0
        np.testing.assert_allclose(found["bz_curvature_along"][of_lines], 2.0, atol=1e-9)

    @pytest.mark.usefixtures("quick_pictures")
    def test_text_and_picture(self, source):
        result = self.run(source, source.with_name("l.ply"), "--picture", source.with_name("p.png"), "--view", "iso")
        assert result.exit_code == 0, result.output
        assert "4 umbilics, sum of indices 2" in result.stdout
        assert source.with_name("p.png").stat().st_size > 10_000

    def test_other_formats_are_refused(self, source):
        result = self.run(source, source.with_name("lines.stl"))
        assert "lines can be saved as .ply, .obj, .vtp files only" in str(result.exception)
