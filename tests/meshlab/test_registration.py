"""The filters as part of pymeshlab: methods, names, lists, and steps of filter scripts."""

import inspect
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from filter_options import quick_options
from meshset_state import changed, mesh_state

import bezier_filters as bf
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.registration import register, unregister
from bezier_filters.meshlab.scripts import FILTERS

CURVATURE, SMOOTHING = "compute_curvature_by_bezier_patch_per_vertex", "apply_coord_bezier_patch_smoothing"
SUITE = Path(pymeshlab.__file__).parent / "tests"


def namespaces():
    return dict(vars(pymeshlab)), dict(vars(pymeshlab.MeshSet))


@pytest.fixture
def registered():
    register()
    yield
    unregister()


def star():
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(Path(__file__).parents[2] / "sample_meshes" / "punched_patch.ply"))
    return ms


def steps_of(ms, tmp_path):
    ms.save_filter_script(str(tmp_path / "recorded.mlx"))
    return bf.read_filter_script(tmp_path / "recorded.mlx")


@pytest.mark.usefixtures("registered")
class TestMethods:
    def test_methods_have_signature_and_docstring(self):
        for function in FILTERS:
            method = getattr(pymeshlab.MeshSet(), function.__name__)
            assert list(inspect.signature(method).parameters) == list(inspect.signature(function).parameters)[1:]
            assert method.__doc__ == function.__doc__

    def test_replaced_functions_keep_their_names_and_docstrings(self):
        replaced = {name: value for name, value in vars(pymeshlab.MeshSet).items() if hasattr(value, "__wrapped__")}
        assert {"apply_filter", "load_filter_script", *(function.__name__ for function in FILTERS)} <= set(replaced)
        for name, value in replaced.items():
            assert (value.__name__, value.__doc__) == (name, value.__wrapped__.__doc__)

    @pytest.mark.parametrize("function", FILTERS)
    def test_they_do_what_the_functions_do(self, function):
        method, applied, called = star(), star(), star()
        for ms in (method, applied, called):
            ms.compute_texcoord_by_function_per_vertex(u="x", v="y")
            if "refmesh" in inspect.signature(function).parameters:
                mesh = ms.current_mesh()
                ms.add_mesh(pymeshlab.Mesh(mesh.vertex_matrix(), mesh.face_matrix()), set_as_current=False)
        name = function.__name__
        selection = {"condselect": "fi == 700"} if "condselect" in inspect.signature(function).parameters else {}
        given = quick_options(function) | selection
        reports = [getattr(method, name)(**given), applied.apply_filter(name, **given), function(called, **given)]
        assert all(report.keys() == reports[2].keys() for report in reports)
        for ms in (method, applied):
            assert changed(mesh_state(ms), mesh_state(called)) == {"script"}

    def test_registering_twice_changes_nothing(self):
        before = namespaces()
        register()
        assert namespaces() == before

    def test_a_foreign_attribute_is_not_overwritten(self, monkeypatch):
        name = FILTERS[1].__name__
        monkeypatch.setattr(pymeshlab.MeshSet, name, print)
        with pytest.raises(BezierFilterError, match=name):
            register()
        assert getattr(pymeshlab.MeshSet, name) is print


def test_unregistering_restores_everything():
    unregister()
    before = namespaces()
    unregister()
    assert namespaces() == before
    register()
    assert namespaces() != before
    unregister()
    assert namespaces() == before


