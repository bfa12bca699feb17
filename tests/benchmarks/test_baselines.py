"""The methods that the paper compares itself with."""

import doctest

import numpy as np
import pytest
from reference import biquadratic_rows, one_ring, tensor_fit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import Delaunay

import baselines
from baselines import (
    REACH,
    SCALES,
    adaptive_gaussian_smoothing,
    control_net_twists,
    gaussian_means,
    ouyang_feng_normals,
    razdan_bae,
)
from bezier_filters import FitStatus, InvalidMeshError, InvalidParameterError
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, ellipsoid, sphere, torus, waves
from smoothing_peers import implicit_fairing


def rotation(seed):
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    return turn * np.sign(np.linalg.det(turn))


def rms(vectors):
    return np.sqrt(np.mean(np.sum(vectors**2, axis=1)))


def test_examples():
    failed, attempted = doctest.testmod(baselines)
    assert attempted > failed == 0


# --- Razdan and Bae ------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", ["edges", "twists"])
@pytest.mark.parametrize("alpha", [0.8, 0.3])
def test_razdan_bae_equals_the_dense_least_squares(shape, alpha):
    surface = waves(jitter=0.3, resolution=14)
    geometry = razdan_bae(surface.vertices, surface.faces, alpha=alpha, shape=shape)
    sample = np.flatnonzero(geometry.status == FitStatus.OK)[::5]
    assert len(sample) > 30
    rows = biquadratic_rows(shape)
    expected = [tensor_fit(surface.vertices, surface.faces, i, geometry.normals[i], alpha, 2, rows) for i in sample]
    normals, mean, gaussian = (np.array(values) for values in zip(*expected, strict=True))
    np.testing.assert_allclose(geometry.normals[sample], normals, atol=1e-9)
    np.testing.assert_allclose(geometry.mean_curvature[sample], mean, atol=1e-8)
    np.testing.assert_allclose(geometry.gaussian_curvature[sample], gaussian, atol=1e-7)


def test_edge_equations_overestimate_the_curvature_of_a_sphere_at_every_resolution():
    means = []
    for resolution in (10, 20, 40):
        ball = sphere(resolution=resolution)
        means.append(razdan_bae(ball.vertices, ball.faces).mean_curvature.mean())
    assert min(means) > 1.1
    assert abs(means[2] - means[1]) < 0.01


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_twists_leave_exactly_sums_of_functions_of_one_parameter_free(degree):
    """On the nets of these functions, whose coefficients are sums of one of i and one of j."""
    rows = control_net_twists(degree)
    assert rows.shape == (degree**2, (degree + 1) ** 2)
    assert np.linalg.matrix_rank(rows) == len(rows)
    i, j = np.divmod(np.arange((degree + 1) ** 2), degree + 1)
    rng = np.random.default_rng(degree)
    of_i, of_j = rng.normal(size=(2, degree + 1))
    assert np.abs(rows @ (of_i[i] - 2.0 * of_j[j])).max() < 1e-12
    # b_ij = (2 i / d - 1) (2 j / d - 1) is the net of s t: every twist is (2 / d)^2.
    product = (2 * i / degree - 1) * (2 * j / degree - 1)
    np.testing.assert_allclose(rows @ product, (2 / degree) ** 2, atol=1e-12)


def test_unknown_shape_equations_are_refused():
    ball = sphere(resolution=2)
    with pytest.raises(InvalidParameterError, match=r"shape: got 'faces'.*edges.*twists"):
        razdan_bae(ball.vertices, ball.faces, shape="faces")


# --- OuYang and Feng -----------------------------------------------------------------------------


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_normals_of_a_sphere_are_exact(jitter):
    """The chords s from a point of a sphere sink by s^2 / 2 r: the parabola's tangent is level."""
    ball = sphere(radius=2.0, resolution=8, jitter=jitter)
    np.testing.assert_allclose(ouyang_feng_normals(ball.vertices, ball.faces), ball.normals, atol=1e-13)


def test_normals_of_a_plane_are_exact_up_to_the_border():
    flat = np.random.default_rng(0).uniform(-1, 1, (300, 2))
    faces = Delaunay(flat).simplices
    turn = rotation(1)
    vertices = np.column_stack([flat, np.zeros(300)]) @ turn.T
    np.testing.assert_allclose(ouyang_feng_normals(vertices, faces), np.tile(turn[:, 2], (300, 1)), atol=1e-10)


@pytest.mark.parametrize(
    ("make", "jitter", "lowest_order"), [(torus, 0.0, 1.8), (torus, 0.3, 0.9), (ellipsoid, 0.3, 0.9)]
)
def test_order_of_convergence(make, jitter, lowest_order):
    """Second on a lattice, where opposite neighbours lie in one plane with the normal, else first."""
    resolutions = np.array([16, 24, 36, 54])
    errors = []
    for resolution in resolutions:
        surface = make(resolution=int(resolution), jitter=jitter)
        errors.append(rms(ouyang_feng_normals(surface.vertices, surface.faces) - surface.normals))
    assert np.polyfit(-np.log(resolutions), np.log(errors), 1)[0] > lowest_order


