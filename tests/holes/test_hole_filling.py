import numpy as np
import pytest
from hole_cases import assert_filled, sheet, without_faces_near, without_squares
from hypothesis import given, settings
from hypothesis import strategies as st
from surface_cases import area_vectors, border_edges

from bezier_filters import CancelledError, InvalidParameterError, fill_holes
from bezier_filters.surfaces import punched_patch, sphere, torus

TOP = np.array([0.0, 0.0, 1.0])


def test_holes_that_need_no_vertices():
    """Three edges; four, of which both diagonals are edges already; and a single face turned to a closed pillow."""
    vertices, faces = sheet(4, 4)
    without_one = np.delete(faces, 5, axis=0)
    result = fill_holes(vertices, without_one)
    assert_filled(vertices, without_one, result)
    assert set(result.faces[-1]) == set(faces[5])
    block = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    two_of_four = np.array([[0, 2, 1], [0, 1, 3]], dtype=np.int32)
    result = fill_holes(block, two_of_four, outer_rims=True)
    assert_filled(block, two_of_four, result)


def test_a_loop_whose_vertices_are_all_joined_gets_a_hub():
    """A cone of six faces over a square, with both diagonals of the square on fins outside."""
    vertices = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, -2], [0, 0, -3]])
    rim = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    fins = np.array([[0, 2, 5], [2, 0, 5], [1, 3, 5], [3, 1, 5]])
    (refused,) = fill_holes(vertices, np.vstack([rim, fins, [[0, 1, 5]]])).holes
    assert "edges of several faces" in refused.reason
    result = fill_holes(vertices, rim)
    assert_filled(vertices, rim, result)


def test_a_slit_is_closed():
    vertices, faces = sheet(20, 8)
    vertices = vertices.copy()
    slit = np.flatnonzero((vertices[:, 1] == 4) & (vertices[:, 0] > 3) & (vertices[:, 0] < 17))
    twin = {int(k): len(vertices) + i for i, k in enumerate(slit)}
    above = vertices[faces].mean(axis=1)[:, 1] > 4
    opened = faces.copy()
    opened[above] = [[twin.get(int(i), int(i)) for i in face] for face in faces[above]]
    vertices = np.vstack([vertices, vertices[slit]])
    vertices[list(twin.values()), 1] += 0.01
    result = fill_holes(vertices, opened)
    assert_filled(vertices, opened, result)
    assert result.filled == 1


def test_an_island_is_joined_to_the_fill():
    vertices, faces = sheet(16, 16)
    faces = without_squares(vertices, faces, lambda x, y: (np.maximum(abs(x - 8), abs(y - 8)) - 4) ** 2 < 2)
    result = fill_holes(vertices, faces)
    assert_filled(vertices, faces, result)
    assert [hole.islands for hole in result.holes] == [0, 1]
    assert np.linalg.norm(area_vectors(result.vertices, result.faces), axis=1).sum() == pytest.approx(256.0)


def test_an_island_that_touches_the_rim_is_joined():
    vertices, faces = sheet(9, 9)
    faces = without_squares(vertices, faces, lambda x, y: (abs(x - 4) < 2) & (abs(y - 4) < 2) & ((x != y) | (x > 4)))
    result = fill_holes(vertices, faces)
    assert_filled(vertices, faces, result)
    assert np.linalg.norm(area_vectors(result.vertices, result.faces), axis=1).sum() == pytest.approx(81.0)


def test_holes_that_meet_are_both_filled():
    vertices, faces = sheet(8, 8)
    faces = without_squares(vertices, faces, lambda x, y: ((x - 4) * (y - 4) > 0) & (abs(x - 4) < 2) & (abs(y - 4) < 2))
    result = fill_holes(vertices, faces)
    assert_filled(vertices, faces, result)
    assert result.filled == 2
    assert np.linalg.norm(area_vectors(result.vertices, result.faces), axis=1).sum() == pytest.approx(64.0)


def test_outer_rims_are_left_open_unless_asked_for():
    surface = punched_patch()
    result = fill_holes(surface.vertices, surface.faces)
    assert_filled(surface.vertices, surface.faces, result)
    assert [hole.filled for hole in result.holes] == [False, True, True, True]
    assert "outer_rims=True" in result.holes[0].reason
    flat, faces = sheet(4, 4)
    dome = flat + np.column_stack([0 * flat[:, :2], 2 - 0.2 * ((flat[:, :2] - 2) ** 2).sum(axis=1)])
    closed = fill_holes(dome, faces, outer_rims=True)
    assert len(border_edges(closed.faces)) == 0
    assert_filled(dome, faces, closed)


