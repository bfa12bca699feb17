"""Stores, sources and targets at URLs give what local files give."""

import dataclasses
from pathlib import Path

import fsspec
import numpy as np
import pytest
from scale_cases import assert_same_as_in_memory, clean, in_memory, noisy, save_arrays, shuffled
from typer.testing import CliRunner

from bezier_filters.cli.commands import app
from bezier_filters.errors import CancelledError, FieldFileError, InvalidParameterError
from bezier_filters.scale import FitOptions, estimate_file, smooth_file
from bezier_filters.scale.array_file import save_array
from bezier_filters.scale.remote import RemotePath, locate
from bezier_filters.scale.tiles import DamagedTileError, open_tile, tile_path

GIVEN = {"rings": 2, "alpha": 0.8}  # fits that need not be chosen
OPTIONS = {"scheduler": "threads", "workers": 2, "tile_vertices": 256}


@pytest.fixture
def memory():
    """The file system of fsspec in this process, emptied at the end."""
    found = fsspec.filesystem("memory")
    yield found
    found.rm("/", recursive=True)


@pytest.mark.parametrize("given", [GIVEN, pytest.param({}, marks=pytest.mark.slow)])
def test_tiles_in_memory_give_the_values_of_local_ones(given, memory, tmp_path):
    vertices, faces = shuffled(*noisy())
    files = save_arrays(tmp_path, vertices, faces)
    how = {"options": FitOptions(**given), "store": "memory://bucket/tiles"} | OPTIONS
    report = estimate_file(files, tmp_path / "out.ply", **how)
    assert_same_as_in_memory(report, vertices, faces, **given)
    assert not memory.exists("/bucket/tiles")  # removed at the end
    assert sorted(path.name for path in tmp_path.iterdir()) == ["faces.npy", "out.ply", "vertices.npy"]


def test_source_and_target_may_be_remote(memory, tmp_path):
    files = save_arrays(tmp_path, *clean())
    for path in files:
        memory.put_file(str(path), f"/bucket/{path.name}")
    urls = [f"memory://bucket/{path.name}" for path in files]
    given = {"options": FitOptions(**GIVEN)} | OPTIONS
    report = estimate_file(urls, "memory://bucket/out.ply", **given)
    assert report["output"] == "memory://bucket/out.ply"
    assert sorted(memory.ls("/bucket", detail=False)) == [
        "/bucket/faces.npy",
        "/bucket/out.ply",
        "/bucket/vertices.npy",
    ]
    memory.get_file("/bucket/out.ply", str(tmp_path / "out.ply"))
    assert_same_as_in_memory(report | {"output": tmp_path / "out.ply"}, *clean(), **GIVEN)
    # and a PLY file as source
    again = estimate_file("memory://bucket/out.ply", tmp_path / "again.ply", **given)
    assert (tmp_path / "again.ply").read_bytes() == (tmp_path / "out.ply").read_bytes()
    assert again["status"] == in_memory(*clean(), **GIVEN).status_counts()
    arguments = ["scale", "curvature", "memory://bucket/out.ply", "memory://bucket/command.ply", "--rings", "2"]
    arguments += ["--alpha", "0.8", "--scheduler", "threads", "--tile-vertices", "512"]
    shown = CliRunner().invoke(app, [*arguments, "--store", "memory://bucket/tiles"])
    assert shown.exception is None
    assert "memory://bucket/command.ply" in shown.stdout
    assert memory.cat_file("/bucket/command.ply") == memory.cat_file("/bucket/out.ply")
    with pytest.raises(InvalidParameterError, match=r"^target: memory://bucket/out.ply is the source"):
        estimate_file("memory://bucket/out.ply", "memory://bucket/out.ply", **given)


@pytest.mark.parametrize("method", ["paper", pytest.param("auto", marks=pytest.mark.slow)])
def test_smoothing_in_a_remote_store_is_that_in_a_local_one(method, memory, tmp_path):
    files, how = save_arrays(tmp_path, *noisy()), {"iterations": 2} | OPTIONS
    local = smooth_file(files, tmp_path / "local.ply", method, **how)
    remote = smooth_file(files, tmp_path / "remote.ply", method, store="memory://bucket/tiles", **how)
    assert (tmp_path / "local.ply").read_bytes() == (tmp_path / "remote.ply").read_bytes()
    assert local["rounds"] == remote["rounds"] > 1


def test_a_remote_store_is_resumed_and_its_damage_found(memory, tmp_path):
    files = save_arrays(tmp_path, *clean())
    given = {"options": FitOptions(**GIVEN), "store": "memory://bucket/tiles"} | OPTIONS

    def progress(stage, done, total):
        return not (stage == "fit" and done >= 8)

    with pytest.raises(CancelledError):
        estimate_file(files, tmp_path / "out.ply", progress=progress, **given)
    with pytest.raises(InvalidParameterError, match=r"^store: memory://bucket/tiles exists already; resume"):
        estimate_file(files, tmp_path / "out.ply", **given)
    (results,) = (RemotePath(f"memory:/{path}") for path in memory.glob("/bucket/tiles/results-*"))
    path = tile_path(results, 5)
    data = bytearray(path.read_bytes())
    data[-3] ^= 1
    memory.pipe_file(path.url.removeprefix("memory:/"), bytes(data))
    with pytest.raises(DamagedTileError, match=r"tile 5 .*memory://bucket/tiles/results-.*/tile-000005\.npy"):
        open_tile(results, 5)
    report = estimate_file(files, tmp_path / "out.ply", resume=True, keep_store=True, **given)
    assert report["damaged_tiles"] == [5]
    assert 0 < report["computed_tiles"] < report["tiles"]
    assert_same_as_in_memory(report, *clean(), **GIVEN)
    store = memory.cat_file("/bucket/tiles/order.bin")
    memory.pipe_file("/bucket/tiles/order.bin", store[:-4])
    with pytest.raises(FieldFileError, match=r"order\.bin is damaged or missing"):
        estimate_file(files, tmp_path / "out.ply", resume=True, **given)


def test_rows_are_taken_from_remote_files_as_from_local_ones(memory, tmp_path):
    """Also rows that are too far apart to be read together."""
    rng = np.random.default_rng(0)
    values = rng.normal(size=(40_000, 3))
    local, remote = (save_array(folder / "v.bin", values) for folder in (tmp_path, RemotePath("memory://bucket")))
    for ids in (rng.integers(0, len(values), 500), np.arange(30), np.array([39_999, 0, 0]), np.zeros(0, int)):
        assert np.array_equal(local.take(ids.astype(np.int32)), values[ids])
        assert np.array_equal(remote.take(ids.astype(np.int32)), values[ids])
    short = dataclasses.replace(remote, rows=50_000)
    for read in (lambda: short.read(39_990, 40_010), lambda: short.take(np.array([45_000], np.int32))):
        with pytest.raises(FieldFileError, match="cut short"):
            read()


def test_a_missing_package_is_named_with_its_extra(tmp_path):
    files = save_arrays(tmp_path, *clean())
    try:
        import s3fs  # noqa: F401
    except ImportError:
        with pytest.raises(InvalidParameterError, match=r'^store: .*needs .*pip install "bezier-filters\[s3\]"'):
            estimate_file(files, tmp_path / "out.ply", store="s3://bucket/tiles", **OPTIONS)
    with pytest.raises(InvalidParameterError, match=r"^target: cannot use nowhere://out.ply"):
        estimate_file(files, "nowhere://out.ply", **OPTIONS)
    assert locate("a/b.ply") == Path("a/b.ply")
    assert sorted(tmp_path.iterdir()) == sorted(files)
