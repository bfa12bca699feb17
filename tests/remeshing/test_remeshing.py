"""Remeshing: regular triangles on the true surface, with the sharp edges and borders that there were."""

import numpy as np
import pytest
from test_subdivision import closed_cylinder, heights, mean_edge, noisy_torus, rms, smallest_angle

from bezier_filters import CancelledError, InvalidMeshError, InvalidParameterError, inspect_mesh, remesh
from bezier_filters.remeshing.vertex_count import least_vertices
from bezier_filters.surfaces import block_with_sharp_edges, cylinder, sphere, torus


def check_closed(result):
    report = inspect_mesh(result.vertices, result.faces)
    assert (report.boundary_edges, report.non_manifold_edges, report.incoherent_edges) == (0, 0, 0)
    assert report.unreferenced_vertices == 0


@pytest.mark.parametrize("level", [0.0, 0.1])
def test_regular_triangles_lie_on_the_torus(level):
    vertices, faces = noisy_torus(level)
    even = remesh(vertices, faces)
    edge = mean_edge(vertices, faces)
    check_closed(even)
    assert rms(heights(even.vertices)) < (0.06 if level else 2e-4) * edge
    assert abs(mean_edge(even.vertices, even.faces) / edge - 1.0) < 0.1
    assert smallest_angle(even.vertices, even.faces) > 25.0
    valences = np.bincount(even.faces.ravel())
    assert ((valences >= 5) & (valences <= 7)).mean() > 0.99
    assert (valences == 6).mean() > 0.7


def test_a_number_of_vertices_is_reached():
    vertices, faces = noisy_torus(0.0)
    for count in (500, 4000):
        assert abs(len(remesh(vertices, faces, vertex_count=count).vertices) / count - 1.0) < 0.03


@pytest.mark.parametrize(("body", "least"), [(sphere(resolution=10), 6), (torus(resolution=24), 25)])
def test_too_few_vertices_end_at_the_smallest_good_mesh(body, least):
    """An octahedron follows a sphere; triangles on each other follow nothing."""
    coarse = remesh(body.vertices, body.faces, vertex_count=7)
    check_closed(coarse)
    assert len(coarse.vertices) >= least
    volume, whole = (
        np.linalg.det(v[f]).sum() for v, f in ((coarse.vertices, coarse.faces), (body.vertices, body.faces))
    )
    assert volume > 0.2 * whole
    assert coarse.has_requested_vertices == (least <= 7)


def test_the_topology_needs_vertices():
    """A torus has no triangulation of six vertices, a sphere none of three, a pair of spheres none of seven."""
    ring, ball = torus(resolution=12), sphere(resolution=4)
    with pytest.raises(InvalidParameterError, match="vertex_count: got 6, expected 7 or more"):
        remesh(ring.vertices, ring.faces, vertex_count=6)
    pair = np.vstack([ball.faces, ball.faces + len(ball.vertices)])
    assert least_vertices(ball.faces, len(ball.vertices)) == 4
    assert least_vertices(pair, 2 * len(ball.vertices)) == 8
    tube = cylinder(radius=1.0)
    assert least_vertices(tube.faces, len(tube.vertices)) == 3


