"""Deviations of meshes from references whose difference is known."""

import numpy as np
import pytest

from bezier_filters import (
    Deviation,
    DeviationStatus,
    InvalidMeshError,
    InvalidParameterError,
    compare,
    fit_surface,
)
from bezier_filters.inspection.deviating_regions import find_deviating_regions
from bezier_filters.inspection.regional_means import mean_variance, regional_means, ring_of_size
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, ellipsoid, height_field, sphere, torus


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def mean_edge(body):
    corners = body.vertices[body.faces]
    return np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1).mean()


def add_noise(body, level, seed):
    """Vertices with noise along the true normals, in mean edges."""
    heights = level * mean_edge(body) * np.random.default_rng(seed).standard_normal((len(body.vertices), 1))
    return body.vertices + heights * body.normals


@pytest.fixture(scope="module")
def ring_pair():
    """Two meshes of one torus with different vertices and noise of a tenth of an edge, the second one fitted."""
    scan, model = torus(resolution=30, jitter=0.3), torus(resolution=34, jitter=0.2, seed=7)
    return scan, add_noise(scan, 0.1, 1), fit_surface(add_noise(model, 0.1, 2), model.faces)


@pytest.mark.parametrize(
    ("make", "resolution", "level"),
    [(torus, 24, 0.05), (ellipsoid, 20, 0.1), pytest.param(bumpy_star, 24, 0.2, marks=pytest.mark.slow)],
)
def test_z_scores_of_two_noisy_meshes_of_one_surface_are_standard(make, resolution, level):
    scan, model = make(resolution=resolution, jitter=0.3), make(resolution=resolution + 4, jitter=0.2, seed=7)
    scores, regional = [], []
    for seed in range(2):
        found = compare(add_noise(scan, level, seed), scan.faces, add_noise(model, level, 10 + seed), model.faces)
        assert found.status_counts() == {"OK": len(scan.vertices)}
        scores.append(found.z_scores)
        regional.append(found.regional_z_scores)
        assert found.share_significant < 0.02
    assert 0.8 < rms(scores) < 1.2
    assert 0.6 < rms(regional) < 1.5  # a dozen independent regions of each


@pytest.mark.parametrize(("make", "resolution"), [(torus, 24), (ellipsoid, 16), (bumpy_star, 16), (sphere, 14)])
def test_two_meshes_of_one_surface_without_noise_have_no_regions(make, resolution):
    """The reference is interpolated between its vertices, with an error of shape."""
    scan, model = make(resolution=resolution, jitter=0.3), make(resolution=resolution + 3, jitter=0.3, seed=4)
    found = compare(scan.vertices, scan.faces, model.vertices, model.faces)
    assert found.regions == ()
    assert 0.3 < rms(found.z_scores) < 3.0


def test_points_against_a_surface_have_their_own_noise(ring_pair):
    scan, vertices, surface = ring_pair
    found = compare(vertices, scan.faces, surface, measured="points")
    assert found.measured == "points"
    assert 0.9 < rms(found.z_scores) < 1.1
    cloud = compare(vertices, None, surface)
    assert cloud.measured == "points"
    np.testing.assert_array_equal(cloud.distances, found.distances)
    assert 0.85 < rms(cloud.z_scores) < 1.15


def test_a_defect_of_three_quarters_of_the_noise_over_200_vertices_is_found(ring_pair):
    scan, vertices, surface = ring_pair
    assert not compare(vertices, scan.faces, surface).regions
    center = 1000
    near = np.argsort(np.linalg.norm(scan.vertices - scan.vertices[center], axis=1))[:200]
    height = 0.75 * 0.1 * mean_edge(scan)
    for side in (1.0, -1.0):
        dented = vertices.copy()
        dented[near] += side * height * scan.normals[near]
        for measured in ("surface", "points"):
            region, *others = compare(dented, scan.faces, surface, measured=measured).regions
            assert len(others) <= 1
            assert region.vertex in near
            assert region.p_value < 0.01
            assert abs(region.distance - side * height) < 3.0 * region.std


def test_distances_are_those_of_the_known_surfaces():
    scan, model = sphere(radius=1.02, resolution=12), sphere(resolution=10)
    found = compare(scan.vertices, scan.faces, model.vertices, model.faces, tolerance=0.03)
    np.testing.assert_allclose(found.distances, 0.02, atol=2e-4)
    np.testing.assert_allclose(np.linalg.norm(found.places, axis=1), 1.0, atol=2e-4)
    assert found.share_within == 1.0
    assert abs(found.mean - 0.02) < 1e-4
    inside = compare(model.vertices, model.faces, scan.vertices, scan.faces, tolerance=0.01)
    np.testing.assert_allclose(inside.distances, -0.02, atol=2e-4)
    assert inside.share_within == 0.0
    assert found.distances[found.highest] == found.distances.max()


def test_what_cannot_be_compared_has_a_status_and_no_deviation():
    model = height_field(lambda x, y: [0.0 * x] * 6, resolution=10)
    edge = model.vertices[:, 0].max()
    points = np.array([[0.1, 0.2, 0.01], [edge + 0.3, 0.0, 0.0], [0.1, 0.0, 3.0], [0.2, 0.1, -0.01]])
    chosen = np.array([True, True, True, False])
    cloud = np.vstack([points, [[0.05, 0.0, 0.0], [0.1, 0.05, 0.0], [0.0, 0.1, 0.0]]])
    found = compare(cloud, None, model.vertices, model.faces, max_distance=1.0, selected=np.append(chosen, [True] * 3))
    names = [DeviationStatus(status).name for status in found.status[:4]]
    assert names == ["OK", "PAST_BORDER", "TOO_FAR", "SKIPPED"]
    np.testing.assert_allclose(found.distances[:4], [0.01, 0.0, 0.0, 0.0], atol=1e-9)
    assert found.compared.sum() == 4


