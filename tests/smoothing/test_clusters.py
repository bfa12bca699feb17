"""Clusters of vertices: what they cover, and how far values spread over them."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.sampling.mesh_parts import whole_mesh
from bezier_filters.smoothing.chebyshev import diffuse
from bezier_filters.smoothing.clusters import AVERAGING_TIME, clusters_of
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.surfaces import bumpy_star


def test_clusters_spread_values_as_far_as_the_mesh_does():
    surface = bumpy_star(resolution=30, jitter=0.25)
    mesh = prepare_mesh(triangle_mesh(surface.vertices, surface.faces))
    clusters = clusters_of(whole_mesh(mesh))
    values = np.random.default_rng(0).standard_normal((mesh.vertex_count, 3))
    on_mesh = diffuse(umbrella_laplacian(whole_mesh(mesh), "free"), values, AVERAGING_TIME)
    means = clusters.diffuse(clusters.means(values.T))
    on_clusters = clusters.spread_to_vertices(means)
    assert on_clusters.std() == pytest.approx(on_mesh.std(), rel=0.15)
    assert np.corrcoef(on_mesh.ravel(), on_clusters.ravel())[0, 1] > 0.95


def test_clusters_cover_what_is_not_connected():
    square = triangle_mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 5]], [[0, 1, 2], [0, 2, 3]])
    clusters = clusters_of(whole_mesh(prepare_mesh(square)))
    assert sorted(clusters.sizes) == [1.0, 4.0]
    assert np.allclose(clusters.means([np.arange(5.0)])[:, 0], [1.5, 4.0])
    assert np.isfinite(clusters.diffuse(np.ones((2, 1)))).all()


def test_clusters_are_connected_and_every_vertex_has_one():
    surface = bumpy_star(resolution=12, jitter=0.25)
    mesh = prepare_mesh(triangle_mesh(surface.vertices, surface.faces))
    clusters, n = clusters_of(whole_mesh(mesh)), mesh.vertex_count
    count = len(clusters.sizes)
    np.testing.assert_array_equal(np.bincount(clusters.of_vertex, minlength=count), clusters.sizes)
    assert clusters.sizes.min() > 0
    starts, ends = np.repeat(np.arange(n), mesh.adjacency.vertices.lengths), mesh.adjacency.vertices.indices
    is_within = clusters.of_vertex[starts] == clusters.of_vertex[ends]
    graph = coo_array((np.ones(is_within.sum()), (starts[is_within], ends[is_within])), shape=(n, n))
    assert connected_components(graph, directed=False)[0] == count
    assert 6 < n / count < 12  # a vertex and its neighbours, about nine


def test_diffusion_between_clusters_keeps_constants():
    surface = bumpy_star(resolution=12, jitter=0.25)
    mesh = triangle_mesh(surface.vertices, surface.faces)
    clusters = clusters_of(whole_mesh(prepare_mesh(mesh)))
    np.testing.assert_allclose(clusters.average([np.full(mesh.vertex_count, 7.0)]), 7.0, rtol=1e-6)
