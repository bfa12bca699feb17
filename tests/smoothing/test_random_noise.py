"""Noise made by heat flow is as alike as the model says, and what smoothing leaves of noise that is."""

import numpy as np
import pytest
from numba import config
from scanner_noise import averaged_noise, mean_edge_of, ring_means

from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.sampling.mesh_parts import whole_mesh
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.noise import NoisyMesh
from bezier_filters.smoothing.random_noise import WHITE, Correlation, random_signs
from bezier_filters.surfaces import bumpy_star, torus, waves

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
    part = whole_mesh(prepare_mesh(mesh))
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


def test_noise_made_here_is_as_alike_as_is_told():
    """The tests' own noise: a pass keeps one half, so neighbours on a regular mesh have a third in common."""
    surface = torus(resolution=20)
    values = averaged_noise(surface.faces, len(surface.vertices), 1, columns=64)
    starts, ends = pairs_apart(surface.faces, len(values))[0]
    assert (values[starts] * values[ends]).mean() == pytest.approx(1.0 / 3.0, abs=0.02)
