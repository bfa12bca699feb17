"""What a prepared mesh keeps is what the functions compute, once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import longest_edges, prepare_mesh
from bezier_filters.meshes.sharp_edges import sharp_edge_vertices
from bezier_filters.surfaces import block_with_sharp_edges, torus

BLOCK = prepare_mesh(triangle_mesh(*block_with_sharp_edges(resolution=6)))


def edges_of(mesh):
    pairs = np.sort(np.concatenate([mesh.faces[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    return np.unique(pairs, axis=0)


def test_quantities_are_those_of_the_functions_and_are_computed_once():
    planes = tangent_planes(BLOCK, BLOCK.adjacency)
    np.testing.assert_array_equal(BLOCK.planes.normals, planes.normals)
    np.testing.assert_array_equal(BLOCK.barriers, sharp_edge_vertices(BLOCK, BLOCK.adjacency, planes))
    assert BLOCK.planes is BLOCK.planes
    assert BLOCK.barriers is BLOCK.barriers
    assert BLOCK.barriers.any()


def test_edges_have_their_lengths():
    ring = torus(resolution=12, jitter=0.2)
    mesh = prepare_mesh(triangle_mesh(ring.vertices, ring.faces))
    pairs = edges_of(mesh)
    lengths = np.linalg.norm(mesh.vertices[pairs[:, 0]] - mesh.vertices[pairs[:, 1]], axis=1)
    longest = np.zeros(mesh.vertex_count)
    np.maximum.at(longest, pairs, lengths[:, np.newaxis])
    assert mesh.mean_edge == pytest.approx(lengths.mean(), rel=1e-12)
    np.testing.assert_allclose(longest_edges(mesh), longest, rtol=1e-15)


@given(st.floats(0.1, 10.0), st.integers(0, 2))
def test_a_moved_mesh_keeps_its_adjacency_and_has_planes_of_its_own(factor, axis):
    stretched = BLOCK.vertices * np.where(np.arange(3) == axis, factor, 1.0)
    moved = BLOCK.move(stretched)
    assert moved.adjacency is BLOCK.adjacency
    assert moved.faces is BLOCK.faces
    afresh = prepare_mesh(triangle_mesh(stretched, BLOCK.faces))
    np.testing.assert_array_equal(moved.planes.normals, afresh.planes.normals)
    assert moved.mean_edge == afresh.mean_edge


def test_a_mesh_that_is_prepared_is_not_prepared_again():
    assert prepare_mesh(BLOCK) is BLOCK


def test_a_mesh_without_edges_has_none():
    points = prepare_mesh(triangle_mesh(np.zeros((3, 3)), []))
    assert points.mean_edge == 0.0
    assert not longest_edges(points).any()
    assert not points.barriers.any()
