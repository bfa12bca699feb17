"""Files that are there already: no command overwrites its input, or what is write-protected, unless that is said."""

import shutil
from pathlib import Path

import pytest
from command_line import in_this_process, run

from bezier_filters import read_fields
from bezier_filters.cli.commands import app
from bezier_filters.runtime import worker_processes

SAMPLES = Path(__file__).parents[2] / "sample_meshes"


def test_the_output_may_be_the_input_if_that_is_said(tmp_path):
    mesh, other = tmp_path / "a scan.ply", tmp_path / "other.ply"
    shutil.copy(SAMPLES / "punched_patch.ply", mesh)
    before = mesh.read_bytes()
    same = tmp_path / "folder" / ".." / "a scan.ply"
    (tmp_path / "folder").mkdir()
    for arguments in (["fill-holes", mesh, mesh], ["smooth", mesh, same], ["creases", mesh, mesh]):
        refused = run(*arguments)
        assert refused.returncode == 2
        assert refused.stderr.endswith("is the input; give --overwrite to replace it\n")
        assert mesh.read_bytes() == before
    for target, options in ((other, []), (mesh, ["--overwrite"])):
        app(["fill-holes", str(mesh), str(target), *options], standalone_mode=False)
    assert mesh.read_bytes() == other.read_bytes()
    assert len(list(tmp_path.iterdir())) == 3


def test_a_write_protected_file_is_replaced_if_that_is_said(tmp_path):
    target = tmp_path / "t.ply"
    target.write_text("precious")
    target.chmod(0o444)
    result = run("normals", SAMPLES / "waves.ply", target)
    assert (result.returncode, target.read_text()) == (2, "precious")
    assert "is write-protected; give --overwrite to replace it" in result.stderr
    assert run("normals", SAMPLES / "waves.ply", target, "--overwrite").returncode == 0
    assert read_fields(target)["bz_normal_x"].any()


@pytest.fixture
def in_folder(tmp_path, monkeypatch):
    """Runs a command in the folder of the test: its exit status, and all that it says."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(worker_processes, "run_in_processes", in_this_process)

    def run_there(command):
        done = run(*command.split())
        return done.returncode, done.stdout + done.stderr

    return run_there


@pytest.mark.parametrize(
    ("command", "target", "status"),
    [
        ("render scan.ply a.png", "a.png", 2),
        ("qmap scan.ply a.qmap", "a.qmap", 2),
        ("report scan.ply", "scan.html", 2),
        ("creases scan.ply a.ply", "a.ply", 2),
        ("creases scan.ply lines.ply --picture a.png", "a.png", 2),
        ("curvature scan.ply curved.ply --save-script a.mlx", "a.mlx", 2),
        ("demo scan.ply", "out/scan_mean_curvature.ply", 2),
        ("batch curvature scan.ply --out out", "out/scan.ply", 1),
        ("scale curvature scan.ply a.ply", "a.ply", 2),
    ],
)
def test_every_command_spares_write_protected_files(command, target, status, tmp_path, in_folder):
    (tmp_path / "out").mkdir()
    shutil.copy(SAMPLES / "torus.ply", tmp_path / "scan.ply")
    (tmp_path / target).write_text("precious")
    (tmp_path / target).chmod(0o444)
    code, said = in_folder(command)
    assert code == status
    assert "is write-protected; give --overwrite to replace it" in said
    assert (tmp_path / target).read_text() == "precious"
    assert {path.name for path in tmp_path.glob("*.*")} <= {"scan.ply", target}


@pytest.mark.parametrize(
    "command",
    ["qmap scan.ply scan.ply", "curvature scan.ply c.ply --save-script scan.ply", "scale smooth scan.ply scan.ply"],
)
def test_every_command_spares_its_input(command, tmp_path, in_folder):
    shutil.copy(SAMPLES / "torus.ply", tmp_path / "scan.ply")
    code, said = in_folder(command)
    assert code == 2
    assert "scan.ply is the input; give --overwrite to replace it" in said
    assert (tmp_path / "scan.ply").read_bytes() == (SAMPLES / "torus.ply").read_bytes()


@pytest.mark.usefixtures("quick_pictures")
@pytest.mark.parametrize(
    ("command", "name"),
    [("render scan.ply {} --field shape --size 50", "a.png"), ("qmap curved.ply {}", "a.qmap"), ("demo scan.ply", "")],
)
def test_they_are_replaced_if_that_is_said(command, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(SAMPLES / "torus.ply", "scan.ply")
    run("curvature", "scan.ply", "curved.ply", "--rings", 2)
    target = tmp_path / (name or "out/scan_mean_curvature.ply")
    target.parent.mkdir(exist_ok=True)
    target.write_text("precious")
    target.chmod(0o444)
    assert run(*command.format(name).split(), "--overwrite").returncode == 0
    assert not target.read_bytes().startswith(b"precious")
