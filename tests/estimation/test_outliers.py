"""Vertices far off the surface, among others that are not: they are found, and come back to it."""

import numpy as np
import pytest
from scanner_noise import mean_edge_of

from bezier_filters import estimate_vertex_geometry, smooth, triangle_mesh
from bezier_filters.fitting.noise_level import learn_mesh_noise
from bezier_filters.fitting.outlier_removal import _geometric_means, move_outliers
from bezier_filters.kernels.kernel_input import kernel_mesh
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.spikes import move_folded_vertices, remove_spikes
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, sphere, torus

SIGMA = 0.0006


def cleaned(vertices, faces):
    """Vertices as `move_outliers` leaves them."""
    mesh = triangle_mesh(vertices, faces)
    adjacency = vertex_adjacency(mesh)
    arrays = kernel_mesh(mesh, adjacency, tangent_planes(mesh, adjacency))
    return move_outliers(arrays, adjacency).vertices


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


def block():
    """A block, its faces and vertex normals."""
    vertices, faces = block_with_sharp_edges(resolution=30, jitter=0.25)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], area_vectors(vertices, faces))
    return vertices, faces, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def star():
    surface = bumpy_star(resolution=24, jitter=0.2)
    return surface.vertices, surface.faces, surface.normals


def bent_torus():
    surface = torus(resolution=30, jitter=0.2)
    return surface.vertices, surface.faces, surface.normals


def with_heights(shape, heights):
    """A mesh with vertices off it by heights in mean edges."""
    vertices, faces, normals = shape
    return vertices + mean_edge_of(vertices, faces) * heights[:, np.newaxis] * normals, faces


def spikes(count, share, size, seed=0):
    """Heights of which a share is normally distributed, and which those are; the others are 0."""
    random = np.random.default_rng(seed)
    hit = random.random(count) < share
    return hit * size * random.standard_normal(count), hit


def with_spikes(shape, share, size, seed=77):
    """A mesh of which some vertices are off along the normal, and which those are."""
    heights, hit = spikes(len(shape[0]), share, size, seed)
    return with_heights(shape, heights)[0], hit


def height_errors(shape, vertices):
    true, faces, normals = shape
    return np.einsum("ij,ij->i", vertices - true, normals) / mean_edge_of(true, faces)


@pytest.mark.parametrize("make", [star, bent_torus, block])
@pytest.mark.parametrize("share", [0.03, 0.1])
@pytest.mark.parametrize("size", [0.1, 1.0])
def test_the_share_of_outliers_is_what_it_is(make, share, size):
    shape = make()
    mesh = triangle_mesh(*with_heights(shape, spikes(len(shape[0]), share, size)[0]))
    noise = learn_mesh_noise(mesh, vertex_adjacency(mesh))
    assert 0.4 * share < noise.outliers < 1.4 * share  # those of small heights are none
    assert noise.sigma < 0.02 * mean_edge_of(mesh.vertices, mesh.faces)


@pytest.mark.parametrize("make", [star, block])
@pytest.mark.parametrize(("share", "size", "base"), [(0.01, 0.5, 0.0), (0.01, 1.0, 0.05), (0.03, 1.0, 0.2)])
def test_a_few_outliers_are_seen(make, share, size, base):
    shape, found = make(), []
    for seed in range(4):  # of one draw, some 28 outliers are looked at
        heights = spikes(len(shape[0]), share, size, seed)[0] + spikes(len(shape[0]), 1.0, base, seed + 1)[0]
        mesh = triangle_mesh(*with_heights(shape, heights))
        found.append(learn_mesh_noise(mesh, vertex_adjacency(mesh)).outliers)
    assert found[0] > 0.2 * share
    assert 0.2 * share < np.mean(found) < 1.2 * share  # small ones are none


@pytest.mark.parametrize("make", [star, block])
@pytest.mark.parametrize("draw", ["standard_normal", "uniform", "laplace", "standard_t"])
def test_noise_that_all_vertices_have_has_no_outliers(make, draw):
    shape, random = make(), np.random.default_rng(1)
    n = len(shape[0])
    heights = random.standard_t(5, n) if draw == "standard_t" else getattr(random, draw)(size=n)
    mesh = triangle_mesh(*with_heights(shape, 0.1 * (heights - heights.mean()) / heights.std()))
    assert learn_mesh_noise(mesh, vertex_adjacency(mesh)).outliers == 0.0


