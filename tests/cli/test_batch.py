"""Batches: the real command line on many files where processes are the point, and the rest in this one."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from command_line import in_this_process, run

from bezier_filters import read_fields
from bezier_filters.cli.app import app
from bezier_filters.cli.batch import RECORDS, Item, check_command, command_line, run_command, summarize
from bezier_filters.cli.console import print_batch
from bezier_filters.errors import InvalidParameterError
from bezier_filters.meshlab.mesh_files import save_mesh
from bezier_filters.parameters import PARAMETERS
from bezier_filters.runtime import worker_processes
from bezier_filters.runtime.worker_processes import run_in_processes
from bezier_filters.surfaces import block_with_sharp_edges

SAMPLES = Path(__file__).parents[2] / "sample_meshes"
MODULE = [sys.executable, "-m", "bezier_filters"]


def run_process(*arguments, cwd):
    return subprocess.run([*MODULE, *map(str, arguments)], capture_output=True, encoding="utf-8", cwd=cwd)


def results(summary):
    return {file["input"]: file["result"] for file in summary["files"]}


@pytest.fixture
def scans(tmp_path):
    """Three meshes, one of them in a folder below, and three files that are none."""
    folder = tmp_path / "scans"
    (folder / "below").mkdir(parents=True)
    shutil.copy(SAMPLES / "torus.ply", folder / "a.ply")
    shutil.copy(SAMPLES / "waves.ply", folder / "below" / "a.ply")
    shutil.copy(SAMPLES / "sphere.ply", folder / "z.ply")
    (folder / "empty.ply").touch()
    (folder / "garbage.ply").write_bytes(os.urandom(1000))
    (folder / "cut.ply").write_bytes((SAMPLES / "torus.ply").read_bytes()[:2000])
    return folder


@pytest.fixture
def without_processes(tmp_path, monkeypatch):
    """Batches in the folder of the test, in this process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(worker_processes, "run_in_processes", in_this_process)


def test_bad_files_do_not_stop_the_others_and_the_next_run_goes_on(scans, tmp_path, without_processes):
    command = ("batch", "curvature", "scans/**/*.ply", "--out", "out", "--options", "--quality gaussian --no-color")
    first = run_process(*command, "--jobs", 1, "--json", cwd=tmp_path)
    assert first.returncode == 1
    summary = json.loads(first.stdout)
    good, bad = {"scans/a.ply", "scans/below/a.ply", "scans/z.ply"}, {"scans/empty.ply", "scans/garbage.ply"}
    found = results(summary)
    assert {name for name in found if found[name] == "done"} == good
    assert bad | {"scans/cut.ply"} == {name for name in found if found[name] == "failed"}
    assert all(("cannot read" in file["error"]) == (file["input"] not in good) for file in summary["files"])
    written = {str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*.*")}
    assert written == {"a.ply", "below/a.ply", "z.ply", RECORDS}

    single = tmp_path / "single.ply"
    run("curvature", scans / "below" / "a.ply", single, "--quality", "gaussian", "--no-color")
    np.testing.assert_array_equal(read_fields(single)["quality"], read_fields(tmp_path / "out/below/a.ply")["quality"])

    shutil.copy(SAMPLES / "waves.ply", scans / "empty.ply")  # mended
    os.utime(scans / "a.ply")  # the same, but newer
    old = (scans / "z.ply").stat()
    shutil.copy(SAMPLES / "ellipsoid.ply", scans / "z.ply")
    os.utime(scans / "z.ply", ns=(old.st_atime_ns, old.st_mtime_ns - 10**9))  # changed, and older
    second = run(*command)
    assert second.returncode == 1
    lines = {line.split()[0]: line for line in second.stdout.splitlines()}
    assert "skipped" in lines["scans/a.ply"]
    assert "done" in lines["scans/empty.ply"]
    assert "done" in lines["scans/z.ply"]
    assert "cannot read" in lines["scans/cut.ply"]
    assert "curvature: 2 done, 2 skipped, 2 failed" in second.stdout


def test_what_was_done_with_other_options_is_done_again(scans, without_processes):
    command = ("batch", "curvature", "scans/[az].ply", "--out", "out")
    gaussian = ("--options", "--quality gaussian")
    for options, done in ((gaussian, 2), (gaussian, 0), ((), 2), ((), 0), (("--redo",), 2)):
        assert json.loads(run(*command, *options, "--json").stdout)["done"] == done
    fields = read_fields("out/a.ply")
    np.testing.assert_array_equal(fields["quality"], fields["bz_mean_curvature"])
    assert json.loads(run("batch", "torsion", *command[2:], "--json").stdout)["done"] == 2
    with open(f"out/{RECORDS}", "a") as records:
        records.write('["cut sho')
    assert json.loads(run("batch", "torsion", *command[2:], "--json").stdout)["skipped"] == 2


def test_where_a_result_goes_does_not_depend_on_the_other_files(scans, without_processes):
    torus = ["scans/below/a.ply"]
    for others in ([], ["scans/z.ply"], [str(scans / "z.ply")]):
        summary = json.loads(run("batch", "normals", *torus, *others, "--out", "out", "--json").stdout)
        assert summary["files"][0]["output"] == "out/a.ply"
    result = run("batch", "normals", *torus, "scans/a.ply", "--out", "out")
    assert "a pattern in quotes from a folder above them keeps their folders" in result.stderr


FILES = 6


def test_an_interrupted_batch_goes_on_where_it_was(tmp_path, without_processes):
    (tmp_path / "scans").mkdir()
    for k in range(FILES):
        shutil.copy(SAMPLES / "bumpy_star.ply", tmp_path / "scans" / f"{k:02}.ply")
    command = [*MODULE, "batch", "smooth", "scans/*.ply", "--out", "out", "--jobs", "2"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 120
    while not list(tmp_path.glob("out/[!.]*.ply")) and time.monotonic() < end:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    before = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("out/[!.]*.ply")}
    assert 0 < len(before) < FILES
    known = int(re.search(rf"(\d) of {FILES} results are in out; the same command goes on\n", said)[1])
    assert len(before) - 2 <= known <= len(before)  # two at a time may have been written, and not been noted yet
    assert "bezier-filters: interrupted; what was written before is whole" in said
    summary = json.loads(run(*command[3:], "--json").stdout)
    assert (summary["done"], summary["skipped"], summary["failed"]) == (FILES - known, known, 0)
    after = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("out/[!.]*") if path.name != RECORDS}
    assert len(after) == FILES, sorted(after)
    assert len(before.items() & after.items()) == known


