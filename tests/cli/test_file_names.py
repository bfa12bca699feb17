"""Files with any names, and pipes: they are read and written, and messages name them as users know them."""

import json
import os
import shutil
import subprocess
import sys
from io import BytesIO, TextIOWrapper
from pathlib import Path

import pymeshlab
import pytest
from command_line import in_this_process, run

from bezier_filters.meshlab.mesh_files import load_mesh, save_mesh
from bezier_filters.surfaces import sphere

WAVES = Path(__file__).parents[2] / "sample_meshes" / "waves.ply"
BALL = sphere(resolution=4)
NOT_UTF8 = os.fsdecode(b"caf\xe9")
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux alone")
NAMES = ["-x", "[red]", "[bold]", ":heart:", "$\\frac$", "{{data}}", "<b>&amp;", "new\nline", "e\x1b[31mc", "y" * 250]


def run_process(*arguments, **options):
    return subprocess.run([sys.executable, "-m", "bezier_filters", *arguments], capture_output=True, **options)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def save_ball(name):
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(BALL.vertices, BALL.faces))
    save_mesh(ms, name)


@LINUX
@pytest.mark.parametrize("name", [*NAMES, NOT_UTF8])
def test_names_of_inputs_and_outputs(name, folder):
    save_ball(f"{name}.ply")
    told = run("info", "--", f"{name}.ply")
    assert told.returncode == 0, told.stderr
    assert "\x1b" not in told.stdout
    assert told.stdout.startswith(name.encode("unicode_escape").decode().replace("\\\\", "\\"))
    result = run("curvature", "--json", "--", f"{name}.ply", f"{name}.obj")
    assert (result.returncode, json.loads(result.stdout)["output"]) == (0, f"{name}.obj")
    assert load_mesh(f"{name}.obj").current_mesh().face_number() == len(BALL.faces)
    refused = run("curvature", "--", f"{name}.xyz", "out.ply")
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1
    assert "\x1b" not in refused.stderr


@pytest.mark.slow
@LINUX
def test_bytes_that_are_no_text_in_a_process(folder):
    """The whole way: arguments, notes to the process that waits, standard output."""
    save_ball(f"{NOT_UTF8}.ply")
    told = run_process("info", f"{NOT_UTF8}.ply", "--json")
    assert (told.returncode, told.stderr) == (0, b"")
    assert json.loads(told.stdout)["file"] == f"{NOT_UTF8}.ply"
    refused = run_process("info", f"{NOT_UTF8}x.ply")
    assert refused.returncode == 2
    assert refused.stderr == b"bezier-filters: cannot read caf\\udce9x.ply: no such file\n"


@LINUX
def test_folders_that_are_no_text_and_what_belongs_to_a_mesh(folder):
    """The materials of an OBJ file are found beside it, and stay beside it."""
    os.mkdir(NOT_UTF8)
    shutil.copy(WAVES, f"{NOT_UTF8}/waves.ply")
    assert run("curvature", f"{NOT_UTF8}/waves.ply", f"{NOT_UTF8}/waves.obj").returncode == 0
    assert sorted(os.listdir(NOT_UTF8))[0].startswith("waves.obj")
    assert run("info", f"{NOT_UTF8}/waves.obj").returncode == 0


@LINUX
def test_a_batch_of_such_names(folder, monkeypatch):
    monkeypatch.setattr("bezier_filters.runtime.worker_processes.run_in_processes", in_this_process)
    names = [*NAMES, NOT_UTF8]
    for name in names:
        save_ball(f"{name}.ply")
    result = run("batch", "torsion", "*.ply", "--out", "out", "--json")
    assert json.loads(result.stdout)["done"] == len(names)
    again = run("batch", "torsion", "*.ply", "--out", "out")
    assert "0 done" in again.stdout
    assert "\x1b" not in again.stdout