@pytest.mark.parametrize("make", [star, block])
@pytest.mark.parametrize("size", [0.3, 0.5])
def test_noise_in_all_directions_has_no_outliers(make, size):
    """It folds neighbourhoods as outliers do, and those are looked at, too."""
    vertices, faces, _ = make()
    noise = np.random.default_rng(1).standard_normal(vertices.shape)
    mesh = triangle_mesh(vertices + size * mean_edge_of(vertices, faces) * noise, faces)
    assert learn_mesh_noise(mesh, vertex_adjacency(mesh)).outliers == 0.0


@pytest.mark.parametrize("make", [star, block])
def test_noise_that_ends_has_no_outliers(make):
    """Beside vertices without noise those with noise look like some."""
    shape = make()
    heights = np.random.default_rng(1).standard_normal(len(shape[0])) * (shape[0][:, 0] > np.median(shape[0][:, 0]))
    mesh = triangle_mesh(*with_heights(shape, 0.1 * heights))
    assert learn_mesh_noise(mesh, vertex_adjacency(mesh)).outliers == 0.0


@pytest.mark.parametrize(
    ("make", "share", "size", "left"),
    [(star, 0.03, 0.3, 0.1), (star, 0.03, 1.0, 0.1), (block, 0.03, 0.1, 0.7), (block, 0.03, 1.0, 0.5)],
)
def test_spikes_go_and_what_is_sharp_stays(make, share, size, left):
    """Edges of a clean block are far off fits, too, and were taken for outliers: errors grew sevenfold."""
    shape = make()
    heights, hit = spikes(len(shape[0]), share, size)
    found = smooth(*with_heights(shape, heights))
    errors = height_errors(shape, found.vertices)
    assert np.sqrt(np.square(errors).mean()) < left * np.sqrt(np.square(heights).mean())
    assert (np.abs(errors[~hit]) > 0.05).mean() < 0.02


def test_outliers_that_are_too_dense_are_noise():
    """They hide each other, and to take them off one by one leaves most; single seeds leave .03 to .09 edges."""
    shape = star()
    vertices, faces, _ = shape
    squares = []
    for seed in (2, 3, 4):
        random = np.random.default_rng(seed)
        hit = random.random((len(vertices), 1)) < 0.25
        moved = vertices + 0.7 * mean_edge_of(vertices, faces) * hit * random.standard_normal(vertices.shape)
        squares.append(np.square(height_errors(shape, smooth(moved, faces).vertices)).mean())
    assert np.sqrt(np.mean(squares)) < 0.08


def off_in_all_directions(shape, share, size, seed=77):
    """A mesh of which some vertices are off in all directions, and which those are."""
    vertices, faces, _ = shape
    random = np.random.default_rng(seed)
    hit = random.random((len(vertices), 1)) < share
    return vertices + size * mean_edge_of(vertices, faces) * hit * random.standard_normal(vertices.shape), hit[:, 0]


