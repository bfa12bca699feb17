"""Loops of boundary edges: their direction, where they touch, and where there are none."""

import numpy as np

from bezier_filters import boundary_loops, triangle_mesh, vertex_adjacency
from bezier_filters.surfaces import punched_patch, sphere, torus


def test_closed_surfaces_have_no_boundary():
    for surface in (sphere(), torus()):
        mesh = triangle_mesh(surface.vertices, surface.faces)
        assert boundary_loops(mesh) == []
        assert not vertex_adjacency(mesh).on_boundary.any()


def test_loops_run_with_the_faces_around_rim_and_against_them_around_holes():
    surface = punched_patch()
    loops = boundary_loops(triangle_mesh(surface.vertices, surface.faces))
    areas = []
    for loop in loops:
        x, y, _ = surface.vertices[loop].T
        areas.append(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    assert sorted(np.sign(areas)) == [-1, -1, -1, 1]
    boundary = vertex_adjacency(triangle_mesh(surface.vertices, surface.faces)).on_boundary
    np.testing.assert_array_equal(np.sort(np.concatenate(loops)), np.flatnonzero(boundary))


def test_loops_that_touch_at_a_vertex_stay_apart():
    # two triangles that share vertex 0 only
    mesh = triangle_mesh(np.random.default_rng(0).random((5, 3)), [[0, 1, 2], [0, 3, 4]])
    assert [loop.tolist() for loop in boundary_loops(mesh)] == [[0, 1, 2], [0, 3, 4]]


def test_borders_that_meet_a_non_manifold_edge_are_no_loops():
    vertices = np.random.default_rng(0).random((8, 3))
    fins = [[0, 1, 2], [0, 1, 3], [0, 1, 4]]
    assert boundary_loops(triangle_mesh(vertices, fins)) == []
    with_another = triangle_mesh(vertices, [*fins, [5, 6, 7], [5, 5, 6]])
    assert [loop.tolist() for loop in boundary_loops(with_another)] == [[5, 6, 7]]


def test_borders_of_faces_that_disagree_are_no_loops():
    vertices = np.random.default_rng(0).random((4, 3))
    assert boundary_loops(triangle_mesh(vertices, [[0, 1, 2], [1, 2, 3]])) == []
    assert [loop.tolist() for loop in boundary_loops(triangle_mesh(vertices, [[0, 1, 2], [2, 1, 3]]))] == [[0, 1, 3, 2]]