REMARKS = {
    "clean": "0 holes filled, 0 left open; noise ",
    "normals": "angle: median ",
    "curvature": "mean curvature: median ",
    "torsion": "torsion: median ",
    "smooth": "noise ",
    "fill-holes": "0 holes filled, 0 left open",
    "replace": "1 patches replaced, 0 left as they were",
    "bridge": "0 pairs of holes joined, 0 left open",
    "subdivide": "192 faces before, 768 after",
    "remesh": "192 faces before, ",
    "creases": "21 lines, 60 sharp edges",
    "bake": "curvature map, 81% of 64 x 64 texels",
    "lines": "0 lines, 0 umbilics; look at: there are no lines",
    "compare": "deviation: rms ",
}
OPTIONS = {"replace": ["--where", "fi == 0"], "bake": ["--size", "64"], "compare": [str(SAMPLES / "block.ply")]}
SUFFIXES = {"bake": (".obj", ".png")}  # of the input, with texture coordinates, and of the output


@pytest.mark.parametrize("command", REMARKS)
def test_every_command_does_what_it_does_for_one_file(command, tmp_path, capsys):
    """A cube without one of its octants has 21 edges, here of two or four edges of the mesh."""
    vertices, faces = block_with_sharp_edges(resolution=4)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    ms.compute_texcoord_parametrization_triangle_trivial_per_wedge(textdim=512)
    before, after = SUFFIXES.get(command, (".ply", ".ply"))
    source, of_batch, alone = (
        str(tmp_path / name) for name in (f"a block{before}", f"of batch{after}", f"alone{after}")
    )
    save_mesh(ms, source)
    report = run_command(command_line(command, OPTIONS.get(command, []), source, of_batch))
    app(command_line(command, OPTIONS.get(command, []), source, alone), standalone_mode=False)
    assert Path(of_batch).read_bytes() == Path(alone).read_bytes()
    capsys.readouterr()
    print_batch(summarize(command, [Item(source, of_batch, "done", 1.0, report=report)], 1.0))
    assert REMARKS[command] in capsys.readouterr().out


def test_every_filter_that_writes_files_is_tried():
    assert {*REMARKS} == {*PARAMETERS, "clean"} - {"measure"}


def test_a_process_that_runs_commands_has_all_of_them():
    code = (
        "import typer, bezier_filters.cli.batch as batch\n"
        "print(*typer.main.get_command(batch.app).commands)"  # what a process of a batch loads
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True)
    assert {*PARAMETERS} <= {*found.stdout.split()}


def test_results_are_made_again_for_a_reference_that_has_changed(scans, without_processes):
    command = ("batch", "compare", "scans/a.ply", "--out", "out", "--json", "--options", "reference.ply")
    assert "'reference.ply', which is not a file" in run(*command).stderr
    shutil.copy(SAMPLES / "torus.ply", "reference.ply")
    assert [json.loads(run(*command).stdout)["done"] for _ in range(2)] == [1, 0]
    shutil.copy(SAMPLES / "sphere.ply", "reference.ply")
    assert json.loads(run(*command).stdout)["done"] == 1


