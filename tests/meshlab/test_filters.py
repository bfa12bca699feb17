"""The filters on a MeshSet: what they write, what they leave alone, and what they refuse."""

import json

import numpy as np
import pymeshlab
import pytest
from meshset_state import attributes, changed, filter_script, mesh_state
from vertex_filter_cases import FILTERS, GIVEN, array, sphere, sphere_and_a_lone_vertex

from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.fields import columns, qualities
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.vertex_filters import (
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)
from bezier_filters.status import FitStatus
from bezier_filters.surfaces import height_field, waves

DIAGNOSTICS = {"bz_fit_grade", "bz_rings_used", "bz_residual"}
CURVATURE_ATTRIBUTES = {
    "bz_mean_curvature",
    "bz_gaussian_curvature",
    "bz_k_min",
    "bz_k_max",
    "bz_curvedness",
    "bz_shape_index",
    "bz_mean_curvature_std",
    "bz_gaussian_curvature_std",
    "bz_extremality_min",
    "bz_extremality_max",
    *(f"bz_direction_{end}_{axis}" for end in ("min", "max") for axis in "xyz"),
    *DIAGNOSTICS,
}


class TestWhatChanges:
    def test_normals(self, textured):
        before = mesh_state(textured)
        compute_normal_by_bezier_patch_per_vertex(textured)
        columns = {f"bz_normal_{c}" for c in ("x", "y", "z", "angle", "std")} | {
            "bz_fit_grade",
            "bz_rings_used",
            "bz_residual",
        }
        expected = {"vertex_normal_matrix", "vertex_scalar_array"} | columns
        assert changed(before, mesh_state(textured)) == {f"0: {key}" for key in expected}

    def test_curvature(self, textured):
        before = mesh_state(textured)
        compute_curvature_by_bezier_patch_per_vertex(textured)
        expected = {"vertex_scalar_array"} | CURVATURE_ATTRIBUTES
        assert changed(before, mesh_state(textured)) == {f"0: {key}" for key in expected}

    def test_torsion_with_colours(self, textured):
        before = mesh_state(textured)
        result = compute_torsion_by_bezier_patch_per_vertex(textured, color=True, colormap="french rgb")
        expected = {"vertex_scalar_array", "vertex_color_matrix", *result["attributes"]}
        assert changed(before, mesh_state(textured)) == {f"0: {key}" for key in expected}

    @pytest.mark.parametrize("function", FILTERS)
    def test_the_second_and_third_run_change_only_the_same_things(self, textured, function):
        function(textured, rings=2)
        once = mesh_state(textured)
        for rings in (3, 2):
            function(textured, rings=rings)
        leftovers = {"0: outlierScore"}
        if function is compute_normal_by_bezier_patch_per_vertex:  # the previous normals are other ones now
            leftovers |= {"0: vertex_scalar_array", "0: bz_normal_angle"}
        assert changed(once, mesh_state(textured)) == leftovers

    def test_quality_none_leaves_the_quality_alone(self, textured):
        before = mesh_state(textured)
        compute_curvature_by_bezier_patch_per_vertex(textured, quality=None, **GIVEN)
        assert changed(before, mesh_state(textured)) == {f"0: {name}" for name in CURVATURE_ATTRIBUTES}

    def test_only_the_current_layer_is_read_and_written(self):
        ms = sphere(radius=2.0)
        ms.create_sphere(radius=1.0, subdiv=3)
        ms.set_current_mesh(0)
        before = mesh_state(ms)
        result = compute_curvature_by_bezier_patch_per_vertex(ms)
        assert result["statistics"]["median"] == pytest.approx(0.5, rel=0.05)
        assert all(key.startswith("0: ") for key in changed(before, mesh_state(ms)))

    def test_the_filter_script_stays(self, textured):
        before = filter_script(textured)
        for function in FILTERS:
            function(textured, color=True, **GIVEN)
        assert filter_script(textured) == before

    @pytest.mark.slow
    def test_running_often_does_not_leak(self):
        ms = pymeshlab.MeshSet()
        ms.create_sphere(subdiv=5)  # 10,242 vertices: a leak of every column would be 30 MB

        def run_all(times):
            for k in range(times):
                for function in FILTERS:
                    function(ms, threads=1, alpha=("auto", 0.5, 0.9)[k % 3])

        run_all(6)
        names = set(attributes(ms))
        with open("/proc/self/statm") as file:
            before = int(file.read().split()[1]) * 4096
        run_all(9)
        with open("/proc/self/statm") as file:
            assert int(file.read().split()[1]) * 4096 - before < 8e6
        assert set(attributes(ms)) == names