@pytest.mark.usefixtures("registered")
class TestNames:
    def test_lists_have_all_filters(self, capfd):
        theirs = pymeshlab.pmeshlab.filter_list()
        names = [function.__name__ for function in FILTERS]
        assert set(pymeshlab.filter_list()) == {*theirs, *names}
        assert pymeshlab.filter_list() == sorted(pymeshlab.filter_list())
        pymeshlab.print_filter_list()
        printed = capfd.readouterr().out.split()
        assert set(names) <= set(printed)

    @pytest.mark.parametrize(("keyword", "index"), [("Fill", 1), ("torsion per_vertex bezier", 4), ("noise", 0)])
    def test_search_finds_words_of_names_and_summaries(self, keyword, index, capfd):
        pymeshlab.search(keyword)
        found = [line.split(" ")[0] for line in capfd.readouterr().out.splitlines() if " : " in line]
        assert [name for name in found if "bezier" in name] == [FILTERS[index].__name__]

    def test_parameters_and_their_defaults(self, capfd):
        for function in FILTERS:
            values = pymeshlab.MeshSet().filter_parameter_values(function.__name__)
            expected = {
                name: parameter.default
                for name, parameter in inspect.signature(function).parameters.items()
                if name not in ("ms", "progress")
            }
            assert values == expected
            pymeshlab.print_filter_parameter_list(function.__name__)
            printed = capfd.readouterr().out.splitlines()[1:]
            assert [line.split()[0] for line in printed] == list(expected)
        given = star().filter_parameter_values(CURVATURE, alpha=0.5)
        assert given["alpha"] == 0.5

    def test_those_of_pymeshlab_are_what_they_were(self, capfd):
        ms = star()
        assert ms.filter_parameter_values("meshing_close_holes")["maxholesize"] == 30
        assert "__ca_vs__bz_a" not in ms.filter_parameter_values("ply")
        pymeshlab.print_filter_parameter_list("meshing_close_holes")
        assert ms.apply_filter("meshing_close_holes", maxholesize=1000)["closed_holes"] > 0
        assert ms.create_cube() is None
        capfd.readouterr()

    @pytest.mark.parametrize("name", [CURVATURE, "meshing_close_holes"])
    def test_unknown_parameters_are_refused(self, name):
        for call in ("apply_filter", "filter_parameter_values"):
            with pytest.raises(pymeshlab.PyMeshLabException, match=f"Parameter bogus not found for filter {name}"):
                getattr(star(), call)(name, bogus=1)


@pytest.mark.usefixtures("registered")
class TestScripts:
    def test_steps_are_recorded_in_order(self, tmp_path):
        ms = star()
        ms.compute_normal_per_vertex()
        ms.apply_filter(SMOOTHING, noise=1 / 300)
        ms.apply_coord_laplacian_smoothing(stepsmoothnum=1)
        ms.compute_curvature_by_bezier_patch_per_vertex(radius=pymeshlab.PercentageValue(9), quality=None)
        bf.compute_torsion_by_bezier_patch_per_vertex(ms)
        with pytest.raises(BezierFilterError):
            ms.compute_torsion_by_bezier_patch_per_vertex(rings=-1)
        steps = steps_of(ms, tmp_path)
        assert [step.name for step in steps] == ["Re-Compute Vertex Normals", SMOOTHING, "Laplacian Smooth", CURVATURE]
        assert steps[1].parameters["noise"]["value"] == repr(1 / 300)
        ms.clear_filter_script()
        assert steps_of(ms, tmp_path) == []

    def test_a_replay_gives_the_same_and_records_nothing(self, tmp_path):
        ms, again = star(), star()
        ms.meshing_close_holes_by_bezier_patch(onselected=False, maxdiameter=pymeshlab.PureValue(0.7))
        ms.apply_filter(SMOOTHING, noise=1 / 300, iterations=2)
        ms.meshing_isotropic_explicit_remeshing(targetlen=pymeshlab.PureValue(0.125), iterations=1)
        ms.compute_curvature_by_bezier_patch_per_vertex(
            radius=pymeshlab.PercentageValue(100 / 9), quality="gaussian", color=True, colorrange=[0.1, 1 / 3]
        )
        ms.compute_normal_by_bezier_patch_per_vertex(quality=None)
        ms.save_filter_script(str(tmp_path / "script.mlx"))
        again.load_filter_script(str(tmp_path / "script.mlx"))
        again.apply_filter_script()
        assert changed(mesh_state(again), mesh_state(ms)) == set()

    def test_scripts_written_by_hand_lose_no_value(self, tmp_path):
        """pymeshlab drops values without a type, and lengths without a range."""
        (tmp_path / "script.mlx").write_text(
            "<!DOCTYPE FilterScript><FilterScript>"
            '<filter name="Remeshing: Isotropic Explicit Remeshing">'
            '<Param name="TargetLen" type="RichAbsPerc" value="0.25"/><Param name="Iterations" value="2"/></filter>'
            f'<filter name="{CURVATURE}"><Param name="radius" type="RichAbsPerc" value="0.3"/>'
            '<Param name="alpha" type="RichFloat" value="0.123456789"/><Param name="quality" value="max"/></filter>'
            "</FilterScript>"
        )
        ms, expected = star(), star()
        ms.load_filter_script(str(tmp_path / "script.mlx"))
        ms.apply_filter_script()
        expected.meshing_isotropic_explicit_remeshing(targetlen=pymeshlab.PureValue(0.25), iterations=2)
        bf.compute_curvature_by_bezier_patch_per_vertex(expected, radius=0.3, alpha=0.123456789, quality="max")
        assert changed(mesh_state(ms), mesh_state(expected)) == {"script"}

    def test_scripts_without_our_steps_are_left_to_pymeshlab(self, tmp_path):
        ms = pymeshlab.MeshSet()
        ms.load_filter_script(str(SUITE / "sample_meshes" / "sample_filter_script.mlx"))
        recorded = steps_of(ms, tmp_path)
        ms.apply_filter_script()
        assert steps_of(ms, tmp_path) == recorded
        assert ms.mesh_number() > 0
        ms.load_filter_script(str(tmp_path / "none.mlx"))  # pymeshlab says so on its own streams, and raises nothing

    def test_a_step_that_fails_is_named(self, tmp_path):
        ms = star()
        ms.apply_filter(SMOOTHING)
        again = pymeshlab.MeshSet()
        ms.save_filter_script(str(tmp_path / "script.mlx"))
        again.load_filter_script(str(tmp_path / "script.mlx"))
        with pytest.raises(BezierFilterError, match=f"step 1, '{SMOOTHING}': the MeshSet has no current mesh"):
            again.apply_filter_script()
        assert len(steps_of(again, tmp_path)) == 1


