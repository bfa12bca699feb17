import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from surface_cases import area_vectors, border_edges, directed_edges

from bezier_filters.holes.loops import (
    MAX_EAR_ANGLE,
    MAX_EXACT_LOOP,
    _cut_ears,
    is_simple,
    points_in_polygon,
    triangulate_loop,
)
from bezier_filters.holes.refinement import Fill, refine


def as_pairs(chords):
    return np.array(sorted(chords), dtype=np.int32).reshape(-1, 2)


def triangulated(points, existing=()):
    count = len(points)
    unknown, flat = np.zeros((count, 3)), np.full(count, 1.0)
    return triangulate_loop(points, np.arange(count, dtype=np.int32), unknown, flat, as_pairs(existing))


def ring(count, radius=1.0):
    angle = 2 * np.pi * np.arange(count) / count
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(count)])


def assert_disk(faces, count):
    """A triangulated disk whose border is the loop 0 .. count - 1."""
    edges = directed_edges(faces)
    assert len(np.unique(edges, axis=0)) == len(edges)
    border = border_edges(faces)
    assert {tuple(edge) for edge in border.tolist()} == {(k, (k + 1) % count) for k in range(count)}


@pytest.mark.parametrize("count", [3, 4, 7, MAX_EXACT_LOOP, MAX_EXACT_LOOP + 1, 3 * MAX_EXACT_LOOP])
def test_convex_polygons_keep_their_area(count):
    points = ring(count)
    faces = triangulated(points)
    assert faces.shape == (count - 2, 3)
    assert_disk(faces, count)
    areas = area_vectors(points, faces)[:, 2]
    assert (areas > 0.0).all()
    assert areas.sum() == pytest.approx(0.5 * count * np.sin(2 * np.pi / count))


@given(st.integers(5, 40), st.integers(0, 10**6))
def test_star_shaped_polygons_are_not_overlapped(count, seed):
    """The least area of a flat loop is that of its inside, which only triangulations without overlaps have."""
    points = ring(count) * np.random.default_rng(seed).uniform(0.3, 1.0, count)[:, np.newaxis]
    faces = triangulated(points)
    assert_disk(faces, count)
    x, y, _ = points.T
    inside = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    assert np.linalg.norm(area_vectors(points, faces), axis=1).sum() == pytest.approx(inside, rel=1e-9)


@given(st.integers(3, 30), st.integers(0, 10**6))
def test_loops_in_space_become_disks(count, seed):
    assert_disk(triangulated(np.random.default_rng(seed).normal(size=(count, 3))), count)


@given(st.integers(3, 12), st.integers(0, 10**6))
def test_points_inside_are_those_that_the_polygon_turns_around(count, seed):
    rng = np.random.default_rng(seed)
    polygon = (ring(count) * rng.uniform(0.3, 1.0, count)[:, np.newaxis])[:, :2] + rng.normal(size=2)
    points = polygon.mean(axis=0) + rng.uniform(-1.2, 1.2, (50, 2))
    to = (polygon - points[:, np.newaxis]) @ np.array([1.0, 1.0j])  # (points, corners)
    turns = np.angle(np.roll(to, -1, axis=1) / to).sum(axis=1) / (2 * np.pi)
    np.testing.assert_array_equal(points_in_polygon(points, polygon), np.abs(turns) > 0.5)
    np.testing.assert_array_equal(points_in_polygon(points, polygon[::-1]), np.abs(turns) > 0.5)


@given(st.integers(4, 9), st.integers(0, 10**6))
def test_simple_polygons_are_those_without_edges_that_cross(count, seed):
    """Two edges cross where both parameters of the point that their lines have in common are between 0 and 1."""
    polygon = np.random.default_rng(seed).normal(size=(count, 2))
    along = np.roll(polygon, -1, axis=0) - polygon
    crossed = False
    for i in range(count):
        for j in range(i + 1, count):
            if j - i not in (1, count - 1):
                s, t = np.linalg.solve(np.column_stack([along[i], -along[j]]), polygon[j] - polygon[i])
                crossed |= bool(0.0 < s < 1.0 and 0.0 < t < 1.0)
    assert is_simple(polygon) == (not crossed)


