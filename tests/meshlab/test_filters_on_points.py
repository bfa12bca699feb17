"""The filters on meshes without faces."""

import numpy as np
import pymeshlab
import pytest
from meshset_state import changed, mesh_state

from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.meshlab.vertex_filters import (
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)
from bezier_filters.surfaces import torus, waves


class TestPointClouds:
    @pytest.fixture
    def surface(self):
        return torus(resolution=24, jitter=0.3)

    def mesh(self, surface, normals):
        return pymeshlab.Mesh(vertex_matrix=surface.vertices, v_normals_matrix=normals)

    def cloud(self, surface, normals=None):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(surface.vertices) if normals is None else self.mesh(surface, normals))
        return ms

    @pytest.mark.parametrize(
        "function",
        [
            compute_normal_by_bezier_patch_per_vertex,
            compute_curvature_by_bezier_patch_per_vertex,
            compute_torsion_by_bezier_patch_per_vertex,
        ],
    )
    def test_every_filter_fits_and_colours_points(self, surface, function):
        ms = self.cloud(surface)
        before = mesh_state(ms)
        result = function(ms, color=True)
        assert set(result["status"]) <= {"OK", "WIDER_RING"}
        assert sum(result["status"].values()) == len(surface.vertices)
        written = {f"0: {name}" for name in result["attributes"]}
        sets_normals = function is compute_normal_by_bezier_patch_per_vertex  # their angle to none before is 0
        own = "0: vertex_normal_matrix" if sets_normals else "0: vertex_scalar_array"
        assert changed(before, mesh_state(ms)) == written | {own, "0: vertex_color_matrix"}

    def test_values_are_those_of_the_points(self, surface):
        ms = self.cloud(surface)
        compute_curvature_by_bezier_patch_per_vertex(ms, quality="gaussian")
        expected = estimate_vertex_geometry(surface.vertices, None).gaussian_curvature
        np.testing.assert_array_equal(ms.current_mesh().vertex_scalar_array(), expected)

    @pytest.mark.parametrize("sign", [1, -1])
    def test_normals_of_the_cloud_tell_the_outside(self, surface, sign):
        ms = self.cloud(surface, 2.0 * sign * surface.normals)
        compute_normal_by_bezier_patch_per_vertex(ms)
        normals = ms.current_mesh().vertex_normal_matrix()
        np.testing.assert_allclose(np.einsum("ij,ij->i", normals, surface.normals), sign, atol=1e-3)

    def test_normals_that_are_not_finite_tell_nothing(self, surface):
        unknown = np.zeros_like(surface.vertices)
        unknown[::2] = np.nan
        ms = self.cloud(surface, unknown)
        compute_normal_by_bezier_patch_per_vertex(ms)
        outward = np.einsum("ij,ij->i", ms.current_mesh().vertex_normal_matrix(), surface.normals)
        assert outward.min() > 0.9

    def test_selected_points_alone(self, surface):
        ms = self.cloud(surface)
        ms.compute_selection_by_condition_per_vertex(condselect="x > 0")
        result = compute_curvature_by_bezier_patch_per_vertex(ms, onselected=True)
        selected = surface.vertices[:, 0] > 0
        assert result["status"].pop("SKIPPED") == (~selected).sum()
        assert sum(result["status"].values()) == selected.sum()
        assert not ms.current_mesh().vertex_scalar_array()[~selected].any()

    @pytest.mark.parametrize(("side", "sign"), [("toward", 1), ("away", -1)])
    def test_a_viewpoint_replaces_the_normals_of_the_cloud(self, side, sign):
        land = waves(resolution=20, jitter=0.3)
        ms = self.cloud(land, -sign * land.normals)
        result = compute_normal_by_bezier_patch_per_vertex(ms, viewpoint=(0, 0, 5), viewpointside=side)
        assert result["flipped"] == 0
        assert (sign * ms.current_mesh().vertex_normal_matrix()[:, 2] > 0).all()

    def test_viewpoints_of_the_cloud_orient_it_where_it_has_no_normals(self, surface):
        places = 0.5 * surface.normals + surface.vertices
        for normals, sign in ((None, 1), (-surface.normals, -1)):
            ms = self.cloud(surface, normals)
            for axis, values in zip("xyz", places.T, strict=True):
                ms.current_mesh().add_vertex_custom_scalar_attribute(values.copy(), f"bz_viewpoint_{axis}")
            result = compute_normal_by_bezier_patch_per_vertex(ms)
            assert result["flipped"] == (0 if normals is None else None)
            found = ms.current_mesh().vertex_normal_matrix()
            assert (sign * np.einsum("ij,ij->i", found, surface.normals) > 0).all()

    def test_normals_that_contradict_their_viewpoints_are_counted(self, surface):
        ms = self.cloud(surface)
        is_wrong = np.isin(np.arange(len(surface.vertices)), surface.vertices.argmax(axis=0))
        places = surface.vertices + np.where(is_wrong[:, np.newaxis], -0.01, 0.01) * surface.normals
        for axis, values in zip("xyz", places.T, strict=True):
            ms.current_mesh().add_vertex_custom_scalar_attribute(values.copy(), f"bz_viewpoint_{axis}")
        result = compute_normal_by_bezier_patch_per_vertex(ms)
        assert result["flipped"] == is_wrong.sum()
        count = f"{is_wrong.sum():,} of {len(is_wrong):,} normals contradict their viewpoints"
        assert any(remark.startswith(count) for remark in result["remarks"])

    def test_a_number_of_neighbours(self, surface):
        ms = self.cloud(surface)
        result = compute_curvature_by_bezier_patch_per_vertex(ms, neighbours=25)
        expected = estimate_vertex_geometry(surface.vertices, neighbours=25)
        assert result["fit"]["neighbours"] == expected.fit.neighbours == 25
        np.testing.assert_array_equal(ms.current_mesh().vertex_scalar_array(), expected.mean_curvature)
