"""Bridges between holes, from truth: gaps in surfaces of known shape, and walls of bolt holes."""

import numpy as np
import pytest
from surface_cases import border_edges, directed_edges

from bezier_filters import (
    InvalidMeshError,
    InvalidParameterError,
    bridge_holes,
    fill_holes,
    replace_selection,
)
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.band_triangulation import triangulate_band
from bezier_filters.holes.bridging import BridgingResult
from bezier_filters.meshes.adjacency import components
from bezier_filters.meshes.intersecting_faces import intersecting_faces
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.surfaces import cylinder, sphere
from hole_jobs import add_noise, gaps, off_the_sphere, off_the_tube
from open_ends import edge_length, plate, revolved, weld

NOTHING = np.empty((0, 2), dtype=np.int32)


def without(vertices: FloatArray, faces: IntArray, values: FloatArray, width: float) -> IntArray:
    """Faces without those that have a vertex where values are within a width of 0."""
    return faces[~(np.abs(values) < width)[faces].any(axis=1)]


def assert_bridged(vertices: FloatArray, faces: IntArray, result: BridgingResult, open_edges: int = 0) -> None:
    """The old part is untouched, the whole is an oriented manifold, open where it was besides, and cuts nothing."""
    assert result.filled == len(result.pairs) > 0
    np.testing.assert_array_equal(result.vertices[: len(vertices)], vertices)
    np.testing.assert_array_equal(result.faces[: len(faces)], faces)
    edges = directed_edges(result.faces)
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert len(border_edges(result.faces)) == open_edges
    assert set(range(len(vertices), len(result.vertices))) <= set(result.faces.ravel().tolist())
    assert all(hole.self_intersections == 0 for hole in result.holes)


def tube_with_gap(width: float) -> tuple[FloatArray, IntArray, FloatArray]:
    tube = cylinder(resolution=64, jitter=0.2)
    middle = tube.vertices[:, 2] - tube.vertices[:, 2].mean()
    return tube.vertices, without(tube.vertices, tube.faces, middle, width), middle


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize(
    ("name", "clean", "noisy"), [("sphere", 0.001, 0.1), ("torus", 0.06, 0.25), ("vessel", 0.01, 0.1)]
)
def test_a_gap_is_closed_by_the_surface(name, clean, noisy, noise):
    """Distances in edges. The gap in the torus is 1 rad wide, 10 to 24 edges: .16 to .21 over seeds of the noise."""
    case = gaps()[name]
    faces, edge = case.faces, edge_length(case.vertices, case.faces)
    vertices = add_noise(case.vertices, faces, noise)
    result = bridge_holes(vertices, faces, case.pairs)
    assert result.pairs == case.pairs
    open_edges = len(border_edges(faces)) - result.holes[0].edge_count
    assert_bridged(vertices, faces, result, open_edges)
    (hole,) = result.holes
    assert hole.method == "surface"
    errors = case.distance(result.vertices[len(vertices) :]) / edge
    assert np.sqrt(np.square(errors).mean()) < (noisy if noise else clean)
    new = result.faces[len(faces) :]
    assert edge_length(result.vertices, new) == pytest.approx(edge, rel=0.3)
    cut = intersecting_faces(prepare_mesh(triangle_mesh(result.vertices, result.faces)))
    assert not (cut >= len(faces)).any()


