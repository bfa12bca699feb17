"""The filters of vertices on selected vertices only."""

import numpy as np
import pytest
from meshset_state import attributes, changed, mesh_state
from vertex_filter_cases import FILTERS, array, sphere

from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.vertex_filters import compute_curvature_by_bezier_patch_per_vertex


class TestSelection:
    @pytest.mark.parametrize("function", FILTERS)
    def test_only_selected_vertices_change(self, textured, function):
        mesh = textured.current_mesh()
        chosen = mesh.vertex_selection_array()
        quality, normals = mesh.vertex_scalar_array(), mesh.vertex_normal_matrix()
        before = mesh_state(textured)
        result = function(textured, onselected=True)
        assert result["status"]["SKIPPED"] == np.count_nonzero(~chosen)
        assert np.array_equal(mesh.vertex_scalar_array()[~chosen], quality[~chosen])
        assert np.array_equal(mesh.vertex_normal_matrix()[~chosen], normals[~chosen])
        assert (mesh.vertex_scalar_array()[chosen] != quality[chosen]).all()
        assert (array(textured, "bz_fit_grade")[~chosen] == 0).all()
        assert (array(textured, "bz_residual")[~chosen] == 0.0).all()
        selections = {"0: vertex_selection_array", "0: face_selection_array"}
        assert not changed(before, mesh_state(textured)) & selections

    @pytest.mark.parametrize("function", FILTERS)
    def test_old_columns_stay_outside_the_selection(self, textured, function):
        chosen = textured.current_mesh().vertex_selection_array()
        function(textured, rings=3)
        before = attributes(textured)
        result = function(textured, onselected=True, rings=1)
        for name in result["attributes"]:
            assert np.array_equal(array(textured, name)[~chosen], before[name][~chosen])
        assert (array(textured, "bz_rings_used")[chosen] != before["bz_rings_used"][chosen]).any()

    @pytest.mark.parametrize("function", FILTERS)
    def test_selected_faces_stand_for_their_vertices(self, function):
        ms = sphere()
        ms.compute_selection_by_condition_per_face(condselect="fi < 7")
        ms.set_selection_none(allfaces=False, allverts=True)
        mesh = ms.current_mesh()
        chosen = np.isin(np.arange(mesh.vertex_number()), mesh.face_matrix()[mesh.face_selection_array()])
        before = mesh_state(ms)
        function(ms, onselected=True)
        assert np.array_equal(array(ms, "bz_fit_grade") != 0, chosen)
        assert (mesh.vertex_scalar_array()[~chosen] == 0.0).all()
        assert (mesh.vertex_scalar_array()[chosen] != 0.0).all()
        assert not changed(before, mesh_state(ms)) & {"0: vertex_selection_array", "0: face_selection_array"}

    def test_nothing_selected(self):
        ms = sphere()
        ms.set_selection_none()
        before = mesh_state(ms)
        with pytest.raises(BezierFilterError, match="there is no selection"):
            compute_curvature_by_bezier_patch_per_vertex(ms, onselected=True)
        assert changed(before, mesh_state(ms)) == set()

    def test_uninitialised_rows_of_old_columns_never_reach_the_mesh_as_nan(self):
        ms = sphere()
        count = ms.current_mesh().vertex_number()
        ms.current_mesh().add_vertex_custom_scalar_attribute(np.full(count, np.nan), "bz_k_min")
        ms.compute_selection_by_condition_per_vertex(condselect="x > 0")
        compute_curvature_by_bezier_patch_per_vertex(ms, onselected=True)
        assert np.isfinite(array(ms, "bz_k_min")).all()
