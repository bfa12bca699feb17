"""Meshes on disk in tiles give what they give in memory."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scale_cases import MESHES, assert_same_as_in_memory, clean, in_memory, noisy, save_arrays

from bezier_filters import InvalidParameterError, estimate_vertex_geometry, read_fields, smooth
from bezier_filters.fields import ESTIMATES
from bezier_filters.fields import columns as columns_of
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.spatial_order import sort_spatially
from bezier_filters.scale import FitOptions, estimate_file, smooth_file
from bezier_filters.scale.halo import part_around
from bezier_filters.scale.source import open_source
from bezier_filters.scale.store import build_store
from bezier_filters.surfaces import sphere, torus

IN_TILES = [
    pytest.param(name, tile, marks=[pytest.mark.slow] if slow else [])
    for name in MESHES
    for tile, slow in ((256, name == "noisy"), (1000, True), (10**6, name != "shuffled"))
]


@pytest.mark.parametrize(("name", "tile"), IN_TILES)
def test_values_are_those_in_memory_to_the_last_bit(name, tile, tmp_path):
    vertices, faces = MESHES[name]()
    files = save_arrays(tmp_path, vertices, faces)
    report = estimate_file(files, tmp_path / "out.ply", scheduler="synchronous", tile_vertices=tile)
    assert report["tiles"] == -(-len(vertices) // report["tile_vertices"])
    assert_same_as_in_memory(report, vertices, faces)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["faces.npy", "out.ply", "vertices.npy"]


@pytest.mark.parametrize(
    "options",
    [
        {"smoothness": "paper"},
        {"smoothness": "paper", "fallbacks": "paper", "fold_test": "crossings"},
        {"alpha": 0.9, "rings": 3},
        {"rings": 4, "degree": 3},
        {"robust": True},
        {"noise": 0.01, "detail": 0.5},
    ],
)
def test_options_do_what_they_do_in_memory(options, tmp_path):
    vertices, faces = noisy()
    files = save_arrays(tmp_path, vertices, faces)
    report = estimate_file(
        files, tmp_path / "out.ply", options=FitOptions(**options), scheduler="synchronous", tile_vertices=512
    )
    assert_same_as_in_memory(report, vertices, faces, **options)


@pytest.mark.parametrize(
    "faces",
    [
        pytest.param([[0, 1, 2]], id="one face"),
        pytest.param([[0, 0, 0], [1, 1, 2]], id="no face with three corners"),
        pytest.param([[k, k + 1, k + 2] for k in range(300)], id="a crumpled strip"),
    ],
)
@pytest.mark.parametrize("size", [0.0, 1.0])
def test_what_can_hardly_be_fitted_is_as_in_memory(faces, size, tmp_path):
    vertices = size * np.random.default_rng(0).random((600, 3))
    files = save_arrays(tmp_path, vertices, np.array(faces))
    report = estimate_file(files, tmp_path / "out.ply", scheduler="synchronous", tile_vertices=256)
    assert_same_as_in_memory(report, vertices, np.array(faces))


def test_the_estimate_in_tiles_converges_to_the_truth(tmp_path):
    errors = []
    for resolution in (24, 48):
        ring = torus(resolution=resolution)
        files = save_arrays(tmp_path, ring.vertices, ring.faces)
        estimate_file(files, tmp_path / "out.ply", scheduler="threads", workers=2, tile_vertices=512)
        fields = read_fields(tmp_path / "out.ply")
        for name in ("mean_curvature", "gaussian_curvature"):
            truth = getattr(ring, name)
            errors.append(np.linalg.norm(fields[f"bz_{name}"] - truth) / np.linalg.norm(truth))
    assert errors[2] < 1e-3
    assert errors[3] < 1e-3
    assert errors[0] > 8.0 * errors[2]  # third order, and more on a mesh as regular as this
    assert errors[1] > 8.0 * errors[3]


@pytest.mark.parametrize("quantity", ["normals", "torsion"])
def test_normals_and_torsion_have_their_columns(quantity, tmp_path):
    vertices, faces = clean()
    files = save_arrays(tmp_path, vertices, faces)
    estimate_file(files, tmp_path / "out.ply", quantity, scheduler="synchronous", tile_vertices=512)
    fields = read_fields(tmp_path / "out.ply")
    expected = columns_of(quantity, in_memory(vertices, faces))
    assert fields.keys() - {"quality"} == expected.keys()
    for name, values in expected.items():
        assert np.array_equal(fields[name], values), name


def test_some_columns_can_be_chosen(tmp_path):
    files = save_arrays(tmp_path, *clean())
    report = estimate_file(
        files, tmp_path / "out.ply", quality="gaussian", columns=["k_min", "bz_k_max"], scheduler="synchronous"
    )
    assert report["attributes"] == ["bz_k_min", "bz_k_max"]
    assert read_fields(tmp_path / "out.ply").keys() == {"quality", "bz_k_min", "bz_k_max"}


def test_columns_of_all_filters_come_from_one_run(tmp_path):
    """What is there for each of them, with any quality."""
    vertices, faces = clean()
    files, geometry = save_arrays(tmp_path, vertices, faces), in_memory(vertices, faces)
    how = {"scheduler": "synchronous", "tile_vertices": 512}
    report = estimate_file(files, tmp_path / "out.ply", "all", quality="torsion", **how)
    fields = read_fields(tmp_path / "out.ply")
    expected = {name: values for one in ESTIMATES for name, values in columns_of(one, geometry).items()}
    assert set(report["attributes"]) == expected.keys() == fields.keys() - {"quality"}
    for name, values in (expected | {"quality": geometry.geodesic_torsion}).items():
        assert np.array_equal(fields[name], values), name
    estimate_file(files, tmp_path / "some.ply", "normals", columns=["geodesic_torsion", "normal_x", "k_min"], **how)
    some = read_fields(tmp_path / "some.ply")
    assert list(some) == ["bz_geodesic_torsion", "bz_normal_x", "bz_k_min"]
    assert all(np.array_equal(some[name], fields[name]) for name in some)


@pytest.mark.parametrize(("name", "iterations"), [("shuffled", 1), ("broken", 1), ("noisy", 3), ("open", 3)])
def test_smoothing_moves_vertices_as_in_memory(name, iterations, tmp_path):
    vertices, faces = MESHES[name]()
    files = save_arrays(tmp_path, vertices, faces)
    target, how = tmp_path / "out.ply", {"scheduler": "synchronous", "tile_vertices": 400}
    report = smooth_file(files, target, "paper", iterations=iterations, **how)
    moved = open_source(tmp_path / "out.ply").vertices(0, len(vertices))
    expected = smooth(vertices, faces, method="paper", iterations=iterations)
    # The mesh in memory is sorted anew by the moved vertices: the same sums in another order.
    assert np.abs(moved - expected.vertices).max() <= (0.0 if iterations == 1 else 1e-12)
    assert np.allclose(read_fields(tmp_path / "out.ply")["quality"], expected.displacement, rtol=0.0, atol=1e-12)
    assert report["computed_tiles"] == iterations * report["tiles"]


def test_smoothing_onto_learned_patches_takes_off_noise(tmp_path):
    ball = sphere(resolution=12)
    noise = np.random.default_rng(0).normal(scale=0.01, size=(len(ball.vertices), 1))
    vertices = ball.vertices * (1.0 + noise)
    files = save_arrays(tmp_path, vertices, ball.faces)
    smooth_file(files, tmp_path / "out.ply", "paper", options=FitOptions(), scheduler="synchronous", tile_vertices=512)
    moved = open_source(tmp_path / "out.ply").vertices(0, len(vertices))
    geometry = estimate_vertex_geometry(vertices, ball.faces)
    assert np.array_equal(moved, vertices + geometry.displacements)
    assert np.abs(np.linalg.norm(moved, axis=1) - 1.0).mean() < 0.5 * np.abs(noise).mean()


@settings(max_examples=8)
@given(seed=st.integers(0, 10**6), tile=st.integers(256, 2000))
def test_the_store_has_the_order_of_meshes_in_memory(seed, tile, tmp_path_factory):
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(int(rng.integers(300, 2000)), 3)) * rng.uniform(0.0, 2.0, 3)
    faces = rng.integers(0, len(vertices), (int(rng.integers(1, 4000)), 3))
    folder = tmp_path_factory.mktemp("store")
    store = build_store(open_source(save_arrays(folder, vertices, faces)), folder, tile)
    ordered = sort_spatially(triangle_mesh(vertices, faces))
    assert np.array_equal(store.coordinates(0, len(vertices)), ordered.mesh.vertices)
    assert np.array_equal(store.rank.read(0, len(vertices))[ordered.order], np.arange(len(vertices)))
    assert np.array_equal(store.order.read(0, len(vertices)), ordered.order)
    whole = part_around(store, np.arange(len(vertices), dtype=np.int32), 1)
    assert np.array_equal(whole.mesh.faces, ordered.mesh.faces)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"quantity": "area"}, "quantity"),
        ({"quality": "height"}, "quality"),
        ({"columns": ["k_min", "k_min"]}, "columns"),
        ({"columns": ["bz_depth"]}, "columns"),
        ({"workers": 0}, "workers"),
        ({"workers": 1.5}, "workers"),
        ({"tile_vertices": 8}, "tile_vertices"),
        ({"memory_limit": 10**8}, "memory_limit"),
        ({"scheduler": "cluster"}, "scheduler"),
        ({"scheduler": 3}, "scheduler"),
        ({"options": FitOptions(rings=0)}, "rings"),
        ({"options": FitOptions(rings=1000)}, "rings"),
        ({"options": FitOptions(alpha=2.0)}, "alpha"),
        ({"options": FitOptions(radius=0.1)}, "radius"),
        ({"options": FitOptions(robust="no")}, "robust"),
        ({"options": {}}, "options"),
        ({"resume": "no"}, "resume"),
        ({"columns": "k_min"}, "columns"),
        ({"tile_vertices": 256.0}, "tile_vertices"),
        ({"tile_vertices": 10**20}, "tile_vertices"),
        ({"memory_limit": "2GB"}, "memory_limit"),
        ({"progress": 5}, "progress"),
        ({"store": 5}, "store"),
    ],
)
def test_bad_parameters_are_named_and_leave_nothing(arguments, name, tmp_path):
    files = save_arrays(tmp_path, *clean())
    with pytest.raises(InvalidParameterError, match=f"^{name}: "):
        estimate_file(files, tmp_path / "out.ply", **({"scheduler": "synchronous"} | arguments))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["faces.npy", "vertices.npy"]


@pytest.mark.parametrize("run", [estimate_file, smooth_file])
def test_a_source_is_not_overwritten_and_targets_are_ply_files(run, tmp_path):
    files = save_arrays(tmp_path, *clean())
    run(files, tmp_path / "mesh.ply", scheduler="synchronous")
    content = (tmp_path / "mesh.ply").read_bytes()
    for source, target in (
        (tmp_path / "mesh.ply", tmp_path / "mesh.ply"),
        (files, files[0]),
        (files, tmp_path / "o.obj"),
    ):
        with pytest.raises(InvalidParameterError, match=r"^target: "):
            run(source, target, scheduler="synchronous")
    assert (tmp_path / "mesh.ply").read_bytes() == content
    assert sorted(path.name for path in tmp_path.iterdir()) == ["faces.npy", "mesh.ply", "vertices.npy"]


def test_options_may_be_numbers_of_numpy(tmp_path):
    vertices, faces = clean()
    files = save_arrays(tmp_path, vertices, faces)
    options = FitOptions(rings=np.int64(2), alpha=np.float64(0.8), degree=np.int32(3), robust=np.True_)
    assert options == FitOptions(2, 0.8, 3, robust=True)
    report = estimate_file(
        files, tmp_path / "out.ply", options=options, tile_vertices=np.int64(512), scheduler="synchronous"
    )
    assert_same_as_in_memory(report, vertices, faces, rings=2, alpha=0.8, degree=3, robust=True)
    smooth_file(
        files,
        tmp_path / "smooth.ply",
        iterations=np.int64(1),
        relax=np.True_,
        noise=np.int64(0),
        scheduler="synchronous",
    )
