"""Commands whose result is none say why, say what helps, and end with status 3."""

import json

import numpy as np
import pymeshlab
import pytest
from command_line import run

from bezier_filters import read_fields
from bezier_filters.scale.scheduling import run_command_line
from bezier_filters.status import FitStatus
from bezier_filters.surfaces import sphere

BALL = sphere(resolution=8)
SOUP = BALL.vertices[BALL.faces].reshape(-1, 3), np.arange(BALL.faces.size).reshape(-1, 3)
TWO_SIDED = BALL.vertices, np.vstack([BALL.faces, BALL.faces[:, ::-1]])
FLIPPED = BALL.vertices, np.vstack([BALL.faces[::2], BALL.faces[1::2, ::-1]])
TRIANGLE = np.eye(3), np.array([[0, 1, 2]])
IS_ABOVE = BALL.vertices[BALL.faces].mean(axis=1)[:, 2] > 0.0
HALF_INWARDS = BALL.vertices, np.where(IS_ABOVE[:, np.newaxis], BALL.faces[:, ::-1], BALL.faces)
INSIDE_OUT = BALL.vertices, BALL.faces[:, ::-1]


def strip_of_two_rows(n=60):
    x, y = np.arange(2 * n) % n, np.arange(2 * n) // n
    heights = np.random.default_rng(0).normal(scale=0.05, size=2 * n)
    i = np.arange(n - 1)
    faces = [np.column_stack([i, i + 1, i + n]), np.column_stack([i + 1, i + n + 1, i + n])]
    return np.column_stack([x, y, heights]).astype(np.float64), np.vstack(faces)


def save(path, vertices, faces):
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    ms.save_current_mesh(str(path))
    return path


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
@pytest.mark.parametrize("command", ["curvature", "torsion", "smooth"])
def test_an_unwelded_file(command, suffix, tmp_path):
    source, target = save(tmp_path / f"soup{suffix}", *SOUP), tmp_path / "out.ply"
    result = run(command, source, target)
    assert result.returncode == 3
    assert f"{len(BALL.faces):,} of {len(BALL.faces):,} faces (100%) are not welded" in result.stderr
    assert "--repair repairs" in result.stderr
    repaired = run(command, source, target, "--repair", "--json")
    assert (repaired.returncode, repaired.stderr) == (0, "")
    report = json.loads(repaired.stdout)
    assert report["repaired"]["welded_vertices"] == len(SOUP[0]) - len(BALL.vertices)
    assert report["warnings"] == []
    assert len(next(iter(read_fields(target).values()))) == len(BALL.vertices)
    if command == "curvature":
        np.testing.assert_allclose(read_fields(target)["bz_mean_curvature"], 1.0, atol=0.01)


@pytest.mark.parametrize(
    ("mesh", "reason"),
    [(TRIANGLE, "at most 3 vertices are connected by faces"), (TWO_SIDED, f"{len(BALL.faces):,} duplicate faces")],
)
def test_other_meshes_without_a_curvature(mesh, reason, tmp_path):
    source = save(tmp_path / "mesh.ply", *mesh)
    result = run("curvature", source, tmp_path / "out.ply", "--quiet")
    assert (result.returncode, result.stdout) == (3, "")
    assert reason in result.stderr
    assert (read_fields(tmp_path / "out.ply")["bz_fit_grade"] < FitStatus.FOLDED.grade).all()
    assert reason in run("info", source).stdout
    assert "Not fit for fitting" in run("info", source).stdout


def test_flipped_faces(tmp_path):
    source, target = save(tmp_path / "mesh.ply", *FLIPPED), tmp_path / "out.ply"
    result = run("curvature", source, target)
    assert result.returncode == 3
    assert "have no curvature to rely on" in result.stderr
    assert "faces (50%) are flipped" in result.stderr
    assert "--repair repairs" in result.stderr
    assert run("smooth", source, target).returncode == 3
    report = json.loads(run("curvature", source, target, "--repair", "--json").stdout)
    assert report["repaired"]["turned_faces"] == len(BALL.faces) / 2
    np.testing.assert_allclose(np.abs(read_fields(target)["bz_mean_curvature"]), 1.0, atol=0.01)


@pytest.mark.parametrize("mesh", [FLIPPED, HALF_INWARDS])
def test_info_names_flipped_faces_and_what_helps(mesh, tmp_path):
    shown = run("info", save(tmp_path / "mesh.ply", *mesh)).stdout
    assert "are flipped against the others" in shown
    assert "--repair of normals, curvature" in shown
    assert "--repair" not in run("info", save(tmp_path / "ball.ply", BALL.vertices, BALL.faces)).stdout


