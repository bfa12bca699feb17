import subprocess
import sys

import numpy as np
import pymeshlab
import pytest
from meshset_state import attributes, changed, filter_script, mesh_state

from bezier_filters.display import color_range
from bezier_filters.errors import InvalidParameterError
from bezier_filters.meshlab.mesh_attributes import (
    check_writable,
    custom_attribute,
    read_columns,
    restore_on_failure,
    write_columns,
    write_coordinates,
)
from bezier_filters.meshlab.mesh_colors import COLOR_MAP_NAMES, color_by_quality, save_quality_map
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    preserve_filter_script,
    read_current_mesh,
)

AWKWARD = np.array([-0.0, 0.0, 5e-324, -1e308, 1e-310, 1 / 3, np.pi, -2.0])


def cube():
    """A cube, which has 8 vertices, transformed, selected, coloured and with a second layer."""
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=1)
    ms.create_cube()
    ms.set_matrix(transformmatrix=np.diag([2.0, 3.0, 4.0, 1.0]), freeze=False)
    ms.compute_selection_by_condition_per_vertex(condselect="x > 0")
    ms.compute_selection_by_condition_per_face(condselect="fi < 5")
    ms.compute_scalar_by_function_per_vertex(q="x + 0.3")
    ms.current_mesh().add_vertex_custom_scalar_attribute(np.arange(8.0), "mine")
    ms.current_mesh().add_face_custom_scalar_attribute(np.arange(12.0), "face value")
    return ms


def bits(values):
    return np.ascontiguousarray(values).view(np.int64).tolist()


def resident_bytes():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096


class TestReading:
    def test_arrays_are_contiguous_copies(self):
        ms = cube()
        mesh = read_current_mesh(ms)
        assert mesh.vertices.dtype == np.float64
        assert mesh.faces.dtype == np.int32
        assert mesh.vertices.flags.c_contiguous
        assert mesh.faces.flags.c_contiguous
        assert np.array_equal(mesh.vertices, ms.current_mesh().vertex_matrix())
        mesh.vertices[:] = 0.0
        assert ms.current_mesh().vertex_matrix().any()

    def test_no_current_mesh(self):
        with pytest.raises(BezierFilterError, match="no current mesh; load one"):
            read_current_mesh(pymeshlab.MeshSet())

    def test_empty_mesh(self):
        ms = cube()
        ms.set_selection_all()
        ms.meshing_remove_selected_vertices()
        with pytest.raises(BezierFilterError, match="is empty"):
            read_current_mesh(ms)

    def test_point_cloud(self):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(np.eye(3)))
        mesh = read_current_mesh(ms)
        assert mesh.faces.shape == (0, 3)
        assert np.array_equal(mesh.vertices, np.eye(3))

    def test_not_a_mesh_set(self):
        with pytest.raises(BezierFilterError, match="got ndarray, expected a pymeshlab"):
            read_current_mesh(np.eye(3))

    def test_our_errors_are_pymeshlab_errors(self):
        assert issubclass(BezierFilterError, pymeshlab.PyMeshLabException)


