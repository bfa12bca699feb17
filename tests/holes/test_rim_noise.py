"""Holes whose rims have noise, or spikes, that the surface around them does not have."""

import numpy as np
import pytest
from hole_cases import filled_hole, hole_around, sheet, without_faces_near
from surface_cases import border_edges

from bezier_filters import fill_holes
from bezier_filters.holes.rim_noise import normals_beyond_noisy_rim
from bezier_filters.surfaces import block_with_sharp_edges, ellipsoid, sphere


def open_ball(height, noise=0.0, spikes=0, seed=0):
    """A ball without its top, whose rim has noise in all directions, or spikes towards the pole; the edge length."""
    ball = sphere(resolution=20, jitter=0.2, seed=1)
    vertices, faces = ball.vertices.copy(), ball.faces[ball.vertices[ball.faces].mean(axis=1)[:, 2] < height]
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    rim = np.unique(border_edges(faces))
    vertices[rim] += noise * edge * np.random.default_rng(seed).standard_normal((len(rim), 3))
    chosen = rim[:: len(rim) // spikes][:spikes] if spikes else rim[:0]
    vertices[chosen] = 0.4 * vertices[chosen] + [0.0, 0.0, 0.6]
    return vertices, faces, edge


def distance(vertices, result, edge):
    new = result.vertices[len(vertices) :]
    return np.sqrt(np.square(np.linalg.norm(new, axis=1) - 1.0).mean()) / edge


@pytest.mark.parametrize("height", [0.5, 0.75, 0.9])
@pytest.mark.parametrize("noise", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_fills_do_not_continue_the_noise_of_a_rim(height, noise, seed):
    vertices, faces, edge = open_ball(height, noise, seed=seed)
    result = fill_holes(vertices, faces)
    assert filled_hole(result).method == "surface"
    assert distance(vertices, result, edge) < 0.05


def test_fills_do_not_continue_spikes():
    vertices, faces, edge = open_ball(0.9, spikes=3)
    result = fill_holes(vertices, faces)
    assert filled_hole(result).method == "surface"
    assert distance(vertices, result, edge) < 0.02


@pytest.mark.parametrize("height", [0.3, 0.5, 0.75, 0.9])
def test_clean_rims_are_followed(height):
    vertices, faces, edge = open_ball(height)
    region = hole_around(vertices, faces, rings=5)
    assert normals_beyond_noisy_rim(region, vertices[region.ids], None) is None
    result = fill_holes(vertices, faces)
    assert distance(vertices, result, edge) < 0.03
    assert filled_hole(result).rim_dihedral < 6.0


@pytest.mark.parametrize("resolution", [12, 24])
def test_shape_at_a_rim_is_no_noise(resolution):
    """Curvature that differs around the rim, and sharp edges that cross it."""
    body = ellipsoid(semi_axes=(1.0, 0.6, 0.3), resolution=resolution)
    block_points, block_faces = block_with_sharp_edges(resolution=12)
    for points, faces, normals, place in (
        (body.vertices, body.faces, body.normals, [1.0, 0.0, 0.0]),
        (body.vertices, body.faces, body.normals, [0.0, 0.0, 0.3]),
        (block_points, block_faces, block_points, [0.5, 0.5, 0.0]),
    ):
        kept = without_faces_near(points, faces, np.array(place), 0.25)
        region = hole_around(points, kept, rings=5)
        assert normals_beyond_noisy_rim(region, normals[region.ids], None) is None


@pytest.mark.parametrize("radius", [4.0, 5.0, 6.0])
def test_a_zigzag_rim_on_a_bump_is_no_noise(radius):
    """Its vertices lie alternately deeper and higher, and the prediction misses them alternately."""
    vertices, faces = sheet(40, 40)
    vertices -= [20.0, 20.0, 0.0]
    vertices[:, 2] = 6.0 * np.exp(-np.square(vertices[:, :2]).sum(axis=1) / 30.0)
    kept = faces[np.linalg.norm(vertices[faces].mean(axis=1)[:, :2], axis=1) > radius]
    new = fill_holes(vertices, kept).vertices[len(vertices) :]
    heights = 6.0 * np.exp(-np.square(new[:, :2]).sum(axis=1) / 30.0)
    assert np.sqrt(np.square(new[:, 2] - heights).mean()) < 0.2
