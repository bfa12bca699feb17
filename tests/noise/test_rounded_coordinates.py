"""Rounded coordinates are noise of a known strength, and their stairs are no sharp edges."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import config
from scale_cases import assert_same_as_in_memory, save_arrays

from bezier_filters import estimate_vertex_geometry, smooth, triangle_mesh
from bezier_filters.fitting.mesh_neighbourhoods import mesh_neighbourhoods
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.meshes.spatial_order import sort_spatially
from bezier_filters.noise.rounded_coordinates import coordinate_steps, rounding_noise
from bezier_filters.sampling import mesh_parts
from bezier_filters.scale import estimate_file, learn
from bezier_filters.scale.source import open_source
from bezier_filters.scale.store import build_store
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surfaces import block_with_sharp_edges, cylinder, sphere, torus, waves
from stairs import ball_mask, mask_boundary, terrain

pytest.importorskip("pyvista")
compiled = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")


def noise_of(vertices, faces):
    return rounding_noise(prepare_mesh(triangle_mesh(vertices, faces)))


def rms(values):
    return float(np.sqrt(np.square(values).mean()))


@given(st.floats(1e-6, 1e6), st.floats(-1e3, 1e3), st.sampled_from([np.float32, np.float64]))
def test_steps_are_found_at_any_scale_and_offset(step, offset, dtype):
    places = np.random.default_rng(0).integers(0, 50, (400, 3)).astype(np.float64)
    found = coordinate_steps((places * step + offset * step).astype(dtype).astype(np.float64))
    np.testing.assert_allclose(found, step, rtol=1e-3)


def test_coordinates_of_full_precision_have_no_step():
    points = np.random.default_rng(0).normal(size=(5000, 3))
    assert not coordinate_steps(points).any()
    assert not coordinate_steps(points.astype(np.float32).astype(np.float64)).any()
    points[:, 1] = np.round(4.0 * points[:, 1]) / 4.0
    np.testing.assert_allclose(coordinate_steps(points), [0.0, 0.25, 0.0])


@pytest.mark.parametrize(("radius", "spacing"), [(8, (1.0, 1.0, 1.0)), (15, (1.0, 1.0, 1.0)), (12, (1.0, 1.0, 2.0))])
def test_a_mask_has_the_noise_that_its_vertices_have(radius, spacing):
    vertices, faces = ball_mask(radius, spacing)
    true = rms(np.linalg.norm(vertices, axis=1) - radius)
    assert noise_of(vertices, faces).sigma == pytest.approx(true, rel=0.15)


@pytest.mark.parametrize("step", [0.8, 1.0])
def test_heights_in_steps_have_noise_in_one_axis_only(step):
    vertices, faces, _, _ = terrain(step)
    exact, _, _, _ = terrain(0.0)
    normals = prepare_mesh(triangle_mesh(exact, faces)).planes.normals
    true = rms((vertices - exact)[:, 2] * normals[:, 2])
    assert noise_of(vertices, faces).sigma == pytest.approx(true, rel=0.15)


@pytest.mark.parametrize(
    "make",
    [
        lambda: block_with_sharp_edges(resolution=16),
        lambda: terrain(0.0)[:2],
        lambda: (cylinder().vertices, cylinder().faces),
        lambda: (sphere(resolution=16).vertices, sphere(resolution=16).faces),
        lambda: (torus().vertices, torus().faces),
        lambda: (waves(amplitude=0.0).vertices, waves(amplitude=0.0).faces),
        lambda: mask_boundary(lambda x: np.abs(x).max(axis=-1) <= 8.0, (11, 11, 11)),
    ],
    ids=["bricks", "grid", "rows", "sphere", "torus", "plane", "cube of voxels"],
)
def test_exact_bodies_on_a_lattice_have_none(make):
    assert noise_of(*make()).variance == 0.0


def turned(vertices, seed):
    """Vertices turned at random, at another place and of another size, in single precision."""
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return (0.37 * vertices @ turn + 100.0).astype(np.float32).astype(np.float64)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "make",
    [lambda: ball_mask(8), lambda: ball_mask(12, (1.0, 1.0, 2.0)), lambda: terrain(1.0)[:2]],
    ids=["cubes", "slices", "terrain"],
)
def test_rounding_is_found_along_turned_axes(make, seed):
    vertices, faces = make()
    expected, found = noise_of(vertices, faces), noise_of(turned(vertices, seed), faces)
    assert found.sigma == pytest.approx(0.37 * expected.sigma, rel=1e-3)
    assert found.length == pytest.approx(0.37 * expected.length, rel=1e-3)


@pytest.mark.parametrize(
    "make",
    [
        lambda: block_with_sharp_edges(resolution=16),
        lambda: (cylinder().vertices, cylinder().faces),
        lambda: (sphere(resolution=16).vertices, sphere(resolution=16).faces),
        lambda: (waves(amplitude=0.0).vertices, waves(amplitude=0.0).faces),
        lambda: (torus(jitter=0.2).vertices, torus(jitter=0.2).faces),
    ],
    ids=["bricks", "rows", "sphere", "plane", "irregular"],
)
def test_exact_turned_bodies_have_no_stairs(make):
    vertices, faces = make()
    assert noise_of(turned(vertices, 0), faces).variance == 0.0


@compiled
def test_curvature_does_not_depend_on_the_axes_of_the_voxels():
    vertices, faces = ball_mask(12)
    expected = estimate_vertex_geometry(vertices, faces).mean_curvature
    found = 0.37 * estimate_vertex_geometry(turned(vertices, 1), faces).mean_curvature
    assert rms(found - expected) < 0.01 * rms(expected)


@compiled
@pytest.mark.parametrize("radius", [8, 15, pytest.param(25, marks=pytest.mark.slow)])
def test_curvature_of_a_ball_of_voxels(radius):
    vertices, faces = ball_mask(radius)
    geometry = estimate_vertex_geometry(vertices, faces)
    error = geometry.mean_curvature * radius - 1.0
    assert rms(error) < 0.06
    assert np.abs(error).max() < 0.3
    assert np.mean(np.abs(error) <= 1.96 * geometry.mean_curvature_std * radius) > 0.88
    away = np.random.default_rng(1).permutation(len(vertices))
    number = np.argsort(away).astype(np.int32)
    assert rms(estimate_vertex_geometry(vertices[away], number[faces]).mean_curvature * radius - 1.0) < 0.06


@compiled
def test_a_ball_of_voxels_is_smoothed_and_keeps_its_volume():
    vertices, faces = ball_mask(20)
    result = smooth(vertices, faces)
    assert rms(np.linalg.norm(result.vertices, axis=1) - 20.0) < 0.15 * rms(np.linalg.norm(vertices, axis=1) - 20.0)
    assert result.volume_ratio == pytest.approx(1.0, abs=1e-6)


@compiled
def test_curvature_of_a_terrain_in_whole_metres():
    vertices, faces, mean, inner = terrain(1.0)
    geometry = estimate_vertex_geometry(vertices, faces)
    error = (geometry.mean_curvature - mean)[inner]
    assert rms(error) < 0.1 * rms(mean[inner])
    assert np.mean(np.abs(error) <= 1.96 * geometry.mean_curvature_std[inner]) > 0.88


@compiled
def test_masks_in_tiles_are_as_in_memory(tmp_path):
    vertices, faces = ball_mask(12)
    files = save_arrays(tmp_path, vertices, faces)
    report = estimate_file(files, tmp_path / "out.ply", tile_vertices=700, scheduler="synchronous")
    assert report["tiles"] > 1
    assert_same_as_in_memory(report, vertices, faces)


def test_unused_vertices_far_away_hide_no_turned_stairs():
    vertices, faces = ball_mask(12)
    found = noise_of(np.vstack([turned(vertices, 0), [1e5, 0.0, 0.0]]), faces)
    assert found.sigma == pytest.approx(0.37 * noise_of(vertices, faces).sigma, rel=1e-3)


def test_tiles_and_memory_find_the_same_rounding_in_parts_of_a_large_mesh(tmp_path, monkeypatch):
    """One vertex lies between the steps, and no part contains it. Normals where parts are cut off may differ."""
    monkeypatch.setattr(mesh_parts, "MAX_WHOLE_VERTICES", 1000)
    for module in (mesh_parts, learn):
        monkeypatch.setattr(module, "PART_VERTICES", 250)
    vertices, faces, _, _ = terrain(1.0)
    vertices[0, 2] += 0.37
    store = build_store(open_source(save_arrays(tmp_path, vertices, faces)), tmp_path, 700)
    ordered = sort_spatially(triangle_mesh(vertices, faces))
    in_memory = mesh_neighbourhoods(prepare_mesh(ordered.mesh), ordered).rounding
    assert in_memory.sigma > 0.2
    assert learn.store_neighbourhoods(store, FitOptions()).rounding.sigma == pytest.approx(in_memory.sigma, rel=0.01)