class TestColumns:
    def test_new_columns_are_exact_and_nothing_else_changes(self):
        ms = cube()
        before = mesh_state(ms)
        write_columns(ms, {"bz_a": AWKWARD})
        assert bits(ms.current_mesh().vertex_custom_scalar_attribute_array("bz_a")) == bits(AWKWARD)
        assert changed(before, mesh_state(ms)) == {"1: bz_a"}

    @pytest.mark.parametrize("count", [1, 2, 3])
    def test_overwritten_columns_are_exact_and_nothing_else_changes(self, count):
        ms = cube()
        names = [f"bz_{k}" for k in range(count)]
        write_columns(ms, {name: np.arange(8.0) for name in names})
        before = mesh_state(ms)
        with preserve_filter_script(ms):
            write_columns(ms, {name: AWKWARD / (k + 1) for k, name in enumerate(names)})
        for k, name in enumerate(names):
            assert bits(custom_attribute(ms.current_mesh(), name)) == bits(AWKWARD / (k + 1))
        assert changed(before, mesh_state(ms)) == {f"1: {name}" for name in [*names, "outlierScore"]}
        assert not custom_attribute(ms.current_mesh(), "outlierScore").any()

    def test_equal_columns_are_left_alone(self):
        ms = cube()
        write_columns(ms, {"bz_a": AWKWARD})
        before = mesh_state(ms)
        write_columns(ms, {"bz_a": AWKWARD.copy()})
        assert changed(before, mesh_state(ms)) == set()

    def test_the_users_attributes_of_the_carriers_names_survive(self):
        ms = cube()
        own = {"sigma": AWKWARD, "plof": -AWKWARD, "outlierScore": np.arange(8.0)}
        for name, values in own.items():
            ms.current_mesh().add_vertex_custom_scalar_attribute(values, name)
        for k in range(3):
            write_columns(ms, {"bz_a": np.full(8, k + 0.5), "bz_b": np.arange(8.0) * k})
        for name, values in own.items():
            assert bits(custom_attribute(ms.current_mesh(), name)) == bits(values)
        assert (custom_attribute(ms.current_mesh(), "bz_a") == 2.5).all()

    def test_coincident_vertices_keep_their_own_values(self):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(np.zeros((60, 3)), np.arange(60).reshape(-1, 3)))
        for k in range(2):
            write_columns(ms, {"bz_a": np.arange(60.0) + k})
        assert np.array_equal(custom_attribute(ms.current_mesh(), "bz_a"), np.arange(60.0) + 1)
        assert not ms.current_mesh().vertex_selection_array().any()

    def test_memory_stays_flat(self):
        ms = pymeshlab.MeshSet()
        ms.create_sphere(subdiv=5)  # 10,242 vertices: a leak of one column a run would be 5 MB
        values = np.zeros(ms.current_mesh().vertex_number())

        def run(times):
            for k in range(times):
                with preserve_filter_script(ms):
                    write_columns(ms, {"bz_a": values + k, "bz_b": values - k})

        run(10)
        before = resident_bytes()
        run(60)
        assert resident_bytes() - before < 4e6
        assert len(attributes(ms)) == 3

    @pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
    def test_only_finite_values_are_written(self, bad):
        ms = cube()
        before = mesh_state(ms)
        with pytest.raises(BezierFilterError, match="bz_b: 1 values are not finite"):
            write_columns(ms, {"bz_a": np.zeros(8), "bz_b": np.where(np.arange(8) == 3, bad, 0.0)})
        assert changed(before, mesh_state(ms)) == set()

    def test_wrong_length(self):
        ms = cube()
        before = mesh_state(ms)
        with pytest.raises(BezierFilterError, match=r"bz_b: got shape \(7,\), expected \(8,\)"):
            write_columns(ms, {"bz_a": np.zeros(8), "bz_b": np.zeros(7)})
        assert changed(before, mesh_state(ms)) == set()

    def test_only_existing_columns_are_read(self):
        assert list(read_columns(cube(), ["bz_a", "mine"])) == ["mine"]


class TestNames:
    @pytest.mark.parametrize("name", ["my attr", "a-b", "é", "1abc", "_pi", "A.B"])
    def test_a_name_that_breaks_expressions_is_refused(self, name):
        ms = cube()
        ms.current_mesh().add_vertex_custom_scalar_attribute(np.zeros(8), name)
        with pytest.raises(RuntimeError, match="unknown exception"):
            ms.compute_scalar_by_function_per_vertex(q="0")
        listed = [key.removeprefix("__ca_vs__") for key in ms.filter_parameter_values("ply")]
        with pytest.raises(BezierFilterError, match="generate_copy_of_current_mesh") as caught:
            check_writable(ms, ["bz_a"])
        culprit = str(caught.value).split(": ")[1].split(" (")[0]
        assert culprit in listed
        assert culprit != "mine"

    @pytest.mark.parametrize("name", ["q", "nx"])
    def test_a_name_that_hides_a_variable_is_refused(self, name):
        ms = cube()
        ms.current_mesh().add_vertex_custom_scalar_attribute(np.zeros(8), name)
        with pytest.raises(BezierFilterError, match=f"filters: {name} "):
            check_writable(ms, ["bz_a"])

    @pytest.mark.parametrize("name", ["bz_a", "sigma"])
    def test_a_point_attribute_in_the_way_is_refused(self, name):
        ms = cube()
        ms.current_mesh().add_vertex_custom_point_attribute(np.zeros((8, 3)), name)
        with pytest.raises(BezierFilterError, match=f"point attribute '{name}'"):
            check_writable(ms, ["bz_a"])

    def test_legal_names_pass_and_nothing_changes(self):
        ms = cube()
        for name in ("MixedCase", "a1", "_x", "radius"):
            ms.current_mesh().add_vertex_custom_scalar_attribute(np.zeros(8), name)
        selection = ms.current_mesh().vertex_selection_array()
        check_writable(ms, ["bz_a", "mine"])
        assert np.array_equal(ms.current_mesh().vertex_selection_array(), selection)