class TestValues:
    @pytest.mark.parametrize(
        ("function", "name"),
        [
            (compute_normal_by_bezier_patch_per_vertex, "normals"),
            (compute_curvature_by_bezier_patch_per_vertex, "curvature"),
            (compute_torsion_by_bezier_patch_per_vertex, "torsion"),
        ],
    )
    @pytest.mark.parametrize("runs", [1, 2])
    def test_columns_are_those_of_the_estimate_bit_for_bit(self, textured, function, name, runs):
        options = {"rings": 3, "alpha": 0.6, "smoothness": "paper"}
        mesh = textured.current_mesh()
        geometry = estimate_vertex_geometry(mesh.vertex_matrix(), mesh.face_matrix(), **options)
        for k in range(runs):
            function(textured, **(options if k == runs - 1 else GIVEN))
        for column, values in columns(name, geometry).items():
            assert np.array_equal(array(textured, column), values), column

    @pytest.mark.parametrize("quality", qualities("curvature"))
    def test_quality_of_curvature(self, textured, quality):
        result = compute_curvature_by_bezier_patch_per_vertex(textured, quality=quality, direction=(1, 2, 3), **GIVEN)
        field = qualities("curvature")[quality]
        assert np.array_equal(textured.current_mesh().vertex_scalar_array(), array(textured, field.column))
        assert (result["quality"], result["unit"]) == (quality, field.unit)

    def test_curvature_of_a_direction(self):
        """Under gravity columns, quality and statistics are those of the arrays; without a direction there are none."""
        ms, hill = pymeshlab.MeshSet(), waves()
        ms.add_mesh(pymeshlab.Mesh(hill.vertices, hill.faces))
        assert not {"bz_curvature_along", "bz_plan_curvature"} & set(
            compute_curvature_by_bezier_patch_per_vertex(ms, **GIVEN)["attributes"]
        )
        report = compute_curvature_by_bezier_patch_per_vertex(ms, direction=(0, 0, -9.81), quality="plan", **GIVEN)
        terrain = estimate_vertex_geometry(hill.vertices, hill.faces, **GIVEN).terrain_curvature()
        assert np.array_equal(array(ms, "bz_curvature_along"), terrain.profile)
        assert np.array_equal(array(ms, "bz_curvature_across"), terrain.tangential)
        assert np.array_equal(ms.current_mesh().vertex_scalar_array(), terrain.plan)
        assert report["statistics"]["max"] == terrain.plan.max()
        assert (report["without_direction"], report["remarks"]) == (0, [])

    def test_level_land_has_no_direction_of_slope(self):
        """Such vertices hold 0, are counted, and do not count for statistics and colours."""
        land = height_field(lambda x, y: (np.maximum(x, 0.0) ** 4, 4.0 * np.maximum(x, 0.0) ** 3, 0, 0, 0, 0))
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(land.vertices, land.faces))
        report = compute_curvature_by_bezier_patch_per_vertex(ms, direction=(0, 0, -1), quality="along", **GIVEN)
        level = estimate_vertex_geometry(land.vertices, land.faces, **GIVEN).terrain_curvature().slope < 1e-12
        assert report["without_direction"] == level.sum() > 300
        assert not array(ms, "bz_curvature_along")[level].any()
        assert report["statistics"]["median"] == np.median(array(ms, "bz_curvature_along")[~level])
        (remark,) = report["remarks"]
        assert remark.startswith(f"direction: it is along the normal at {level.sum():,} of 1,369 vertices")

    @pytest.mark.parametrize(
        ("direction", "got"),
        [
            ((0, 0, 0), r"\(0, 0, 0\)"),
            ((0, np.nan, 1), r"\(0, nan, 1\)"),
            ((0, 1), r"\(0, 1\)"),
            ("down", "'down'"),
            (np.ones((2, 2)), "ndarray"),
        ],
    )
    def test_directions_that_are_none_are_refused(self, direction, got):
        with pytest.raises(BezierFilterError, match=f"direction: got {got}, expected three finite numbers, not all 0"):
            compute_curvature_by_bezier_patch_per_vertex(sphere(), direction=direction)

    @pytest.mark.parametrize("quality", ["along", "across", "plan"])
    def test_qualities_of_a_direction_need_one(self, quality):
        with pytest.raises(BezierFilterError, match=f"direction: got None, which quality='{quality}' needs"):
            compute_curvature_by_bezier_patch_per_vertex(sphere(), quality=quality)

    def test_a_sphere_is_positively_curved(self):
        ms = sphere(radius=2.0)
        compute_curvature_by_bezier_patch_per_vertex(ms, quality="gaussian")
        assert ms.current_mesh().vertex_scalar_array() == pytest.approx(0.25, rel=0.1)

    def test_normals_of_a_sphere(self):
        ms = sphere(radius=2.0)
        compute_normal_by_bezier_patch_per_vertex(ms, quality="z")
        mesh = ms.current_mesh()
        assert mesh.vertex_normal_matrix() == pytest.approx(mesh.vertex_matrix() / 2.0, abs=1e-2)
        assert np.array_equal(mesh.vertex_scalar_array(), mesh.vertex_normal_matrix()[:, 2])

    def test_angle_to_previous_normals(self):
        ms = sphere()
        compute_normal_by_bezier_patch_per_vertex(ms)
        ms.compute_normal_by_function_per_vertex(x="-3 * nx", y="-3 * ny", z="-3 * nz")
        result = compute_normal_by_bezier_patch_per_vertex(ms)
        assert ms.current_mesh().vertex_scalar_array() == pytest.approx(180.0)
        assert result["unit"] == "degrees"
        compute_normal_by_bezier_patch_per_vertex(ms)
        assert ms.current_mesh().vertex_scalar_array() == pytest.approx(0.0, abs=1e-5)

    def test_previous_normals_that_are_not_finite_do_no_harm(self):
        ms = sphere()
        ms.compute_normal_by_function_per_vertex(x="vi == 5 ? 0/0 : nx", y="ny", z="nz")
        assert np.isnan(ms.current_mesh().vertex_normal_matrix()).any()
        compute_normal_by_bezier_patch_per_vertex(ms)
        assert np.isfinite(ms.current_mesh().vertex_normal_matrix()).all()
        assert ms.current_mesh().vertex_scalar_array()[5] == 0.0

    def test_isolated_vertices_keep_their_normals(self):
        ms = sphere_and_a_lone_vertex()
        ms.compute_normal_by_function_per_vertex(x="1", y="2", z="3")
        result = compute_normal_by_bezier_patch_per_vertex(ms)
        assert ms.current_mesh().vertex_normal_matrix()[-1].tolist() == [1.0, 2.0, 3.0]
        assert array(ms, "bz_fit_grade")[-1] == FitStatus.ISOLATED.grade
        assert result["status"] == {"OK": 642, "ISOLATED": 1}

    def test_the_transform_is_ignored(self):
        ms = sphere(radius=2.0)
        ms.set_matrix(transformmatrix=np.diag([3.0, 3.0, 3.0, 1.0]), freeze=False)
        before = ms.current_mesh().vertex_matrix()
        result = compute_curvature_by_bezier_patch_per_vertex(ms)
        assert result["statistics"]["median"] == pytest.approx(0.5, rel=0.05)
        assert np.array_equal(ms.current_mesh().vertex_matrix(), before)