WRITING = """
import bezier_filters, pymeshlab
bezier_filters.register()
ms = pymeshlab.MeshSet()
ms.create_torus(hsubdiv=40, vsubdiv=24)
ms.apply_filter("compute_normal_by_bezier_patch_per_vertex", rings=2, alpha=0.8)
ms.apply_filter("apply_coord_laplacian_smoothing", stepsmoothnum=1)
ms.apply_filter("compute_curvature_by_bezier_patch_per_vertex", rings=3, alpha=1 / 3, quality="gaussian")
ms.save_filter_script("script.mlx")
bezier_filters.save_mesh(ms, "written.ply")
"""
READING = """
import bezier_filters, pymeshlab
bezier_filters.register()
ms = pymeshlab.MeshSet()
ms.load_filter_script("script.mlx")
ms.apply_filter_script()
bezier_filters.save_mesh(ms, "read.ply")
"""


def test_another_process_replays_a_script_to_the_last_bit(tmp_path):
    for code in (WRITING, READING):
        subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True)
    assert (tmp_path / "read.ply").read_bytes() == (tmp_path / "written.ply").read_bytes()
    assert "bz_k_min" in bf.read_fields(tmp_path / "read.ply")


REGISTERED = "import bezier_filters\n\ndef pytest_configure():\n    bezier_filters.register()\n"


@pytest.mark.slow
def test_the_suite_of_pymeshlab_passes_as_before(tmp_path):
    """Its own tests and examples, in a copy, since they write files. One ends a process without a display."""
    outcomes = []
    for conftest in ("", REGISTERED):
        folder = tmp_path / f"run{len(outcomes)}"
        shutil.copytree(SUITE, folder / "tests")
        (folder / "conftest.py").write_text(conftest)
        options = ["-o", "python_files=test*.py example*.py", "-o", "python_functions=test* example*"]
        options += ["-rA", "-p", "no:cacheprovider", "-k", "not texture_map_defragmentation"]
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *options, "tests"], cwd=folder, capture_output=True, text=True
        )
        lines = (line.partition(" - ")[0] for line in done.stdout.splitlines())
        outcomes.append(sorted(line for line in lines if line.startswith(("PASSED", "FAILED", "ERROR"))))
    assert outcomes[0] == outcomes[1]
    assert sum(line.startswith("PASSED") for line in outcomes[1]) > 20


def test_importing_registers_nothing():
    code = "import pymeshlab, bezier_filters.meshlab.registration; print(hasattr(pymeshlab.MeshSet, {!r}))"
    command = [sys.executable, "-c", code.format(FILTERS[0].__name__)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "False\n"


def test_curvature_directions_of_pymeshlab_are_left_to_its_own_filter():
    """There is no way to set them; a field that is there stays that of the filter that made it."""
    ms = star()
    bf.compute_curvature_by_bezier_patch_per_vertex(ms)
    with pytest.raises(pymeshlab.MissingComponentException):
        ms.current_mesh().vertex_curvature_principal_dir1_matrix()
    ms.compute_curvature_principal_directions_per_vertex()
    before = np.array(ms.current_mesh().vertex_curvature_principal_dir1_matrix())
    bf.compute_curvature_by_bezier_patch_per_vertex(ms)
    np.testing.assert_array_equal(ms.current_mesh().vertex_curvature_principal_dir1_matrix(), before)
