"""The share of outliers among the vertices, and noise that has none."""

import numpy as np
import pytest
from outlier_cases import bent_torus, block, spikes, star, with_heights
from scanner_noise import mean_edge_of

from bezier_filters import triangle_mesh
from bezier_filters.fitting.noise_level import learn_mesh_noise
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.noise.outliers import stand_out
from bezier_filters.sampling.neighbourhood_samples import NeighbourhoodSample


@pytest.mark.parametrize("make", [star, bent_torus, block])
@pytest.mark.parametrize("share", [0.03, 0.1])
@pytest.mark.parametrize("size", [0.1, 1.0])
def test_the_share_of_outliers_is_what_it_is(make, share, size):
    shape = make()
    mesh = triangle_mesh(*with_heights(shape, spikes(len(shape[0]), share, size)[0]))
    noise = learn_mesh_noise(prepare_mesh(mesh))
    assert 0.4 * share < noise.outliers < 1.4 * share  # those of small heights are none
    assert noise.sigma < 0.02 * mean_edge_of(mesh.vertices, mesh.faces)


@pytest.mark.parametrize("make", [star, pytest.param(block, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("share", "size", "base"), [(0.01, 0.5, 0.0), (0.01, 1.0, 0.05), (0.03, 1.0, 0.2)])
def test_a_few_outliers_are_seen(make, share, size, base):
    shape, found = make(), []
    for seed in range(4):  # of one draw, some 28 outliers are looked at
        heights = spikes(len(shape[0]), share, size, seed)[0] + spikes(len(shape[0]), 1.0, base, seed + 1)[0]
        mesh = triangle_mesh(*with_heights(shape, heights))
        found.append(learn_mesh_noise(prepare_mesh(mesh)).outliers)
    assert found[0] > 0.2 * share
    assert 0.2 * share < np.mean(found) < 1.2 * share  # small ones are none


@pytest.mark.parametrize("make", [star, block])
@pytest.mark.parametrize("draw", ["standard_normal", "uniform", "laplace", "standard_t"])
def test_noise_that_all_vertices_have_has_no_outliers(make, draw):
    shape, random = make(), np.random.default_rng(1)
    n = len(shape[0])
    heights = random.standard_t(5, n) if draw == "standard_t" else getattr(random, draw)(size=n)
    mesh = triangle_mesh(*with_heights(shape, 0.1 * (heights - heights.mean()) / heights.std()))
    assert learn_mesh_noise(prepare_mesh(mesh)).outliers == 0.0


@pytest.mark.parametrize("make", [star, block])
@pytest.mark.parametrize("size", [0.3, 0.5])
def test_noise_in_all_directions_has_no_outliers(make, size):
    """It folds neighbourhoods as outliers do, and those are looked at, too."""
    vertices, faces, _ = make()
    noise = np.random.default_rng(1).standard_normal(vertices.shape)
    mesh = triangle_mesh(vertices + size * mean_edge_of(vertices, faces) * noise, faces)
    assert learn_mesh_noise(prepare_mesh(mesh)).outliers == 0.0


@pytest.mark.parametrize("make", [star, block])
def test_noise_that_ends_has_no_outliers(make):
    """Beside vertices without noise those with noise look like some."""
    shape = make()
    heights = np.random.default_rng(1).standard_normal(len(shape[0])) * (shape[0][:, 0] > np.median(shape[0][:, 0]))
    mesh = triangle_mesh(*with_heights(shape, 0.1 * heights))
    assert learn_mesh_noise(prepare_mesh(mesh)).outliers == 0.0


@pytest.mark.parametrize(("like_it", "expected"), [(0, True), (2, True), (4, False), (6, False)])
def test_most_neighbours_of_outliers_are_on_the_surface(like_it, expected):
    """Planes with a raised center, next to so many raised neighbours in the mesh."""
    count, rng = 200, np.random.default_rng(0)
    angles = np.arange(6) * np.pi / 3.0
    hexagon = np.column_stack([np.cos(angles), np.sin(angles)])
    flat = np.concatenate([np.zeros((1, 2)), *(k * hexagon for k in (1, 2, 3)), rng.uniform(-3, 3, (18, 2))])
    points = np.zeros((count, len(flat), 3))
    points[..., :2] = flat
    points[..., 2] = 0.01 * rng.standard_normal(points.shape[:2])
    points[:, 0, 2] += 1.0
    points[:, 1 : 1 + like_it, 2] += 1.0
    sizes = np.tile(np.array([1, 7, 13, len(flat)], dtype=np.int32), (count, 1))
    usable = np.ones(sizes.shape, dtype=np.bool_)
    sample = NeighbourhoodSample(np.arange(count, dtype=np.int32), points, sizes, usable, usable, np.zeros(count))
    assert stand_out(sample) == expected
