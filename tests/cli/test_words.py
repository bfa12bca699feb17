"""What the command line says: in the words of the shell, and explained where it is printed."""

import json
import re
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
import typer
from command_line import run

from bezier_filters import load_mesh, mesh_arrays, read_fields, save_mesh
from bezier_filters.cli import console
from bezier_filters.cli.commands import app as console_app
from bezier_filters.cli.outcomes import describe_outcome
from bezier_filters.surfaces import sphere

SAMPLES = Path(__file__).parents[2] / "sample_meshes"
WAVES = SAMPLES / "waves.ply"


def holed_ball(path):
    """A ball of radius 1 without its top."""
    ball = sphere(resolution=12)
    top = (ball.vertices[ball.faces][..., 2] > 0.9).all(axis=1)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(ball.vertices, ball.faces[~top]))
    save_mesh(ms, path)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--radius", "0"], "--radius: got 0.0, expected a positive length"),
        (["--detail", "-1"], "--detail: got -1.0, expected a positive length"),
        (
            ["--quality", "along"],
            "--direction: got None, which quality='along' needs; gravity is (0, 0, -1)",
        ),
        (
            ["--direction", "0", "0", "0"],
            "--direction: got (0.0, 0.0, 0.0), expected three finite numbers, not all 0",
        ),
        (["--noise", "nan"], "--noise: got nan, expected a length of 0 or more"),
        (
            ["--quality", "foo"],
            "--quality: got 'foo', expected 'mean', 'gaussian', 'min', 'max', 'curvedness', 'shape_index', 'std', "
            "'along', 'across' or 'plan'",
        ),
    ],
)
def test_messages_name_options_and_nothing_that_only_python_has(arguments, message, tmp_path):
    assert run("curvature", WAVES, tmp_path / "w.ply", *arguments).stderr == f"bezier-filters: {message}\n"


def test_colours_need_a_quality(tmp_path):
    result = run("smooth", WAVES, tmp_path / "w.ply", "--color")
    assert result.stderr == "bezier-filters: --color: there is no quality to colour by; choose one\n"


def test_a_missing_picture_is_what_is_missing():
    result = run("render", WAVES)
    assert result.returncode == 2
    assert "expected a picture to write, whose name ends in one of .png" in result.stderr


def test_a_file_that_is_no_mesh_is_called_that(tmp_path):
    (tmp_path / "notes.ply").write_text("Wednesday: scan the vase again.")
    result = run("info", tmp_path / "notes.ply")
    assert "notes.ply: it is no PLY file: it starts with 'Wednesday: s'" in result.stderr


def test_fields_that_are_missing_are_listed_as_info_does(tmp_path):
    ms = load_mesh(WAVES)
    ms.compute_scalar_by_function_per_vertex(q="0")
    save_mesh(ms, tmp_path / "w.ply")
    assert "quality" not in run("info", tmp_path / "w.ply").stdout
    result = run("render", tmp_path / "w.ply", tmp_path / "w.png", "--field", "bz_k_min")
    assert "has no 'bz_k_min'; it has shape" in result.stderr


def test_the_table_of_holes_explains_itself(tmp_path):
    holed_ball(tmp_path / "ball.ply")
    result = run("fill-holes", tmp_path / "ball.ply", tmp_path / "closed.ply")
    assert "surface:     on the surface that continues the one around the hole" in result.stdout
    assert "rim angle:   between old and new faces" in result.stdout
    assert "flat:" not in result.stdout


@pytest.mark.parametrize(("limit", "is_noted"), [("10", True), ("50%", False), ("1.5", False)])
def test_a_limit_that_limits_nothing_is_noted(limit, is_noted, tmp_path):
    holed_ball(tmp_path / "ball.ply")
    result = run("fill-holes", tmp_path / "ball.ply", tmp_path / "closed.ply", "--max-diameter", limit)
    note = "note: --max-diameter: no hole can have a diameter of 10 where all of the mesh is 3.46 across\n"
    assert (result.returncode, result.stderr) == (0, note if is_noted else "")


