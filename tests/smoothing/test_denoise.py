"""Noise is removed from meshes, and from parts of them as from the whole."""

import numpy as np
import pytest
from numba import config
from scanner_noise import along_normals, averaged_noise, in_all_directions, mean_edge_of
from smoothing_cases import edge_of, height_error, mean_angle, noisy_block, part_around, with_noise

from bezier_filters import smooth
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.sampling.mesh_parts import sample_parts, whole_mesh
from bezier_filters.smoothing.denoise import SmoothingOptions, denoise, halo_rings, learn_and_denoise, remove_noise
from bezier_filters.surfaces import bumpy_star, ellipsoid, sphere, torus

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")


def noisy_star():
    star = bumpy_star(resolution=52, jitter=0.2)
    return with_noise(star.vertices, star.faces, star.normals, 0.2), star.faces


@pytest.mark.parametrize("make", [noisy_star, lambda: noisy_block(50)[1:]], ids=["star", "block"])
def test_parts_with_rings_around_are_smoothed_as_the_whole(make):
    mesh = prepare_mesh(triangle_mesh(*make()))
    sigma = 0.2 * edge_of(mesh.vertices, mesh.faces)
    plan, _ = learn_and_denoise(sample_parts(mesh), NoiseModel(sigma**2), SmoothingOptions())
    whole = denoise(whole_mesh(mesh), plan)
    learned = remove_noise(mesh, NoiseModel(sigma**2), SmoothingOptions())
    assert np.abs(learned.points - whole.points).max() < 1e-3 * sigma  # whose filters are series of other lengths
    squares = []
    low, high = np.quantile(mesh.vertices[:, 0], (0.1, 0.9))
    for inner in (mesh.vertices[:, 0] < low, mesh.vertices[:, 0] > high):
        part = part_around(mesh, inner, halo_rings(plan))
        assert part.cut.any()
        is_inner = inner[part.ids]
        found, expected = denoise(part, plan), part.ids[is_inner]
        distances = np.linalg.norm(found.points[is_inner] - whole.points[expected], axis=1) / sigma
        assert distances.max() < 0.01
        assert np.abs(found.sharpness[is_inner] - whole.sharpness[expected]).max() < 0.01
        squares.append(np.square(distances))
    assert np.sqrt(np.concatenate(squares).mean()) < 0.001


def test_noise_of_many_lengths_goes_once_its_strength_is_known():
    """Of which less than a third can be distinguished from shape: the rest is longer."""
    ball, parts = sphere(resolution=40, jitter=0.2), {0: 0.05, 2: 0.1, 7: 0.15, 27: 0.3, 110: 0.5}  # by passes
    noise = sum(
        strength * averaged_noise(ball.faces, len(ball.vertices), passes, seed=passes)
        for passes, strength in parts.items()
    )
    sigma = 0.6 * mean_edge_of(ball.vertices, ball.faces)
    noisy = ball.vertices + sigma / noise.std() * noise * ball.normals
    learned, known = smooth(noisy, ball.faces), smooth(noisy, ball.faces, noise=sigma)
    assert learned.noise_before < sigma / 3
    assert known.noise_before == pytest.approx(sigma)
    assert known.noise_length > 2.0 * learned.noise_length > 0.0
    errors = [mean_angle(result.vertices, ball.vertices, ball.faces) for result in (learned, known)]
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize(
    ("surface", "passes", "most"),
    [
        pytest.param(torus(resolution=40, jitter=0.3), 3, 0.45, id="torus, three times"),
        pytest.param(ellipsoid(resolution=14, jitter=0.2), 1, 0.3, id="ellipsoid, once"),
        pytest.param(ellipsoid(resolution=14, jitter=0.2), 3, 0.4, id="ellipsoid, three times"),
    ],
)
def test_averaged_noise_is_taken_off(surface, passes, most):
    noisy = along_normals(surface, 0.1, passes, seed=1)
    result = smooth(noisy, surface.faces)
    assert height_error(surface, result.vertices) < most * height_error(surface, noisy)
    assert result.noise_before == pytest.approx(height_error(surface, noisy), rel=0.15)


def test_noise_that_turns_normals_is_taken_off():
    """Half an edge in every coordinate."""
    surface = ellipsoid(resolution=16, jitter=0.2)
    noisy = in_all_directions(surface.vertices, surface.faces, 0.5)
    result = smooth(noisy, surface.faces)
    assert height_error(surface, result.vertices) < 0.3 * height_error(surface, noisy)
