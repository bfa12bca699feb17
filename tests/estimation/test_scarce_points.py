"""Meshes of which nothing can be learned, or whose points leave something open."""

import numpy as np
import pytest
from scarce_meshes import soup, tube

from bezier_filters import estimate_vertex_geometry, inspect_mesh, smooth
from bezier_filters.status import FitStatus
from bezier_filters.surfaces import sphere, torus


class TestTwoRows:
    @pytest.mark.parametrize("edges", [40, 200, 1000])
    @pytest.mark.parametrize("height", [0.02, 0.2, 2.0])
    @pytest.mark.parametrize("radius", [1e-3, 5.0])
    def test_a_cylinder_bends_across_its_straight_edges(self, edges, height, radius):
        vertices, faces = tube(edges, height * radius, radius)
        geometry = estimate_vertex_geometry(vertices, faces)
        assert geometry.status_counts() == {"LOWER_DEGREE": 2 * edges}
        step = 2.0 * np.pi / edges
        np.testing.assert_allclose(geometry.k_max * radius, 1.0, atol=0.001 + 1.2 * step**2)
        np.testing.assert_allclose(geometry.k_min * radius, 0.0, atol=0.001 + 1.2 * step**2)
        outward = vertices * [1.0, 1.0, 0.0] / radius
        assert np.einsum("ij,ij->i", geometry.normals, outward).min() > np.cos(0.1 * step)

    def test_a_strip_is_flat(self):
        x, y = np.divmod(np.arange(40), 2)
        i = np.arange(0, 38, 2)
        faces = np.concatenate([np.column_stack([i, i + 2, i + 3]), np.column_stack([i, i + 3, i + 1])])
        geometry = estimate_vertex_geometry(np.column_stack([x, y, 0.0 * x]), faces)
        assert not geometry.mean_curvature.any()
        assert geometry.status_counts()["LOWER_DEGREE"] == 40

    @pytest.mark.parametrize("width", [1e-13, 1e-10, 1e-8, 1e-5, 0.1])
    def test_a_strip_of_any_width_determines_no_patch(self, width):
        """However narrow, nothing is known across it: rounding does not stand in for points."""
        along = 0.1 * np.arange(12)
        vertices = np.zeros((24, 3))
        vertices[:, 1] = np.concatenate([along, along + 0.03])
        vertices[12:, 0] = width
        i = np.arange(11)
        faces = np.concatenate([np.column_stack([i, i + 1, i + 12]), np.column_stack([i + 1, i + 13, i + 12])])
        geometry = estimate_vertex_geometry(vertices, faces, rings=2, alpha=0.8)
        assert not geometry.mean_curvature.any()
        assert "OK" not in geometry.status_counts()

    def test_separate_triangles_and_tetrahedra_have_no_curvature(self):
        corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
        tetrahedra = np.concatenate([corners + 3.0 * k for k in range(30)])
        faces = np.concatenate([4 * k + np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]) for k in range(30)])
        for mesh in (soup(), (tetrahedra, faces)):
            assert estimate_vertex_geometry(*mesh).status_counts().keys() == {"NORMAL_ONLY"}


class TestDegreeThatWasAskedFor:
    @pytest.mark.parametrize(("degree", "used"), [("auto", 3), (2, 2), (3, 3), (4, 4), (5, 4), (6, 4)])
    @pytest.mark.parametrize("size", [{}, {"rings": 2}, {"radius": 0.5}])
    def test_it_is_used_where_nothing_is_learned(self, degree, used, size):
        geometry = estimate_vertex_geometry(*tube(40, 0.2), degree=degree, **size)
        assert (geometry.fit.degree, geometry.fit.alpha) == (used, 0.8)
        assert geometry.fit.noise_reason

    def test_it_changes_what_is_fitted(self):
        small = sphere(resolution=2)
        keep = small.vertices[small.faces].mean(axis=1)[:, 2] > -0.2
        two, four = (estimate_vertex_geometry(small.vertices, small.faces[keep], degree=k) for k in (2, 4))
        assert two.fit.alpha == four.fit.alpha == 0.8
        assert np.abs(two.mean_curvature - four.mean_curvature).max() > 1e-3


class TestFacesWithoutArea:
    @staticmethod
    def pillows(mesh, count):
        """The mesh with vertices at others, in faces without area on an edge there; and which these are."""
        rng = np.random.default_rng(0)
        chosen = rng.choice(len(mesh.faces), count, replace=False)
        first, second = mesh.faces[chosen, 0], mesh.faces[chosen, 1]
        new = len(mesh.vertices) + np.arange(count)
        faces = [mesh.faces, np.column_stack([second, first, new]), np.column_stack([first, second, new])]
        return np.concatenate([mesh.vertices, mesh.vertices[first]]), np.concatenate(faces), first, new

    @pytest.mark.parametrize("options", [{}, {"rings": 2}])
    def test_vertices_at_one_place_have_nearly_one_estimate(self, options):
        mesh = torus(resolution=40)
        vertices, faces, twin, new = self.pillows(mesh, 12)
        assert inspect_mesh(vertices, faces).degenerate_faces == 24
        geometry = estimate_vertex_geometry(vertices, faces, **options)
        assert geometry.status.max() <= FitStatus.WIDER_RING
        assert np.linalg.norm(geometry.normals[new] - geometry.normals[twin], axis=1).max() < 0.005
        assert np.abs(geometry.mean_curvature[new] - geometry.mean_curvature[twin]).max() < 0.02
        np.testing.assert_allclose(geometry.mean_curvature[new], mesh.mean_curvature[twin], atol=0.02)

    def test_smoothing_moves_them_together(self):
        mesh = torus()
        vertices, faces, twin, new = self.pillows(mesh, 12)
        vertices[: len(mesh.vertices)] += np.random.default_rng(1).normal(scale=0.01, size=mesh.vertices.shape)
        vertices[new] = vertices[twin]
        result = smooth(vertices, faces)
        assert result.displacement.max() > 0.0
        np.testing.assert_array_equal(result.vertices[new], result.vertices[twin])

    def test_where_no_face_has_an_area_there_is_no_estimate(self):
        line = np.column_stack([np.arange(9.0), np.zeros((9, 2))])
        faces = np.column_stack([np.arange(7), np.arange(7) + 1, np.arange(7) + 2])
        assert estimate_vertex_geometry(line, faces).status_counts() == {"ISOLATED": 9}