def test_the_vertices_of_a_noisy_mesh_have_places_on_its_surface():
    body = torus(resolution=16)
    vertices = add_noise(body, 0.1, seed=0)
    found = compare(vertices, None, vertices, body.faces)
    assert found.compared.mean() > 0.95


def test_edges_of_a_larger_block_are_compared():
    vertices, faces = block_with_sharp_edges(resolution=6)
    vertices = vertices - vertices.mean(axis=0)
    found = compare(1.02 * vertices, faces, vertices, faces, reference_noise=0.0)
    assert found.compared.mean() > 0.99
    lengths = 0.02 * np.linalg.norm(vertices, axis=1)  # by which the vertices are away from their own places
    assert (found.distances[found.compared] <= lengths[found.compared] + 1e-9).all()
    assert found.distances.max() > 0.9 * lengths.max()
    assert found.distances.min() > -1e-9


def test_the_other_side_of_a_wall_is_no_deviation():
    ball = sphere(resolution=8)
    found = compare(ball.vertices, ball.faces[:, ::-1], ball.vertices, ball.faces)
    assert found.status_counts() == {"OPPOSITE": len(ball.vertices)}
    assert found.mean is None
    assert found.highest is None
    assert not found.regions


def test_regional_means_are_those_of_the_rings():
    ball = sphere(resolution=8, jitter=0.2)
    adjacency, values = vertex_adjacency(ball.vertices, ball.faces), ball.vertices[:, 0].copy()
    valid = np.arange(len(values)) % 3 > 0
    means, counts = regional_means(values, valid, adjacency, 1)
    for i in (0, 17, 100):
        around = np.append(adjacency.vertices.row(i), i)
        around = around[valid[around]]
        assert counts[i] == len(around)
        assert abs(means[i] - values[around].mean()) < 1e-14


def test_the_variance_of_a_mean_of_fitted_positions_is_that_of_the_model():
    """Positions that are means of m noisy values around each place of a ring: their mean over n of them."""
    rng, m, count = np.random.default_rng(0), 25, 400
    noise = rng.standard_normal((4000, count))
    kernel = np.zeros(count)
    kernel[:m] = 1.0 / m
    positions = np.fft.irfft(np.fft.rfft(noise, axis=1) * np.fft.rfft(kernel), count, axis=1)
    for n in (1, 5, 50, 200):
        (stated,) = mean_variance(np.array([1.0 / m]), np.ones(1), np.array([float(n)]))
        assert 0.7 < positions[:, :n].mean(axis=1).var() / stated < 1.45


def test_white_noise_alone_seldom_makes_a_region():
    """With 4 tests per region, as for regions that overlap by half, 6 of 100 meshes had one."""
    body = sphere(resolution=10)
    adjacency = vertex_adjacency(triangle_mesh(body.vertices, body.faces))
    n, false = len(body.vertices), 0
    for seed in range(100):
        noise = np.random.default_rng(seed).standard_normal(n)
        means, counts = regional_means(noise, np.ones(n, dtype=bool), adjacency, ring_of_size(100))
        false += bool(find_deviating_regions(means, 1.0 / np.sqrt(counts), body.vertices, adjacency, 100))
    assert false <= 3


def test_errors_of_shape_do_not_average_out():
    assert mean_variance(np.array([4.0]), np.ones(1), np.array([100.0])) == 4.0
    assert ring_of_size(1) == 0


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_it_follows_the_scale(ring_pair, scale):
    scan, vertices, _ = ring_pair
    model = torus(resolution=24)
    found, plain = (
        compare(s * vertices, scan.faces, s * model.vertices, model.faces, tolerance=s) for s in (scale, 1.0)
    )
    np.testing.assert_allclose(found.distances, scale * plain.distances, rtol=1e-6, atol=2e-5 * scale)
    np.testing.assert_allclose(found.regional_std, scale * plain.regional_std, rtol=5e-3)


def test_results_are_tables_and_rows(ring_pair):
    scan, vertices, surface = ring_pair
    found = compare(vertices, scan.faces, surface, tolerance=0.01)
    assert isinstance(found, Deviation)
    assert "vertices compared" in str(found)
    assert found.to_dict()["tolerance"] == 0.01
    pytest.importorskip("pandas", reason="pandas is not installed")
    assert len(found.to_pandas()) == len(vertices)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 0.0}, "tolerance"),
        ({"max_distance": -1.0}, "max_distance"),
        ({"region": 0}, "region"),
        ({"region": 2.5}, "region"),
        ({"region": "200"}, "region"),
        ({"measured": "patches"}, "measured"),
        ({"reference_noise": 0.1}, "has its own"),
        ({"noise": -1.0}, "noise"),
        ({"selected": np.ones(3, dtype=bool)}, "selected"),
    ],
)
def test_wrong_parameters_are_refused(ring_pair, options, message):
    scan, vertices, surface = ring_pair
    with pytest.raises(InvalidParameterError, match=message):
        compare(vertices, scan.faces, surface, **options)


def test_references_need_faces(ring_pair):
    scan, vertices, _ = ring_pair
    with pytest.raises(InvalidMeshError, match="faces"):
        compare(vertices, scan.faces, vertices)
    with pytest.raises(InvalidMeshError, match="measured"):
        compare(vertices, None, vertices, scan.faces, measured="surface")