def test_measure_is_refused():
    with pytest.raises(InvalidParameterError, match="writes no files; run it with --json"):
        check_command("measure", [])


def test_lines_of_many_files(tmp_path, without_processes):
    (tmp_path / "my parts").mkdir()
    for name in ("block.ply", "torus.ply"):
        shutil.copy(SAMPLES / name, tmp_path / "my parts")
    done = run("batch", "creases", "my parts/*", "--out", "lines", "--suffix", ".obj")
    assert "creases: 2 done, 0 skipped, 0 failed" in done.stdout
    assert "\nl 1 2\n" in (tmp_path / "lines" / "block.obj").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["render", "a.ply", "--out", "out"], "command: got 'render', expected one of clean, normals"),
        (["smooth", "b*.ply", "--out", "out"], "files: nothing matches 'b*.ply'"),
        (["smooth", "a.ply", "--out", "."], "out: a.ply is one of the inputs"),
        (["smooth", "a.ply", "a.obj", "--out", "out"], "files: a.ply and a.obj would both become out/a.ply"),
        (["smooth", "a.ply", "--out", "out", "--suffix", "ply"], "suffix: got 'ply'"),
        (["smooth", "a.ply", "--out", "out", "--options", "--json"], "options: got --json"),
        (["smooth", "a.ply", "--out", "out", "--options", "--colour"], "No such option"),
        (["smooth", "a.ply", "--out", "out", "--options", "--save-script a.mlx"], "got --save-script, which names one"),
        (["creases", "a.ply", "--out", "out", "--options", "--picture a.png"], "got --picture, which names one file"),
    ],
)
def test_mistakes_are_refused_before_anything_is_done(arguments, message, tmp_path, monkeypatch):
    shutil.copy(SAMPLES / "waves.ply", tmp_path / "a.ply")
    (tmp_path / "a.obj").touch()
    monkeypatch.chdir(tmp_path)
    result = run("batch", *arguments)
    assert result.returncode == 2
    assert message in " ".join(result.stderr.split())
    assert not (tmp_path / "out").exists()


def test_a_job_that_ends_its_process_costs_nothing_but_itself():
    jobs = [0, signal.SIGKILL, 0, signal.SIGABRT, 0]  # raising 0 does nothing
    outcomes = dict(run_in_processes(signal.raise_signal, jobs, processes=2))
    assert [outcomes[k].error for k in (0, 2, 4)] == ["", "", ""]
    assert "SIGKILL" in outcomes[1].error
    assert "SIGABRT" in outcomes[3].error


@pytest.mark.slow
def test_two_hundred_files_some_of_them_broken(tmp_path):
    (tmp_path / "scans").mkdir()
    names = ("torus.ply", "waves.ply", "block.ply", "ellipsoid.ply")
    for k in range(200):
        target = tmp_path / "scans" / f"{k:03}.ply"
        if k % 20:
            shutil.copy(SAMPLES / names[k % len(names)], target)
        else:
            target.write_text("broken")
    summary = json.loads(run_process("batch", "torsion", "scans/*.ply", "--out", "out", "--json", cwd=tmp_path).stdout)
    assert (summary["done"], summary["skipped"], summary["failed"]) == (190, 0, 10)
    assert len(list((tmp_path / "out").glob("*.ply"))) == 190
    summary = json.loads(run_process("batch", "torsion", "scans/*.ply", "--out", "out", "--json", cwd=tmp_path).stdout)
    assert (summary["done"], summary["skipped"], summary["failed"]) == (0, 190, 10)


def test_reports_of_a_batch_have_one_index(tmp_path):
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=2)
    ms.save_current_mesh(str(tmp_path / "sphere.ply"))
    ms.create_torus(hsubdiv=12, vsubdiv=12)
    ms.save_current_mesh(str(tmp_path / "torus.ply"))
    (tmp_path / "broken.ply").write_text("ply\n")
    arguments = ["batch", "normals", str(tmp_path / "*.ply"), "--out", str(tmp_path / "out"), "--report", "--quiet"]
    done = run(*arguments)
    assert done.returncode == 1, done.stderr
    index = (tmp_path / "out" / "index.html").read_text("utf-8")
    assert re.findall('href="(.*?)"', index) == ["sphere.html", "torus.html"]
    assert index.index("broken.ply") < index.index("sphere.ply")  # failures first
    assert not re.search(r"https?://|<script", index)
    stamps = [(tmp_path / "out" / f"{name}.html").stat().st_mtime_ns for name in ("sphere", "torus")]
    run(*arguments)
    assert [(tmp_path / "out" / f"{name}.html").stat().st_mtime_ns for name in ("sphere", "torus")] == stamps
