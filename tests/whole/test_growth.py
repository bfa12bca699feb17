"""Work grows about like n log n, on meshes of which all pairs were once compared: sizes are eight times apart."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import pdist

import bezier_filters as bf
from bezier_filters.holes.loops import _hull_corners, _longest_distance, diameter
from bezier_filters.holes.refinement import MAX_FACES_PER_RIM_VERTEX, MIN_FACE_LIMIT, Fill, face_limit, refine
from bezier_filters.holes.smooth_fill import _fairest_fill, initial_fill
from bezier_filters.meshes.prepared_mesh import prepare_mesh

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from growth import fan, islands, ring, soup, strip, touching_holes, wavy_ring

pytestmark = pytest.mark.slow

MOST = 24.0
"""Eight times the size may take three times as long for each; all pairs would take 64 times as long."""


def seconds(run):
    """The least process time of two runs."""
    times = []
    for _ in range(2):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return max(min(times), 0.01)


@pytest.mark.parametrize(("make", "size"), [(soup, 500), (touching_holes, 32), (strip, 25_000), (islands, 16)])
def test_time_of_filling_grows_about_like_the_mesh(make, size):
    small, large = make(size), make(8 * size)
    bf.fill_holes(*small)
    assert seconds(lambda: bf.fill_holes(*large, threads=1)) < MOST * seconds(lambda: bf.fill_holes(*small, threads=1))


@pytest.mark.parametrize("filter_", [bf.estimate_vertex_geometry, bf.smooth, bf.find_creases])
def test_time_on_a_fan_grows_about_like_its_faces(filter_):
    small, large = fan(2_500), fan(20_000)
    filter_(*small)
    assert seconds(lambda: filter_(*large, threads=1)) < MOST * seconds(lambda: filter_(*small, threads=1))


def test_new_faces_grow_about_like_the_rim():
    counts = [sum(len(hole.new_faces) for hole in bf.fill_holes(*ring(n), bolt_holes=True).holes) for n in (250, 2_000)]
    assert 6 * counts[0] < counts[1] < MOST * counts[0]


def test_small_holes_are_filled_as_finely_as_their_surroundings():
    """Nothing of a round hole of 200 edges is deep: the area of its triangles is that of those around."""
    result = bf.fill_holes(*ring(200), bolt_holes=True)
    a, b, c = result.vertices[result.faces[result.holes[0].new_faces.start :]].transpose(1, 0, 2)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert 0.3 < np.median(areas) < 0.6  # an equilateral triangle has 0.43


def test_triangles_grow_away_from_the_rim():
    count = 1_000
    result = bf.fill_holes(*ring(count), bolt_holes=True)
    a, b, c = result.vertices[result.faces[result.holes[0].new_faces.start :]].transpose(1, 0, 2)
    depth = count / (2 * np.pi) - np.linalg.norm((a + b + c)[:, :2] / 3.0, axis=1)
    edges = np.linalg.norm(b - a, axis=1)
    near, far = edges[depth < 20], edges[depth > 120]
    assert 0.8 < near.mean() < 1.2
    assert 3.0 < far.mean() < 7.0  # the root of 1 + (140 - 32) / 4 is 5.3
    np.testing.assert_allclose(result.vertices[:, 2], 0.0, atol=1e-9)


def test_a_fill_of_too_many_faces_says_that_it_was_limited():
    angle = 2 * np.pi * np.arange(40) / 40
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(40)])
    faces = np.column_stack([np.zeros(38), np.arange(1, 39), np.arange(2, 40)]).astype(np.int32)
    none = np.empty((0, 2), dtype=np.int32)
    limited = refine(Fill(rim, np.full(40, 1e-3), faces, 40), none)
    assert limited.is_limited
    assert face_limit(40) < len(limited.faces) <= 3 * face_limit(40)
    assert not refine(Fill(rim, np.full(40, 0.1), faces, 40), none).is_limited
    assert face_limit(10_000) == MIN_FACE_LIMIT + MAX_FACES_PER_RIM_VERTEX * 10_000


def test_the_report_says_that_a_fill_was_limited():
    """Most edges of the rim are tiny, and the others ask for nothing else in the middle."""
    vertices, faces = ring(60)
    angle = np.arctan2(vertices[:, 1], vertices[:, 0]) % (2 * np.pi)
    turned = 2 * np.pi * (angle / (2 * np.pi)) ** 8
    radius = np.linalg.norm(vertices[:, :2], axis=1)
    vertices = np.column_stack([radius * np.cos(turned), radius * np.sin(turned), vertices[:, 2]])
    hole = next(hole for hole in bf.fill_holes(vertices, faces, bolt_holes=True).holes if hole.filled)
    assert ("triangles stay larger" in hole.reason) == (len(hole.new_faces) > face_limit(60))


def rims():
    rng = np.random.default_rng(1)
    angle = 2 * np.pi * np.arange(6_000) / 6_000
    circle = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    tilted = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    yield "circle", circle
    yield "tilted circle", 1e3 + circle @ tilted
    yield "noisy circle", circle + 1e-3 * rng.normal(size=circle.shape)
    yield "saddle", np.column_stack([circle[:, :2], np.cos(3 * angle)])
    along = np.linspace(0, 1, 2_000)[:, np.newaxis]
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0]])
    yield "triangle", np.vstack([corners[k - 1] * (1 - along) + corners[k] * along for k in range(3)])
    yield "line", along * [1.0, 2.0, 3.0]
    yield "cloud", rng.normal(size=(3_000, 3))
    yield "point", np.ones((1_000, 3))


@pytest.mark.parametrize(("name", "points"), list(rims()))
def test_the_diameter_is_the_largest_of_all_distances(name, points):
    np.testing.assert_allclose(diameter(points), pdist(points).max(), rtol=1e-12)


def test_few_pairs_are_measured_for_a_diameter():
    for name, points in rims():
        corners = points[_hull_corners(points)] if name != "point" else points[:1]
        reach = np.linalg.norm(corners - 0.5 * (corners.min(axis=0) + corners.max(axis=0)), axis=1)
        order = reach.argsort()[::-1]
        longest = diameter(points)
        assert _longest_distance(corners[order], reach[order], longest)[1] < 50 * len(points), name


def test_a_large_fill_is_faired_at_a_resolution_that_memory_allows(monkeypatch):
    """It lies where the one at full resolution lies, and ends at the same rim."""
    from bezier_filters.holes import smooth_fill
    from bezier_filters.holes.influence_region import influence_regions
    from bezier_filters.meshes.mesh import triangle_mesh

    vertices, faces = wavy_ring(300)
    mesh = triangle_mesh(vertices, faces)
    rim = np.arange(300, dtype=np.int32)
    region = influence_regions(prepare_mesh(mesh), [(rim,)])[0]
    fill = initial_fill(region)
    fine = _fairest_fill(fill, region, 3)
    monkeypatch.setattr(smooth_fill, "MAX_FAIRED_VERTICES", len(fill.points) // 3)
    coarse = _fairest_fill(fill, region, 3)
    np.testing.assert_array_equal(coarse.points[:300], fine.points[:300])
    from scipy.spatial import cKDTree

    distance = cKDTree(fine.points).query(coarse.points)[0]
    assert np.median(distance) < 0.02 * 300 / np.pi  # of the diameter