def test_normals_minimise_the_variance_of_the_dot_products():
    """Pairs, parabolas and the minimum once more, vertex by vertex in plain NumPy."""
    surface = bumpy_star(resolution=6, jitter=0.3)
    normals = ouyang_feng_normals(surface.vertices, surface.faces)
    for vertex in range(0, len(normals), 7):
        ring = surface.vertices[sorted(one_ring(surface.faces, vertex))] - surface.vertices[vertex]
        a, b, c = surface.vertices[surface.faces[(surface.faces == vertex).any(axis=1)]].transpose(1, 0, 2)
        face_normals = np.cross(b - a, c - a)
        face_normals /= np.linalg.norm(face_normals, axis=1, keepdims=True)
        up = face_normals.sum(axis=0) / np.linalg.norm(face_normals.sum(axis=0))
        flat = ring - np.outer(ring @ up, up)
        flat /= np.linalg.norm(flat, axis=1, keepdims=True)
        tangents = []
        for edge, direction in zip(ring, flat, strict=True):
            partner = ring[np.argmin(flat @ direction)]
            parameters = [-np.linalg.norm(partner), 0.0, np.linalg.norm(edge)]
            parabola = np.polyfit(parameters, np.array([partner, np.zeros(3), edge]), 2)
            tangents.append(parabola[1] / np.linalg.norm(parabola[1]))
        both_ways = np.array(tangents + [-t for t in tangents])
        expected = np.linalg.svd(both_ways - both_ways.mean(axis=0))[2][2]
        np.testing.assert_allclose(normals[vertex], expected * np.sign(expected @ up), atol=1e-10)


@pytest.mark.parametrize("make", [torus, waves])
def test_normals_turn_with_the_mesh_and_do_not_mind_its_size(make):
    surface = make(jitter=0.3)
    normals = ouyang_feng_normals(surface.vertices, surface.faces)
    turn = rotation(2)
    moved = 1e3 * surface.vertices @ turn.T + np.array([3.0, -2.0, 5.0])
    np.testing.assert_allclose(ouyang_feng_normals(moved, surface.faces), normals @ turn.T, atol=1e-9)


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_normals_do_not_depend_on_the_numbering(jitter):
    surface = torus(jitter=jitter)
    order = np.random.default_rng(0).permutation(len(surface.vertices))
    renumbered = np.argsort(order)[surface.faces]
    normals = ouyang_feng_normals(surface.vertices[order], renumbered)
    np.testing.assert_allclose(normals, ouyang_feng_normals(surface.vertices, surface.faces)[order], atol=1e-9)


def test_turning_the_faces_round_negates_the_normals():
    surface = waves(jitter=0.3)
    normals = ouyang_feng_normals(surface.vertices, surface.faces)
    flipped = ouyang_feng_normals(surface.vertices, surface.faces[:, ::-1])
    np.testing.assert_array_equal(flipped, -normals)


def test_thread_count_does_not_matter():
    surface = torus(resolution=50, jitter=0.3)
    assert len(surface.vertices) > 4096  # more than one chunk
    one, two = (ouyang_feng_normals(surface.vertices, surface.faces, threads=t) for t in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_corners_and_single_triangles_take_the_normal_of_their_faces():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
    np.testing.assert_allclose(
        ouyang_feng_normals(square, [[0, 1, 2], [0, 2, 3]]), np.tile([0.0, 0.0, 1.0], (4, 1)), atol=1e-12
    )
    obtuse = np.array([[0, 0, 0], [1, 0, 0], [-1, 0.1, 0]], dtype=np.float64)
    np.testing.assert_allclose(ouyang_feng_normals(obtuse, [[0, 1, 2]]), np.tile([0.0, 0.0, 1.0], (3, 1)), atol=1e-12)


def test_noise_slivers_and_borders_give_finite_unit_normals():
    rng = np.random.default_rng(0)
    flat = np.vstack([rng.uniform(-1, 1, (300, 2)), rng.uniform(-1e-3, 1e-3, (50, 2))])
    vertices = np.column_stack([flat, rng.standard_normal(350) * 0.3])
    normals = ouyang_feng_normals(vertices, Delaunay(flat).simplices)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-12)


def test_vertices_without_a_face_with_an_area_get_zero():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5], [6, 6, 6], [7, 7, 7]], dtype=np.float64)
    normals = ouyang_feng_normals(vertices, [[0, 1, 2], [4, 5, 5]])
    np.testing.assert_array_equal(normals[3:], 0)
    np.testing.assert_allclose(normals[:3], [[0, 0, 1]] * 3, atol=1e-12)
    # Two faces back to back cancel out.
    np.testing.assert_array_equal(ouyang_feng_normals(vertices[:3], [[0, 1, 2], [0, 2, 1]]), 0)


