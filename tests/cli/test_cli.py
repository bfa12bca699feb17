"""The command line: most of it in this process, and the real one in a process of its own."""

import json
import os
import re
import subprocess
import sys
from io import BytesIO, TextIOWrapper
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from command_line import run

from bezier_filters import estimate_vertex_geometry, mesh_arrays, read_fields
from bezier_filters._version import __version__
from bezier_filters.surfaces import sphere

SINGLE = 2.0**-24  # relative rounding of the estimates in files that commands write
SAMPLES = Path(__file__).parents[2] / "sample_meshes"
COMMANDS = [
    "normals",
    "curvature",
    "torsion",
    "smooth",
    "fill-holes",
    "replace",
    "bridge",
    "subdivide",
    "remesh",
    "creases",
    "lines",
    "batch",
    "run",
    "render",
    "view",
    "qmap",
    "info",
    "report",
    "demo",
    "scale",
    "watch",
]


def run_process(*arguments, command=(sys.executable, "-m", "bezier_filters"), **options):
    """The real command line, which starts another interpreter."""
    return subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True, **options)


def load(path):
    meshset = pymeshlab.MeshSet()
    meshset.load_new_mesh(str(path))
    return meshset


@pytest.mark.parametrize("command", ["normals", "curvature", "torsion"])
def test_filters_write_quality_colour_and_fields(command, tmp_path):
    target = tmp_path / "result.ply"
    result = run(command, SAMPLES / "torus.ply", target)
    assert result.returncode == 0, result.stderr
    assert "fitted as asked (OK)" in result.stdout
    assert f"wrote {target}" in result.stdout
    meshset = load(target)
    mesh = meshset.current_mesh()
    assert mesh.has_vertex_color()
    assert len(np.unique(mesh.vertex_color_array())) > 50
    assert np.ptp(mesh.vertex_scalar_array()) > 0
    fields = read_fields(target)
    np.testing.assert_array_equal(fields["quality"], mesh.vertex_scalar_array())
    assert "bz_fit_grade" in fields


def test_a_file_keeps_the_fields_of_an_earlier_command(tmp_path):
    first, second = tmp_path / "curved.ply", tmp_path / "both.ply"
    run("curvature", SAMPLES / "torus.ply", first, "--rings", 2)
    run("torsion", first, second, "--rings", 2)
    before, after = read_fields(first), read_fields(second)
    np.testing.assert_array_equal(before["bz_gaussian_curvature"], after["bz_gaussian_curvature"])
    np.testing.assert_array_equal(after["bz_geodesic_torsion"], after["quality"])
    run("smooth", second, first, "--overwrite")
    assert set(read_fields(first)) == {*after, "bz_displacement", "bz_sharpness"}


def test_the_quality_is_the_field_asked_for(tmp_path):
    target = tmp_path / "result.ply"
    run("curvature", SAMPLES / "ellipsoid.ply", target, "--quality", "gaussian", "--rings", 3, "--degree", 4)
    fields = read_fields(target)
    np.testing.assert_array_equal(fields["quality"], fields["bz_gaussian_curvature"])
    from plyfile import PlyData

    truth = PlyData.read(SAMPLES / "ellipsoid.ply")["vertex"]["true_gaussian_curvature"]
    assert np.abs(fields["quality"] - truth).max() < 0.1 * np.abs(truth).max()


def test_curvature_along_gravity(tmp_path):
    target, script = tmp_path / "result.ply", tmp_path / "steps.mlx"
    gravity = "--direction", 0, 0, -1, "--quality", "along"
    result = run(
        "curvature", SAMPLES / "waves.ply", target, *gravity, "--rings", 2, "--alpha", 1, "--save-script", script
    )
    assert "normal curvature along the direction" in result.stdout
    fields = read_fields(target)
    geometry = estimate_vertex_geometry(*mesh_arrays(SAMPLES / "waves.ply"), rings=2, alpha=1.0)
    np.testing.assert_allclose(fields["quality"], geometry.terrain_curvature().profile, rtol=SINGLE)
    again = tmp_path / "again.ply"
    assert run("run", script, SAMPLES / "waves.ply", again).returncode == 0
    np.testing.assert_array_equal(read_fields(again)["quality"], fields["quality"])


