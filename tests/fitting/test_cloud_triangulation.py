"""Triangles between the points of clouds."""

import numpy as np
import pytest
from clouds import CLOSED, noisy

from bezier_filters import triangle_mesh
from bezier_filters.fitting.cloud_triangulation import cloud_surface
from bezier_filters.surfaces import waves


@pytest.mark.parametrize("edges", [0.0, 0.3])
@pytest.mark.parametrize("name", CLOSED)
def test_closed_clouds_are_closed_meshes(name, edges):
    """Euler's formula: F = 2 (V - 2 + 2 handles) without a border, also under noise in all directions."""
    surface = CLOSED[name]
    made = cloud_surface(triangle_mesh(noisy(surface, edges), []))
    assert made.face_count == 2 * (made.vertex_count - 2 + 2 * (name == "torus"))
    assert not made.adjacency.on_boundary.any()
    if not edges:
        corners = surface.vertices[made.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("ij,ij->i", normals, surface.normals[made.faces[:, 0]]) > 0.0).all()


def test_no_edge_has_more_than_two_faces():
    sheet = waves(resolution=20)
    made = cloud_surface(triangle_mesh(noisy(sheet, 0.5), []))
    pairs = np.sort(made.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert np.unique(pairs, axis=0, return_counts=True)[1].max() == 2


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.eye(3)[:1], np.outer(np.arange(9.0), [1.0, 2.0, 3.0])])
def test_clouds_without_a_surface_have_no_faces(points):
    assert cloud_surface(triangle_mesh(points, [])).face_count == 0