def test_meshes_that_are_none_are_refused():
    with pytest.raises(InvalidMeshError):
        ouyang_feng_normals([[0.0, 0.0, np.nan]], np.zeros((0, 3), dtype=int))
    ball = sphere(resolution=2)
    with pytest.raises(InvalidParameterError, match="threads"):
        ouyang_feng_normals(ball.vertices, ball.faces, threads=0)


# --- Ohtake, Belyaev and Seidel -------------------------------------------------------------------


def faces_of(vertices, faces):
    """Centroids, areas and unit normals."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals = 0.5 * np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    return (a + b + c) / 3.0, areas, normals / areas[:, np.newaxis]


def dual_distances(centroids, faces):
    """Lengths of the shortest paths along centroids of faces that share an edge, (m, m)."""
    edges = {}
    for f, face in enumerate(faces.tolist()):
        for k in range(3):
            edges.setdefault(frozenset((face[k], face[(k + 1) % 3])), []).append(f)
    pairs = np.array([pair for pair in edges.values() if len(pair) == 2])
    lengths = np.linalg.norm(centroids[pairs[:, 0]] - centroids[pairs[:, 1]], axis=1)
    graph = coo_array((lengths, tuple(pairs.T)), shape=(len(faces), len(faces)))
    return dijkstra(graph.tocsr(), directed=False), pairs, lengths.mean()


def test_gaussian_means_are_those_of_all_faces_with_shortest_paths():
    surface = bumpy_star(resolution=5, jitter=0.3)
    centroids, areas, normals = faces_of(surface.vertices, surface.faces)
    distances, pairs, step = dual_distances(centroids, surface.faces)
    beside = np.full((len(surface.faces), 3), -1, dtype=np.int32)
    for pair in pairs.tolist():
        for f, g in (pair, pair[::-1]):
            beside[f, np.argmax(beside[f] < 0)] = g
    widths = step * np.array([0.5, 2.0])
    means, variances = gaussian_means(centroids, areas, normals, beside, widths)
    for s, width in enumerate(widths):
        weights = areas * np.exp(-0.5 * (distances / width) ** 2) * (distances <= REACH * width)
        expected = weights @ normals
        lengths = np.linalg.norm(expected, axis=1)
        np.testing.assert_allclose(means[:, s], expected / lengths[:, np.newaxis], atol=1e-12)
        unit = expected / weights.sum(axis=1, keepdims=True)
        spread = [(w * ((normals - m) ** 2).sum(axis=1)).sum() / w.sum() for w, m in zip(weights, unit, strict=True)]
        np.testing.assert_allclose(variances[:, s], spread, atol=1e-12)


def test_one_round_takes_the_best_width_and_moves_vertices_to_the_planes():
    surface = bumpy_star(resolution=4, jitter=0.3)
    noise = 0.01
    centroids, areas, normals = faces_of(surface.vertices, surface.faces)
    distances, _, step = dual_distances(centroids, surface.faces)
    best, filtered = np.full(len(areas), np.inf), np.zeros_like(normals)
    for scale in SCALES:
        weights = areas * np.exp(-0.5 * (distances / (scale * step)) ** 2) * (distances <= REACH * scale * step)
        mean = weights @ normals / weights.sum(axis=1, keepdims=True)
        length = np.linalg.norm(mean, axis=1)
        cost = noise / scale**2 + 1.0 - length**2
        better = cost < best
        best[better], filtered[better] = cost[better], (mean / length[:, np.newaxis])[better]
    expected = surface.vertices.copy()
    for i, point in enumerate(surface.vertices):
        at = np.flatnonzero((surface.faces == i).any(axis=1))
        heights = ((centroids[at] - point) * filtered[at]).sum(axis=1)
        expected[i] += ((areas[at] * heights)[:, np.newaxis] * filtered[at]).sum(axis=0) / areas[at].sum()
    found = adaptive_gaussian_smoothing(surface.vertices, surface.faces, rounds=1, noise=noise)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_adaptive_gaussians_keep_edges_better_than_implicit_fairing():
    vertices, faces = block_with_sharp_edges(resolution=10)
    noisy = vertices + 0.02 * np.random.default_rng(0).standard_normal(vertices.shape)
    truth = faces_of(vertices, faces)[2]

    def off(points):
        return np.degrees(np.arccos(np.clip((faces_of(points, faces)[2] * truth).sum(axis=1), -1, 1))).mean()

    def moved(smooth):
        return np.abs(smooth(vertices, faces) - vertices).max()

    assert off(adaptive_gaussian_smoothing(noisy, faces)) < off(noisy)
    assert moved(adaptive_gaussian_smoothing) < moved(implicit_fairing)


def test_a_single_face_and_no_faces_stay():
    corners = np.eye(3)
    np.testing.assert_allclose(adaptive_gaussian_smoothing(corners, [[0, 1, 2]]), corners, atol=1e-15)
    np.testing.assert_array_equal(adaptive_gaussian_smoothing(corners, np.empty((0, 3), dtype=int)), corners)
