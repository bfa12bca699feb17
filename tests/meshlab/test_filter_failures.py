"""What the filters of vertices refuse, and that all stays as it was when one fails."""

import numpy as np
import pymeshlab
import pytest
from meshset_state import changed, mesh_state
from vertex_filter_cases import GIVEN, sphere

from bezier_filters.errors import CancelledError
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.vertex_filters import (
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)


class TestFailure:
    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"rings": 0}, "rings: got 0"),
            ({"alpha": 1.5}, "alpha: got 1.5"),
            ({"degree": 7}, "degree: got 7"),
            ({"smoothness": "soft"}, "smoothness: got 'soft'"),
            ({"threads": 0}, "threads: got 0"),
            ({"radius": "200%"}, r"radius: got '200%', expected a length such as 0.5, or a percentage such as 2%"),
            ({"quality": "colour"}, "quality: got 'colour', expected 'mean', 'gaussian'"),
            ({"quality": 3}, "quality: got 3"),
            ({"color": True, "quality": None}, "color: there is no quality"),
            ({"color": True, "colormap": "jet"}, "colormap: got 'jet', expected one of auto, RGB"),
            ({"color": True, "percentile": 50}, "percentile: got 50"),
        ],
    )
    def test_parameters_are_refused_and_all_stays(self, textured, options, message):
        before = mesh_state(textured)
        with pytest.raises(BezierFilterError, match=message):
            compute_curvature_by_bezier_patch_per_vertex(textured, **options)
        assert changed(before, mesh_state(textured)) == set()

    @pytest.mark.parametrize("runs", [0, 1])
    def test_cancelling_leaves_all_as_it_was(self, textured, runs):
        for _ in range(runs):
            compute_normal_by_bezier_patch_per_vertex(textured, **GIVEN)
        before = mesh_state(textured)
        with pytest.raises(CancelledError):
            compute_normal_by_bezier_patch_per_vertex(textured, progress=lambda done, total: False)
        assert changed(before, mesh_state(textured)) == set()

    def test_an_error_in_the_callback_leaves_all_as_it_was(self, textured):
        def fail(done, total):
            raise ZeroDivisionError

        before = mesh_state(textured)
        with pytest.raises(ZeroDivisionError):
            compute_normal_by_bezier_patch_per_vertex(textured, progress=fail)
        assert changed(before, mesh_state(textured)) == set()

    def test_coordinates_that_are_not_finite(self):
        ms = sphere()
        ms.compute_coord_by_function(x="vi == 3 ? 0/0 : x", y="y", z="z")
        before = mesh_state(ms)
        with pytest.raises(BezierFilterError, match="finite"):
            compute_curvature_by_bezier_patch_per_vertex(ms)
        assert changed(before, mesh_state(ms)) == set()

    def test_a_point_attribute_of_our_name(self):
        ms = sphere()
        count = ms.current_mesh().vertex_number()
        ms.current_mesh().add_vertex_custom_point_attribute(np.zeros((count, 3)), "bz_k_max")
        before = mesh_state(ms)
        with pytest.raises(BezierFilterError, match="point attribute 'bz_k_max'"):
            compute_curvature_by_bezier_patch_per_vertex(ms)
        assert changed(before, mesh_state(ms)) == set()

    def test_an_illegal_attribute_is_reported_before_the_fit(self):
        ms = sphere()
        ms.current_mesh().add_vertex_custom_scalar_attribute(np.zeros(642), "my-field")
        with pytest.raises(BezierFilterError, match="my_field"):
            compute_curvature_by_bezier_patch_per_vertex(ms, progress=lambda done, total: pytest.fail("was fitted"))
        assert list(ms.filter_parameter_values("ply")) == ["binary", "__ca_vs__my_field"]

    def test_a_change_of_the_mesh_meanwhile(self):
        ms = sphere()

        def switch(done, total):
            ms.create_cube()

        with pytest.raises(BezierFilterError, match="changed while the filter ran"):
            compute_curvature_by_bezier_patch_per_vertex(ms, progress=switch)

    @pytest.mark.parametrize("runs", [0, 1])
    def test_an_interrupt_while_writing_is_undone(self, textured_bunny_file, runs):
        class Interrupted(pymeshlab.MeshSet):
            def compute_normal_by_function_per_vertex(self, **options):
                super().compute_normal_by_function_per_vertex(**options)
                if "bz_normal_x" in options["x"]:
                    raise KeyboardInterrupt

        ms = Interrupted()
        ms.load_new_mesh(str(textured_bunny_file))
        ms.compute_scalar_by_function_per_vertex(q="y")
        if runs:
            with pytest.raises(KeyboardInterrupt):
                compute_normal_by_bezier_patch_per_vertex(ms, **GIVEN)
        before = mesh_state(ms)
        with pytest.raises(KeyboardInterrupt):
            compute_normal_by_bezier_patch_per_vertex(ms, rings=3)
        left = changed(before, mesh_state(ms)) - {"0: outlierScore"}
        assert all(key.startswith("0: bz_") for key in left)  # new columns cannot be removed
        assert not (left and runs)


class TestProgress:
    def test_progress_reaches_the_total(self, textured):
        calls = []
        compute_torsion_by_bezier_patch_per_vertex(textured, progress=lambda done, total: calls.append((done, total)))
        done, total = calls[-1]
        assert done == total
