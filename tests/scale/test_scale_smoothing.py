"""The automatic smoothing in tiles moves vertices as in memory, but for a hundredth of the noise."""

import contextlib
import json
import os
import shutil
import signal
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import config
from scale_cases import MESHES, clean, pipe, save_arrays, shuffled
from typer.testing import CliRunner

from bezier_filters import InvalidParameterError, read_fields, smooth
from bezier_filters.cli.commands import app
from bezier_filters.errors import CancelledError
from bezier_filters.meshes.adjacency import incoherent_vertices, vertex_adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.sampling import mesh_parts
from bezier_filters.sampling.mesh_parts import MAX_WHOLE_VERTICES, PART_CORE_VERTICES, PART_VERTICES
from bezier_filters.scale import FitOptions, learn, smooth_file
from bezier_filters.scale.components import label_vertices, merge_components
from bezier_filters.scale.halo import tile_part
from bezier_filters.scale.learn import sample_store_parts
from bezier_filters.scale.source import open_source
from bezier_filters.scale.store import build_store
from bezier_filters.scale.tiles import TileReport, open_tile, tile_path, write_tile
from bezier_filters.smoothing.volume import ClosedComponents
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, sphere, torus, waves

pytestmark = pytest.mark.slow

compiled = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")
HOW = {"scheduler": "synchronous", "workers": 1}


def with_noise(vertices, faces, amount=0.2):
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    return vertices + np.random.default_rng(5).normal(scale=amount * edge, size=vertices.shape), faces


def star(resolution):
    surface = bumpy_star(resolution=resolution, jitter=0.2)
    return surface.vertices, surface.faces


def sheet(resolution):
    surface = waves(resolution=resolution)
    return surface.vertices, surface.faces


def several():
    """A block, a ball, a sheet and a lonely vertex, in any order."""
    block, faces = block_with_sharp_edges(resolution=12, jitter=0.2)
    ball, waved = bumpy_star(resolution=10), waves(resolution=14)
    n = len(block), len(block) + len(ball.vertices)
    vertices = np.vstack([block, ball.vertices + np.array([3, 0, 0]), waved.vertices - 4.0, [[9.0, 9.0, 9.0]]])
    return shuffled(*with_noise(vertices, np.vstack([faces, ball.faces + n[0], waved.faces + n[1]])))


