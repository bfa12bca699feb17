"""What render, view and qmap show: fields with names and units, common colours, histograms."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from filter_options import quick_options
from matplotlib.image import imread
from PIL import Image
from scipy.spatial import cKDTree
from typer.testing import CliRunner

import bezier_filters as bf
from bezier_filters.cli.commands import app
from bezier_filters.feature_lines.crease_lines import COLORS
from bezier_filters.fields import columns, qualities
from bezier_filters.meshlab.mesh_files import load_mesh, save_mesh
from bezier_filters.meshlab.scripts import FILTERS
from bezier_filters.pictures import demo
from bezier_filters.pictures.field_panels import (
    DIRECTIONS,
    LINE_SPACING,
    add_directions,
    are_significant,
    check_field,
    crease_panel,
    field_limits,
    field_panels,
    read_mesh_file,
)
from bezier_filters.pictures.render import legend
from bezier_filters.pictures.scene import draw, view_of
from bezier_filters.pictures.views import view_axes
from bezier_filters.status import FitStatus
from bezier_filters.surfaces import block_with_sharp_edges, sphere

LOOK = {"colormap": "auto", "percentile": 2.0}
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
        for _ in range(2):
            ms.load_new_mesh(str(SAMPLES / "torus.ply"))
        options = {"replace": {"condselect": "fi == 0"}, "deviation": {"refmesh": 0}}
        for function in FILTERS:
            if "texmap" in function.__name__:  # it writes no columns, and the mesh has no texture coordinates
                continue
            given = next((given for name, given in options.items() if name in function.__name__), {})
            function(ms, **quick_options(function), **given)
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

    def test_different_quantities_never_share_a_range(self, folder):
        files = [read_mesh_file(folder / name) for name in ("curved.ply", "twisted.ply", "large.ply")]
        curved, twisted, large = field_panels(files, "quality", colormap="auto", percentile=2.0)
        assert (curved.label, twisted.label) == ("mean curvature", "principal geodesic torsion")
        assert curved.limits == large.limits == field_limits(files[::2], "quality", percentile=2.0, limits=None)
        assert twisted.limits == field_limits(files[1:2], "quality", percentile=2.0, limits=None)
        assert twisted.limits[0] == 0.0 > curved.limits[0]

    def test_codes_are_categories_with_names_and_numbers(self, folder):
        file = read_mesh_file(folder / "curved.ply")
        codes = np.full(len(file.vertices), FitStatus.OK.grade, float)
        codes[:5], codes[5], codes[6] = FitStatus.FOLDED.grade, FitStatus.ISOLATED.grade, 0.0
        (panel,) = field_panels([replace(file, columns={"bz_fit_grade": codes})], "bz_fit_grade", **LOOK)
        assert [name for name, _ in panel.names] == [
            "not selected, or added by another program: 1",
            "no face with an area, here or at a neighbour, or points on a line: 1",
            "quadratic fit of a folded neighbourhood: 5",
            f"fitted as asked: {len(codes) - 7:,}",
        ]
        for k, (_, color) in zip((6, 5, 0, 7), panel.names, strict=True):
            np.testing.assert_array_equal(panel.colors[k], color)
        assert len({color for _, color in panel.names}) == 4
        kinds = np.resize([-2.0, -1, 0, 1, 2], len(codes))
        (panel,) = field_panels([replace(file, columns={"bz_crease": kinds})], "bz_crease", **LOOK)
        assert [name.split(":")[0] for name, _ in panel.names] == [
            "sharp ravine",
            "ravine",
            "none found",
            "ridge",
            "sharp ridge",
        ]

    def test_titles_name_the_fields_of_one_file_and_several_files(self, folder):
        files = [read_mesh_file(folder / name) for name in ("curved.ply", "large.ply")]
        assert field_panels(files[:1], "bz_k_min", **LOOK)[0].title == "smallest principal curvature"
        assert field_panels(files[:1], "shape", **LOOK)[0].title == "shape"
        assert [panel.title for panel in field_panels(files, "bz_k_min", **LOOK)] == ["curved.ply", "large.ply"]

    def test_a_symmetric_logarithmic_scale_has_room_for_all_values_and_shows_small_ones(self, folder):
        files = [read_mesh_file(folder / "curved.ply")]
        values = files[0].columns["bz_gaussian_curvature"]
        (panel,) = field_panels(files, "bz_gaussian_curvature", **LOOK, scale="symlog")
        assert panel.limits[0] <= values.min() < values.max() <= panel.limits[1]
        places, median = panel.norm()(values), np.median(np.abs(values))
        assert panel.norm()(0.0) == pytest.approx(0.5)
        assert (np.diff(places[np.argsort(values)]) >= 0).all()
        small, large = panel.norm()(np.array([0.5, 1.0]) * median) - 0.5
        assert small == pytest.approx(0.5 * large)  # linear there
        (linear,) = field_panels(files, "bz_gaussian_curvature", colormap="auto", percentile=0.0)
        assert large > 2 * (linear.norm()(median) - 0.5)
        bf.render_panels(folder / "symlog.png", [panel, linear], size=(100, 100))
        image = imread(folder / "symlog.png")[..., :3]
        left, right = (np.ptp(half, axis=2).mean() for half in np.array_split(image, 2, axis=1))
        assert left > 1.3 * right  # less of it is grey

    def test_holes_of_shapes_show_the_backs_of_faces(self):
        (panel,) = field_panels([read_mesh_file(SAMPLES / "waves.ply")], "shape", colormap="auto", percentile=2.0)
        assert panel.back is not None
        assert np.abs(np.array(panel.back) - panel.colors[0]).max() > 0.2

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
    row = image[first + 3 * added // 4]  # below the number that stands on the histogram
    left, right = columns[0] + 2, columns[-1] - 2  # within the outlines
    assert row[left, 2] > 0.7 > 0.4 > row[left, 0]
    assert row[right, 0] > 0.7 > 0.2 > row[right, 2]
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

    @pytest.mark.parametrize("suffix", [".jpg", ".pdf", ".svg"])
    def test_pictures_of_other_formats_and_resolutions(self, folder, suffix):
        result = run(folder, "render", "curved.ply", f"a{suffix}", "--size", 100, "--dpi", 300)
        assert result.exit_code == 0, result.output
        start = {".jpg": b"\xff\xd8\xff", ".pdf": b"%PDF", ".svg": b"<?xml"}[suffix]
        data = (folder / f"a{suffix}").read_bytes()
        assert data.startswith(start)
        if suffix == ".jpg":
            with Image.open(folder / "a.jpg") as image:
                assert image.info["dpi"] == pytest.approx((300, 300), abs=1)

    def test_a_scale_is_linear_or_symlog(self, folder):
        assert (
            run(folder, "render", "curved.ply", "s.png", "--scale", "symlog", "--histogram", "--size", 100).exit_code
            == 0
        )
        assert run(folder, "render", "curved.ply", "t.png", "--scale", "log").exit_code == 2

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


def test_creases_are_lines_in_their_colours():
    vertices, faces = block_with_sharp_edges(resolution=6)
    creases = bf.find_creases(vertices, faces)
    panel = crease_panel(vertices, faces, creases, radius=0.01)
    assert [color for _, color in panel.lines] == [COLORS[line.kind] for line in creases.lines]
    assert list(panel.names) == [("ridges", COLORS["ridge"]), ("ravines", COLORS["ravine"])]
    views = [view_of(panel, view_axes("iso", "y"))]
    with_lines, without = (
        draw(shown, views, scale=200.0, background="white")[0] / 255.0 for shown in (panel, replace(panel, lines=()))
    )
    red = (with_lines[..., 0] > 0.5) & (with_lines[..., 1] < 0.3)
    assert 0.01 < red.mean() < 0.2
    assert np.ptp(without, axis=2).max() < 0.02


def test_the_demonstration_shows_normals_as_colours_and_fields_with_the_range_of_their_files(tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr(demo, "render_panels", lambda path, panels, **_: shown.extend(panels))
    steps = list(demo.run_demo(tmp_path, SAMPLES / "ellipsoid.ply"))
    normals, *others = shown
    ms = load_mesh(steps[0][1])
    np.testing.assert_allclose(2.0 * normals.colors - 1.0, ms.current_mesh().vertex_normal_matrix(), atol=1e-6)
    assert [panel.title for panel in others] == ["mean curvature", "Gaussian curvature", "principal geodesic torsion"]
    for panel, (_, _, report) in zip(others, steps[1:], strict=True):
        low, high = report["color_range"]
        assert panel.limits[0] <= low < high <= panel.limits[1]
        assert panel.limits[1] - panel.limits[0] < 1.6 * (high - low)


class TestDirections:
    def test_lines_run_around_the_tube_of_a_torus_and_along_it(self, tmp_path):
        assert run(tmp_path, "curvature", SAMPLES / "torus.ply", "c.ply").exit_code == 0
        file = read_mesh_file(tmp_path / "c.ply")
        (panel,) = field_panels([file], "shape", "auto", 2.0)
        lines = add_directions(panel, file).lines
        diagonal = np.linalg.norm(np.ptp(file.vertices, axis=0))
        for (_, color), along_tube in zip(DIRECTIONS, (False, True), strict=True):
            ends = np.array([line for line, other in lines if other == color])
            middle, direction = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
            direction /= np.linalg.norm(direction, axis=1)[:, None]
            circle = np.cross([0.0, 0, 1], middle)
            circle /= np.linalg.norm(circle, axis=1)[:, None]
            sides = np.abs(np.einsum("ij,ij->i", direction, circle))
            assert np.median(np.abs(sides - along_tube)) < 0.1
            distance, _ = cKDTree(middle).query(middle, k=2)
            assert distance[:, 1].min() > 0.99 * LINE_SPACING * diagonal
            assert cKDTree(middle).query(file.vertices)[0].max() < 1.5 * LINE_SPACING * diagonal

    def test_noise_on_a_sphere_makes_none(self):
        ball = sphere(resolution=24)
        noisy = ball.vertices + 0.01 * np.random.default_rng(1).normal(size=(len(ball.vertices), 1)) * ball.normals
        g = bf.estimate_vertex_geometry(noisy, ball.faces)
        assert are_significant(columns("curvature", g)).mean() < 0.05

    def test_the_command_draws_them_and_says_what_it_needs(self, tmp_path):
        run(tmp_path, "curvature", SAMPLES / "torus.ply", "c.ply")
        options = ("--field", "shape", "--size", "200")
        assert run(tmp_path, "render", "c.ply", "c.png", "--directions", *options).exit_code == 0
        assert run(tmp_path, "render", "c.ply", "plain.png", *options).exit_code == 0
        image, plain = (imread(tmp_path / name) for name in ("c.png", "plain.png"))
        assert (np.ptp(image, axis=2) > 0.3).sum() > 100
        assert np.ptp(plain[..., :3], axis=2).max() < 0.02
        refused = run(tmp_path, "render", SAMPLES / "torus.ply", "d.png", "--directions")
        assert "has no column bz_direction_max_x" in str(refused.exception)
