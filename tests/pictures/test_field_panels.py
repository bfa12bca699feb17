"""What render, view and qmap show: fields with names and units, common colours, histograms."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from matplotlib.image import imread
from scipy.spatial import cKDTree
from typer.testing import CliRunner

import bezier_filters as bf
from bezier_filters.cli.commands import app
from bezier_filters.feature_lines.crease_lines import COLORS
from bezier_filters.fields import qualities
from bezier_filters.meshlab.mesh_files import load_mesh, save_mesh
from bezier_filters.meshlab.scripts import FILTERS
from bezier_filters.pictures import demo
from bezier_filters.pictures.field_panels import check_field, crease_panel, field_limits, field_panels, read_mesh_file
from bezier_filters.pictures.render import legend
from bezier_filters.surfaces import block_with_sharp_edges

SAMPLES = Path(__file__).parents[2] / "sample_meshes"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A blob with its curvature, the same at twice the size, and with torsion."""
    folder = tmp_path_factory.mktemp("fields")
    for name, scale, function in [
        ("curved.ply", 1.0, bf.compute_curvature_by_bezier_patch_per_vertex),
        ("large.ply", 2.0, bf.compute_curvature_by_bezier_patch_per_vertex),
        ("twisted.ply", 1.0, bf.compute_torsion_by_bezier_patch_per_vertex),
    ]:
        ms = pymeshlab.MeshSet()
        ms.load_new_mesh(str(SAMPLES / "bumpy_star.ply"))
        ms.compute_matrix_from_scaling_or_normalization(axisx=scale, uniformflag=True)
        function(ms)
        save_mesh(ms, folder / name)
    return folder


def run(folder, *arguments):
    import os

    before = os.getcwd()
    os.chdir(folder)
    try:
        return CliRunner().invoke(app, list(map(str, arguments)))
    finally:
        os.chdir(before)


class TestFields:
    def test_a_quality_has_the_name_and_unit_of_the_column_that_it_equals(self, folder):
        field = read_mesh_file(folder / "curved.ply").field("quality")
        assert (field.label, field.unit, field.signed) == ("mean curvature", "1/length", True)
        field = read_mesh_file(folder / "twisted.ply").field("quality")
        assert (field.label, field.unit, field.signed) == ("principal geodesic torsion", "1/length", False)

    def test_every_column_that_a_filter_writes_has_a_unit(self, tmp_path):
        ms = pymeshlab.MeshSet()
        ms.load_new_mesh(str(SAMPLES / "torus.ply"))
        for function in FILTERS:
            function(ms)
        save_mesh(ms, tmp_path / "all.ply")
        file = read_mesh_file(tmp_path / "all.ply")
        columns = [name for name in file.columns if name.startswith("bz_")]
        assert len(columns) > 20
        assert {name: file.field(name).unit for name in columns if file.field(name).unit == "unit unknown"} == {}
        assert file.field("bz_gaussian_curvature_std").unit == "1/length²"
        assert file.field("bz_displacement").unit == "length"
        assert file.field("bz_normal_angle").unit == qualities("normals")["angle"].unit == "degrees"

    def test_several_files_have_one_range(self, folder):
        files = [read_mesh_file(folder / name) for name in ("curved.ply", "large.ply")]
        both = field_limits(files, "bz_mean_curvature", percentile=2.0, limits=None)
        alone = field_limits(files[1:], "bz_mean_curvature", percentile=2.0, limits=None)
        assert both[1] > 1.2 * alone[1]
        panels = field_panels(files, "bz_mean_curvature", colormap="auto", percentile=2.0)
        assert [panel.limits for panel in panels] == [both, both]

    def test_files_without_the_field_are_grey(self, folder):
        files = [read_mesh_file(SAMPLES / "bumpy_star.ply"), read_mesh_file(folder / "curved.ply")]
        before, after = field_panels(files, "quality", colormap="auto", percentile=2.0, histogram=True)
        assert len(np.unique(before.colors)) == 1
        assert after.histogram

    def test_an_unknown_field_lists_the_others(self, folder):
        with pytest.raises(bf.InvalidParameterError, match=r"has no 'bz_h'; it has .*bz_k_min.*shape"):
            check_field([read_mesh_file(folder / "curved.ply")], "bz_h")