@pytest.mark.parametrize("width", [0.1, 0.4])
def test_a_tube_goes_on_and_its_ends_stay_open(width):
    vertices, faces, middle = tube_with_gap(width)
    holes = fill_holes(vertices, faces, holes=[]).holes
    inner = sorted(np.argsort([abs(middle[hole.rim].mean()) for hole in holes])[:2].tolist())
    result = bridge_holes(vertices, faces, [inner])
    assert_bridged(vertices, faces, result, 128)
    assert np.abs(off_the_tube(result.vertices[len(vertices) :])).max() < 0.002 * edge_length(vertices, faces)
    assert result.pairs == (tuple(inner),)
    if width == 0.1:
        automatic = bridge_holes(vertices, faces)
        assert automatic.pairs == result.pairs
        np.testing.assert_array_equal(automatic.vertices, result.vertices)
    else:
        assert bridge_holes(vertices, faces).pairs == ()
    assert repr(result).startswith("BridgingResult(")


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_bolt_holes_get_straight_walls(noise):
    case = gaps()["bolt holes"]
    vertices, faces = add_noise(case.vertices, case.faces, noise), case.faces
    result = bridge_holes(vertices, faces)
    assert result.pairs == case.pairs
    assert_bridged(vertices, faces, result)
    assert len(result.pairs) == 5
    assert {hole.method for hole in result.holes} == {"straight"}
    errors = case.distance(result.vertices[len(vertices) :])
    assert np.abs(errors).max() < (0.15 if noise else 0.001)
    assert all(abs(hole.rim_dihedral - 90.0) < 10.0 for hole in result.holes)


def test_a_cone_joins_circles_of_different_radii():
    """Two flat rings above each other, each as if a tube went on from its inner rim."""
    low = revolved(np.array([6.0, 5.0, 4.0, 3.0]), np.zeros(4), 24)
    high = revolved(np.array([2.0, 3.0, 4.0, 5.0]), np.full(4, 5.0), 24)
    vertices, faces = weld(low, high)
    holes = fill_holes(vertices, faces, holes=[]).holes
    pair = [k for k, hole in enumerate(holes) if hole.diameter < 7.0]
    result = bridge_holes(vertices, faces, [pair])
    assert result.holes[0].method == "straight"
    new = result.vertices[len(vertices) :]
    np.testing.assert_allclose(np.hypot(new[:, 0], new[:, 1]), 3.0 - 0.2 * new[:, 2], atol=0.01)


def test_two_halves_become_one_component():
    ball = sphere(resolution=32)
    faces = without(ball.vertices, ball.faces, ball.vertices[:, 2], 0.05)
    result = bridge_holes(ball.vertices, faces)
    assert result.pairs == ((0, 1),)
    assert_bridged(ball.vertices, faces, result)
    for parts, count in ((faces, 2), (result.faces, 1)):
        mesh = prepare_mesh(triangle_mesh(result.vertices, parts))
        assert len(np.unique(components(mesh.adjacency)[parts])) == count
    assert np.abs(off_the_sphere(result.vertices[len(ball.vertices) :])).max() < 1e-4