@pytest.mark.parametrize("make", [star, bent_torus, block])
def test_outliers_in_all_directions_come_back(make):
    """They fold the mesh: neighbourhoods that fold were not looked at, nor fitted, and faces stayed turned over."""
    shape = make()
    moved, _ = off_in_all_directions(shape, 0.03, 1.0)
    truth = area_vectors(shape[0], shape[1])
    errors, turned = [], []
    for vertices in (moved, smooth(moved, shape[1]).vertices):
        errors.append(np.sqrt(np.square(height_errors(shape, vertices)).mean()))
        turned.append((np.einsum("ij,ij->i", area_vectors(vertices, shape[1]), truth) < 0.0).mean())
    assert errors[1] < 0.5 * errors[0]
    assert turned[1] < 0.15 * turned[0]


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_vertices_outside_of_their_neighbours_come_back_between_them(scale):
    vertices, faces, _ = block()
    clean = triangle_mesh(scale * vertices, faces)
    adjacency = vertex_adjacency(clean)
    assert np.array_equal(move_folded_vertices(clean, adjacency).vertices, clean.vertices)
    inside = np.flatnonzero((np.abs(np.abs(vertices) - np.abs(vertices).max(axis=0)) > 0.15).sum(axis=1) == 2)
    k = inside[0]  # on one of the sides, and not near its edges
    ring = adjacency.vertices.indices[adjacency.vertices.indptr[k] : adjacency.vertices.indptr[k + 1]]
    outside = clean.vertices.copy()
    outside[k] += 3.0 * (clean.vertices[ring[0]] - clean.vertices[k])
    moved = move_folded_vertices(triangle_mesh(outside, faces), adjacency).vertices
    assert np.flatnonzero((moved != outside).any(axis=1)).tolist() == [k]
    assert np.allclose(moved[k], clean.vertices[ring].mean(axis=0), rtol=1e-12)
    areas = area_vectors(moved, clean.faces), area_vectors(clean.vertices, clean.faces)
    assert (np.einsum("ij,ij->i", *areas) > 0.0).all()


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_tips_are_lone_vertices(scale):
    vertices, faces, _ = block()
    mesh = triangle_mesh(scale * vertices, faces)
    flat = remove_spikes(mesh, vertex_adjacency(mesh)).vertices
    assert (flat != mesh.vertices).any(axis=1).sum() <= 2  # neither edges nor most of the corners
    heights, hit = spikes(len(vertices), 0.03, 1.0)
    spiky = triangle_mesh(*with_heights((scale * vertices, faces, block()[2]), heights))
    moved = (remove_spikes(spiky, vertex_adjacency(spiky)).vertices != spiky.vertices).any(axis=1)
    assert moved[hit & (np.abs(heights) > 0.5)].mean() > 0.6
    assert moved[~hit].sum() <= 5


@pytest.mark.parametrize(
    ("make", "share", "base", "most"), [(bent_torus, 0.015, 0.0, 1.0), (bent_torus, 0.1, 0.02, 2.0)]
)
def test_patches_are_fitted_to_what_is_left_without_outliers(make, share, base, most):
    """Where fits are narrow, spikes beside a vertex turned its normal, however little they weighed: 3 and 7 degrees."""
    shape = make()
    heights = spikes(len(shape[0]), share, 0.5)[0] + spikes(len(shape[0]), 1.0, base, 1)[0]
    vertices, faces = with_heights(shape, heights)
    found = estimate_vertex_geometry(vertices, faces)
    cosines = np.einsum("ij,ij->i", found.normals, shape[2])
    angles = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    assert np.sqrt(np.square(angles).mean()) < most
    far = np.abs(heights) > 0.2
    edge = mean_edge_of(shape[0], faces)
    back = np.einsum("ij,ij->i", found.displacements, shape[2])[far] / edge
    assert np.median(np.abs(back + heights[far])) < 0.05  # from where they were measured to the surface
    again = estimate_vertex_geometry(vertices, faces)
    assert np.array_equal(found.displacements, again.displacements)
    assert np.array_equal(found.normals, again.normals)


@pytest.mark.parametrize("make", [star, bent_torus])
@pytest.mark.parametrize("move", [with_spikes, off_in_all_directions])
def test_frames_do_not_lean_towards_outliers(make, move):
    """Normals beside spikes turned the planes that patches were fitted over: 5 and 18 degrees."""
    shape = make()
    moved, hit = move(shape, 0.03, 1.0)
    found = estimate_vertex_geometry(moved, shape[1])
    cosines = np.einsum("ij,ij->i", found.normals, shape[2])[~hit]
    assert np.sqrt(np.square(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))).mean()) < 2.0


def test_patches_end_at_sharp_edges_that_noise_and_outliers_hide():
    """They reached across, and normals of flat faces were 10 degrees off."""
    vertices, faces = block_with_sharp_edges(resolution=20, jitter=0.25)
    of_faces = area_vectors(vertices, faces)
    of_faces /= np.linalg.norm(of_faces, axis=1, keepdims=True)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], of_faces)
    lengths = np.linalg.norm(normals, axis=1)
    is_flat = lengths > 0.999 * np.bincount(faces.ravel())
    normals /= lengths[:, np.newaxis]
    heights = spikes(len(vertices), 0.03, 1.0)[0] + spikes(len(vertices), 1.0, 0.1, 1)[0]
    found = estimate_vertex_geometry(*with_heights((vertices, faces, normals), heights))
    cosines = np.einsum("ij,ij->i", found.normals, normals)[is_flat]
    angles = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    assert np.sqrt(np.square(angles).mean()) < 2.0