@pytest.mark.parametrize(
    ("command", "mesh"),
    [
        (["smooth"], strip_of_two_rows()),
        (["smooth"], SOUP),
        (["smooth"], FLIPPED),
        (["scale", "smooth", "--scheduler", "synchronous"], SOUP),
    ],
)
def test_nothing_is_smoothed_without_the_noise(command, mesh, tmp_path):
    source, target = save(tmp_path / "mesh.ply", *mesh), tmp_path / "out.ply"
    result = run(*command, source, target)
    assert result.returncode == 3
    assert "nothing was smoothed, as the noise is not known" in result.stderr
    report = json.loads(run(*command, source, target, "--json").stdout)
    assert len(report["warnings"]) == 1
    assert not read_fields(target)["bz_displacement"].any()


@pytest.mark.parametrize("command", [["smooth"], ["scale", "smooth", "--scheduler", "synchronous"]])
def test_a_mesh_without_noise_needs_no_look(command, tmp_path):
    result = run(*command, save(tmp_path / "mesh.ply", BALL.vertices, BALL.faces), tmp_path / "out.ply", "--json")
    assert (result.returncode, json.loads(result.stdout)["warnings"]) == (0, [])


@pytest.mark.parametrize(
    ("mesh", "status", "text"),
    [
        ((BALL.vertices, BALL.faces), 0, ""),
        (strip_of_two_rows(), 0, ""),
        (INSIDE_OUT, 0, "note: the closed surface has a negative volume"),
        (HALF_INWARDS, 0, "vertices, faces are flipped against others"),
        (FLIPPED, 3, "vertices have no curvature to rely on"),
    ],
)
def test_orientation_in_tiles(mesh, status, text, tmp_path):
    source, target = save(tmp_path / "mesh.ply", *mesh), tmp_path / "out.ply"
    result = run("scale", "curvature", source, target, "--scheduler", "synchronous", "--tile-vertices", "256")
    assert result.returncode == status
    assert text in result.stderr
    assert bool(text) == bool(result.stderr)


def test_a_body_that_is_inside_out_is_turned(tmp_path):
    source, target = save(tmp_path / "mesh.ply", BALL.vertices, BALL.faces[:, ::-1]), tmp_path / "out.ply"
    assert "1 closed bodies are inside out" in run("info", source).stdout
    assert run("curvature", source, target, "--repair").returncode == 0
    np.testing.assert_allclose(read_fields(target)["bz_mean_curvature"], 1.0, atol=0.01)


def test_a_sound_mesh_is_not_changed_by_repair(tmp_path):
    source = save(tmp_path / "mesh.ply", BALL.vertices, BALL.faces)
    assert run("curvature", source, tmp_path / "a.ply").returncode == 0
    assert run("curvature", source, tmp_path / "b.ply", "--repair").returncode == 0
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_scripts_lines_and_demonstrations(tmp_path):
    source, script = save(tmp_path / "soup.ply", *SOUP), tmp_path / "steps.mlx"
    assert run("torsion", source, tmp_path / "out.ply", "--save-script", script).returncode == 3
    for arguments in (
        ["run", script, source, tmp_path / "out.ply"],
        ["creases", source, tmp_path / "lines.ply"],
        ["scale", "curvature", source, tmp_path / "big.ply", "--scheduler", "synchronous"],
    ):
        result = run(*arguments)
        assert result.returncode == 3, arguments
        assert "no vertex has a curvature" in result.stderr


def test_a_batch_says_which_files_need_a_look(tmp_path, monkeypatch):
    from command_line import in_this_process

    monkeypatch.setattr("bezier_filters.runtime.worker_processes.run_in_processes", in_this_process)
    files = save(tmp_path / "soup.ply", *SOUP), save(tmp_path / "ball.ply", BALL.vertices, BALL.faces)
    result = run("batch", "curvature", *files, "--out", tmp_path / "out")
    assert result.returncode == 3
    assert "are not welded" in result.stdout
    assert run("batch", "curvature", files[1], "--out", tmp_path / "out", "--redo").returncode == 0


def test_workers_of_a_scheduler_do_not_take_it_for_a_failure(tmp_path):
    source = save(tmp_path / "soup.ply", *SOUP)
    job = ["curvature", "--", str(source), str(tmp_path / "out.ply")]
    _, outcome = run_command_line((0, job))
    assert (outcome.error, len(outcome.result["warnings"])) == ("", 1)