class TestRestoring:
    @pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
    @pytest.mark.parametrize("moved", [False, True])
    def test_a_failure_puts_everything_back(self, error, moved):
        ms = cube()
        write_columns(ms, {"bz_a": AWKWARD, "bz_b": np.arange(8.0)})
        before = mesh_state(ms)

        def fail_half_way():
            with preserve_filter_script(ms), restore_on_failure(ms, ["bz_a", "bz_b"]):
                write_columns(ms, {"bz_a": np.ones(8)})
                ms.compute_scalar_by_function_per_vertex(q="5")
                ms.compute_normal_by_function_per_vertex(x="1", y="2", z="q")
                if moved:
                    write_coordinates(ms, ms.current_mesh().vertex_matrix() ** 3 + 0.1)
                raise error

        with pytest.raises(error):
            fail_half_way()
        assert changed(before, mesh_state(ms)) == {"1: outlierScore"}

    def test_without_failure_nothing_is_put_back(self):
        ms = cube()
        write_columns(ms, {"bz_a": AWKWARD})
        with restore_on_failure(ms, ["bz_a"]):
            write_columns(ms, {"bz_a": np.ones(8)})
        assert (custom_attribute(ms.current_mesh(), "bz_a") == 1.0).all()


class TestFilterScript:
    def test_an_empty_script_stays_empty(self):
        ms = cube()
        ms.clear_filter_script()
        before = filter_script(ms)
        with preserve_filter_script(ms):
            ms.compute_scalar_by_function_per_vertex(q="x")
        assert filter_script(ms) == before

    def test_a_script_stays_byte_for_byte_also_after_errors(self, capfd):
        ms = cube()
        before = filter_script(ms)
        assert "Per Vertex Quality Function" in before

        def fail():
            with preserve_filter_script(ms):
                ms.apply_coord_laplacian_smoothing(stepsmoothnum=1)
                raise KeyError("any")

        with pytest.raises(KeyError):
            fail()
        assert filter_script(ms) == before
        assert capfd.readouterr() == ("", "")

    def test_stderr_works_afterwards(self, capfd):
        ms = cube()
        with preserve_filter_script(ms):
            pass
        sys.stderr.write("still there")
        sys.stderr.flush()
        assert capfd.readouterr().err == "still there"

    def test_a_closed_stderr_does_no_harm(self):
        code = (
            "import os, pymeshlab; from bezier_filters.meshlab.meshset import preserve_filter_script\n"
            "ms = pymeshlab.MeshSet(); ms.create_cube(); os.close(2)\n"
            "with preserve_filter_script(ms): ms.create_sphere()\n"
            "print(ms.mesh_number())"
        )
        result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert result.stdout == "2\n"