def test_json_is_a_report_and_nothing_else(tmp_path):
    result = run_process("curvature", SAMPLES / "waves.ply", tmp_path / "w.ply", "--json")
    report = json.loads(result.stdout)
    assert sum(report["status"].values()) == load(SAMPLES / "waves.ply").current_mesh().vertex_number()
    assert report["unit"] == "1/length"
    assert "bz_k_min" in report["attributes"]


def test_quiet_prints_nothing(tmp_path):
    result = run("torsion", SAMPLES / "waves.ply", tmp_path / "w.ply", "--quiet")
    assert (result.stdout, result.returncode) == ("", 0)


def test_smoothing(tmp_path):
    source, target = tmp_path / "noisy.ply", tmp_path / "smooth.ply"
    ms = load(SAMPLES / "torus.ply")
    ms.apply_coord_random_displacement(displacement=pymeshlab.PercentageValue(0.3))
    ms.save_current_mesh(str(source))
    result = run("smooth", source, target, "--quality", "displacement", "--color")
    assert result.returncode == 0
    assert "mean edges" in result.stdout
    assert "displacement [length]: min" in result.stdout
    displacement = read_fields(target)["bz_displacement"]
    assert displacement.max() > 0
    before, after = load(source), load(target)  # a mesh lives only as long as its MeshSet
    moves = after.current_mesh().vertex_matrix() - before.current_mesh().vertex_matrix()
    np.testing.assert_allclose(np.linalg.norm(moves, axis=1), displacement, atol=1e-6 * displacement.max())
    report = json.loads(run("smooth", source, target, "--method", "paper", "--json").stdout)
    assert 0 < abs(report["volume_ratio"] - 1.0) < 0.05


def test_filling_holes(tmp_path):
    target = tmp_path / "closed.ply"
    result = run("fill-holes", SAMPLES / "punched_patch.ply", target)
    assert result.returncode == 0
    assert "left open" in result.stdout
    assert "--outer-rims fills it, too" in result.stdout
    assert max(map(len, result.stdout.splitlines()[:-2])) <= 80  # but for the path and the sentence at the end
    command = "fill-holes", SAMPLES / "punched_patch.ply", target, "--outer-rims", "--json"
    assert json.loads(run(*command).stdout)["open_holes"] == 1  # the sheet winds through every lid
    report = json.loads(run(*command, "--intersecting").stdout)
    assert report["open_holes"] == 0
    assert load(target).get_topological_measures()["boundary_edges"] == 0
    result = run("fill-holes", SAMPLES / "sphere.ply", target)
    assert "no holes" in result.stdout


@pytest.mark.skipif(os.name != "posix", reason="pipes are for POSIX systems")
def test_meshes_come_and_go_through_pipes(tmp_path, monkeypatch):
    """Through those of a process at first, and then through what it reads as the standard input."""
    command = [sys.executable, "-m", "bezier_filters", "curvature", "-", "-", "--rings", "2"]
    done = subprocess.run(command, input=(SAMPLES / "torus.ply").read_bytes(), capture_output=True, check=True)
    run("curvature", SAMPLES / "torus.ply", tmp_path / "file.ply", "--rings", 2)
    assert done.stdout == (tmp_path / "file.ply").read_bytes()
    assert b"fitted as asked (OK)" in done.stderr
    ms = load(SAMPLES / "waves.ply")
    for suffix in (".obj", ".off", ".stl"):
        ms.save_current_mesh(str(tmp_path / f"w{suffix}"))
        monkeypatch.setattr(sys, "stdin", TextIOWrapper(BytesIO((tmp_path / f"w{suffix}").read_bytes())))
        report = json.loads(run("info", "-", "--json").stdout)
        assert report["faces"] == ms.current_mesh().face_number()
    monkeypatch.setattr(sys, "stdin", TextIOWrapper(BytesIO(b"nothing")))
    refused = run("curvature", "-", "-")
    assert (refused.returncode, refused.stdout) == (2, "")


