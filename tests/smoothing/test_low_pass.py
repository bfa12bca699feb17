"""The strength and the order of the low-pass filter."""

import numpy as np
import pytest
from laplacian_cases import dense
from numba import config
from scipy.linalg import lu_factor, lu_solve

from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.sampling.mesh_parts import whole_mesh
from bezier_filters.smoothing.chebyshev import DEFAULT_ORDER, low_pass
from bezier_filters.smoothing.clusters import clusters_of
from bezier_filters.smoothing.laplacian import cotangent_laplacian, umbrella_laplacian
from bezier_filters.smoothing.low_pass import FILTER_ORDERS, learn_low_pass, max_strength
from bezier_filters.smoothing.noise import NoisyMesh
from bezier_filters.surfaces import sphere, torus


@pytest.mark.parametrize("power", [None, 0.0, 1.0])
@pytest.mark.parametrize("length", [2.5, 4.0, 8.0, 16.0])
def test_the_strongest_filter_leaves_half_of_a_wave(power, length):
    """On triangles of one size, whatever the Laplacian and the order; a stronger filter leaves less."""
    i, j = np.indices((90, 90)).reshape(2, -1)
    first = np.flatnonzero((i < 89) & (j < 89))
    faces = np.concatenate([first + np.array([[0], [90], [1]]), first + np.array([[90], [91], [1]])], axis=1).T
    plane = np.column_stack([i + 0.5 * j, np.sqrt(0.75) * j])
    mesh = prepare_mesh(triangle_mesh(np.column_stack([plane, np.zeros(len(i))]), faces))
    inside = (np.minimum(i, j) > 30) & (np.maximum(i, j) < 59)
    umbrella = umbrella_laplacian(whole_mesh(mesh), "curve")
    laplacian = umbrella if power is None else cotangent_laplacian(whole_mesh(mesh), "curve", power, 1.0)
    for angle in (0.0, 0.5):
        wave = np.sin(2.0 * np.pi / length * plane @ [np.cos(angle), np.sin(angle)])[:, np.newaxis]
        for order in FILTER_ORDERS:
            for times in (1.0, 3.0):
                left = low_pass(laplacian, wave, np.array([times * max_strength(length)]), order=order)
                share = (left * wave)[inside].sum() / np.square(wave[inside]).sum()
                assert share == pytest.approx(1.0 / (1.0 + times ** (order / 4)), abs=0.02)


@pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")
def test_the_order_suits_the_detail():
    ring = torus(resolution=30, jitter=0.2)  # whose detail ends at some size
    assert chosen_order(ring.vertices, ring.normals, ring.faces) > DEFAULT_ORDER
    ball = sphere(resolution=20)  # with detail of all sizes, whose spectrum x^-4 Wiener's filter of order 4 suits best
    mesh = prepare_mesh(triangle_mesh(ball.vertices, ball.faces))
    laplacian = umbrella_laplacian(whole_mesh(mesh), "curve")
    roughness = np.random.default_rng(1).standard_normal((mesh.vertex_count, 1))
    factors = lu_factor(dense(laplacian) + 0.01 * np.eye(mesh.vertex_count))
    for _ in range(2):  # over x + 0.01 twice, so that even the largest detail is finite
        roughness = lu_solve(factors, roughness)
    rough = ball.vertices * (1.0 + 0.02 * roughness / roughness.std())
    assert chosen_order(rough, ball.normals, ball.faces) == DEFAULT_ORDER


def chosen_order(vertices, normals, faces):
    """The order of the filter that noise of a fifth of the mean edge leads to."""
    clean = prepare_mesh(triangle_mesh(vertices, faces))
    unit = clean.mean_edge
    heights = 0.2 * unit * np.random.default_rng(0).standard_normal(len(vertices))
    noisy = triangle_mesh(vertices + heights[:, np.newaxis] * normals, faces)
    part = whole_mesh(prepare_mesh(noisy))
    noisy = NoisyMesh(part, clusters_of(part), np.full(len(vertices), 0.2 * unit))
    return learn_low_pass(noisy, "curve", unit)[0].order
