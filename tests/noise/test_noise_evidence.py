"""The likelihood tells correlated noise from white noise and from detail."""

import numpy as np
import pytest
from scanner_noise import along_normals, in_all_directions, learned, mean_edge_of

from bezier_filters.noise.noise_evidence import Contrasts, noise_evidence
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, torus

WHITE, CORRELATED = NoiseModel(1.0), NoiseModel(0.05, (0.95,), (1.2,))


def drawn_contrasts(model, level, places=60, seed=0):
    """Contrasts of noise that is drawn with the covariance of a model, on hexagonal 3-rings without shape."""
    grid = np.array([(i + 0.5 * j, 0.75**0.5 * j) for i in range(-3, 4) for j in range(-3, 4) if abs(i + j) <= 3])
    x, y = grid.T
    design = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
    across = np.linalg.qr(design, mode="complete")[0][:, 6:].T
    squares = np.square(grid[:, np.newaxis] - grid).sum(axis=2)
    covariance = model.scale_variance(level**2 / model.variance).covariances_of(squares[np.newaxis], np.ones((1, 37)))
    heights = np.random.default_rng(seed).multivariate_normal(np.zeros(37), covariance[0], size=places)
    repeated = np.broadcast_to(across, (places, *across.shape))
    return Contrasts(heights @ across.T, repeated, repeated, np.broadcast_to(squares, (places, 37, 37)), 1.0)


@pytest.mark.parametrize("level", [1e-6, 0.1, 30.0])
@pytest.mark.parametrize(("true", "other"), [(WHITE, CORRELATED), (CORRELATED, WHITE)])
def test_the_true_model_is_more_likely(true, other, level):
    contrasts = drawn_contrasts(true, level)
    assert noise_evidence(contrasts, true, 1.0) > noise_evidence(contrasts, other, 1.0) + 10.0


def test_the_level_of_the_model_and_the_unit_of_length_do_not_matter():
    contrasts = drawn_contrasts(CORRELATED, 0.2)
    longer = NoiseModel(0.05 * 9.0, (0.95 * 9.0,), (1.2 * 7.0,))
    assert noise_evidence(contrasts, longer, 7.0) == pytest.approx(noise_evidence(contrasts, CORRELATED, 1.0))


@pytest.mark.parametrize(("true", "other"), [(WHITE, CORRELATED), (CORRELATED, WHITE)])
def test_shape_and_levels_that_differ_from_place_to_place_do_not_matter(true, other):
    contrasts = drawn_contrasts(true, 0.1)
    smooth = np.exp(-0.5 / 9.0 * contrasts.squares[0])
    random = np.random.default_rng(1)
    shape = random.multivariate_normal(np.zeros(37), smooth, size=60) * 10.0 ** random.uniform(-1, 2, size=(60, 1))
    levels = np.where(np.arange(60) < 42, 1.0, 0.03)[:, np.newaxis]
    mixed = contrasts._replace(values=levels * contrasts.values + shape @ contrasts.of_shape[0].T)
    assert noise_evidence(mixed, true, 1.0) > noise_evidence(mixed, other, 1.0) + 10.0


def test_exact_planes_are_finite():
    contrasts = drawn_contrasts(WHITE, 1.0)
    assert np.isfinite(noise_evidence(contrasts._replace(values=0.0 * contrasts.values), WHITE, 1.0))


@pytest.mark.parametrize("seed", range(3))
def test_detail_beside_white_noise_is_not_correlated_noise(seed):
    """Edges and corners of a block and the tips of a star look correlated; they are not everywhere."""
    vertices, faces = block_with_sharp_edges(resolution=24, jitter=0.2)
    assert learned(in_all_directions(vertices, faces, 0.05, seed), faces) is None
    star = bumpy_star(resolution=40, jitter=0.3)
    assert learned(along_normals(star, 0.05, 0, seed), star.faces) is None


@pytest.mark.parametrize("passes", [1, 3])
def test_averaged_noise_is_correlated_noise(passes):
    surface = torus(resolution=48, jitter=0.2)
    edge = mean_edge_of(surface.vertices, surface.faces)
    assert learned(along_normals(surface, 0.1, passes), surface.faces).sigma == pytest.approx(0.1 * edge, rel=0.2)
