"""What is learned of noise that was made by averaging, and that shape and white noise are not taken for such."""

import numpy as np
import pytest
from numba import config
from scanner_noise import along_normals, in_all_directions, learned, length_of, mean_edge_of

from bezier_filters import estimate_vertex_geometry
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, cylinder, ellipsoid, sphere, torus, waves

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")

LEVEL = 0.1  # mean edges
SURFACES = {
    "torus": torus(resolution=60, jitter=0.3),
    "star": bumpy_star(resolution=30, jitter=0.2),
    "ellipsoid": ellipsoid(resolution=20, jitter=0.3),
}
SEEDS = range(4)


def found(surface, passes, level=LEVEL):
    """Standard deviations and lengths over the true ones, with different noise, (seeds, 2)."""
    edge = mean_edge_of(surface.vertices, surface.faces)
    models = [learned(along_normals(surface, level, passes, seed), surface.faces) for seed in SEEDS]
    assert all(model is not None for model in models)
    unit = level * edge, length_of(passes) * edge
    return np.array([(model.sigma / unit[0], model.length / unit[1]) for model in models])


@pytest.mark.parametrize("passes", [1, 3])
@pytest.mark.parametrize("name", SURFACES)
def test_strength_and_length_of_averaged_noise_are_found(name, passes):
    """On average and, by however few neighbourhoods, nearly as well each time."""
    sigmas, lengths = found(SURFACES[name], passes).T
    assert np.exp(np.log(sigmas).mean()) == pytest.approx(1.0, abs=0.15)
    assert np.abs(sigmas - 1.0).max() < 0.2
    assert np.abs(np.log(lengths)).max() < np.log(1.4)


@pytest.mark.parametrize("name", SURFACES)
def test_of_noise_over_many_edges_most_is_found(name):
    """Some of it is as smooth as shape."""
    sigmas, lengths = found(SURFACES[name], 8).T
    assert sigmas.min() > 0.6
    assert sigmas.max() < 1.1
    assert np.abs(np.log(lengths)).max() < np.log(1.25)


@pytest.mark.parametrize("passes", [pytest.param(1, marks=pytest.mark.slow), 3])
@pytest.mark.parametrize("make", [torus, bumpy_star, ellipsoid])
def test_on_regular_meshes_it_is_no_shape(make, passes):
    """Triangles of one kind make it depend on the direction, and averages of these leave less white noise."""
    sigmas, lengths = found(make(resolution=80 if make is torus else 40), passes).T
    assert 0.8 < sigmas.min() <= sigmas.max() < 1.9
    assert np.abs(np.log(lengths)).max() < np.log(1.6)


def test_on_a_regular_mesh_its_fine_waves_are_no_shape():
    """A Gaussian covariance leaves next to nothing to high degrees, which real averages do not."""
    surface = torus(resolution=80)
    for seed in range(3, 6):
        fit = estimate_vertex_geometry(along_normals(surface, 0.3, 3, seed), surface.faces).fit
        assert fit.rings >= 6, (seed, fit)


def test_twice_the_noise_and_a_larger_mesh_are_told_alike():
    """Lengths are in edges, and nothing depends on the unit."""
    surface = SURFACES["ellipsoid"]
    vertices = along_normals(surface, LEVEL, 3)
    model, larger = learned(vertices, surface.faces), learned(1024.0 * vertices, surface.faces)
    assert larger.sigma == pytest.approx(1024.0 * model.sigma, rel=1e-6)
    assert larger.lengths == pytest.approx([1024.0 * length for length in model.lengths], rel=1e-6)
    twice = learned(along_normals(surface, 2.0 * LEVEL, 3), surface.faces)
    assert twice.sigma == pytest.approx(2.0 * model.sigma, rel=0.1)
    assert twice.length == pytest.approx(model.length, rel=0.15)


@pytest.mark.parametrize("level", [0.02, 0.1])
@pytest.mark.parametrize("name", SURFACES)
def test_white_noise_is_white(name, level):
    surface = SURFACES[name]
    assert [learned(along_normals(surface, level, 0, seed), surface.faces) for seed in SEEDS] == [None] * len(SEEDS)


@pytest.mark.parametrize("jitter", [0.0, 0.3])
@pytest.mark.parametrize("make", [sphere, torus, bumpy_star, ellipsoid, waves, cylinder])
def test_shape_is_not_noise(make, jitter):
    for resolution in (12, 28):
        surface = make(resolution=resolution, jitter=jitter)
        assert learned(surface.vertices, surface.faces) is None


@pytest.mark.parametrize("level", [0.02, 0.1])
def test_sharp_edges_are_not_noise(level):
    vertices, faces = block_with_sharp_edges(resolution=24, jitter=0.2)
    for seed in SEEDS:
        assert learned(in_all_directions(vertices, faces, level, seed), faces) is None


def test_noise_is_found_on_a_small_mesh():
    """Its flattest places are too few to show by themselves what is everywhere."""
    surface = cylinder(resolution=60, jitter=0.2)
    edge = mean_edge_of(surface.vertices, surface.faces)
    white = np.random.default_rng(0).normal(scale=0.1 * edge, size=(3, len(surface.vertices), 1)) * surface.normals
    models = [learned(along_normals(surface, 0.17, 4, k) + white[k], surface.faces) for k in range(3)]
    assert all(model.sills for model in models)
    assert np.mean([model.sigma for model in models]) == pytest.approx(0.2 * edge, rel=0.15)


def test_noise_with_hardly_a_white_part_need_not_show_it_at_a_few_places():
    surface = torus(resolution=64)
    edge = mean_edge_of(surface.vertices, surface.faces)
    for seed in range(2):
        model = learned(along_normals(surface, 0.2, 4, seed), surface.faces)
        assert model.sigma == pytest.approx(0.2 * edge, rel=0.2)


def test_chance_does_not_decide_between_lengths_that_explain_about_as_much():
    """With the shorter one, a third of the noise counts as shape."""
    surface = bumpy_star(resolution=40, jitter=0.3)
    edge = mean_edge_of(surface.vertices, surface.faces)
    for seed in (1, 5, 6, 7):
        assert 0.8 < learned(along_normals(surface, 0.1, 8, seed), surface.faces).sigma / (0.1 * edge) < 1.1
