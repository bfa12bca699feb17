"""Rows, rings and components agree with slower ways to find them."""

import numpy as np
import pytest

from bezier_filters import k_rings, triangle_mesh, vertex_adjacency
from bezier_filters.meshes.adjacency import closed_components
from bezier_filters.meshes.neighbourhoods import rings_around
from bezier_filters.surfaces import punched_patch, sphere, torus


def adjacency_of(surface):
    return vertex_adjacency(triangle_mesh(surface.vertices, surface.faces))


def test_some_rows_come_one_after_the_other():
    rows = adjacency_of(punched_patch()).faces
    ids = np.array([5, 0, 5, 300], dtype=np.int32)
    np.testing.assert_array_equal(rows.of(ids), np.concatenate([rows.row(i) for i in ids]))
    assert rows.of(ids[:0]).size == 0


@pytest.mark.parametrize("rings", [0, 1, 4])
def test_rings_around_a_vertex_are_its_k_rings(rings):
    adjacency = adjacency_of(punched_patch())
    rows = k_rings(adjacency, rings)
    for seed in (0, 700):
        found = np.concatenate(rings_around(adjacency.vertices, np.array([seed]), rings))
        np.testing.assert_array_equal(found, rows.row(seed))


def test_rings_around_several_vertices_hold_what_is_nearest_to_any():
    adjacency = adjacency_of(torus(resolution=12))
    seeds = np.array([3, 50, 51], dtype=np.int32)
    within = [np.unique(k_rings(adjacency, k).of(seeds)) for k in range(4)]
    for k, ring in enumerate(rings_around(adjacency.vertices, seeds, 3)):
        np.testing.assert_array_equal(np.sort(ring), np.setdiff1d(within[k], within[k - 1] if k else []))


def test_components_are_closed_where_every_edge_has_two_faces():
    ball, ring, sheet = sphere(resolution=3), torus(resolution=8), punched_patch()
    shapes = (sheet, ball, ring)
    firsts = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    vertices = np.vstack([shape.vertices for shape in shapes])
    faces = np.vstack([shape.faces + first for shape, first in zip(shapes, firsts, strict=False)])
    mesh = triangle_mesh(vertices, faces)
    number, first = closed_components(mesh, vertex_adjacency(mesh))
    np.testing.assert_array_equal(number, np.repeat([-1, 0, 1], np.diff(firsts)))
    np.testing.assert_array_equal(first, firsts[1:3])
    turned = triangle_mesh(vertices, np.vstack([faces[:-1], faces[-1:, ::-1]]))
    assert (closed_components(turned, vertex_adjacency(turned))[0] == -1).all()
