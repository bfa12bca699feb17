"""The local strength of the noise, and the roughest vertices."""

from functools import partial

import numpy as np
import pytest
from numba import config
from scanner_noise import along_normals, mean_edge_of, ring_means
from smoothing_cases import edge_of, height_error, noisy_block, part_around

from bezier_filters import smooth
from bezier_filters.fitting.noise_level import learn_noise_at
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.sampling.mesh_parts import whole_mesh
from bezier_filters.smoothing.clusters import clusters_of
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.noise import (
    RELIEF_PER_EDGE,
    NoisyMesh,
    learn_noise_levels,
    local_sigma,
    roughest_vertices,
    roughness,
)
from bezier_filters.surfaces import block_with_sharp_edges, sphere, torus

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")


def test_the_roughest_place_is_at_the_corners():
    _, vertices, faces = noisy_block(50)
    mesh = prepare_mesh(triangle_mesh(vertices, faces))
    part, sigma = whole_mesh(mesh), 0.2 * edge_of(vertices, faces)
    found = roughness(part, sigma)
    edges = (np.abs(np.abs(vertices) - np.abs(vertices).max(axis=0)) < 0.05).sum(axis=1)
    assert edges[found.argmax()] >= 2
    inner = vertices[:, 0] > 0.2
    tile = part_around(mesh, inner, 40)
    rows = inner[tile.ids]
    assert np.allclose(roughness(tile, sigma)[rows], found[tile.ids[rows]], rtol=1e-3)


@pytest.mark.parametrize("share", [1.0, 0.03, 0.0])
def test_what_is_as_rough_is_chosen_alike_from_tiles(share):
    """Although sums of tiles are others, many are as rough as the roughest, and each tile tells of a few only."""
    rng, alike, n = np.random.default_rng(0), 0, 20_000
    for _ in range(50):
        values, ids = 5.0 - share * rng.random(n), rng.permutation(n).astype(np.int32)
        expected = roughest_vertices(values, ids)[0]
        rounded, few = values * (1.0 + 1e-5 * rng.standard_normal(n)), []
        for start in range(0, n, 2000):
            tile = slice(start, start + 2000)
            few.extend(start + roughest_vertices(rounded[tile], ids[tile]))
        assert len(few) < 150
        alike += few[roughest_vertices(rounded[few], ids[few])[0]] == expected
        assert values[expected] >= 0.98 * values.max()
    assert alike >= 48


def test_little_noise_that_varies_is_taken_off():
    """Creases are as strong as that in their surroundings, but what a weak filter takes off there is no noise."""
    surface = torus(resolution=40, jitter=0.3)
    place = surface.vertices[:, 0] / np.ptp(surface.vertices[:, 0])  # from -1/2 to 1/2
    heights = np.einsum("ij,ij->i", along_normals(surface, 0.04, 0) - surface.vertices, surface.normals)
    noisy = surface.vertices + (10.0**place * heights)[:, np.newaxis] * surface.normals
    assert height_error(surface, smooth(noisy, surface.faces).vertices) < 0.3 * height_error(surface, noisy)


@pytest.mark.parametrize("seed", range(2))
def test_creases_are_not_noise_that_varies(seed):
    """Little of averaged noise is left to a weak filter, so that creases look like far more of it than there is."""
    vertices, faces = block_with_sharp_edges(resolution=30)
    mesh = triangle_mesh(vertices, faces)
    heights, halves = np.random.default_rng(seed).standard_normal(len(vertices)), ring_means(faces, len(vertices))
    for _ in range(3):  # means of six neighbours and the vertex itself
        heights = (12.0 * (halves @ heights) - 5.0 * heights) / 7.0
    heights *= 0.1 * mean_edge_of(vertices, faces) / heights.std()
    noise = heights[:, np.newaxis] * tangent_planes(mesh, vertex_adjacency(mesh)).normals
    off = smooth(vertices + noise, faces).vertices - vertices
    assert np.square(off).sum() < 1.1 * np.square(noise).sum()


def levels_of(vertices, faces, sigma):
    """What is learned of the noise of a mesh, and its standard deviation at the vertices."""
    mesh = triangle_mesh(vertices, faces)
    part, unit = whole_mesh(prepare_mesh(mesh)), edge_of(vertices, faces)
    clusters, laplacian = clusters_of(part), umbrella_laplacian(part, "free")
    noisy = NoisyMesh(part, clusters, np.full(len(vertices), sigma), laplacian=laplacian)
    levels, found = learn_noise_levels(noisy, laplacian, sigma, unit, partial(learn_noise_at, part.mesh))
    np.testing.assert_array_equal(local_sigma(part, clusters, levels, unit), found)
    return levels, found