@pytest.mark.parametrize("function", FILTERS)
def test_robust_fits_are_those_of_the_estimate(function):
    ms = sphere()
    mesh = ms.current_mesh()
    expected = estimate_vertex_geometry(mesh.vertex_matrix(), mesh.face_matrix(), rings=3, alpha=0.8, robust=True)
    function(ms, rings=3, alpha=0.8, robust=True)
    assert np.array_equal(array(ms, "bz_residual"), expected.residual)
    function(ms, rings=3, alpha=0.8)
    assert not np.array_equal(array(ms, "bz_residual"), expected.residual)


class TestRadius:
    @pytest.mark.parametrize("function", FILTERS)
    def test_a_percentage_is_one_of_the_diagonal_of_the_bounding_box(self, function):
        results = []
        for radius in (pymeshlab.PercentageValue(20), pymeshlab.PureValue(0.2 * 4 * 3**0.5), 0.2 * 4 * 3**0.5):
            ms = sphere(radius=2.0)  # of diagonal 4 sqrt(3)
            result = function(ms, radius=radius)
            assert result["fit"]["radius"] == pytest.approx(0.2 * 4 * 3**0.5)
            assert result["fit"]["rings"] == 0
            assert json.loads(json.dumps(result)) == result
            results.append(ms.current_mesh().vertex_scalar_array())
            assert (array(ms, "bz_rings_used") >= 4).all()
        np.testing.assert_allclose(results[0], results[1], atol=1e-9)
        np.testing.assert_array_equal(results[1], results[2])

    def test_the_diagonal_is_that_of_pymeshlab(self, textured):
        mesh = textured.current_mesh()
        expected = 0.05 * mesh.bounding_box().diagonal()
        for radius in (pymeshlab.PercentageValue(5), "5%"):
            result = compute_normal_by_bezier_patch_per_vertex(textured, radius=radius)
            assert result["fit"]["radius"] == pytest.approx(expected)

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"radius": pymeshlab.PercentageValue(0)}, r"radius: got 0\.0, expected a positive length"),
            ({"radius": pymeshlab.PureValue(-2)}, r"radius: got -2\.0, expected a positive length"),
            ({"radius": "wide"}, r"radius: got 'wide', expected a length such as 0.5, or a percentage such as 2%"),
            ({"radius": 0.5, "rings": 3}, r"radius: got 0\.5 and rings=3; give one of them, not both"),
        ],
    )
    def test_what_is_refused(self, options, message):
        ms = sphere()
        before = mesh_state(ms)
        with pytest.raises(BezierFilterError, match=message):
            compute_curvature_by_bezier_patch_per_vertex(ms, **options)
        assert not changed(before, mesh_state(ms))


