"""The strength of the noise of a mesh, learned or given."""

import numpy as np
import pytest
from scanner_noise import along_normals, mean_edge_of
from scarce_meshes import soup

from bezier_filters import smooth, triangle_mesh
from bezier_filters.fitting.mesh_neighbourhoods import MeshNeighbourhoods
from bezier_filters.fitting.noise_level import (
    MAX_NOISE_PER_EDGE,
    estimate_noise,
    explain_unknown_noise,
    is_noisy,
    learn_mesh_noise,
)
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.surfaces import sphere, torus

RING = torus(resolution=40, jitter=0.3)
EDGE = mean_edge_of(RING.vertices, RING.faces)


def learned(vertices, faces, *options):
    mesh = triangle_mesh(vertices, faces)
    return learn_mesh_noise(prepare_mesh(mesh), *options)


@pytest.mark.parametrize("level", [0.05, 0.2])
@pytest.mark.parametrize("passes", [0, 3])
def test_white_and_averaged_noise_have_their_strength(level, passes):
    noise = learned(along_normals(RING, level, passes), RING.faces)
    assert noise.sigma == pytest.approx(level * EDGE, rel=0.15)
    assert bool(noise.sills) == (passes > 0)


def test_a_given_strength_is_taken_and_the_rest_is_learned():
    vertices = along_normals(RING, 0.1, 3)
    found, given = learned(vertices, RING.faces), learned(vertices, RING.faces, 0.1 * EDGE)
    assert given.sigma == pytest.approx(0.1 * EDGE)
    assert given.length == pytest.approx(found.length)
    assert learned(vertices, RING.faces, 0.0) == NoiseModel(0.0)


def test_triangles_that_share_nothing_have_no_noise_and_a_reason():
    mesh = triangle_mesh(*soup())
    assert learned(*soup()) is None
    assert "reach a border or a sharp edge" in explain_unknown_noise(prepare_mesh(mesh))


def test_noise_masks_edges_from_a_fiftieth_of_an_edge_on():
    mesh = prepare_mesh(triangle_mesh(RING.vertices, RING.faces))
    assert [is_noisy(mesh, level * EDGE) for level in (0.01, 0.03)] == [False, True]
    assert not is_noisy(mesh, None)


def test_noise_that_would_make_edges_longer_is_shape():
    """White noise of one edge makes edges 2 / sqrt(pi) edges long at least: shorter ones cannot have it."""
    mesh = prepare_mesh(triangle_mesh(along_normals(RING, 0.2, 0), RING.faces))
    source = MeshNeighbourhoods(prepare_kernel_mesh(mesh, with_barriers=True))
    sigma = estimate_noise(source, None, None, mesh.mean_edge).sigma
    assert estimate_noise(source, None, None, 1.01 * sigma / MAX_NOISE_PER_EDGE).sigma == sigma
    assert estimate_noise(source, None, None, 0.99 * sigma / MAX_NOISE_PER_EDGE) is None


@pytest.mark.parametrize(
    "make", [lambda: torus(resolution=48, jitter=0.2), lambda: sphere(resolution=32, jitter=0.2)], ids=["torus", "ball"]
)
def test_noise_on_a_part_is_learned_and_removed(make):
    surface = make()
    edge, n = mean_edge_of(surface.vertices, surface.faces), len(surface.vertices)
    is_noisy = surface.vertices[:, 0] > np.quantile(surface.vertices[:, 0], 0.85)
    heights = 0.2 * edge * np.random.default_rng(0).normal(size=n) * is_noisy
    vertices = surface.vertices + heights[:, np.newaxis] * surface.normals
    noise = learned(vertices, surface.faces)
    assert noise.sigma == pytest.approx(0.2 * edge, rel=0.3)
    after = np.einsum("ij,ij->i", smooth(vertices, surface.faces).vertices - surface.vertices, surface.normals) / edge
    assert np.sqrt(np.mean(after[is_noisy] ** 2)) < 0.05
    assert np.abs(after[surface.vertices[:, 0] < np.quantile(surface.vertices[:, 0], 0.7)]).max() < 0.05


def test_large_residuals_of_shape_are_no_noise():
    """A smooth ball with waves of a few edges on a part of it."""
    ball = sphere(resolution=32, jitter=0.2)
    angle = np.maximum(ball.vertices[:, 2] - 0.6, 0.0)
    vertices = ball.vertices * (1.0 + 0.02 * np.sin(25.0 * ball.vertices[:, :1]) * angle[:, np.newaxis])
    noise = learned(vertices, ball.faces)
    assert noise.sigma < 0.01 * mean_edge_of(vertices, ball.faces)