@LINUX
@pytest.mark.parametrize("name", ["{{data}}", "{{script}}", "</title><script>", NOT_UTF8])
def test_pages_have_names_as_text(name, folder):
    source = f"{name.replace('/', '')}.ply"
    save_ball(source)
    assert run("report", source, "page.html").returncode == 0
    html = Path("page.html").read_text(encoding="utf-8")
    title = html.partition("<title>")[2].partition("</title>")[0]
    assert len(title) < 60
    assert "<" not in title
    assert html.count("<title>") == 1
    data = html.partition('id="data">')[2].partition("</script>")[0]
    assert json.loads(data)["title"] == source.encode("unicode_escape").decode()


@LINUX
@pytest.mark.parametrize("name", ["[red].png", ":heart:.png", f"{NOT_UTF8}.png"])
def test_pictures(name, folder):
    save_ball("$x$.ply")
    result = run("render", "$x$.ply", name, "--field", "shape", "--view", "front", "--size", 60)
    assert result.returncode == 0, result.stderr
    assert result.stdout == f"wrote {name.encode('unicode_escape').decode()}\n"
    assert Path(name).exists()


PIPED = {
    "info": ["-"],
    "render": ["-", "-", "--field", "shape", "--view", "front", "--size", "60"],
    "qmap": ["-", "out.qmap", "--field", "quality"],
    "report": ["-", "-"],
    "creases": ["-", "-"],
    "curvature": ["-", "-"],
    "demo": ["-", "--out", "shown"],
    "scale": ["curvature", "-", "-", "--scheduler", "synchronous"],
}
BEGINS = {"render": b"\x89PNG", "report": b"<!doctype", "creases": b"ply", "curvature": b"ply", "scale": b"ply"}


@pytest.mark.skipif(os.name != "posix", reason="pipes are for POSIX systems")
class TestPipes:
    @pytest.fixture
    def pipe(self, monkeypatch):
        def give(data):
            monkeypatch.setattr(sys, "stdin", TextIOWrapper(BytesIO(data)))

        return give

    @pytest.mark.parametrize("command", [c for c in PIPED if c not in BEGINS])
    def test_every_command_reads_the_standard_input(self, command, folder, pipe):
        pipe(WAVES.read_bytes())
        result = run(command, *PIPED[command])
        said = result.stdout + result.stderr
        assert (result.returncode == 0) or "has no 'quality'" in said, said
        assert "bezier_filters_" not in said
        assert command == "qmap" or "<stdin>" in said

    @pytest.mark.parametrize(
        "command", [c if c in ("curvature", "render") else pytest.param(c, marks=pytest.mark.slow) for c in BEGINS]
    )
    def test_commands_write_the_standard_output(self, command, folder):
        result = run_process(command, *PIPED[command], input=WAVES.read_bytes())
        assert result.returncode == 0, result.stderr
        assert result.stdout.startswith(BEGINS[command])
        assert b"bezier_filters_" not in result.stderr
        assert b"<stdout>" in result.stderr
        assert not list(folder.iterdir())

    def test_reports_and_errors_name_the_pipes(self, pipe, folder):
        pipe(WAVES.read_bytes())
        report = json.loads(run("curvature", "-", "out.ply", "--json").stdout)
        assert (report["input"], report["output"]) == ("<stdin>", "out.ply")
        for data in (b"nothing", b"", WAVES.read_bytes()[:3000]):
            pipe(data)
            refused = run("info", "-")
            assert refused.returncode == 2
            assert refused.stderr.startswith("bezier-filters: cannot read <stdin>: ")
            assert "/" not in refused.stderr.replace("and/or", "")

    def test_a_file_may_be_called_so(self, folder, pipe):
        pipe(b"nothing")
        shutil.copy(WAVES, "x.ply")
        assert run("curvature", "x.ply", "./-").returncode == 2  # without a suffix
        assert "unknown format" in run("curvature", "x.ply", "./-").stderr

    def test_a_batch_reads_no_pipe(self, folder):
        assert "a batch reads files" in run("batch", "curvature", "-", "--out", "out").stderr
