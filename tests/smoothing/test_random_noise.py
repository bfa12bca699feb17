"""Noise made by heat flow is as alike as the model says, and what smoothing leaves of noise that is."""

from dataclasses import replace

import numpy as np
import pytest
from numba import config
from scanner_noise import along_normals, averaged_noise, in_all_directions, mean_edge_of, ring_means
from test_smoothing import mean_angle

from bezier_filters import smooth
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.mesh_parts import whole_mesh
from bezier_filters.smoothing.noise import NoisyMesh
from bezier_filters.smoothing.random_noise import WHITE, Correlation, random_signs
from bezier_filters.noise.noise_model import HIDDEN_RANGE_FACTOR, MAX_UNDERESTIMATION, NoiseModel, rescale_noise
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, ellipsoid, sphere, torus, waves

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")

SURFACES = {
    "torus": torus(resolution=30, jitter=0.3),
    "star": bumpy_star(resolution=20, jitter=0.2),
    "waves": waves(resolution=40),
}
NOISES = {  # lengths in edges
    "short": NoiseModel(0.3, (0.7,), (0.7,)),
    "middle": NoiseModel(0.05, (0.95,), (1.2,)),
    "long": NoiseModel(0.02, (0.98,), (2.0,)),
    "two parts": NoiseModel(0.2, (0.5, 0.3), (0.7, 2.0)),
}
each_surface = pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES)
each_noise = pytest.mark.parametrize("noise", NOISES.values(), ids=NOISES)


def in_units(noise, unit):
    return NoiseModel(noise.white, noise.sills, tuple(unit * length for length in noise.lengths))


def made_of(surface, noise):
    """The part, its Laplacian and how the noise is made there."""
    mesh = triangle_mesh(surface.vertices, surface.faces)
    part = whole_mesh(mesh, vertex_adjacency(mesh))
    laplacian, unit = umbrella_laplacian(part, "free"), mean_edge_of(surface.vertices, surface.faces)
    every = np.ones(len(surface.vertices), dtype=np.bool_)
    return part, laplacian, Correlation.calibrate(in_units(noise, unit), unit, part.ids, laplacian, every)


def pairs_apart(faces, count):
    """Pairs of vertices that are one edge apart, and that are two edges apart."""
    one = ring_means(faces, count) > 0
    one.setdiag(False)
    one.eliminate_zeros()
    two = (one @ one).astype(np.int8) - (one @ one).multiply(one).astype(np.int8)
    two.setdiag(0)
    two.eliminate_zeros()
    return one.nonzero(), two.nonzero()


def model_correlations(noise, squares):
    return sum(
        sill * np.exp(-squares / (2.0 * length**2)) for sill, length in zip(noise.sills, noise.lengths, strict=True)
    ) / (noise.white + sum(noise.sills))


@each_surface
@each_noise
def test_noise_is_as_alike_as_the_model_says(surface, noise):
    """At one edge and at two, as means over all pairs, and it has variance 1."""
    part, laplacian, correlation = made_of(surface, noise)
    scaled = in_units(noise, mean_edge_of(surface.vertices, surface.faces))
    noisy = NoisyMesh(part, None, np.ones(len(part.ids)), correlation, laplacian)
    for make in (noisy.probes, noisy.samples):
        made = make(32).astype(np.float64)
        variance = np.square(made).mean()
        assert variance == pytest.approx(1.0, abs=0.16)  # so well is it known by a single column of signs
        assert abs(made.mean()) < 0.05
        for starts, ends in pairs_apart(surface.faces, len(made)):
            squares = np.square(surface.vertices[starts] - surface.vertices[ends]).sum(axis=1)
            found = (made[starts] * made[ends]).mean() / variance
            assert found == pytest.approx(model_correlations(scaled, squares).mean(), abs=0.045)


@each_surface
@each_noise
def test_the_number_of_vertices_that_are_alike_is_the_sum_of_squared_correlations(surface, noise):
    _, _, correlation = made_of(surface, noise)
    scaled = in_units(noise, mean_edge_of(surface.vertices, surface.faces))
    rows = np.arange(0, len(surface.vertices), 9)
    squares = np.square(surface.vertices[rows, np.newaxis] - surface.vertices).sum(axis=2)
    correlations = model_correlations(scaled, squares)
    correlations[np.arange(len(rows)), rows] = 1.0
    assert correlation.variance_inflation == pytest.approx(np.square(correlations).sum(axis=1).mean(), rel=0.25)


def test_white_noise_is_made_of_signs_alone():
    part, laplacian, correlation = made_of(SURFACES["torus"], NoiseModel(3.0))
    assert correlation is WHITE
    noisy = NoisyMesh(part, None, np.ones(len(part.ids)), correlation, laplacian)
    np.testing.assert_array_equal(noisy.probes(4, first=7), random_signs(part.ids, 4, first=7))
    np.testing.assert_array_equal(noisy.mean_squares(noisy.probes(5)), 5.0)


def test_noise_of_known_strength_is_as_alike_as_was_learned():
    """Up to what may be a mistake; beyond it the shape of what was seen stays, and the rest is longer."""
    learned = NOISES["two parts"]
    for strength in (0.1, 1.0, MAX_UNDERESTIMATION, 2.0 * MAX_UNDERESTIMATION):
        found = rescale_noise(learned, strength * learned.sigma)
        assert found.sigma == pytest.approx(strength * learned.sigma)
        assert found.lengths[:2] == learned.lengths
        seen = replace(found, sills=found.sills[:2], lengths=found.lengths[:2])
        assert seen.white / seen.variance == pytest.approx(learned.white / learned.variance)
        assert seen.sigma == pytest.approx(min(strength, MAX_UNDERESTIMATION) * learned.sigma)
        assert found.lengths[2:] == (
            (HIDDEN_RANGE_FACTOR * max(learned.lengths),) if strength > MAX_UNDERESTIMATION else ()
        )
    assert rescale_noise(NoiseModel(2.0), 3.0) == rescale_noise(None, 3.0) == NoiseModel(9.0, given=True)


def test_noise_of_many_lengths_goes_once_its_strength_is_known():
    """Of which less than a third can be told from shape: the rest is longer."""
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


def height_error(surface, vertices):
    """Root mean square of the distance along the normals."""
    return np.sqrt(np.square(np.einsum("ij,ij->i", vertices - surface.vertices, surface.normals)).mean())


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


def test_noise_that_turns_normals_is_taken_off():
    """Half an edge in every coordinate."""
    surface = ellipsoid(resolution=16, jitter=0.2)
    noisy = in_all_directions(surface.vertices, surface.faces, 0.5)
    result = smooth(noisy, surface.faces)
    assert height_error(surface, result.vertices) < 0.3 * height_error(surface, noisy)


def test_noise_made_here_is_as_alike_as_is_told():
    """The tests' own noise: a pass keeps one half, so neighbours on a regular mesh have a third in common."""
    surface = torus(resolution=20)
    values = averaged_noise(surface.faces, len(surface.vertices), 1, columns=64)
    starts, ends = pairs_apart(surface.faces, len(values))[0]
    assert (values[starts] * values[ends]).mean() == pytest.approx(1.0 / 3.0, abs=0.02)