def test_a_histogram_stands_on_its_bar(tmp_path):
    """Half of the values at each end, none in between: blue and red columns, and nothing between them."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    look = {"limits": (0.0, 1.0), "colormap": "Cool Warm"}
    images = []
    for histogram in (False, True):
        panel = bf.Panel(vertices, faces, np.array([0.0, 0.0, 1.0, 1.0]), histogram=histogram, **look)
        bf.render_panels(tmp_path / "a.png", [panel], size=(300, 300))
        images.append(imread(tmp_path / "a.png")[..., :3])
    without, image = images
    added = len(image) - len(without)
    assert added > 20
    first = int(np.argmax((without != image[: len(without)]).any(axis=(1, 2))))
    columns = np.flatnonzero((np.ptp(image[first : first + added // 2], axis=2) > 0.3).any(axis=0))
    row = image[first + added // 2]
    assert row[columns[0], 2] > 0.7 > 0.4 > row[columns[0], 0]
    assert row[columns[-1], 0] > 0.7 > 0.2 > row[columns[-1], 2]
    gap = np.diff(columns).max()
    assert gap > 0.9 * (columns[-1] - columns[0])


class TestCommands:
    def test_a_quality_of_zeros_is_not_shown_unless_it_is_asked_for(self, folder):
        ms = load_mesh(folder / "curved.ply")
        ms.compute_scalar_by_function_per_vertex(q="0")
        save_mesh(ms, folder / "zeros.ply")
        for arguments, expected in [([], "shape"), (["--field", "quality"], "quality")]:
            result = run(folder, "render", "zeros.ply", "z.png", *arguments, "--size", 60, "--json")
            assert json.loads(result.stdout)["panels"][0]["field"] == expected
        result = run(folder, "render", "zeros.ply", "curved.ply", "z.png", "--size", 60, "--json")
        assert json.loads(result.stdout)["panels"][0]["field"] == "quality"

    def test_a_mesh_is_not_overwritten_by_a_picture(self, folder):
        before = (folder / "large.ply").read_bytes()
        result = run(folder, "render", "curved.ply", "large.ply")
        assert isinstance(result.exception, bf.InvalidParameterError)
        assert (folder / "large.ply").read_bytes() == before

    def test_before_and_after_with_several_fields(self, folder):
        arguments = ["curved.ply", "large.ply", "both.png", "--field", "quality", "--field", "shape", "--view", "iso"]
        result = run(folder, "render", *arguments, "--size", 150, "--histogram", "--json")
        assert result.exit_code == 0, result.output
        report = json.loads(result.stdout)
        assert report["inputs"] == ["curved.ply", "large.ply"]
        assert [panel["unit"] for panel in report["panels"]] == ["1/length", ""]
        height, width = imread(folder / "both.png").shape[:2]
        assert height > 300
        assert width > 300

    def test_a_given_range(self, folder):
        result = run(folder, "render", "curved.ply", "a.png", "--range", "-1", "2", "--size", 100, "--json")
        assert json.loads(result.stdout)["panels"][0]["limits"] == [-1.0, 2.0]

    def test_a_quality_map_has_the_range_of_the_field(self, folder):
        result = run(folder, "qmap", "curved.ply", "curved.qmap", "--json")
        report = json.loads(result.stdout)
        assert (report["unit"], report["colormap"]) == ("1/length", "Cool Warm")
        low, middle, high, brightness = (folder / "curved.qmap").read_text().splitlines()[-1].rstrip(";").split(";")
        assert [float(low), float(high)] == report["limits"]
        assert (middle, brightness) == ("0.5", "1")
        assert "Viridis, 0 to" in run(folder, "qmap", "twisted.ply", "t.qmap", "--colormap", "auto").stdout

    def test_fields_without_values_have_no_quality_map(self, folder):
        assert run(folder, "qmap", "curved.ply", "c.qmap", "--field", "shape").exit_code == 2


def test_a_legend_has_a_unit():
    panel = bf.Panel(np.eye(3), np.array([[0, 1, 2]]), np.zeros(3), label="mean curvature", unit="1/length")
    assert legend(panel) == "mean curvature [1/length]"
    assert legend(panel, -7) == "mean curvature [10⁻⁷ 1/length]"


def test_creases_are_tubes_in_their_colours():
    vertices, faces = block_with_sharp_edges(resolution=6)
    creases = bf.find_creases(vertices, faces)
    panel = crease_panel(vertices, faces, creases, radius=0.01)
    assert len(panel.vertices) > len(vertices)
    np.testing.assert_array_equal(panel.vertices[: len(vertices)], vertices)
    points = np.vstack([line.points for line in creases.lines])
    distance = cKDTree(panel.vertices[len(vertices) :]).query(points)[0]
    assert distance.max() < 0.0101
    assert {tuple(color) for color in panel.colors[len(vertices) :]} == {COLORS[line.kind] for line in creases.lines}
    alone = crease_panel(vertices, faces, replace(creases, lines=creases.lines[:0]))
    assert len(alone.vertices) == len(vertices)


def test_the_demonstration_shows_normals_as_colours_and_fields_with_the_range_of_their_files(tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr(demo, "render_panels", lambda path, panels, **_: shown.extend(panels))
    steps = list(demo.run_demo(tmp_path, SAMPLES / "ellipsoid.ply"))
    normals, *others = shown
    ms = load_mesh(steps[0].path)
    np.testing.assert_allclose(2.0 * normals.colors - 1.0, ms.current_mesh().vertex_normal_matrix(), atol=1e-6)
    assert [panel.title for panel in others] == ["mean curvature", "Gaussian curvature", "principal geodesic torsion"]
    for panel, step in zip(others, steps[1:], strict=True):
        low, high = step.report["color_range"]
        assert panel.limits[0] <= low < high <= panel.limits[1]
        assert panel.limits[1] - panel.limits[0] < 1.6 * (high - low)
