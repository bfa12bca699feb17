"""Runs in tiles that are interrupted, damaged or lose a worker end with the same result."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scale_cases import assert_same_as_in_memory, clean, noisy, save_arrays

from bezier_filters.errors import CancelledError, FieldFileError, InvalidParameterError
from bezier_filters.scale import FitOptions, estimate_file, smooth_file
from bezier_filters.scale.clients import start_workers
from bezier_filters.scale.run import check_room
from bezier_filters.scale.scheduling import LostTaskError, run_tasks
from bezier_filters.scale.source import open_source
from bezier_filters.scale.tiles import DamagedTileError, TileReport, open_tile, report_path, tile_path, write_tile
from bezier_filters.surfaces import bumpy_star

pytestmark = pytest.mark.slow

TILES = 9
OPTIONS = {"scheduler": "synchronous", "workers": 1, "tile_vertices": 256}
GIVEN = {"rings": 2, "alpha": 0.8}  # where it does not matter how fits are chosen


@pytest.fixture
def files(tmp_path):
    return save_arrays(tmp_path, *clean())


def interrupted(files, target, after, **options):
    """Stop a run after some tiles; the folder of its results."""

    def progress(stage, done, total):
        return not (stage == "fit" and done >= after)

    with pytest.raises(CancelledError):
        estimate_file(files, target, progress=progress, **OPTIONS, **options)
    assert not target.exists()
    (results,) = Path(f"{target}.tiles").glob("results-*")
    return results


def tiles_in(results):
    return sorted(path.name for path in results.glob("tile-*.json"))


def test_only_unfinished_tiles_are_computed_after_an_interrupt(files, tmp_path):
    results = interrupted(files, tmp_path / "out.ply", 4)
    before = {name: (results / name).stat().st_mtime_ns for name in tiles_in(results)}
    assert 4 <= len(before) < TILES
    report = estimate_file(files, tmp_path / "out.ply", resume=True, keep_store=True, **OPTIONS)
    assert (report["tiles"], report["computed_tiles"]) == (TILES, TILES - len(before))
    assert before == {name: (results / name).stat().st_mtime_ns for name in before}
    assert_same_as_in_memory(report, *clean())
    again = estimate_file(files, tmp_path / "out.ply", resume=True, **OPTIONS)
    assert again["computed_tiles"] == 0
    assert_same_as_in_memory(again, *clean())
    assert not results.exists()


def test_a_run_that_is_stopped_while_it_sorts_starts_anew(files, tmp_path):
    given = {"options": FitOptions(**GIVEN)}

    def progress(stage, done, total):
        return stage != "sort" or done < total // 2

    with pytest.raises(CancelledError):
        estimate_file(files, tmp_path / "out.ply", progress=progress, **OPTIONS, **given)
    report = estimate_file(files, tmp_path / "out.ply", resume=True, **OPTIONS, **given)
    assert report["computed_tiles"] == TILES
    assert_same_as_in_memory(report, *clean(), **GIVEN)


@pytest.mark.parametrize("find", [tile_path, report_path])
@pytest.mark.parametrize("place", [3, 100, -3, None])
def test_a_damaged_tile_is_named_and_computed_again(find, place, files, tmp_path):
    given = {"options": FitOptions(**GIVEN)}
    results = interrupted(files, tmp_path / "out.ply", 8, **given)
    path = find(results, 5)
    data = bytearray(path.read_bytes())
    if place is None:
        data = data[: len(data) // 2]  # half written
    else:
        data[place] ^= 1
    path.write_bytes(data)
    with pytest.raises(DamagedTileError, match=r"tile 5 .*tile-000005\.npy"):
        open_tile(results, 5)
    done = len(tiles_in(results))
    report = estimate_file(files, tmp_path / "out.ply", resume=True, **OPTIONS, **given)
    assert report["damaged_tiles"] == [5]
    assert report["computed_tiles"] == TILES - done + 1
    assert_same_as_in_memory(report, *clean(), **GIVEN)


def test_what_a_killed_process_leaves_is_no_result(files, tmp_path):
    given = {"options": FitOptions(**GIVEN)}
    results = interrupted(files, tmp_path / "out.ply", 3, **given)
    done = tiles_in(results)
    tile_path(results, 7).with_name(".0123456789abcdef.npy").write_bytes(b"NUMPY")
    tile_path(results, 8).touch()
    report = estimate_file(files, tmp_path / "out.ply", resume=True, **OPTIONS, **given)
    assert report["computed_tiles"] == TILES - len(done)
    assert_same_as_in_memory(report, *clean(), **GIVEN)


def test_other_parameters_have_other_results(files, tmp_path):
    interrupted(files, tmp_path / "out.ply", 6)
    options = FitOptions(alpha=0.7)
    report = estimate_file(files, tmp_path / "out.ply", resume=True, options=options, **OPTIONS)
    assert report["computed_tiles"] == TILES
    assert_same_as_in_memory(report, *clean(), alpha=0.7)


def test_smoothing_goes_on_at_the_step_it_was_in(files, tmp_path):
    def progress(stage, done, total):
        return not (stage == "step 2" and done >= 4)

    with pytest.raises(CancelledError):
        smooth_file(files, tmp_path / "out.ply", "paper", iterations=3, progress=progress, **OPTIONS)
    report = smooth_file(files, tmp_path / "out.ply", "paper", iterations=3, resume=True, **OPTIONS)
    assert TILES < report["computed_tiles"] < 2 * TILES
    smooth_file(files, tmp_path / "whole.ply", "paper", iterations=3, **OPTIONS)
    assert (tmp_path / "out.ply").read_bytes() == (tmp_path / "whole.ply").read_bytes()


def test_a_store_of_another_mesh_is_refused(files, tmp_path):
    given = {"options": FitOptions(**GIVEN)}
    interrupted(files, tmp_path / "out.ply", 2, **given)
    np.save(files[0], noisy()[0])
    with pytest.raises(FieldFileError, match="changed since"):
        estimate_file(files, tmp_path / "out.ply", resume=True, **OPTIONS, **given)
    with pytest.raises(InvalidParameterError, match="resume the run, or remove the folder"):
        estimate_file(files, tmp_path / "out.ply", **OPTIONS, **given)


@pytest.mark.parametrize("name", ["vertices.bin", "order.bin", "rank.bin", "faces.bin", "face_ptr.npy"])
@pytest.mark.parametrize("damage", ["cut short", "empty", "missing"])
def test_a_store_that_is_damaged_is_named(name, damage, files, tmp_path):
    given = {"options": FitOptions(**GIVEN)}
    interrupted(files, tmp_path / "out.ply", 2, **given)
    path = tmp_path / "out.ply.tiles" / name
    if damage == "missing":
        path.unlink()
    else:
        os.truncate(path, 0 if damage == "empty" else path.stat().st_size - 16)
    with pytest.raises(FieldFileError, match=rf"{name} is damaged or missing; remove the folder$"):
        estimate_file(files, tmp_path / "out.ply", resume=True, **OPTIONS, **given)


@pytest.mark.parametrize("name", ["vertices.bin", "order.bin", "rank.bin", "faces.bin", "face_ptr.npy", "store.json"])
def test_a_flipped_byte_in_a_store_is_found(name, files, tmp_path):
    given = {"options": FitOptions(**GIVEN)}
    interrupted(files, tmp_path / "out.ply", 2, **given)
    path = tmp_path / "out.ply.tiles" / name
    data = bytearray(path.read_bytes())
    place = data.index(b'"scale": ') + 11 if name == "store.json" else len(data) // 2
    data[place] ^= 1
    path.write_bytes(data)
    with pytest.raises(FieldFileError, match=rf"{name} is damaged"):
        estimate_file(files, tmp_path / "out.ply", resume=True, **OPTIONS, **given)
    assert not (tmp_path / "out.ply").exists()


def test_a_source_that_changed_in_the_middle_is_another_one(tmp_path):
    """Under its old time and size, and far from both ends."""
    vertices = np.random.default_rng(0).normal(size=(200_000, 3))
    files = save_arrays(tmp_path, vertices, np.array([[0, 1, 2]]))
    before, status = open_source(files).fingerprint(), files[0].stat()
    with files[0].open("r+b") as stream:
        stream.seek(status.st_size // 2)
        stream.write(b"!")
    os.utime(files[0], ns=(status.st_atime_ns, status.st_mtime_ns))
    assert open_source(files).fingerprint() != before


def test_other_tiles_are_refused(files, tmp_path):
    given = {"options": FitOptions(**GIVEN)}
    interrupted(files, tmp_path / "out.ply", 2, **given)
    with pytest.raises(InvalidParameterError, match=r"^tile_vertices: got 512, .* has tiles of 256"):
        estimate_file(files, tmp_path / "out.ply", resume=True, **given, **OPTIONS | {"tile_vertices": 512})
    report = estimate_file(files, tmp_path / "out.ply", resume=True, **given, **OPTIONS | {"tile_vertices": None})
    assert (report["tile_vertices"], report["computed_tiles"] < report["tiles"]) == (256, True)


@pytest.mark.parametrize("resume", [False, True])
def test_a_folder_with_something_else_is_left_alone(resume, files, tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "cat.jpg").write_bytes(b"cat")
    with pytest.raises(InvalidParameterError, match="choose another folder"):
        estimate_file(files, tmp_path / "out.ply", store=folder, resume=resume, **OPTIONS)
    assert (folder / "cat.jpg").read_bytes() == b"cat"


def test_a_tile_is_written_whole_or_not_at_all(tmp_path):
    report = TileReport(7, 8, {"edges": [3.0]})
    write_tile(tmp_path, report, np.arange(6.0))
    found = open_tile(tmp_path, 7)
    assert found.rows()[2:5].tolist() == [2.0, 3.0, 4.0]
    assert found.report == report
    with pytest.raises(TypeError):  # a report that JSON does not know
        write_tile(tmp_path, replace(report, sums={"edges": object()}), np.zeros(6))
    assert open_tile(tmp_path, 7).rows()[5] == 5.0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["tile-000007.json", "tile-000007.npy"]


def test_what_would_fail_in_the_end_is_refused_at_once(files, tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no directory"):
        estimate_file(files, tmp_path / "nowhere" / "out.ply", **OPTIONS)
    source = open_source(files)
    huge = replace(source, vertex_rows=replace(source.vertex_rows, rows=10**12))
    with pytest.raises(InvalidParameterError, match=r"^store: .* GB are needed below .* GB are free"):
        check_room(huge, tmp_path / "store", tmp_path / "out.ply", 200, 200)
    assert sorted(tmp_path.iterdir()) == sorted(files)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_stopped_command_goes_on_where_it_was(number, tmp_path):
    star = bumpy_star(resolution=80)
    vertices, faces = save_arrays(tmp_path, star.vertices, star.faces)
    command = [sys.executable, "-m", "bezier_filters", "scale", "curvature", vertices, tmp_path / "out.ply"]
    command += ["--faces", faces, "--tile-vertices", "256", "--workers", "2", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 120
    while len(list(tmp_path.glob("*.tiles/results-*/tile-*.json"))) < 20 and time.monotonic() < end:
        time.sleep(0.01)
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    if number == signal.SIGINT:
        assert process.returncode == 2
        assert "give --resume to go on" in said.splitlines()[-1]
    assert not (tmp_path / "out.ply").exists()
    time.sleep(2.0)  # workers notice that they are alone
    done = len(list(tmp_path.glob("*.tiles/results-*/tile-*.json")))
    output = subprocess.run([*command, "--resume"], capture_output=True, text=True, check=True).stdout
    report = json.loads(output)
    assert report["computed_tiles"] == report["tiles"] - done < report["tiles"]
    assert_same_as_in_memory(report, star.vertices, star.faces)


@pytest.mark.slow
@pytest.mark.parametrize("where", [None, "processes"])
def test_a_task_that_ends_its_workers_is_named(where):
    def end(status, task):
        if task == 5:
            os._exit(status)
        return task

    with (
        start_workers(where, workers=2, memory_limit=None) as cluster,
        pytest.raises(LostTaskError, match=r"task 5|5, 6"),
    ):
        list(run_tasks(cluster.ready(), partial(end, 1), range(8), workers=2))


def test_a_killed_worker_changes_nothing(files, tmp_path):
    import distributed

    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        pids = client.run(os.getpid)
        victim = next(iter(pids.values()))

        def progress(stage, done, total):
            if stage == "fit" and done == 2:
                os.kill(victim, signal.SIGKILL)

        options = OPTIONS | {"scheduler": cluster.scheduler_address}
        report = estimate_file(files, tmp_path / "out.ply", progress=progress, keep_store=True, **options)
        with pytest.raises(ProcessLookupError):
            os.kill(victim, 0)
    assert report["tiles"] == report["computed_tiles"] == TILES
    assert_same_as_in_memory(report, *clean())
    (results,) = (tmp_path / "out.ply.tiles").glob("results-*")
    workers = {open_tile(results, tile).report.process for tile in range(TILES)}
    assert workers - {victim}
    assert os.getpid() not in workers


def test_damaged_headers_of_tiles_are_noticed_or_read_all_the_same(tmp_path):
    """A quote or a bracket that is lost makes other errors of NumPy than a wrong number; blanks do not matter."""
    rows, noticed = np.zeros(300, dtype=[("x", "f8"), ("y", "f8")]), 0
    write_tile(tmp_path, TileReport(0, 300, {}), rows)
    path, data = tile_path(tmp_path, 0), tile_path(tmp_path, 0).read_bytes()
    for place in range(128):
        for bit in range(8):
            damaged = bytearray(data)
            damaged[place] ^= 1 << bit
            path.write_bytes(bytes(damaged))
            try:
                np.testing.assert_array_equal(open_tile(tmp_path, 0).rows(), rows)
            except DamagedTileError:
                noticed += 1
    assert noticed > 500
