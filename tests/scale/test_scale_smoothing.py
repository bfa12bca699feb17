"""The automatic smoothing in tiles gives the vertices that it gives in memory, to the last bit."""

import contextlib
import json
import os
import signal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import config
from scale_cases import MESHES, clean, open_sheet, save_arrays, shuffled
from typer.testing import CliRunner

from bezier_filters import InvalidParameterError, read_fields, smooth
from bezier_filters.cli.commands import app
from bezier_filters.errors import CancelledError
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.scale import FitOptions, smooth_file
from bezier_filters.scale import sampled_parts as scale_parts
from bezier_filters.scale.connections import cluster_centers, label_parts, neighbours_of
from bezier_filters.scale.partition import build_store
from bezier_filters.scale.sampled_parts import sampled_parts_of
from bezier_filters.scale.source import open_source
from bezier_filters.smoothing import mesh_parts
from bezier_filters.smoothing.clusters import clusters_of
from bezier_filters.smoothing.mesh_parts import CORE, LARGEST_WHOLE, PART
from bezier_filters.smoothing.whole_mesh import WholeMesh
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, sphere, waves

compiled = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")
HOW = {"scheduler": "synchronous", "workers": 1}


def with_noise(vertices, faces, amount=0.2):
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    return vertices + np.random.default_rng(5).normal(scale=amount * edge, size=vertices.shape), faces


def several():
    """A block, a ball, a sheet and a lonely vertex, in any order."""
    block, faces = block_with_sharp_edges(resolution=12, jitter=0.2)
    star, sheet = bumpy_star(resolution=10), waves(resolution=14)
    n = len(block), len(block) + len(star.vertices)
    vertices = np.vstack([block, star.vertices + np.array([3, 0, 0]), sheet.vertices - 4.0, [[9.0, 9.0, 9.0]]])
    return shuffled(*with_noise(vertices, np.vstack([faces, star.faces + n[0], sheet.faces + n[1]])))


def ball():
    """A small one of two tiles."""
    surface = sphere(resolution=10, jitter=0.2)
    return with_noise(surface.vertices, surface.faces)


def far_away():
    vertices, faces = with_noise(*clean())
    return vertices + np.array([1e3, -2e3, 5e2]), faces


CASES = MESHES | {
    "several": several,
    "sharp": lambda: with_noise(*block_with_sharp_edges(resolution=16, jitter=0.2)),
    "noisy sheet": lambda: shuffled(*with_noise(*open_sheet())),
    "far away": far_away,
    "large": lambda: with_noise(*(lambda s: (s.vertices, s.faces))(bumpy_star(resolution=80, jitter=0.2))),
}
QUICK = {"several": 1024, "clean": 1024}
SLOW = {name: 512 for name in CASES if name not in ("clean", "large")} | {"large": 20_000}


def assert_same(report, expected):
    """Coordinates and columns, and all that is told."""
    target = report["output"]
    fields = read_fields(target)
    assert np.array_equal(open_source(target).vertices(0, len(expected.vertices)), expected.vertices)
    assert np.array_equal(fields["bz_displacement"], expected.displacement)
    assert np.array_equal(fields["quality"], expected.displacement)
    assert np.array_equal(fields["bz_sharpness"], expected.sharpness)
    assert report["noise"] == {"before": expected.noise_before, "after": expected.noise_after}
    assert report["volume"] == {"before": expected.volume_before, "after": expected.volume_after}
    assert report["faces"]["flipped before"] == expected.flipped_before
    assert report["faces"]["flipped after"] == expected.flipped_after
    assert report["faces"]["new"] == expected.new_bad_faces == 0


@compiled
@pytest.mark.parametrize(
    ("name", "tile"),
    [*QUICK.items(), *(pytest.param(name, tile, marks=pytest.mark.slow) for name, tile in SLOW.items())],
)
def test_vertices_are_those_in_memory_to_the_last_bit(name, tile, tmp_path):
    vertices, faces = CASES[name]()
    files = save_arrays(tmp_path, vertices, faces)
    report = smooth_file(files, tmp_path / "out.ply", tile_vertices=tile, **HOW)
    expected = smooth(vertices, faces)
    assert_same(report, expected)
    assert (expected.max_displacement > 0.0) == (name not in ("clean", "open", "broken"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["faces.npy", "out.ply", "vertices.npy"]


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
    assert_same(report, smooth(vertices, faces, noise=0.1))


@compiled
@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [{"iterations": 2}, {"noise": 0.02}, {"borders": "fixed", "keep_volume": False}, {"noise": 0.0}],
)
def test_options_do_what_they_do_in_memory(options, tmp_path):
    vertices, faces = several()
    files = save_arrays(tmp_path, vertices, faces)
    report = smooth_file(files, tmp_path / "out.ply", tile_vertices=1024, **HOW, **options)
    assert_same(report, smooth(vertices, faces, **options))


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), tile=st.integers(256, 600), crumpled=st.booleans())
def test_clusters_and_closed_parts_are_those_in_memory(seed, tile, crumpled, tmp_path_factory):
    vertices, faces = several()
    rng, folder = np.random.default_rng(seed), tmp_path_factory.mktemp("store")
    faces = faces[rng.random(len(faces)) > rng.choice([0.0, 1e-3])]
    if crumpled:
        faces = np.concatenate([faces, rng.integers(0, len(vertices), (20, 3))]).astype(np.int32)
    mesh = triangle_mesh(*shuffled(vertices, faces))
    store = build_store(open_source(save_arrays(folder, mesh.vertices, mesh.faces)), folder, tile)
    adjacency, neighbours = vertex_adjacency(mesh), neighbours_of(store)
    expected, ranks = clusters_of(adjacency), store.rank.read(0, len(vertices))
    rows = cluster_centers(store, neighbours).read(0, len(vertices))[ranks]
    assert np.array_equal(rows["label"], expected.centers[expected.of_vertex])
    is_open = np.zeros(len(vertices), dtype=bool)
    is_open[ranks] = adjacency.on_boundary | (adjacency.vertices.lengths == 0)
    parts, firsts = label_parts(store, neighbours, is_open, folder / "parts.bin")
    if not crumpled:
        whole = WholeMesh(mesh, adjacency).closed_parts()
        assert np.array_equal(parts.read(0, len(vertices))["part"][ranks], whole.of_vertex["part"])
        assert np.array_equal(store.coordinates(0, len(vertices))[firsts], whole.origins)