def many_components():
    """Sixty small closed surfaces, in any order."""
    vertices, faces, n = [], [], 0
    for k in range(60):
        surface = bumpy_star(resolution=8 + k % 4) if k % 3 else sphere(resolution=6 + k % 5, jitter=0.2)
        vertices.append(surface.vertices + np.array([3 * (k % 8), 3 * (k // 8), 0]))
        faces.append(surface.faces + n)
        n += len(surface.vertices)
    return shuffled(*with_noise(np.vstack(vertices), np.vstack(faces)))


def ball():
    """A small one of two tiles."""
    surface = sphere(resolution=10, jitter=0.2)
    return with_noise(surface.vertices, surface.faces)


def far_away():
    vertices, faces = with_noise(*clean())
    return vertices + np.array([1e3, -2e3, 5e2]), faces


CASES = MESHES | {
    "several": several,
    "star": lambda: with_noise(*star(48)),
    "noisy sheet": lambda: shuffled(*with_noise(*sheet(150))),
    "block": lambda: with_noise(*block_with_sharp_edges(resolution=48, jitter=0.2)),
    "large block": lambda: with_noise(*block_with_sharp_edges(resolution=130, jitter=0.2)),
    "many": many_components,
    "pipe": lambda: with_noise(*pipe(12, 5200)),
    "short pipe": lambda: with_noise(*pipe(12, 700)),
    "far away": far_away,
    "large": lambda: with_noise(*star(120)),
}
QUICK = {"several": 1024, "clean": 1024, "short pipe": 1024}
SLOW = {
    "pipe": 8192,
    "noisy": 512,
    "shuffled": 512,
    "open": 512,
    "broken": 512,
    "far away": 512,
    "star": 2048,
    "noisy sheet": 2048,
    "block": 2048,
    "many": 1024,
    "large": 30_000,
    "large block": 20_000,
}


def assert_close(found, expected, most):
    """Numbers that hardly differ, or are both missing."""
    assert (found is None) == (expected is None)
    assert expected is None or abs(found - expected) <= most


def assert_near(report, expected, most=0.01, on_average=0.001):
    """A hundredth of the noise at any vertex, a thousandth in the root mean square, and what is told."""
    target, sigma = report["output"], expected.noise_before or 1e-12
    fields, found = read_fields(target), open_source(target).vertices(0, len(expected.vertices))
    apart = np.linalg.norm(found - expected.vertices, axis=1) / sigma
    assert apart.max() <= most
    assert np.sqrt(np.square(apart).mean()) <= on_average
    assert np.abs(fields["bz_displacement"] - expected.displacement).max() <= most * sigma
    assert np.array_equal(fields["quality"], fields["bz_displacement"])
    assert np.abs(fields["bz_sharpness"] - expected.sharpness).max() <= 0.01
    # tiles add up the samples in another order, and the search for the covariance amplifies that: 5e-9 on one processor
    assert_close(report["noise"]["before"], expected.noise_before, 1e-7 * sigma)
    assert_close(report["noise"]["after"], expected.noise_after, 0.005 * sigma)
    for when in ("before", "after"):
        volume = getattr(expected, f"volume_{when}")
        assert_close(report["volume"][when], volume, 1e-3 * most * abs(volume or 0.0))
    assert report["faces"]["flipped before"] == expected.flipped_before
    assert report["faces"]["flipped after"] == expected.flipped_after
    assert report["faces"]["new"] == expected.new_bad_faces == 0


@compiled
@pytest.mark.parametrize(
    ("name", "tile"),
    [*QUICK.items(), *(pytest.param(name, tile, marks=pytest.mark.slow) for name, tile in SLOW.items())],
)
def test_vertices_move_as_in_memory(name, tile, tmp_path):
    vertices, faces = CASES[name]()
    files = save_arrays(tmp_path, vertices, faces)
    report = smooth_file(files, tmp_path / "out.ply", tile_vertices=tile, **HOW)
    expected = smooth(vertices, faces)
    assert_near(report, expected)
    assert (expected.max_displacement > 0.0) == (name not in ("clean", "open"))  # "broken" moves by 0.06 of its noise
    assert sorted(path.name for path in tmp_path.iterdir()) == ["faces.npy", "out.ply", "vertices.npy"]


@compiled
@pytest.mark.slow
def test_errors_next_to_borders_of_tiles_are_no_larger_than_inside(tmp_path):
    """Distances from the true torus, whose tiles have their rings around them and not all of it."""
    ring = torus(resolution=200, jitter=0.2)
    rng = np.random.default_rng(0)
    edge = np.linalg.norm(ring.vertices[ring.faces[:, 0]] - ring.vertices[ring.faces[:, 1]], axis=1).mean()
    vertices = ring.vertices + 0.2 * edge * rng.standard_normal((len(ring.vertices), 1)) * ring.normals
    files, target = save_arrays(tmp_path, vertices, ring.faces), tmp_path / "out.ply"
    report = smooth_file(files, target, tile_vertices=16_384, keep_store=True, **HOW)
    assert report["halo"] < report["tiles"] - 1.0
    assert_near(report, smooth(vertices, ring.faces))
    found = open_source(target).vertices(0, len(vertices))
    errors = np.einsum("ij,ij->i", found - ring.vertices, ring.normals)
    tile = np.fromfile(f"{target}.tiles/rank.bin", dtype=np.int32)[ring.faces] // report["tile_vertices"]
    near = np.zeros(len(vertices), dtype=bool)
    near[ring.faces[(tile != tile[:, :1]).any(axis=1)]] = True
    for _ in range(3):
        near[ring.faces[near[ring.faces].any(axis=1)]] = True
    assert 0.02 < near.mean() < 0.5
    assert np.sqrt(np.square(errors[near]).mean()) < 1.1 * np.sqrt(np.square(errors[~near]).mean())


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        pytest.param(np.eye(3), [[0, 1, 2]], id="one face"),
        pytest.param(np.ones((300, 3)), np.random.default_rng(0).integers(0, 300, (500, 3)), id="all in one place"),
        pytest.param(np.eye(300, 3), np.zeros((9, 3), dtype=int), id="no face with three corners"),
    ],
)
def test_what_is_hardly_a_mesh_is_as_in_memory(vertices, faces, tmp_path):
    files = save_arrays(tmp_path, vertices, np.array(faces))
    report = smooth_file(files, tmp_path / "out.ply", tile_vertices=256, noise=0.1, **HOW)
    assert_near(report, smooth(vertices, faces, noise=0.1))


@compiled
@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"iterations": 2},
        {"noise": 0.02},
        {"noise": 0.02, "detail": 0.3},
        {"borders": "fixed", "keep_volume": False},
        {"noise": 0.0},
    ],
)
def test_options_do_what_they_do_in_memory(options, tmp_path):
    vertices, faces = several()
    files = save_arrays(tmp_path, vertices, faces)
    report = smooth_file(files, tmp_path / "out.ply", tile_vertices=1024, **HOW, **options)
    assert_near(report, smooth(vertices, faces, **options))


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), tile=st.integers(256, 600))
def test_closed_components_are_those_in_memory(seed, tile, tmp_path_factory):
    vertices, faces = several()
    rng, folder = np.random.default_rng(seed), tmp_path_factory.mktemp("store")
    faces = faces[rng.random(len(faces)) > rng.choice([0.0, 1e-3, 0.3])]
    mesh = triangle_mesh(*shuffled(vertices, faces))
    store = build_store(open_source(save_arrays(folder, mesh.vertices, mesh.faces)), folder, tile)
    tiles = []
    for k in range(store.layout.tile_count):
        part = tile_part(store, k, 1)
        adjacency = vertex_adjacency(part.mesh)
        assert not incoherent_vertices(part.mesh.faces, adjacency)[part.own].any()
        write_tile(folder, TileReport(k, len(part.ids), {}), label_vertices(part, adjacency))
        tiles.append(open_tile(folder, k))
    found, expected = merge_components(store, tiles), ClosedComponents.locate(prepare_mesh(mesh))
    if not expected.count:
        assert found is None
        return
    assert found.count == expected.count
    numbers = found.of_vertex.read(0, len(vertices))[store.rank.read(0, len(vertices))]
    assert np.array_equal(numbers < 0, expected.of_vertex < 0)
    pairs = np.unique(np.column_stack([numbers, expected.of_vertex]), axis=0)
    assert len(pairs) == expected.count + (numbers < 0).any()  # the same, in another order
    ids = np.arange(len(vertices), dtype=np.int32)
    local, there = found.select(ids[100:300])
    assert np.array_equal(np.append(there, -1)[local.of_vertex], found.of_vertex.read(100, 300))
    assert all((store.coordinates(0, len(vertices)) == origin).all(axis=1).any() for origin in local.origins)