class TestColors:
    @staticmethod
    def ramp():
        """Qualities 0, 1/8, ..., 1 on a strip, all different bits, and the colours of them."""
        ms = pymeshlab.MeshSet()
        x = np.linspace(0.0, 1.0, 9)
        vertices = np.stack([x, np.arange(9) % 2, np.zeros(9)], axis=1)
        faces = np.arange(7)[:, None] + np.arange(3)
        ms.add_mesh(pymeshlab.Mesh(vertices, faces, v_scalar_array=x))
        return ms

    @pytest.mark.parametrize("name", COLOR_MAP_NAMES)
    def test_only_colours_change(self, name):
        ms = cube()
        before = mesh_state(ms)
        with preserve_filter_script(ms):
            color_by_quality(ms, -1.0, 1.0, name)
        assert changed(before, mesh_state(ms)) == {"1: vertex_color_matrix", "1: has_vertex_color"}

    @pytest.mark.parametrize(
        ("name", "low", "high"),
        [
            ("RGB", (0, 0, 255), (255, 0, 0)),
            ("turbo", (48, 18, 59), (122, 4, 2)),
            ("Meshlab RGB", (0, 0, 128), (128, 0, 0)),
            ("FRENCH rgb", (0, 0, 255), (255, 0, 0)),
            ("Viridis", (68, 1, 84), (253, 231, 36)),
            ("Plasma", (12, 7, 134), (239, 248, 33)),
            ("Cividis", (0, 34, 77), (253, 231, 55)),
            ("RdPu", (255, 247, 243), (73, 0, 106)),
            ("Grey Scale", (0, 0, 0), (255, 255, 255)),
            ("Red Scale", (0, 0, 0), (255, 0, 0)),
            ("Green Scale", (0, 0, 0), (0, 255, 0)),
            ("Blue Scale", (0, 0, 0), (0, 0, 255)),
        ],
    )
    def test_the_ends_of_the_maps(self, name, low, high):
        ms = self.ramp()
        color_by_quality(ms, 0.125, 0.875, name)
        colors = np.rint(ms.current_mesh().vertex_color_matrix()[:, :3] * 255).astype(int)
        assert [tuple(color) for color in colors[:2].tolist()] == [low, low]
        assert [tuple(color) for color in colors[-2:].tolist()] == [high, high]

    def test_french_rgb_is_white_in_the_middle(self):
        ms = self.ramp()
        color_by_quality(ms, 0.0, 1.0, "French RGB")
        assert ms.current_mesh().vertex_color_matrix()[4].tolist() == [1.0, 1.0, 1.0, 1.0]

    def test_reversing_keeps_every_bit_of_the_quality(self):
        ms = cube()
        write_columns(ms, {"bz_a": AWKWARD})
        ms.compute_scalar_by_function_per_vertex(q="bz_a")
        color_by_quality(ms, -1.0, 1.0, "rgb")
        assert bits(ms.current_mesh().vertex_scalar_array()) == bits(AWKWARD)

    @pytest.mark.parametrize("name", ["magma", "", None, 3, np.eye(3)])
    def test_an_unknown_map_lists_the_names(self, name):
        with pytest.raises(BezierFilterError, match=r"colormap: got .*Turbo.*Saw 8"):
            color_by_quality(cube(), 0.0, 1.0, name)

    @pytest.mark.parametrize(
        ("low", "high"), [(1.0, 1.0), (1.0, 0.0), (0.0, np.nan), (1.0, 1.0 + 1e-9), (0.0, 1e-50), (0.0, 1e50)]
    )
    def test_an_empty_range_is_refused(self, low, high):
        with pytest.raises(BezierFilterError, match="colour range: got"):
            color_by_quality(cube(), low, high, "Turbo")

    @pytest.mark.parametrize("wrong", [np.eye(3), "1", None, True])
    def test_arguments_of_a_wrong_type_are_named(self, wrong, tmp_path):
        with pytest.raises(InvalidParameterError, match=r"ms: got .*, expected a pymeshlab.MeshSet"):
            color_by_quality(wrong, np.eye(3), 5)
        for ends, name in (((wrong, 1.0), "low"), ((0.0, wrong), "high")):
            with pytest.raises(InvalidParameterError, match=f"{name}: got .*, expected a number"):
                color_by_quality(cube(), *ends)
            with pytest.raises(InvalidParameterError, match=f"{name}: got .*, expected a number"):
                save_quality_map(tmp_path / "a.qmap", *ends)
        with pytest.raises(InvalidParameterError, match="path: got ndarray, expected a text or a path"):
            save_quality_map(np.eye(3), np.eye(3), 5)

    def test_without_quality(self):
        ms = pymeshlab.MeshSet()
        ms.create_cube()
        with pytest.raises(BezierFilterError, match="no quality"):
            color_by_quality(ms, 0.0, 1.0, "Turbo")

    def test_quality_that_is_not_finite(self):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(np.eye(3), [[0, 1, 2]], v_scalar_array=np.array([0.0, np.nan, 1.0])))
        with pytest.raises(BezierFilterError, match="not finite"):
            color_by_quality(ms, 0.0, 1.0, "Turbo")


class TestColorRange:
    def test_outliers_are_cut(self):
        values = np.append(np.linspace(0.0, 1.0, 99), 1e9)
        assert color_range(values, signed=False, percentile=2.0)[1] < 1.1

    def test_signed_is_symmetric(self):
        low, high = color_range(np.array([-3.0, 1.0, 2.0]), signed=True, percentile=0.0)
        assert (low, high) == (-3.0, 3.0)

    @pytest.mark.parametrize("signed", [False, True])
    @pytest.mark.parametrize("value", [0.0, 2.0, -2.0, 1e-30, 1e30])
    def test_a_constant_has_a_range_around_it(self, signed, value):
        low, high = color_range(np.full(5, value), signed=signed)
        assert low < high
        assert np.float32(low) < np.float32(high)
        assert low <= value <= high

    def test_a_few_values_other_than_the_rest(self):
        assert color_range(np.array([0.0] * 99 + [5.0]), signed=False) == (0.0, 5.0)

    @pytest.mark.parametrize("mask", [None, np.zeros(2, dtype=bool)])
    def test_nothing_usable(self, mask):
        values = np.array([np.nan, np.inf]) if mask is None else np.ones(2)
        assert color_range(values, signed=False, mask=mask) == (-1.0, 1.0)

    @pytest.mark.parametrize("percentile", [-1, 50, np.nan, "2", None])
    def test_percentile_out_of_range(self, percentile):
        with pytest.raises(InvalidParameterError, match="percentile: got"):
            color_range(np.ones(2), signed=False, percentile=percentile)