@given(st.integers(MAX_EXACT_LOOP - 2, MAX_EXACT_LOOP + 15), st.integers(0, 10**6))
def test_ears_are_cut_where_the_chord_is_shortest_until_few_vertices_are_left(count, seed):
    """Of a convex polygon; a gap of the hole is its angle there, and at some vertices more than that."""
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0.0, 2 * np.pi, count))
    points = np.column_stack([2.0 * np.cos(turn), np.sin(turn), np.zeros(count)])
    more = rng.choice([0.0, 0.6, 3.0], count)
    existing = {(k, k + 2) for k in range(0, count - 2, 3)}
    rest, ears = _cut_ears(points, np.arange(count), angles_and_chords(points)[0] + more, as_pairs(existing))
    left = list(range(count))
    for a, k, b in ears:
        angles, chords = angles_and_chords(points[left])
        ends = zip(np.roll(left, 1).tolist(), np.roll(left, -1).tolist(), strict=True)
        allowed = (angles + more[left] < MAX_EAR_ANGLE) & [tuple(sorted(pair)) not in existing for pair in ends]
        place = left.index(k)
        assert (a, b) == (left[place - 1], left[(place + 1) % len(left)])
        assert allowed[place]
        assert chords[place] <= chords[allowed].min() * (1 + 1e-12)
        left.remove(k)
    assert rest.tolist() == left
    assert len(left) == min(count, MAX_EXACT_LOOP)


def angles_and_chords(polygon):
    """At every vertex of a convex polygon, its angle, and the distance of its neighbours."""
    before, after = np.roll(polygon, 1, axis=0) - polygon, np.roll(polygon, -1, axis=0) - polygon
    cosine = (before * after).sum(axis=1) / np.linalg.norm(before, axis=1) / np.linalg.norm(after, axis=1)
    return np.arccos(np.clip(cosine, -1.0, 1.0)), np.linalg.norm(after - before, axis=1)


def test_forbidden_chords_are_avoided():
    points = ring(6)
    chords = {(0, 2), (0, 3), (0, 4), (2, 5)}
    faces = triangulated(points, chords)
    assert_disk(faces, 6)
    assert not chords & {tuple(edge) for edge in np.sort(directed_edges(faces), axis=1).tolist()}
    assert triangulated(ring(4), {(0, 2), (1, 3)}) is None


def test_a_fold_of_the_surroundings_goes_on():
    """Two squares that meet at an angle; only triangles that keep to them have no sharper edge than their fold."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 1], [2, 1, 1], [1, 1, 0], [0, 1, 0]])
    flat, leaning = np.array([0.0, 0, 1]), np.array([-1.0, 0, 1]) / np.sqrt(2)
    normals = np.array([flat, leaning, leaning, leaning, flat, flat])
    faces = triangulate_loop(points, np.arange(6, dtype=np.int32), normals, np.ones(6), as_pairs(()))
    assert [1, 4] in np.sort(directed_edges(faces), axis=1).tolist()
    of_each = area_vectors(points, faces)
    of_each /= np.linalg.norm(of_each, axis=1, keepdims=True)
    assert sorted(np.round(of_each @ flat, 6)) == [0.707107, 0.707107, 1.0, 1.0]


@given(st.integers(4, 30), st.integers(0, 10**6))
def test_refined_polygons_are_delaunay_and_fine_enough(count, seed):
    points = ring(count) * np.random.default_rng(seed).uniform(0.5, 1.0, count)[:, np.newaxis]
    sizes = np.full(count, 0.25)
    fill = refine(Fill(points, sizes, triangulated(points), count), as_pairs(()))
    assert_disk(fill.faces, count)
    areas = area_vectors(fill.points, fill.faces)[:, 2]
    assert (areas > 0.0).all()
    assert areas.sum() == pytest.approx(area_vectors(points, triangulated(points))[:, 2].sum())
    corners = fill.points[fill.faces]
    distances = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2)
    assert (np.sqrt(2) * distances.min(axis=1) <= 0.25 * (1 + 1e-12)).all()
    assert_locally_delaunay(fill)


def assert_locally_delaunay(fill):
    tips = {}
    for face in fill.faces.tolist():
        for k in range(3):
            tips[face[k], face[(k + 1) % 3]] = face[(k + 2) % 3]
    for (a, b), c in tips.items():
        if (b, a) in tips:
            d = tips[b, a]
            assert angle(fill.points, c, a, b) + angle(fill.points, d, a, b) <= np.pi + 1e-6


def angle(points, tip, left, right):
    u, v = points[left] - points[tip], points[right] - points[tip]
    return np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v)