@pytest.mark.parametrize("shape", ["star", "pieces", "pipe"])
@pytest.mark.parametrize("size", [600, pytest.param(PART_VERTICES, marks=[compiled, pytest.mark.slow])])
def test_sampled_parts_are_those_in_memory(size, shape, tmp_path, monkeypatch):
    """Also where a mesh falls into many small pieces, so that parts go on and on, or is long and thin."""
    vertices, faces = star(80 if size == PART_VERTICES else 24)
    if shape == "pieces":
        faces = faces[np.random.default_rng(0).random(len(faces)) < 0.2]
    elif shape == "pipe":
        vertices, faces = pipe(12, 5200) if size == PART_VERTICES else pipe(3, 1800)
    mesh = triangle_mesh(*shuffled(vertices, faces))
    monkeypatch.setattr(mesh_parts, "PART_CORE_VERTICES", PART_CORE_VERTICES * size // PART_VERTICES)
    monkeypatch.setattr(mesh_parts, "MAX_WHOLE_VERTICES", MAX_WHOLE_VERTICES * size // PART_VERTICES)
    for module in (mesh_parts, learn):
        monkeypatch.setattr(module, "PART_VERTICES", size)
    monkeypatch.setattr(learn, "INITIAL_RINGS", 64 if size == PART_VERTICES else 6)
    assert mesh.vertex_count > MAX_WHOLE_VERTICES * size // PART_VERTICES
    store = build_store(
        open_source(save_arrays(tmp_path, mesh.vertices, mesh.faces)), tmp_path, 8192 * size // PART_VERTICES
    )
    expected, found = mesh_parts.sample_parts(prepare_mesh(mesh), (17,)), sample_store_parts(store, (17,))
    assert np.array_equal(found.core, expected.core)
    assert len(found.ids) < found.vertex_count == mesh.vertex_count
    for one, other in zip(
        (found.ids, found.cut, found.mesh.vertices, found.mesh.faces),
        (expected.ids, expected.cut, expected.mesh.vertices, expected.mesh.faces),
        strict=True,
    ):
        assert np.array_equal(one, other)


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A folder with a run that was stopped before the result was written."""
    folder = tmp_path_factory.mktemp("stopped")

    def progress(name, done, total):
        return name != "write"

    with pytest.raises(CancelledError):
        smooth_file(save_arrays(folder, *ball()), folder / "out.ply", tile_vertices=512, progress=progress, **HOW)
    assert not (folder / "out.ply").exists()
    return folder


@cache
def smoothed_ball():
    return smooth(*ball())


@compiled
@pytest.mark.parametrize("stage", ["measure", "smooth", "finish"])
def test_a_run_goes_on_in_the_round_it_was_in(stage, stopped, tmp_path):
    """Only what is not there is computed, and a tile that was damaged, in whatever round."""
    folder = shutil.copytree(stopped, tmp_path / "run")
    files, target = (folder / "vertices.npy", folder / "faces.npy"), folder / "out.ply"
    folders = {"measure": "measure-1-1", "smooth": "smooth-1-1", "finish": "finish"}
    (results,) = folder.glob(f"out.ply.tiles/results-*/{folders[stage]}")
    damaged = tile_path(results, 1)
    damaged.write_bytes(damaged.read_bytes()[:-8])
    report = smooth_file(files, target, resume=True, **HOW)
    assert report["damaged_tiles"] == [1]
    assert (report["computed_tiles"], report["rounds"]) == (1, 3)
    assert_near(report, smoothed_ball())
    assert not results.exists()


@compiled
@pytest.mark.slow
def test_a_killed_worker_changes_nothing(tmp_path):
    import distributed

    vertices, faces = several()
    files, target = save_arrays(tmp_path, vertices, faces), tmp_path / "out.ply"
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        victim = next(iter(client.run(os.getpid).values()))

        def progress(stage, done, total):
            if stage == "smooth" and done == 1:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGKILL)

        how = {"scheduler": cluster.scheduler_address, "progress": progress}
        report = smooth_file(files, target, tile_vertices=512, **how)
        with pytest.raises(ProcessLookupError):
            os.kill(victim, 0)
    assert_near(report, smooth(vertices, faces))


@compiled
def test_the_command_line_smooths(tmp_path):
    vertices, faces = save_arrays(tmp_path, *ball())
    arguments = ["scale", "smooth", vertices, tmp_path / "out.ply", "--faces", faces, "--scheduler", "synchronous"]
    result = CliRunner().invoke(app, [*map(str, arguments), "--noise", "0.0", "--borders", "fixed", "--json"])
    assert result.exception is None
    assert_near(json.loads(result.stdout), smooth(np.load(vertices), np.load(faces), noise=0.0, borders="fixed"))


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"method": "taubin"}, "method"),
        ({"iterations": 0}, "iterations"),
        ({"noise": -1.0}, "noise"),
        ({"noise": 0.1, "method": "paper"}, "noise"),
        ({"borders": "free"}, "borders"),
        ({"options": FitOptions()}, "options"),
        ({"method": "paper", "borders": "fixed"}, "borders, keep_volume"),
        ({"method": "paper", "options": FitOptions(rings=0)}, "rings"),
        ({"tile_vertices": 8}, "tile_vertices"),
    ],
)
def test_bad_parameters_are_named_and_leave_nothing(arguments, name, tmp_path):
    files = save_arrays(tmp_path, *clean())
    with pytest.raises(InvalidParameterError, match=f"^{name}: "):
        smooth_file(files, tmp_path / "out.ply", **HOW | arguments)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["faces.npy", "vertices.npy"]
