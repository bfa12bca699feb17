"""Rings agree with slower ways to find them."""

import numpy as np
import pytest
from face_lists import random_faces
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters import k_rings, triangle_mesh, vertex_adjacency
from bezier_filters.meshes.neighbourhoods import rings_around
from bezier_filters.surfaces import punched_patch, torus


def adjacency_of(surface):
    return vertex_adjacency(triangle_mesh(surface.vertices, surface.faces))


def reference_rings(faces, start, rings):
    """Breadth-first search with sets."""
    neighbours = {}
    for face in faces.tolist():
        for vertex in face:
            neighbours.setdefault(vertex, set()).update(set(face) - {vertex})
    ring = {start}
    for _ in range(rings):
        ring = ring.union(*(neighbours.get(vertex, set()) for vertex in ring))
    return ring


@given(random_faces, st.integers(0, 4))
def test_rings_of_any_face_list_agree_with_sets(faces, rings):
    mesh = triangle_mesh(np.zeros((15, 3)), faces)
    proper = faces[[len(set(face)) == 3 for face in faces.tolist()]]
    rows = k_rings(vertex_adjacency(mesh), rings)
    assert len(rows) == 15
    for vertex in range(15):
        row = rows.row(vertex).tolist()
        assert row[0] == vertex
        assert len(set(row)) == len(row)
        assert set(row) == reference_rings(proper, vertex, rings)


@pytest.mark.parametrize("rings", [0, 1, 4])
def test_rings_around_a_vertex_are_its_k_rings(rings):
    adjacency = adjacency_of(punched_patch())
    rows = k_rings(adjacency, rings)
    for seed in (0, 700):
        found, _ = rings_around(adjacency.vertices, np.array([seed], dtype=np.int32), rings)
        np.testing.assert_array_equal(found, rows.row(seed))


def test_rings_around_several_vertices_hold_what_is_nearest_to_any():
    adjacency = adjacency_of(torus(resolution=12))
    seeds = np.array([3, 50, 51], dtype=np.int32)
    within = [np.unique(k_rings(adjacency, k).of(seeds)) for k in range(4)]
    found, distances = rings_around(adjacency.vertices, seeds, 3)
    for k in range(4):
        nearer = within[k - 1] if k else []
        np.testing.assert_array_equal(np.sort(found[distances == k]), np.setdiff1d(within[k], nearer))
