"""Neighbourhoods in local coordinates, and the vertices that are drawn for them."""

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.sampling.neighbourhood_samples import NORMAL_CHECK_RINGS, draw_from_mesh, sample_neighbourhoods
from bezier_filters.surfaces import sphere, waves

RINGS = 4


def sample_of(vertices, faces, ids, max_flipped_fraction=0.0):
    mesh = prepare_kernel_mesh(triangle_mesh(vertices, faces), with_barriers=True)
    rows = np.flatnonzero(np.isin(mesh.origin, ids)).astype(np.int32)
    found = sample_neighbourhoods(mesh, rows, rings=RINGS, max_flipped_fraction=max_flipped_fraction)
    return mesh, found


def rings_of(mesh, center):
    """The vertices within some edges, for each number of edges."""
    found, neighbours = [{int(center)}], mesh.mesh_with_adjacency().adjacency.vertices
    for _ in range(RINGS):
        found.append(found[-1] | {int(j) for i in found[-1] for j in neighbours.row(i)})
    return found


def test_neighbourhoods_are_the_rings_of_the_vertex_turned_into_its_plane():
    ball = sphere(resolution=12, jitter=0.3)
    mesh, sample = sample_of(ball.vertices, ball.faces, np.arange(0, 1000, 90))
    assert sample.usable.all(axis=0)[1:].all()
    for row, center in enumerate(sample.centers):
        rings = rings_of(mesh, center)
        np.testing.assert_array_equal(sample.sizes[row, 1:], [len(ring) for ring in rings[1:]])
        count = sample.sizes[row, RINGS]
        points = sample.points[row, :count]
        assert not sample.points[row, count:].any()
        np.testing.assert_array_equal(points[0], 0.0)
        members = mesh.vertices[sorted(rings[RINGS])]
        np.testing.assert_allclose(np.sort(pdist(points)), np.sort(pdist(members)), atol=1e-12)
        # On a sphere the plane is nearly that of the vertex: heights are negative, and about half the squared distance.
        distances = np.square(points[:, :2]).sum(axis=1)
        np.testing.assert_allclose(points[:, 2], -0.5 * distances, atol=0.05)


def test_rings_that_reach_a_border_are_not_interior():
    sheet = waves(resolution=20)
    mesh, sample = sample_of(sheet.vertices, sheet.faces, np.arange(len(sheet.vertices)))
    for row in range(0, len(sample.centers), 37):
        rings = rings_of(mesh, sample.centers[row])
        inside = [not (mesh.on_boundary | mesh.barriers)[sorted(ring)].any() for ring in rings[:-1]]
        np.testing.assert_array_equal(sample.is_interior[row, 1:], inside)
    assert not (sample.usable & ~sample.is_interior).any()


@pytest.mark.parametrize("allowed", [0.0, 0.2])
def test_rings_with_too_many_flipped_normals_are_not_usable(allowed):
    """One normal in the ring of the vertex points inwards."""
    ball = sphere(resolution=12)
    mesh = prepare_kernel_mesh(triangle_mesh(ball.vertices, ball.faces), with_barriers=True)
    center = 40
    flipped = mesh.normals.copy()
    flipped[mesh.mesh_with_adjacency().adjacency.vertices.row(center)[0]] *= -1.0
    sample = sample_neighbourhoods(
        mesh._replace(normals=flipped),
        np.array([center], np.int32),
        rings=RINGS,
        max_flipped_fraction=allowed,
    )
    size = sample.sizes[0, NORMAL_CHECK_RINGS]
    assert sample.flipped_fraction[0] == pytest.approx(1.0 / size)
    assert sample.usable[0, 2:].all() == (allowed > 0.0)
    assert sample.usable[0, 1]  # where only the vertex itself is asked for


@pytest.mark.parametrize("count", [10, 100, 10_000])
def test_one_vertex_is_drawn_from_each_interval(count):
    """Of the user's numbers, whatever the order in memory; vertices without a normal are none."""
    ball = sphere(resolution=12)
    lone = np.vstack([ball.vertices, np.full((50, 3), 9.0)])
    mesh = prepare_kernel_mesh(triangle_mesh(lone, ball.faces), with_barriers=True)
    found = np.sort(mesh.origin[draw_from_mesh(mesh, count)])
    n = len(ball.vertices)
    ends = np.linspace(0, n, min(n, count) + 1).astype(int)
    np.testing.assert_array_equal(np.searchsorted(ends, found, side="right"), np.arange(1, len(ends)))
