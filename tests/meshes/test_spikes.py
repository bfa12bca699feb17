"""Spikes and folded vertices are moved between their neighbours."""

import numpy as np
import pytest
from outlier_cases import block, spikes, with_heights

from bezier_filters import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.meshes.spikes import move_folded_vertices, remove_spikes
from bezier_filters.meshes.triangles import area_vectors


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_vertices_outside_of_their_neighbours_come_back_between_them(scale):
    vertices, faces, _ = block()
    clean = prepare_mesh(triangle_mesh(scale * vertices, faces))
    assert np.array_equal(move_folded_vertices(clean).vertices, clean.vertices)
    inside = np.flatnonzero((np.abs(np.abs(vertices) - np.abs(vertices).max(axis=0)) > 0.15).sum(axis=1) == 2)
    k = inside[0]  # on one of the sides, and not near its edges
    ring = clean.adjacency.vertices.indices[clean.adjacency.vertices.indptr[k] : clean.adjacency.vertices.indptr[k + 1]]
    outside = clean.vertices.copy()
    outside[k] += 3.0 * (clean.vertices[ring[0]] - clean.vertices[k])
    moved = move_folded_vertices(prepare_mesh(triangle_mesh(outside, faces))).vertices
    assert np.flatnonzero((moved != outside).any(axis=1)).tolist() == [k]
    assert np.allclose(moved[k], clean.vertices[ring].mean(axis=0), rtol=1e-12)
    areas = area_vectors(moved, clean.faces), area_vectors(clean.vertices, clean.faces)
    assert (np.einsum("ij,ij->i", *areas) > 0.0).all()


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_tips_are_lone_vertices(scale):
    vertices, faces, _ = block()
    mesh = triangle_mesh(scale * vertices, faces)
    flat = remove_spikes(prepare_mesh(mesh)).vertices
    assert (flat != mesh.vertices).any(axis=1).sum() <= 2  # neither edges nor most of the corners
    heights, hit = spikes(len(vertices), 0.03, 1.0)
    spiky = triangle_mesh(*with_heights((scale * vertices, faces, block()[2]), heights))
    moved = (remove_spikes(prepare_mesh(spiky)).vertices != spiky.vertices).any(axis=1)
    assert moved[hit & (np.abs(heights) > 0.5)].mean() > 0.6
    assert moved[~hit].sum() <= 5
