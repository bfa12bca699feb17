import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bezier_filters.holes.polygon_triangulation import triangulate_polygon

NONE = np.empty((0, 2), dtype=np.int32)


def areas(points, faces):
    a, b, c = points[faces].transpose(1, 0, 2)
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def signed_area(polygon):
    x, y = polygon.T
    return 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), corners=st.integers(3, 60), islands=st.integers(0, 5), roughness=st.floats(0.0, 0.8))
def test_triangles_cover_the_polygon_once(seed, corners, islands, roughness):
    rng = np.random.default_rng(seed)
    angles = (
        np.sort(rng.uniform(0.0, 2.0 * np.pi, corners)) if roughness else np.linspace(0, 2 * np.pi, corners + 1)[1:]
    )
    radii = 30.0 * (1.0 + roughness * rng.uniform(-1.0, 0.0, corners))
    outer = radii[:, np.newaxis] * np.column_stack([np.cos(angles), np.sin(angles)])
    if signed_area(outer) <= 1.0 or np.diff(np.r_[angles, angles[0] + 2 * np.pi]).max() > 3.0:
        return  # the centre is outside
    loops, points = [np.arange(corners)], [outer]
    for k in range(islands):
        count = int(rng.integers(3, 12))
        turn = -np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
        centre = 0.5 * np.array([np.cos(1.3 * k), np.sin(1.3 * k)])
        loops.append(sum(len(p) for p in points) + np.arange(count))
        points.append(centre + 0.2 * np.column_stack([np.cos(turn), np.sin(turn)]))
    inner = min((np.linalg.norm(outer, axis=1)).min(), 1e9)
    scale = 0.4 * inner * np.cos(0.5 * np.diff(np.r_[angles, angles[0] + 2 * np.pi]).max())
    if scale < 0.01:
        return
    points = np.vstack([outer, *(scale * island for island in points[1:])])
    faces = triangulate_polygon(points, loops, NONE)
    assert faces is not None
    assert len(faces) == len(points) + 2 * islands - 2
    assert (areas(points, faces) > 0.0).all()
    assert areas(points, faces).sum() == pytest.approx(sum(signed_area(points[loop]) for loop in loops))
    sides = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    assert len(np.unique(sides, axis=0)) == len(sides)  # oriented and manifold
    border = {tuple(side) for side in sides.tolist()} - {tuple(side[::-1]) for side in sides.tolist()}
    assert border == {(int(a), int(b)) for loop in loops for a, b in zip(loop, np.roll(loop, -1), strict=True)}


def test_vertices_on_straight_sides_get_no_degenerate_triangles():
    side = np.linspace(0.0, 1.0, 9)[:-1, np.newaxis]
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    square = np.vstack([corners[k] + side * (corners[(k + 1) % 4] - corners[k]) for k in range(4)])
    faces = triangulate_polygon(square, [np.arange(32)], NONE)
    assert areas(square, faces).min() > 1e-3
    assert areas(square, faces).sum() == pytest.approx(1.0)


def test_existing_edges_are_no_chords():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    for diagonal in ([0, 2], [1, 3]):
        faces = triangulate_polygon(square, [np.arange(4)], np.array([diagonal]))
        assert not any(set(diagonal) <= set(face) for face in faces.tolist())
    assert triangulate_polygon(square, [np.arange(4)], np.array([[0, 2], [1, 3]])) is None


def test_a_polygon_that_runs_clockwise_has_no_triangles():
    square = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]])
    assert triangulate_polygon(square, [np.arange(4)], NONE) is None