@pytest.mark.parametrize("scattered", [False, True])
@pytest.mark.parametrize("size", [600, pytest.param(PART, marks=[compiled, pytest.mark.slow])])
def test_sampled_parts_are_those_in_memory(size, scattered, tmp_path, monkeypatch):
    """Also where a mesh falls into many small pieces, so that parts go on and on with the next vertex."""
    star = bumpy_star(resolution=80 if size == PART else 24)
    vertices, faces = star.vertices, star.faces
    if scattered:
        faces = faces[np.random.default_rng(0).random(len(faces)) < 0.2]
    mesh = triangle_mesh(*shuffled(vertices, faces))
    monkeypatch.setattr(mesh_parts, "CORE", CORE * size // PART)
    for module in (mesh_parts, scale_parts):
        monkeypatch.setattr(module, "PART", size)
        monkeypatch.setattr(module, "LARGEST_WHOLE", LARGEST_WHOLE * size // PART)
    monkeypatch.setattr(scale_parts, "FIRST_RINGS", 64 if size == PART else 6)
    assert mesh.vertex_count > LARGEST_WHOLE * size // PART
    store = build_store(open_source(save_arrays(tmp_path, mesh.vertices, mesh.faces)), tmp_path, 8192 * size // PART)
    expected, found = mesh_parts.sampled_parts(mesh, vertex_adjacency(mesh), (17,)), sampled_parts_of(store, (17,))
    assert len(found.vertices) < mesh.vertex_count
    assert np.array_equal(found.vertices, expected.vertices)
    assert np.array_equal(found.core, expected.core)
    assert np.array_equal(found.mesh.vertices, expected.mesh.vertices)
    assert np.array_equal(found.mesh.faces, expected.mesh.faces)


def stopped(files, target, stage, after, **options):
    """Stop a run in some stage; the folder of its results."""

    def progress(name, done, total):
        return not (name == stage and done >= after)

    with pytest.raises(CancelledError):
        smooth_file(files, target, progress=progress, **HOW, **options)
    assert not target.exists()
    (results,) = target.with_suffix(".ply.tiles").glob("results-*")
    return results


@compiled
@pytest.mark.parametrize("stage", ["Shares", pytest.param("Levels", marks=pytest.mark.slow)])
def test_a_run_goes_on_in_the_stage_it_was_in(stage, tmp_path):
    """A damaged tile is computed again, if need be with all that it was computed from."""
    vertices, faces = ball()
    files, target = save_arrays(tmp_path, vertices, faces), tmp_path / "out.ply"
    results = stopped(files, target, "shares", 1, tile_vertices=512)
    (damaged,) = results.glob(f"*-{stage}/vertices/tile-000001.bin")
    damaged.write_bytes(damaged.read_bytes()[:-8])
    report = smooth_file(files, target, resume=True, **HOW)
    assert report["damaged_tiles"] == [f"{damaged.parent.parent.name}: tile 1"]
    assert (report["computed_tiles"] == report["tiles"]) == (stage == "Levels")
    assert report["computed_tiles"] > 0
    assert_same(report, smooth(vertices, faces))
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
            if stage == "measuring" and done == 1:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGKILL)

        how = {"scheduler": cluster.scheduler_address, "progress": progress}
        report = smooth_file(files, target, tile_vertices=512, **how)
        with pytest.raises(ProcessLookupError):
            os.kill(victim, 0)
    assert_same(report, smooth(vertices, faces))


@compiled
def test_the_command_line_smooths(tmp_path):
    vertices, faces = save_arrays(tmp_path, *ball())
    arguments = ["scale", "smooth", vertices, tmp_path / "out.ply", "--faces", faces, "--scheduler", "synchronous"]
    result = CliRunner().invoke(app, [*map(str, arguments), "--noise", "0.0", "--borders", "fixed", "--json"])
    assert result.exception is None
    assert_same(json.loads(result.stdout), smooth(np.load(vertices), np.load(faces), noise=0.0, borders="fixed"))


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