def test_noise_of_two_strengths_is_found_on_both_sides():
    ring = torus(resolution=40, jitter=0.3)
    is_loud = ring.vertices[:, 0] > 0.0
    sigma = np.where(is_loud, 0.2, 0.05) * edge_of(ring.vertices, ring.faces)
    heights = sigma * np.random.default_rng(0).standard_normal(len(sigma))
    levels, found = levels_of(ring.vertices + heights[:, np.newaxis] * ring.normals, ring.faces, sigma.mean())
    assert levels.sigma is None
    is_inside = np.abs(ring.vertices[:, 0]) > 0.5  # means over the neighbourhood reach across the middle
    for side in (is_loud, ~is_loud):
        assert np.median(found[side & is_inside] / sigma[side & is_inside]) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("level", [0.05, 0.3])
def test_noise_of_one_strength_has_one_level(level):
    ring = torus(resolution=40, jitter=0.3)
    sigma = level * edge_of(ring.vertices, ring.faces)
    heights = sigma * np.random.default_rng(0).standard_normal(len(ring.vertices))
    levels, found = levels_of(ring.vertices + heights[:, np.newaxis] * ring.normals, ring.faces, sigma)
    assert levels.sigma == sigma
    relief = RELIEF_PER_EDGE * edge_of(ring.vertices, ring.faces)
    np.testing.assert_allclose(found, np.sqrt(sigma**2 - relief**2), rtol=1e-3)


@pytest.mark.parametrize("share", [0.05, pytest.param(0.1, marks=pytest.mark.slow), 0.4])
def test_noise_on_a_part_is_removed_up_to_its_border(share):
    """As if it were alone: less than a sixth of it remains, and the exact rest hardly moves."""
    ball = sphere(resolution=32)
    edge, is_noisy = edge_of(ball.vertices, ball.faces), ball.vertices[:, 2] > 1.0 - 2.0 * share
    noise = 0.3 * edge * is_noisy * np.random.default_rng(0).standard_normal(len(is_noisy))
    result = smooth(ball.vertices * (1.0 + noise[:, np.newaxis]), ball.faces)
    errors = (np.linalg.norm(result.vertices, axis=1) - 1.0) / edge
    assert np.sqrt(np.square(errors[is_noisy]).mean()) < 0.05
    assert np.sqrt(np.square(errors[~is_noisy]).mean()) < 0.01


def test_bodies_of_different_sizes_are_smoothed_as_if_they_were_alone():
    ball = sphere(resolution=24, jitter=0.2)
    noise = 0.2 * edge_of(ball.vertices, ball.faces) * np.random.default_rng(0).standard_normal((2, len(ball.vertices)))
    large, small = (
        ball.vertices * (1.0 + noise[0, :, np.newaxis]),
        0.02 * ball.vertices * (1.0 + noise[1, :, np.newaxis]),
    )
    both = smooth(
        np.vstack([large, small + np.array([3.0, 0.0, 0.0])]), np.vstack([ball.faces, ball.faces + len(large)])
    )
    for points, scale in ((both.vertices[: len(large)], 1.0), (both.vertices[len(large) :] - [3.0, 0.0, 0.0], 0.02)):
        errors = np.linalg.norm(points, axis=1) / scale - 1.0
        assert errors.std() < 0.25 * noise.std()


def test_the_feet_of_fins_next_to_noise_hardly_move():
    """Where three faces meet at an edge residuals are far larger than noise."""
    ball = sphere(resolution=20)
    edge, n = edge_of(ball.vertices, ball.faces), len(ball.vertices)
    noise = 0.3 * edge * (ball.vertices[:, 2] > 0.0) * np.random.default_rng(0).standard_normal(n)
    feet = ball.faces[ball.vertices[ball.faces][:, :, 2].max(axis=1) < -0.3][::40, :2]
    tips = (1.0 + edge) * ball.vertices[feet].mean(axis=1)
    fins = np.column_stack([feet, n + np.arange(len(feet))])
    vertices = np.vstack([ball.vertices * (1.0 + noise[:, np.newaxis]), tips])
    moved = smooth(vertices, np.vstack([ball.faces, fins])).displacement / edge
    assert moved[feet].max() < 0.1