def test_iterations_that_had_nothing_to_do_are_noted(tmp_path):
    ball = sphere(resolution=16)
    radii = 1.0 + np.random.default_rng(0).normal(scale=0.01, size=(len(ball.vertices), 1))
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(ball.vertices * radii, ball.faces))
    save_mesh(ms, tmp_path / "noisy.ply")
    files = tmp_path / "noisy.ply", tmp_path / "clean.ply"
    assert run("smooth", *files).stderr == ""
    once = files[1].read_bytes()
    result = run("smooth", *files, "--iterations", 9)
    assert result.stderr.startswith("note: --iterations: ")
    assert "of 9 moved something, then nothing was left to do" in result.stderr
    if " 1 of 9" in result.stderr:
        assert files[1].read_bytes() == once
    assert run("smooth", *files, "--iterations", 2, "--method", "paper").stderr == ""


def test_a_mesh_that_is_coloured_cleaned_and_closed_keeps_its_colours_and_what_they_mean(tmp_path):
    """The chain of the quick start: curvature of the scan, which smoothing and filling keep."""
    holed_ball(tmp_path / "a.ply")
    for command, source, target in [("curvature", "a", "b"), ("smooth", "b", "c"), ("fill-holes", "c", "d")]:
        assert run(command, tmp_path / f"{source}.ply", tmp_path / f"{target}.ply").returncode == 0
    first, last = read_fields(tmp_path / "b.ply"), read_fields(tmp_path / "d.ply")
    count = len(first["quality"])
    np.testing.assert_array_equal(last["quality"][:count], first["bz_mean_curvature"])
    assert len(last["quality"]) == count or (last["quality"][count:] != 0.0).all()
    mesh = load_mesh(tmp_path / "d.ply").current_mesh()
    assert mesh.has_vertex_color()
    result = run("render", tmp_path / "d.ply", tmp_path / "d.png", "--size", 60, "--json")
    assert '"label": "mean curvature"' in result.stdout


@pytest.mark.parametrize(
    ("command", "last"),
    [
        ("fill-holes", r"1 hole filled, 0 left open"),
        ("fill-holes --max-edges 3", r"0 holes filled, 1 left open: \d+ edges, more than --max-edges 3"),
        ("smooth", r"noise .*; nothing moved"),
        (
            "curvature",
            r"mean curvature: median 1 \[1/length\]; reliable (everywhere|at .* vertices)",
        ),
        ("clean", r"noise .*; nothing moved"),
    ],
)
def test_the_last_line_says_what_matters(command, last, tmp_path):
    holed_ball(tmp_path / "ball.ply")
    name, *given = command.split()
    result = run(name, tmp_path / "ball.ply", tmp_path / "out.ply", *given)
    assert re.fullmatch(last, result.stdout.splitlines()[-1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("curvature --quality foo", "--quality: got 'foo', expected 'mean'"),
        ("curvature --colormap jet", "--colormap: got 'jet'"),
        ("curvature --percentile 70", "--percentile: got 70.0"),
        ("curvature --range 3 1", "colour range: got 3.0 to 1.0"),
        ("curvature --degree 9", "--degree: got 9"),
        ("fill-holes --max-diameter -1", "--max-diameter: got -1.0, expected a positive length"),
        ("smooth --method foo", "--method: got 'foo', expected 'auto' or 'paper'"),
        ("clean --noise -1", "--noise: got -1.0, expected a length of 0 or more"),
        ("clean --report page.txt", "expected a file name that ends in .html"),
        ("lines --family foo", "--family: got 'foo'"),
    ],
)
def test_options_are_checked_before_the_mesh_is_read(arguments, message, tmp_path):
    name, *given = arguments.split()
    result = run(name, tmp_path / "missing.ply", tmp_path / "out.ply", *given)
    assert result.returncode == 2
    assert message in result.stderr
    assert "missing.ply" not in result.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("render missing.ply picture.png --colormap jett", "--colormap: got 'jett'"),
        ("render missing.ply picture.png --percentile 70", "--percentile: got 70.0"),
        ("render missing.ply picture.png --view nope", "view: got 'nope', expected one of front"),
        ("compare missing.ply missing.ply --up q", "up: got 'q', expected one of auto, x"),
        ("qmap missing.ply map.qmap --colormap jett", "--colormap: got 'jett'"),
    ],
)
def test_options_of_pictures_are_checked_before_the_mesh_is_read(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments.split())
    assert result.returncode == 2
    assert message in result.stderr
    assert "there is no" not in result.stderr