def test_formats_without_quality_are_written_with_a_note(tmp_path):
    result = run("curvature", SAMPLES / "waves.ply", tmp_path / "w.obj")
    assert result.returncode == 0
    assert "hold no quality" in result.stderr
    assert load(tmp_path / "w.obj").current_mesh().has_vertex_color()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["curvature", "missing.ply", "out.ply"], "cannot read missing.ply: no such file"),
        (["curvature", SAMPLES / "waves.ply", "out.xyzzy"], "unknown format .xyzzy"),
        (["curvature", SAMPLES / "waves.ply", "no/such/folder/out.ply"], "there is no directory"),
        (
            ["curvature", SAMPLES / "waves.ply", "out.ply", "--quality", "gauss"],
            "quality: got 'gauss', expected 'mean'",
        ),
        (["curvature", SAMPLES / "waves.ply", "out.ply", "--alpha", "2"], "alpha: got 2.0"),
        (["curvature", SAMPLES / "waves.ply", "out.ply", "--radius", "nan"], "radius: got nan, expected a positive"),
        (
            ["curvature", SAMPLES / "waves.ply", "out.ply", "--radius", "1", "--rings", "3"],
            "radius: got 1.0 and rings=3; give one of them, not both",
        ),
        (["curvature", SAMPLES / "waves.ply", "out.ply", "--smoothness", "x"], "smoothness: got 'x'"),
        (["curvature", SAMPLES / "waves.ply", "out.ply", "--colormap", "jet"], "colormap: got 'jet'"),
        (["curvature", SAMPLES / "generate.py", "out.ply"], "cannot read"),
        (
            ["smooth", SAMPLES / "waves.ply", "out.ply", "--method", "hc"],
            "method: got 'hc', expected 'auto' or 'paper'",
        ),
        (["info", SAMPLES], "it is a directory"),
        (["render", SAMPLES / "waves.ply", "out.png", "--field", "bz_k_min"], "has no 'bz_k_min'"),
        (
            ["render", SAMPLES / "waves.ply", "out.ply"],
            "picture: got 'out.ply', expected a picture to write, whose name ends in one of .png",
        ),
        (
            ["creases", SAMPLES / "waves.ply", "out.obj", "--picture", "out.gif"],
            "picture: got 'out.gif', expected a picture to write, whose name ends in one of .png",
        ),
        (["run", "missing.mlx", SAMPLES / "waves.ply", "out.ply"], "missing.mlx: No such file or directory"),
        (["demo", "missing.ply"], "cannot read missing.ply"),
        (["view", SAMPLES / "waves.ply"], "there is no display to open a window on; `bezier-filters render` draws"),
        (["qmap", SAMPLES / "waves.ply", "out.qmap"], "has no 'quality'; it has shape; commands such as curvature"),
        (["run", SAMPLES / "waves.ply", SAMPLES / "waves.ply", "out.ply"], "waves.ply: is no filter script"),
    ],
)
def test_bad_input_ends_with_one_line_and_status_2(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in [name for name in os.environ if name.endswith("DISPLAY")]:
        monkeypatch.delenv(name)
    result = run(*arguments)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith("bezier-filters: ")
    assert message in result.stderr
    assert not list(tmp_path.glob("out.*"))


def test_the_process_ends_with_that_line_and_status(tmp_path):
    arguments = ["curvature", "missing.ply", "out.ply"]
    result, expected = run_process(*arguments, cwd=tmp_path), run(*arguments)
    assert (result.returncode, result.stdout, result.stderr) == (2, "", expected.stderr)


def test_numbers_may_be_auto_and_nothing_else(tmp_path):
    result = run("torsion", SAMPLES / "waves.ply", tmp_path / "w.ply", "--rings", "two")
    assert result.returncode == 2
    assert "got 'two', expected a number or auto" in " ".join(result.stderr.replace("│", "").split())
    result = run("torsion", SAMPLES / "waves.ply", tmp_path / "w.ply", "--rings", 3, "--alpha", "auto", "--json")
    assert json.loads(result.stdout)["fit"]["rings"] == 3


def test_robust_fits(tmp_path):
    target = tmp_path / "t.ply"
    residuals = []
    for option in ("--robust", "--no-robust"):
        assert run("torsion", SAMPLES / "waves.ply", target, "--rings", 3, option).returncode == 0
        residuals.append(read_fields(target)["bz_residual"])
    assert not np.array_equal(*residuals)


def test_a_radius_is_a_length_or_a_percentage_of_the_diagonal(tmp_path):
    diagonal = load(SAMPLES / "torus.ply").current_mesh().bounding_box().diagonal()
    target = tmp_path / "t.ply"
    absolute = json.loads(run("curvature", SAMPLES / "torus.ply", target, "--radius", 0.1 * diagonal, "--json").stdout)
    assert absolute["fit"]["radius"] == pytest.approx(0.1 * diagonal)
    expected = read_fields(target)["quality"]
    result = run("curvature", SAMPLES / "torus.ply", target, "--radius", "10%")
    assert f"fitted within a radius of {0.1 * diagonal:.4g} (length), degree" in result.stdout
    np.testing.assert_allclose(read_fields(target)["quality"], expected, atol=1e-9)


@pytest.mark.parametrize("radius", ["wide", "150%", "0%", "-1%", "nan%", "%"])
def test_a_radius_that_is_neither_is_refused(radius, tmp_path):
    result = run("torsion", SAMPLES / "waves.ply", tmp_path / "w.ply", f"--radius={radius}")
    assert result.returncode == 2
    text = " ".join(result.stderr.replace("│", "").split())
    assert f"got '{radius}', expected a length such as 0.5, or a percentage such as 2%, up to 100%" in text


def test_wrong_usage_ends_with_status_2():
    assert run("curvature").returncode == 2
    assert run_process("no-such-command").returncode == 2


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(command):
    result = run(command, "--help")
    assert result.returncode == 0
    assert "Example: bezier-filters" in result.stdout


def test_placeholders_of_lengths_are_words():
    assert "LENGTH|PERCENT%" in run("fill-holes", "--help").stdout


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_in_a_process_of_its_own(command):
    assert run_process(command, "--help").stdout == run(command, "--help").stdout


def test_the_shell_completes_commands_and_options():
    script = Path(sys.executable).parent / "bezier-filters"
    for words, position, expected in [
        ("bezier-filters fi", 1, "fill-holes"),
        ("bezier-filters render --hist", 2, "--histogram"),
        ("bezier-filters curvature --quality gauss", 3, "gaussian"),
    ]:
        asked = {"_BEZIER_FILTERS_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(position)}
        result = subprocess.run([script], env=os.environ | asked, capture_output=True, text=True)
        assert result.stdout.split() == [expected]


def test_version_by_script_and_by_module():
    script = Path(sys.executable).parent / "bezier-filters"
    assert run_process("--version", command=[str(script)]).stdout == f"bezier-filters {__version__}\n"
    assert run_process("--version").stdout == f"bezier-filters {__version__}\n"


def test_info_says_what_stands_in_the_way(tmp_path):
    assert "nothing stands in the way" in run("info", SAMPLES / "torus.ply").stdout
    airplane = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes" / "airplane.obj"
    text = run("info", airplane).stdout
    assert "1,617 unreferenced vertices" in text
    assert "meshing_remove_unreferenced_vertices" in text
    report = json.loads(run("info", SAMPLES / "punched_patch.ply", "--json").stdout)
    assert report["boundary_loops"] == 4
    assert report["fit_for_fitting"]
    points = tmp_path / "points.xyz"
    points.write_text("0 0 0 0 0 1\n1 0 0 0 0 1\n")
    assert "Not fit for fitting" in run("info", points).stdout
    points.write_text("".join(f"{x} {y} {x * y} 0 0 1\n" for x in range(9) for y in range(9)))
    text = run("info", points).stdout
    assert "Fit for fitting, but note" in text
    assert "a point cloud" in text
    assert "genus" not in text


def test_the_noise_is_told_in_words_and_may_be_given(tmp_path):
    """By every command that looks at it, of a sphere with noise of 0.1 edges that is independent."""
    ball, scan = sphere(resolution=20, jitter=0.2), tmp_path / "scan.ply"
    edge = float(np.linalg.norm(ball.vertices[ball.faces[:, 0]] - ball.vertices[ball.faces[:, 1]], axis=1).mean())
    heights = 0.1 * edge * np.random.default_rng(0).standard_normal((len(ball.vertices), 1))
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(ball.vertices + heights * ball.normals, ball.faces))
    meshes.save_current_mesh(str(scan))
    for arguments in (["info", scan], ["curvature", scan, tmp_path / "a.ply"], ["smooth", scan, tmp_path / "a.ply"]):
        text = " ".join(run(*arguments).stdout.split())
        level, words = re.search(r"noise (0\.\d+) edges, ([a-z ]+)", text).groups()
        assert float(level) == pytest.approx(0.1, rel=0.15)
        assert words.startswith("independent from vertex to vertex")
    known = json.loads(run("info", scan, "--json").stdout)["noise"]
    report = json.loads(run("curvature", scan, tmp_path / "a.ply", "--json").stdout)
    assert known.pop("reason") == report["fit"]["noise_reason"] == ""
    assert [report["fit"][f"noise_{key}"] for key in known] == pytest.approx(list(known.values()), rel=1e-9)
    given = json.loads(run("curvature", scan, tmp_path / "b.ply", "--noise", 2 * edge, "--json").stdout)["fit"]
    assert given["noise_sigma"] == pytest.approx(2 * edge)
    refused = run("curvature", scan, tmp_path / "b.ply", "--noise", -1)
    assert refused.stderr == "bezier-filters: --noise: got -1.0, expected a length of 0 or more\n"


def test_viewpoints_and_numbers_of_neighbours(tmp_path):
    """Of terrain, seen from below and then, by a script, too."""
    waves = load(SAMPLES / "waves.ply")
    land = waves.current_mesh().vertex_matrix()
    cloud, script = tmp_path / "land.ply", tmp_path / "steps.mlx"
    points = pymeshlab.MeshSet()
    points.add_mesh(pymeshlab.Mesh(land))
    points.save_current_mesh(str(cloud))
    below = ("--viewpoint", 0, 0, -9)
    result = run("normals", cloud, tmp_path / "a.ply", *below, "--neighbours", 30, "--save-script", script)
    assert "normals oriented by viewpoints; 0 contradict them" in result.stdout
    assert "on 30 nearest points" in result.stdout
    run("run", script, cloud, tmp_path / "b.ply")
    run("normals", cloud, tmp_path / "c.ply", *below, "--viewpoint-side", "away")
    loaded = [load(tmp_path / f"{name}.ply") for name in "abc"]
    a, b, c = (each.current_mesh().vertex_normal_matrix() for each in loaded)
    assert (a[:, 2] < 0).all()
    assert (c[:, 2] > 0).all()
    np.testing.assert_array_equal(a, b)
    for options, message in (
        (("--neighbours", 3), "--neighbours: got 3, where the fit needs 6 points"),
        (("--neighbours", 30, "--rings", 2), "--neighbours: got 30 and rings=2; give one of them"),
        (("--viewpoint-side", "away"), "--viewpoint-side: got 'away' without a viewpoint"),
        (("--viewpoint-side", "up"), "--viewpoint-side: got 'up', expected 'toward' or 'away'"),
    ):
        refused = run("normals", cloud, tmp_path / "d.ply", *options)
        assert refused.returncode == 2
        assert message in refused.stderr
    for options in (below, ("--neighbours", 30)):
        refused = run("normals", SAMPLES / "waves.ply", tmp_path / "d.ply", *options)
        assert refused.returncode == 2
        assert f"{options[0]}: " in refused.stderr


def test_point_clouds(tmp_path):
    """From a file with points alone to one with curvature and colour, and a picture of it."""
    star = load(SAMPLES / "bumpy_star.ply")
    vertices = star.current_mesh().vertex_matrix()
    cloud, curved, picture = (tmp_path / name for name in ("cloud.ply", "curved.ply", "curved.png"))
    points = pymeshlab.MeshSet()
    points.add_mesh(pymeshlab.Mesh(vertices))
    points.save_current_mesh(str(cloud))
    report = json.loads(run("curvature", cloud, curved, "--json").stdout)
    assert report["status"] == {"OK": len(vertices)}
    result = load(curved)
    saved = result.current_mesh()
    assert saved.is_point_cloud()
    assert np.array_equal(saved.vertex_scalar_array(), read_fields(curved)["bz_mean_curvature"])
    assert np.ptp(saved.vertex_color_matrix(), axis=0)[:3].min() > 0.5
    given = load(cloud)
    expected = estimate_vertex_geometry(given.current_mesh().vertex_matrix(), None).mean_curvature
    np.testing.assert_allclose(saved.vertex_scalar_array(), expected, rtol=SINGLE)
    result = run("render", curved, picture, "--size", 200)
    assert result.returncode == 0, result.stderr
    assert picture.stat().st_size > 10_000


def test_render_draws_several_fields(tmp_path):
    curved, picture = tmp_path / "curved.ply", tmp_path / "picture.png"
    run("curvature", SAMPLES / "bumpy_star.ply", curved)
    fields = ["--field", "quality", "--field", "bz_shape_index", "--field", "color"]
    result = run("render", curved, picture, *fields, "--view", "iso", "--size", 200, "--json")
    assert result.returncode == 0, result.stderr
    panels = json.loads(result.stdout)["panels"]
    assert [panel["field"] for panel in panels] == ["quality", "bz_shape_index", "color"]
    assert panels[0]["limits"][0] < panels[0]["limits"][1]
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size > 10_000


@pytest.mark.usefixtures("quick_pictures")
def test_demo_of_a_mesh_writes_four_meshes_and_a_picture(tmp_path):
    result = run("demo", SAMPLES / "bumpy_star.ply", "--out", tmp_path / "new" / "folder", "--json")
    assert result.returncode == 0, result.stderr
    report = json.loads(result.stdout)
    assert all(Path(file["output"]).is_file() and file["statistics"] for file in report["files"])
    assert Path(report["picture"]).is_file()
    names = sorted(path.name for path in (tmp_path / "new" / "folder").iterdir())
    quantities = ["gaussian_curvature", "geodesic_torsion", "mean_curvature", "normal_angle"]
    assert names == sorted(["bumpy_star.png", *(f"bumpy_star_{q}.ply" for q in quantities)])
    for path in (tmp_path / "new" / "folder").glob("*.ply"):
        mesh_set = load(path)
        assert np.ptp(mesh_set.current_mesh().vertex_scalar_array()) > 0


def test_info_says_what_a_file_carries(tmp_path, textured_bunny_file):
    run("torsion", SAMPLES / "torus.ply", tmp_path / "t.ply")
    (columns,) = json.loads(run("info", tmp_path / "t.ply", "--json").stdout)["contents"][3:]
    assert {"bz_geodesic_torsion", "bz_fit_grade"} <= set(columns.split(", "))
    shown = " ".join(run("info", tmp_path / "t.ply").stdout.split())
    assert "carries colours of vertices; quality; normals; bz_fit_grade, bz_geodesic_torsion" in shown
    assert "textures TextureDouble_A.png" in run("info", textured_bunny_file).stdout
    ms = pymeshlab.MeshSet()
    ms.create_cube()
    ms.save_current_mesh(str(tmp_path / "cube.obj"), save_vertex_normal=False)
    assert "carries nothing but its shape" in " ".join(run("info", tmp_path / "cube.obj").stdout.split())


def test_messages_name_the_options_of_the_shell(tmp_path):
    arguments = ["fill-holes", SAMPLES / "waves.ply", tmp_path / "w.ply"]
    for option in ("--max-diameter", "--max-perimeter", "--noise"):
        assert run(*arguments, option, "-1").stderr.startswith(f"bezier-filters: {option}: got -1.0")
    points = tmp_path / "points.ply"
    save(points, sphere(resolution=4).vertices, np.empty((0, 3), int))
    assert run("fill-holes", points, tmp_path / "w.ply").stderr.startswith("bezier-filters: the mesh has no faces")


def test_smoothing_says_why_nothing_moved(tmp_path):
    result = run("smooth", SAMPLES / "torus.ply", tmp_path / "t.ply")
    assert "nothing moved: the mesh is clean" in " ".join(result.stdout.split())
    ms = load(SAMPLES / "torus.ply")
    ms.apply_coord_random_displacement(displacement=pymeshlab.PercentageValue(0.3))
    ms.save_current_mesh(str(tmp_path / "noisy.ply"))
    assert "nothing moved" not in run("smooth", tmp_path / "noisy.ply", tmp_path / "t.ply").stdout


def test_fills_that_need_a_look_are_told_last_and_by_the_status(tmp_path):
    half, target = tmp_path / "half.ply", tmp_path / "closed.ply"
    ball = sphere(resolution=16)
    upper = (ball.vertices[ball.faces][:, :, 2] > -0.1).all(axis=1)
    save(half, ball.vertices, ball.faces[upper])
    result = run("fill-holes", half, target)
    assert result.returncode == 3
    assert target.exists()
    assert result.stderr.startswith(f"look at {target}: 1 of the filled holes as wide as half of the mesh")
    assert "a largest diameter of 50% leaves such open" in result.stderr
    report = json.loads(run("fill-holes", half, target, "--json").stdout)
    assert len(report["warnings"]) == 1
    assert run("fill-holes", half, target, "--max-diameter", "50%").returncode == 0
    most = ball.faces[(ball.vertices[ball.faces][:, :, 2] < 0.9).all(axis=1)]
    save(half, ball.vertices, most)
    result = run("fill-holes", half, target)
    assert (result.returncode, result.stderr) == (0, "")
    # No fill gets past a needle through the hole.
    needle = np.array([[0.01, 0, 0], [-0.01, 0.01, 0], [-0.01, -0.01, 0], [0, 0, 2]])
    corners = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]) + len(ball.vertices)
    save(half, np.vstack([ball.vertices, needle]), np.vstack([most, corners]))
    result = run("fill-holes", half, target)
    assert result.returncode == 3
    assert (
        "1 of the holes, left open because every fill would intersect others; --intersecting fills them"
        in result.stderr
    )
    assert "every fill would cut other faces, --intersecting takes" in " ".join(result.stdout.split())
    result = run("fill-holes", half, target, "--intersecting", "--verbose")
    assert result.returncode == 3
    assert "1 of the fills with faces that intersect others" in result.stderr
    assert re.search(r"\w+: \d+ of its faces would cut others;", " ".join(result.stdout.split()))
    assert re.search(r"\w+: taken, though \d+ of its faces cut others, the fewest", " ".join(result.stdout.split()))


def test_the_papers_method_says_where_it_is_not_used(tmp_path):
    ball = sphere()
    x, y, z = ball.vertices[ball.faces].mean(axis=1).T
    is_in_band = (np.abs(z) < 0.35) & (np.abs(np.arctan2(y, x)) < 2.4)  # no plane shows its rim without overlaps
    save(tmp_path / "cut.ply", ball.vertices, ball.faces[~is_in_band])
    fill = ("fill-holes", tmp_path / "cut.ply", tmp_path / "closed.ply", "--method", "paper", "--overwrite")
    result, report = run(*fill), json.loads(run(*fill, "--json").stdout)
    others = sum(hole["method"] != "paper" for hole in report["holes"])
    assert others > 0
    assert f"{others} of them by another method than the paper's" in result.stdout


def save(path, vertices, faces):
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    ms.save_current_mesh(str(path))