def test_an_outer_rim_gives_way_to_the_holes_of_its_sheet():
    surface = punched_patch()
    result = fill_holes(surface.vertices, surface.faces, outer_rims=True, intersecting=True)
    assert [hole.is_outer_rim for hole in result.holes] == [True, False, False, False]
    assert [hole.method for hole in result.holes[1:]] == 3 * ["surface"]
    assert [hole.self_intersections for hole in result.holes[1:]] == 3 * [0]
    assert len(border_edges(result.faces)) == 0
    assert result.holes[0].self_intersections > 0
    without = fill_holes(surface.vertices, surface.faces, outer_rims=True)
    assert without.holes[0].self_intersections == result.holes[0].self_intersections
    assert not without.holes[0].filled
    assert without.holes[0].reason.startswith("every fill would cut other faces")
    for own, other in zip(result.holes[1:], without.holes[1:], strict=True):
        np.testing.assert_array_equal(result.faces[own.new_faces], without.faces[other.new_faces])
    for attribute, rows in (("new_vertices", result.vertices), ("new_faces", result.faces)):
        ranges = [getattr(hole, attribute) for hole in (*result.holes[1:], result.holes[0])]
        assert [part.start for part in ranges[1:]] == [part.stop for part in ranges[:-1]]
        assert ranges[-1].stop == len(rows)
    lid = result.holes[0]
    assert set(result.faces[lid.new_faces].ravel()) == {*lid.rim, *lid.new_vertices}


def test_holes_are_chosen():
    surface = punched_patch()
    holes = fill_holes(surface.vertices, surface.faces, holes=[]).holes
    inner = holes[1:]
    middle = sorted(hole.edge_count for hole in inner)[1]
    rim = np.zeros(len(surface.vertices), dtype=bool)
    rim[inner[0].rim[0]] = True

    def filled(**choice):
        return [hole.filled for hole in fill_holes(surface.vertices, surface.faces, **choice).holes[1:]]

    assert filled(max_edges=middle) == [hole.edge_count <= middle for hole in inner]
    assert filled(max_perimeter=inner[1].perimeter) == [hole.perimeter <= inner[1].perimeter for hole in inner]
    assert filled(max_diameter=inner[1].diameter) == [hole.diameter <= inner[1].diameter for hole in inner]
    assert filled(selected=rim) == [True, False, False]
    assert filled(holes=[2]) == [False, True, False]
    assert filled(holes=[]) == [False] * 3


def test_nothing_to_fill_gives_the_mesh():
    ball = sphere()
    result = fill_holes(ball.vertices, ball.faces)
    np.testing.assert_array_equal(result.vertices, ball.vertices)
    np.testing.assert_array_equal(result.faces, ball.faces)
    assert result.holes == ()
    assert fill_holes(np.empty((0, 3)), np.empty((0, 3), dtype=int)).filled == 0


def test_fills_turn_and_scale_with_the_mesh():
    shape = torus(resolution=20, jitter=0.2)
    faces = without_faces_near(shape.vertices, shape.faces, np.array([1.4, 0, 0]), 0.4)
    rotation = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    still = fill_holes(shape.vertices, faces)
    moved = fill_holes(3.0 * shape.vertices @ rotation.T + [1, 2, 3], faces)
    np.testing.assert_array_equal(moved.faces, still.faces)
    np.testing.assert_allclose(moved.vertices, 3.0 * still.vertices @ rotation.T + [1, 2, 3], atol=1e-6)


@settings(max_examples=8)
@given(st.integers(0, 10**6), st.integers(1, 60))
def test_holes_of_any_outline_are_filled(seed, count):
    """Faces taken away one after the other, each next to the last or anywhere."""
    rng = np.random.default_rng(seed)
    ball = sphere(resolution=8, jitter=0.3, seed=seed)
    order = np.argsort(
        np.linalg.norm(ball.vertices[ball.faces].mean(axis=1) - TOP, axis=1) * rng.uniform(0.3, 1, len(ball.faces))
    )
    faces = np.delete(ball.faces, order[:count], axis=0)
    result = fill_holes(ball.vertices, faces)
    assert all(hole.filled or hole.is_outer_rim for hole in result.holes)
    edges = np.sort(np.vstack([result.faces[:, [0, 1]], result.faces[:, [1, 2]], result.faces[:, [2, 0]]]), axis=1)
    assert np.unique(edges, axis=0, return_counts=True)[1].max() == 2
    np.testing.assert_array_equal(result.vertices[: len(ball.vertices)], ball.vertices)
    np.testing.assert_array_equal(result.faces[: len(faces)], faces)


def test_progress_is_told_and_can_cancel():
    surface = punched_patch()
    seen = []
    fill_holes(surface.vertices, surface.faces, progress=lambda done, total: seen.append((done, total)))
    assert seen[0] == (0, 3)
    assert seen[-1] == (3, 3)
    assert seen == sorted(seen)
    with pytest.raises(CancelledError):
        fill_holes(surface.vertices, surface.faces, progress=lambda done, total: False)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "method: got 'magic'"),
        ({"max_edges": 2}, "max_edges: got 2"),
        ({"max_edges": 3.5}, "max_edges: got 3.5"),
        ({"max_perimeter": 0.0}, "max_perimeter: got 0.0"),
        ({"max_diameter": float("nan")}, "max_diameter: got nan"),
        ({"holes": [4]}, r"holes: got 4, expected numbers from 0 to 3"),
        ({"selected": np.zeros(3, dtype=bool)}, "selected: got bool of shape"),
        ({"noise": -1.0}, "noise: got -1.0"),
        ({"method": "paper", "alpha": 0.0}, "alpha: got 0.0"),
        ({"alpha": 0.5}, "alpha: method=.auto. does not use it"),
    ],
)
def test_bad_parameters_are_refused_by_name(options, message):
    surface = punched_patch()
    with pytest.raises(InvalidParameterError, match=message):
        fill_holes(surface.vertices, surface.faces, **options)