def test_the_help_has_whole_sentences_at_80_columns(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for arguments in (["--help"], ["scale", "--help"]):
        lines = run(*arguments).stdout.splitlines()
        assert not [line for line in lines if not line.startswith("Usage") and (line.endswith("...") or len(line) > 80)]
    shown = "\n".join(lines) + run("--help").stdout
    assert [name for name in typer.main.get_command(console_app).commands if f"\n  {name} " not in shown] == []


def test_cleaning_fills_and_then_smooths(tmp_path):
    holed_ball(tmp_path / "ball.ply")
    result = run("clean", tmp_path / "ball.ply", tmp_path / "clean.ply", "--json")
    report = json.loads(result.stdout)
    assert report["fill"]["closed_holes"] == 1
    assert run("fill-holes", tmp_path / "ball.ply", tmp_path / "f.ply").returncode == 0
    assert run("smooth", tmp_path / "f.ply", tmp_path / "s.ply").returncode == 0
    first, second = (mesh_arrays(tmp_path / name) for name in ("clean.ply", "s.ply"))
    np.testing.assert_array_equal(first[1], second[1])
    np.testing.assert_allclose(first[0], second[0], atol=1e-9)


def test_a_reason_of_a_filled_hole_is_what_was_tried_before(capsys):
    hole = {"edge_count": 9, "diameter": 0.1, "method": "flat", "new_faces": 7, "rim_dihedral": 9.0}
    reason = {"reason": "surface: 3 of its faces would cut others"}
    report = {"repaired": None, "closed_holes": 1, "open_holes": 1, "new_faces": 7, "trimmed_faces": 0}
    report["holes"] = [hole | reason | {"filled": True}, hole | reason | {"filled": False, "method": ""}]
    console.print_holes(report, "a.ply")
    shown = capsys.readouterr().out
    assert "tried before" not in shown
    assert shown.count("surface: 3 of its faces would cut others") == 1
    console.print_holes(report, "a.ply", verbose=True)
    shown = capsys.readouterr().out
    assert shown.count("tried before: surface: 3 of its faces would cut others") == 1
    assert shown.count("surface: 3 of its faces would cut others") == 2


@pytest.mark.parametrize("command", ["measure", "lines", "creases", "bake"])
def test_commands_that_refuse_point_clouds_ask_for_faces(command):
    text = " ".join(run(command, "--help").stdout.split())
    assert "Mesh with faces to read" in text
    assert "point cloud to read" not in text


def test_the_page_of_a_cleaning_in_place_shows_the_mesh_before(tmp_path):
    holed_ball(tmp_path / "ball.ply")
    result = run("clean", tmp_path / "ball.ply", tmp_path / "ball.ply", "--overwrite", "--report", tmp_path / "p.html")
    assert result.returncode == 0
    assert (
        "holes are filled" in (tmp_path / "p.html").read_text() or "hole is filled" in (tmp_path / "p.html").read_text()
    )


def test_unknown_noise_does_not_stay():
    known = {"noise_before": None, "noise_after": None, "mean_edge": 1.0, "moved": 5}
    assert describe_outcome(known) == "noise unknown before, unknown after"
    assert "stays" in describe_outcome(known | {"noise_before": 0.1, "noise_after": 0.1})
    assert describe_outcome({"fill": {}, "smooth": known}) == "noise unknown before, unknown after"
