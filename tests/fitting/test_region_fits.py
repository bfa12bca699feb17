"""Regions of a mesh have fits of their own where noise or shape differ, and only there."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numba import config
from scanner_noise import ball_with_a_narrow_ring, mean_edge_of

from bezier_filters import estimate_vertex_geometry, load_mesh
from bezier_filters.fitting.mesh_neighbourhoods import MeshNeighbourhoods
from bezier_filters.fitting.region_fits import _region_fit
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshlab.meshset import bunny_path
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.learn import learn_surface
from bezier_filters.surfaces import bumpy_star, ellipsoid, sphere, torus, waves
from survivors import keep_survivors


@pytest.mark.parametrize("level", [0.05, 0.1])
def test_a_part_too_narrow_for_the_fit_of_all_has_a_fit_of_its_own(level):
    """Rings that suit the ball reach around the tube of the ring; there normals are as if the ring were alone."""
    vertices, faces, normals, is_narrow = ball_with_a_narrow_ring(level)
    together = estimate_vertex_geometry(vertices, faces)
    alone = estimate_vertex_geometry(vertices[is_narrow], faces[is_narrow[faces].all(axis=1)] - (~is_narrow).sum())
    cosines = [(normals[is_narrow] * found).sum(axis=1) for found in (together.normals[is_narrow], alone.normals)]
    errors = [np.arccos(np.minimum(cosine, 1.0)).mean() for cosine in cosines]
    assert errors[0] < 1.3 * errors[1]
    assert together.fit.parts[-1].vertices == pytest.approx(is_narrow.sum(), rel=0.1)
    assert together.fit.parts[-1].rings < together.fit.rings


def test_the_fit_of_a_narrow_part_does_not_depend_on_what_is_selected():
    vertices, faces, _, is_narrow = ball_with_a_narrow_ring(0.1)
    whole, some = (estimate_vertex_geometry(vertices, faces, selected=mask) for mask in (None, is_narrow))
    np.testing.assert_array_equal(some.k_max[is_narrow], whole.k_max[is_narrow])


@pytest.mark.parametrize("levels", [(0.02, 0.2), (0.05, 0.5)])
def test_ten_times_the_noise_at_a_few_vertices_is_smoothed_there_and_the_rest_is_as_without_it(levels):
    """Among what the fit of all does not follow, curved places are distinguished from noisy ones."""
    surface = ellipsoid(resolution=30, jitter=0.3)
    is_noisy = surface.vertices[:, 0] < np.quantile(surface.vertices[:, 0], 0.03)
    generator, edge = np.random.default_rng(3), mean_edge_of(surface.vertices, surface.faces)
    heights = generator.normal(size=len(is_noisy)) * np.where(is_noisy, levels[1], levels[0]) * edge
    geometry = estimate_vertex_geometry(surface.vertices + heights[:, np.newaxis] * surface.normals, surface.faces)
    cosines = np.einsum("ij,ij->i", geometry.normals, surface.normals)
    angles = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    noisy, rest = (np.sqrt(np.square(angles[part]).mean()) for part in (is_noisy, ~is_noisy))
    assert noisy < 4.0
    assert rest < 1.2


def mean_edge_length(surface):
    corners = surface.vertices[surface.faces]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean()


def with_noise(surface, levels, seed):
    heights = levels * mean_edge_length(surface) * np.random.default_rng(seed).standard_normal(len(surface.vertices))
    return surface.vertices + heights[:, np.newaxis] * surface.normals


@pytest.mark.parametrize(
    "make", [lambda: torus(resolution=40, jitter=0.3), lambda: ellipsoid(resolution=30, jitter=0.3)]
)
def test_a_surface_with_two_kinds_of_noise_is_fitted_in_parts(make):
    surface = make()
    noisy = surface.vertices[:, 0] > 0
    vertices = with_noise(surface, np.where(noisy, 0.05, 0.005), 1)
    geometry = estimate_vertex_geometry(vertices, surface.faces)
    parts = geometry.fit.parts
    sigmas = np.array([part.noise_sigma for part in parts]) / mean_edge_length(surface)
    assert sigmas.min() == pytest.approx(0.005, rel=0.15)
    assert sigmas.max() == pytest.approx(0.05, rel=0.15)
    assert sum(part.vertices for part in parts) == len(vertices)


def test_a_surface_that_is_the_same_everywhere_is_mostly_fitted_in_one_piece():
    count = 0
    for surface in (sphere(resolution=16, jitter=0.3), torus(resolution=32, jitter=0.3)):
        for seed in range(4):
            geometry = estimate_vertex_geometry(with_noise(surface, 0.05, seed), surface.faces)
            count += bool(geometry.fit.parts)
    assert count <= 3


def test_the_parts_do_not_depend_on_what_is_selected():
    surface = torus(resolution=32, jitter=0.3)
    vertices = with_noise(surface, np.where(surface.vertices[:, 0] > 0, 0.05, 0.005), 1)
    whole = estimate_vertex_geometry(vertices, surface.faces, threads=1)
    selected = surface.vertices[:, 1] > 0.3
    part = estimate_vertex_geometry(vertices, surface.faces, selected=selected, threads=2)
    assert whole.fit.parts
    kinds = [(p.rings, p.degree, p.noise_sigma) for p in whole.fit.parts]
    assert [(p.rings, p.degree, p.noise_sigma) for p in part.fit.parts] == kinds
    assert sum(p.vertices for p in part.fit.parts) == selected.sum()
    for name in ("k_min", "k_max", "normals", "mean_curvature_std", "rings_used", "status"):
        np.testing.assert_array_equal(getattr(part, name)[selected], getattr(whole, name)[selected])
    assert not part.k_max[~selected].any()


@cache
def bunny():
    """A scan, and the estimate of its geometry."""
    ms = load_mesh(bunny_path())
    mesh = ms.current_mesh()
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix()
    used = np.unique(faces)
    vertices, faces = vertices[used], np.searchsorted(used, faces).astype(np.int32)
    return vertices, faces, estimate_vertex_geometry(vertices, faces)


@pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")
@pytest.mark.parametrize(
    ("deleted", "turned", "moved"), [pytest.param(10, 1.0, 0.08, marks=pytest.mark.slow), (30, 1.5, 0.13)]
)
def test_a_scan_with_detail_as_long_as_its_noise_keeps_its_fit(deleted, turned, moved):
    """Otherwise a few vertices less turn normals by degrees, and move H by a fifth."""
    vertices, faces, full = bunny()
    survivors = np.ones(len(vertices), dtype=bool)
    survivors[np.random.default_rng([1, deleted]).permutation(len(vertices))[: len(vertices) * deleted // 100]] = False
    kept, reduced = keep_survivors(vertices, faces, survivors)
    less = estimate_vertex_geometry(vertices[kept], reduced)
    assert all((g.fit.rings, g.fit.degree) == (2, 3) for g in (full, less))
    others = [p for g in (full, less) for p in g.fit.parts if (p.rings, p.degree) != (2, 3)]
    assert sum(p.vertices for p in others) < 0.1 * len(less.normals)
    cosines = np.einsum("nk,nk->n", full.normals[kept], less.normals)
    assert np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))).mean() < turned
    difference = np.abs(full.mean_curvature[kept] - less.mean_curvature).sum()
    assert difference < moved * np.abs(full.mean_curvature[kept]).sum()


@pytest.mark.parametrize("exact", ["normal_noise", "curvature_noise", "height_noise"])
def test_parts_of_a_surface_that_is_exact_elsewhere_have_fits_of_their_own(exact):
    """Standard errors of 0, as a flat whole has, are no unit for those of a part."""
    surface = bumpy_star(resolution=12, jitter=0.2)
    arrays = prepare_kernel_mesh(triangle_mesh(surface.vertices, surface.faces), with_barriers=True)
    leaf = learn_surface(MeshNeighbourhoods(arrays), FitOptions())
    assert not _region_fit(leaf, leaf).attempts
    part = _region_fit(replace(leaf, chosen=replace(leaf.chosen, **{exact: 0.0})), leaf)
    assert part.attempts
    assert not np.isfinite(part.error_ratios).any()


@pytest.mark.parametrize("make", [bumpy_star, ellipsoid], ids=lambda make: make.__name__)
@pytest.mark.parametrize("share", [0.03, pytest.param(0.1, marks=pytest.mark.slow), 0.3])
def test_noise_on_a_part_costs_no_more_accuracy_than_the_same_noise_everywhere(make, share):
    """Whole surfaces without noise need no wide rings, and the model of the whole has none."""
    surface = make(resolution=32, jitter=0.2)
    edge, offsets = mean_edge_of(surface.vertices, surface.faces), np.random.default_rng(7).standard_normal(10242)
    is_noisy = surface.vertices[:, 0] > np.quantile(surface.vertices[:, 0], 1.0 - share)

    def error(sigma):
        vertices = surface.vertices + (sigma * edge * offsets)[:, np.newaxis] * surface.normals
        found = estimate_vertex_geometry(vertices, surface.faces)
        errors = (found.mean_curvature - surface.mean_curvature)[is_noisy]
        inside = np.abs(errors) <= 1.96 * found.mean_curvature_std[is_noisy]
        return np.sqrt(np.mean(errors**2)), inside.mean()

    of_part, inside = error(np.where(is_noisy, 0.1, 0.0))
    everywhere, _ = error(np.full(10242, 0.1))
    assert of_part < 1.5 * everywhere
    assert inside > 0.75


def test_shape_that_leaves_large_residuals_is_not_split_off_as_noise():
    """Coarse exact surfaces: a third to a half of their residuals are large against the least ones."""
    flat = ellipsoid(semi_axes=(1.0, 1.0, 0.2), resolution=12, jitter=0.2, seed=2)
    curved = waves(amplitude=0.3, wavelength=0.4, resolution=70, jitter=0.1, seed=5)
    for surface, degrees in ((flat, 0.7), (curved, 9.0)):
        found = estimate_vertex_geometry(surface.vertices, surface.faces)
        cosines = np.clip(np.einsum("ij,ij->i", found.normals, surface.normals), -1.0, 1.0)
        assert np.sqrt(np.mean(np.degrees(np.arccos(cosines)) ** 2)) < degrees
