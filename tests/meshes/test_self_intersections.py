import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters.meshes.self_intersections import cut_faces, faces_in_boxes
from bezier_filters.surfaces import sphere, torus


def test_good_meshes_have_no_cuts():
    for surface in (sphere(), torus()):
        assert not cut_faces(surface.vertices, surface.faces, len(surface.faces)).any()


def test_two_balls_cut_each_other_along_their_circle():
    ball = sphere(resolution=6)
    vertices = np.vstack([ball.vertices, ball.vertices + np.array([1.0, 0.1, 0.2])])
    cuts = cut_faces(vertices, np.vstack([ball.faces, ball.faces + len(ball.vertices)]), len(ball.faces))
    center = np.array([0.5, 0.05, 0.1])
    far = np.abs((vertices[ball.faces + len(ball.vertices)] - center) @ np.array([1.0, 0.1, 0.2])).min(axis=1) > 0.3
    assert cuts.any()
    assert not cuts[far].any()


@given(st.integers(0, 10**6))
def test_cuts_agree_with_points_common_to_both_triangles(seed):
    """Second formula: the least distance of two triangles, by a linear programme, is zero only if they meet."""
    from scipy.optimize import linprog

    points = np.random.default_rng(seed).normal(size=(6, 3))
    found = bool(cut_faces(points, np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int32), 1)[0])
    equal = np.vstack([np.hstack([points[:3].T, -points[3:].T]), [1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]])
    meet = linprog(np.zeros(6), A_eq=equal, b_eq=[0, 0, 0, 1, 1], bounds=[(0, None)] * 6).status == 0
    assert found == meet


def test_faces_that_touch_do_not_cut_but_folded_ones_do():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.2, 0.3, 0], [0.2, -1, 0.5]])
    flat = np.array([[0, 1, 2], [1, 3, 2]], dtype=np.int32)
    folded = np.array([[0, 1, 2], [1, 0, 4]], dtype=np.int32)
    corner = np.array([[0, 1, 2], [0, 5, 1]], dtype=np.int32)
    assert [cut_faces(points, faces, 1).any() for faces in (flat, folded, corner)] == [False, True, False]


def test_a_face_through_a_shared_vertex_cuts():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.5, -1], [0.4, 0.4, 1]])
    faces = np.array([[0, 1, 2], [0, 3, 4]], dtype=np.int32)
    assert cut_faces(points, faces, 1).any()
    assert not cut_faces(points - [0.0, 0.0, 0.0], np.array([[0, 1, 2], [0, 4, 1]], dtype=np.int32), 1).any()


@pytest.mark.parametrize("size", [1.0, 0.0])
@pytest.mark.parametrize("count", [0, 1, 7, 40])
def test_faces_in_boxes_are_those_whose_boxes_meet(count, size):
    """Boxes of no size are vertices."""
    ball = sphere()
    rng = np.random.default_rng(count)
    low = rng.uniform(-1, 0.8, (count, 3)) if size else rng.choice(ball.vertices, count)
    high = low + size * rng.uniform(0, 1, (count, 3))
    rows = faces_in_boxes(ball.vertices, ball.faces, low, high)
    corners = ball.vertices[ball.faces]
    for k in range(count):
        meets = ((corners.min(axis=1) <= high[k]) & (corners.max(axis=1) >= low[k])).all(axis=1)
        np.testing.assert_array_equal(rows.row(k), np.flatnonzero(meets))
    assert len(rows) == count


def test_an_edge_through_a_common_side_cuts_both_faces():
    """As seen on a range scan: neither face alone has the crossing in its interior."""
    points = np.array([[-1.0, 0, 0], [0, -1, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1], [0, 3, 0]])
    faces = np.array([[4, 5, 6], [0, 1, 2], [0, 2, 3]], dtype=np.int32)
    assert cut_faces(points, faces, 2).all()


@pytest.mark.parametrize("shift", [0.25, 0.5, 0.9375, 1.0, 1.5])
@pytest.mark.parametrize("axes", [[0, 1, 2], [1, 2, 0], [2, 1, 0]])
def test_faces_in_one_plane_overlap_if_they_have_a_common_part(shift, axes):
    """A right triangle, and the same shifted along its side, in each plane of coordinates."""
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    points = np.vstack([triangle, triangle + np.array([shift, 0.0, 0.0])])[:, axes]
    assert cut_faces(points, np.arange(6, dtype=np.int32).reshape(2, 3), 1)[0] == (shift < 1.0)


def test_faces_in_one_plane_that_share_a_corner_may_overlap():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0.2, 0], [0.2, 2, 0], [-1, 0.2, 0], [-1, -1, 0]])
    assert cut_faces(points, np.array([[0, 1, 2], [0, 3, 4]], dtype=np.int32), 1).all()
    assert not cut_faces(points, np.array([[0, 1, 2], [0, 5, 6]], dtype=np.int32), 1).any()