class TestReport:
    def test_report(self, textured):
        result = compute_curvature_by_bezier_patch_per_vertex(textured, color=True, percentile=5.0)
        quality = textured.current_mesh().vertex_scalar_array()
        assert json.loads(json.dumps(result)) == result
        assert sum(result["status"].values()) == len(quality)
        assert set(result["attributes"]) == CURVATURE_ATTRIBUTES
        assert result["statistics"] == {
            "min": quality.min(),
            "median": np.median(quality),
            "max": quality.max(),
            "mean": quality.mean(),
        }
        assert set(result["seconds"]) == {"read", "fit", "topology", "write", "color"}
        low, high = result["color_range"]
        assert high == -low == np.abs(np.percentile(quality, [5.0, 95.0])).max()
        assert result["colormap"] == "Cool Warm"

    def test_without_quality_and_colour(self, textured):
        result = compute_normal_by_bezier_patch_per_vertex(textured, quality=None, **GIVEN)
        assert (result["quality"], result["unit"], result["statistics"]) == (None, None, None)
        assert "color_range" not in result
        assert set(result["seconds"]) == {"read", "fit", "topology", "write"}

    def test_statistics_leave_out_what_was_not_estimated(self):
        ms = sphere_and_a_lone_vertex()
        result = compute_curvature_by_bezier_patch_per_vertex(ms, color=True)
        assert result["statistics"]["min"] > 0.4
        assert ms.current_mesh().vertex_scalar_array()[-1] == 0.0

    def test_nothing_estimated(self):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(np.eye(3), [[0, 1, 2]]))
        result = compute_curvature_by_bezier_patch_per_vertex(ms, color=True)
        assert result["statistics"] is None
        assert result["color_range"] == [-1.0, 1.0]
        assert result["status"] == {"NORMAL_ONLY": 3}

    def test_red_is_high(self):
        ms = pymeshlab.MeshSet()
        ms.create_torus(hradius=3.0, vradius=1.0, hsubdiv=48, vsubdiv=24)
        compute_curvature_by_bezier_patch_per_vertex(ms, quality="gaussian", color=True, colormap="RGB")
        mesh = ms.current_mesh()
        colors, quality = mesh.vertex_color_matrix(), mesh.vertex_scalar_array()
        highest, lowest = colors[quality.argmax()], colors[quality.argmin()]
        assert highest[0] > 0.9 > 0.1 > highest[2]
        assert lowest[2] > 0.9 > 0.1 > lowest[0]
