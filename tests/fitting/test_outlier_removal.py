"""Vertices far off the surface are moved onto it, and the others stay."""

import numpy as np

from bezier_filters import triangle_mesh
from bezier_filters.fitting.outlier_removal import _geometric_means, move_outliers
from bezier_filters.kernels.kernel_input import kernel_mesh, prepare_kernel_mesh
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.surfaces import block_with_sharp_edges, sphere, torus

SIGMA = 0.0006


def cleaned(vertices, faces):
    """Vertices as `move_outliers` leaves them."""
    mesh = triangle_mesh(vertices, faces)
    adjacency = vertex_adjacency(mesh)
    arrays = kernel_mesh(mesh, adjacency, tangent_planes(mesh, adjacency))
    return move_outliers(arrays).vertices


def noisy_torus(far_share):
    """A torus with noise that is five times as large on one half, and some vertices much farther off."""
    rng = np.random.default_rng(0)
    surface = torus(resolution=40, jitter=0.3)
    n = len(surface.vertices)
    sigma = SIGMA * np.where(surface.vertices[:, 0] > 0, 5.0, 1.0)
    heights = sigma * rng.standard_normal(n)
    far = rng.random(n) < far_share
    heights[far] += sigma[far] * rng.choice([-1, 1], far.sum()) * rng.uniform(10, 20, far.sum())
    return surface, sigma, far, heights, surface.vertices + heights[:, None] * surface.normals


def test_outliers_come_back_to_the_surface_and_the_others_stay():
    surface, sigma, far, heights, vertices = noisy_torus(0.04)
    result = cleaned(vertices, surface.faces)
    moved = (result != vertices).any(axis=1)
    assert moved[far].mean() > 0.9
    assert moved[~far].mean() < 0.02
    left = np.einsum("ij,ij->i", result - surface.vertices, surface.normals)
    assert np.median(np.abs(left / sigma)[far]) < 2.0
    assert np.median(np.abs(heights / sigma)[far]) > 10.0


def test_what_is_not_fitted_makes_nothing_around_it_far_off():
    """Its distance from a fit is not 0: that made the noise around it seem none."""
    surface = sphere(resolution=12)
    mesh = triangle_mesh(surface.vertices, surface.faces)
    adjacency = vertex_adjacency(mesh)
    arrays = kernel_mesh(mesh, adjacency, tangent_planes(mesh, adjacency))
    values, is_known = np.full(mesh.vertex_count, 2.0), np.arange(mesh.vertex_count) % 3 > 0
    values[~is_known] = 0.0
    assert np.allclose(_geometric_means(arrays, values, is_known), 2.0, rtol=1e-12)


def test_hardly_anything_is_far_off_in_gaussian_noise():
    surface, _, _, _, vertices = noisy_torus(0.0)
    assert (cleaned(vertices, surface.faces) != vertices).any(axis=1).mean() < 0.01


def test_moves_do_not_depend_on_the_numbering():
    """On the exact sides of a block the distances from the fits are rounding."""
    vertices, faces = block_with_sharp_edges(resolution=12, jitter=0.2)
    random = np.random.default_rng(0)
    vertices = vertices + 0.1 * random.standard_normal(vertices.shape) * (random.random((len(vertices), 1)) < 0.3)
    order = random.permutation(len(vertices))
    number = np.argsort(order).astype(np.int32)
    one, other = (
        move_outliers(prepare_kernel_mesh(triangle_mesh(*mesh), with_barriers=False)).vertices
        for mesh in ((vertices, faces), (vertices[order], number[faces]))
    )
    np.testing.assert_allclose(other, one[order], atol=1e-9)
    assert (np.abs(one - vertices).max(axis=1) > 0.01).any()