def test_rings_of_a_selection_become_bands():
    """Around an island in a plane, also one that is not in its middle, and around a tube."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(25.0), np.arange(25.0)))
    corner = (np.arange(24)[:, np.newaxis] * 25 + np.arange(24)).ravel()
    faces = np.vstack([np.c_[corner, corner + 1, corner + 26], np.c_[corner, corner + 26, corner + 25]])
    for center, inner in (([12.0, 12.0], 3.0), ([6.0, 8.0], 1.5)):
        island = np.hypot(x - center[0], y - center[1]) < inner
        raised = ~island & (np.abs(x - 12.0) < 10.0) & (np.abs(y - 12.0) < 10.0)
        vertices = np.column_stack([x, y, 0.5 * raised])
        result = replace_selection(vertices, faces, raised[faces].any(axis=1))
        assert result.replaced == 1
        assert result.patches[0].hole.islands == 1
        np.testing.assert_allclose(result.vertices[:, 2], 0.0, atol=1e-9)
        assert result.patches[0].removed_volume == pytest.approx(0.5 * np.count_nonzero(raised), rel=1e-9)


@pytest.mark.parametrize("turn", [0.0, 1.0, 3.0])
def test_bands_join_loops_at_the_same_angle(turn):
    """Circles with a tilt, with different numbers of vertices and far apart, as in a bent tube."""
    angle, other = (2.0 * np.pi * np.arange(n) / n for n in (24, 36))
    first = np.column_stack([5.0 + np.cos(angle), 0.0 * angle, np.sin(angle)])
    second = np.column_stack([5.0 + np.cos(other), 0.0 * other, np.sin(other)])
    c, s = np.cos(turn), np.sin(turn)
    second = second @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [0.0, 0.0, 0.0 if turn else 4.0]
    points = np.vstack([first, second])
    faces = triangulate_band(points, np.arange(24)[::-1], 24 + np.arange(36), NOTHING)
    assert faces.shape == (60, 3)
    edges = directed_edges(faces)
    assert len(np.unique(edges, axis=0)) == len(edges)
    angles = np.concatenate([angle, other])
    across = edges[(edges[:, 0] < 24) != (edges[:, 1] < 24)]
    apart = np.abs((angles[across[:, 0]] - angles[across[:, 1]] + np.pi) % (2.0 * np.pi) - np.pi)
    assert apart.max() < 0.4


def test_bands_do_not_repeat_edges():
    points = np.vstack(
        [
            np.column_stack([np.cos(a), np.sin(a), np.full(6, z)])
            for z, a in ((0.0, np.arange(6.0)), (1.0, np.arange(6.0)))
        ]
    )
    existing = np.array([[0, 6], [1, 7]])
    faces = triangulate_band(points, np.arange(6), np.arange(11, 5, -1), existing)
    edges = np.sort(directed_edges(faces), axis=1)
    assert not (edges[:, np.newaxis] == existing).all(axis=2).any()
    every = np.array([[i, 6 + j] for i in range(6) for j in range(6)])
    assert triangulate_band(points, np.arange(6), np.arange(11, 5, -1), every) is None


def test_bad_pairs_are_refused_by_name():
    vertices, faces, _ = tube_with_gap(0.1)
    for pairs, message in [
        ("all", "pairs: got 'all', expected 'auto' or pairs of numbers"),
        ([(0, 9)], r"pairs: got \(0, 9\), expected two numbers from 0 to 3, for 4 holes"),
        ([(0, 1, 2)], r"pairs: got \(0, 1, 2\), expected two numbers"),
        ([(0, 1.5)], "expected two numbers"),
        ([0, 1], "pairs: got 0, expected two numbers"),
        ([(0, 1), (1, 2)], "pairs: hole 1 occurs 2 times"),
        ([(1, 1)], "pairs: hole 1 occurs 2 times"),
    ]:
        with pytest.raises(InvalidParameterError, match=message):
            bridge_holes(vertices, faces, pairs)
    with pytest.raises(InvalidParameterError, match="noise: got -1"):
        bridge_holes(vertices, faces, noise=-1.0)
    with pytest.raises(InvalidMeshError, match="faces: got None"):
        bridge_holes(vertices, None)
    tube = revolved(np.full(4, 3.0), 20.0 + np.arange(4.0), 24)
    vertices, faces = weld(plate(bottom=False, bolt_walls=True), tube)
    listed = fill_holes(vertices, faces, holes=[]).holes
    (number,) = (k for k, hole in enumerate(listed) if hole.islands)
    with pytest.raises(InvalidParameterError, match=f"hole {number} cannot be joined: its rims bound one fill already"):
        bridge_holes(vertices, faces, [(number, number - 1)])


def test_no_pairs_change_nothing():
    vertices, faces, _ = tube_with_gap(0.4)
    for pairs in ("auto", []):
        result = bridge_holes(vertices, faces, pairs)
        np.testing.assert_array_equal(result.vertices, vertices)
        np.testing.assert_array_equal(result.faces, faces)
        assert result.holes == result.pairs == ()


def test_the_result_is_that_of_a_scaled_mesh():
    ball = sphere(resolution=12)
    faces = without(ball.vertices, ball.faces, ball.vertices[:, 2], 0.1)
    small, large = (bridge_holes(factor * ball.vertices, faces, [(0, 1)]) for factor in (1.0, 2.0**80))
    np.testing.assert_array_equal(small.vertices * 2.0**80, large.vertices)