def test_iterations_report_their_progress_and_can_be_cancelled():
    ball, seen = sphere(resolution=8), []
    remesh(ball.vertices, ball.faces, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (30, 30)
    first = seen.index((0, 30)) if (0, 30) in seen else seen.index((1, 30))
    steps = [done for done, _ in seen[first:]]
    assert steps == sorted(steps)
    assert len(set(steps)) >= 20
    calls = iter(range(len(seen)))
    with pytest.raises(CancelledError):
        remesh(ball.vertices, ball.faces, progress=lambda *_: next(calls) < first + 5)


def test_edges_are_shorter_where_the_surface_is_curved():
    """An ellipsoid of revolution is most curved at its ends."""
    ball = sphere(resolution=16)
    vertices = ball.vertices * [1.0, 1.0, 3.0]
    graded = remesh(vertices, ball.faces, tolerance=0.01)
    check_closed(graded)
    corners = graded.vertices[graded.faces]
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
    height = np.abs(corners[..., 2].mean(axis=1))
    assert size[height > 2.8].mean() < 0.8 * size[height < 1.0].mean()
    assert graded.chord_error < 0.015
    assert len(graded.vertices) < len(vertices)


def test_edges_of_a_block_stay():
    block, faces = block_with_sharp_edges(resolution=12)
    even = remesh(block, faces, length=0.11)
    check_closed(even)
    volume = [np.linalg.det(v[f]).sum() / 6.0 for v, f in ((block, faces), (even.vertices, even.faces))]
    np.testing.assert_allclose(volume[1], volume[0], rtol=1e-9)


def test_a_round_sharp_edge_stays_round():
    vertices, faces = closed_cylinder(32)
    even = remesh(vertices, faces)
    check_closed(even)
    radius, lid = np.hypot(*even.vertices[:, :2].T), np.abs(np.abs(even.vertices[:, 2]) - 1.0)
    assert np.minimum(np.abs(radius - 1.0), lid).max() < 5e-4
    assert ((np.abs(radius - 1.0) < 5e-4) & (lid < 5e-4)).sum() >= 48


def test_borders_stay():
    tube = cylinder(radius=1.0)
    even = remesh(tube.vertices, tube.faces, length=1.5 * mean_edge(tube.vertices, tube.faces))
    corners = np.stack([even.faces, np.roll(even.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, count = np.unique(np.sort(corners, axis=1), axis=0, return_counts=True)
    ends = even.vertices[np.unique(edges[count == 1])]
    np.testing.assert_allclose(np.abs(ends[:, 2]), np.abs(tube.vertices[:, 2]).max(), atol=1e-6)
    np.testing.assert_allclose(np.hypot(*even.vertices[:, :2].T), 1.0, atol=1e-3)


def test_faces_that_are_not_selected_stay():
    ball = sphere(resolution=12)
    selected = ball.vertices[ball.faces][..., 2].min(axis=1) > 0.2
    half = remesh(ball.vertices, ball.faces, selected=selected, length=0.08)
    check_closed(half)
    others = np.flatnonzero(~selected)
    np.testing.assert_array_equal(half.old_faces[: len(others)], others)
    np.testing.assert_array_equal(half.vertices[half.faces[: len(others)]], ball.vertices[ball.faces[others]])
    assert np.abs(np.linalg.norm(half.vertices, axis=1) - 1.0).max() < 1e-3


def test_given_edges_stay():
    ring = torus(resolution=24)
    sides = np.stack([ring.faces, np.roll(ring.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    points = ring.vertices[sides]
    outer = sides[((np.abs(points[..., 2]) < 1e-9) & (np.hypot(points[..., 0], points[..., 1]) > 1.0)).all(axis=1)]
    assert len(outer) >= 24
    even = remesh(ring.vertices, ring.faces, edges=outer, length=0.2)
    check_closed(even)
    heights_ = even.vertices[even.faces][..., 2]
    outside = (np.hypot(*even.vertices[:, :2].T) > 1.0)[even.faces].all(axis=1)
    assert not ((heights_ > 1e-6).any(axis=1) & (heights_ < -1e-6).any(axis=1) & outside).any()


def test_places_are_those_below_the_vertices():
    vertices, faces = noisy_torus(0.0)
    even = remesh(vertices, faces)
    weights = np.column_stack([1.0 - even.vertex_coordinates.sum(axis=1), even.vertex_coordinates])
    below = np.einsum("nk,nkd->nd", weights, vertices[faces[even.vertex_faces]])
    assert np.linalg.norm(below - even.vertices, axis=1).max() < 0.2 * mean_edge(vertices, faces)


@pytest.mark.parametrize(
    "options",
    [
        {"length": 0.0},
        {"length": 1e-9},
        {"tolerance": -1.0},
        {"vertex_count": 3},
        {"vertex_count": 100, "length": 0.1},
        {"iterations": 0},
        {"edges": np.array([[0, 9999]])},
        {"selected": np.zeros(3, np.bool_)},
    ],
    ids=str,
)
def test_wrong_parameters_are_refused(options):
    ball = sphere(resolution=6)
    with pytest.raises(InvalidParameterError, match=next(iter(options))):
        remesh(ball.vertices, ball.faces, **options)


def test_a_tolerance_above_the_radius_ends():
    ball = sphere(resolution=8)
    assert 4 <= len(remesh(ball.vertices, ball.faces, tolerance=3.0).vertices) < 300


def test_edges_of_three_faces_are_refused():
    ball = sphere(resolution=8)
    fin = np.vstack([ball.faces, [[*ball.faces[0, :2], len(ball.vertices)]]])
    with pytest.raises(InvalidMeshError, match="1 edges have three faces"):
        remesh(np.vstack([ball.vertices, [[1.2] * 3]]), fin)


def test_a_single_huge_face_is_named_and_not_filled():
    ball = sphere(resolution=16)
    vertices = ball.vertices.copy()
    vertices[ball.faces[0]] *= 1e4
    with pytest.raises(InvalidParameterError, match="a few are far larger"):
        remesh(vertices, ball.faces)
