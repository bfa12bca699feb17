"""Filter scripts: what is read, written and run is the same as the filters called from Python."""

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import bezier_filters as bf
from bezier_filters.cli.commands import app
from bezier_filters.meshlab.meshset import BezierFilterError, filter_list, former_filter_names
from bezier_filters.meshlab.scripts import _NEWER_NAMES, FILTERS, check_steps

SAMPLES = Path(__file__).parents[2] / "sample_meshes"
WORDS = st.text(st.characters(codec="utf-8", exclude_categories=["C"]) | st.sampled_from("\n\t"), min_size=1)


def script(tmp_path, content):
    path = tmp_path / "script.mlx"
    path.write_text(f"<!DOCTYPE FilterScript>\n<FilterScript>{content}</FilterScript>\n", encoding="utf-8")
    return path


def state(ms):
    mesh = ms.current_mesh()
    return [mesh.vertex_matrix(), mesh.face_matrix(), mesh.vertex_normal_matrix(), mesh.vertex_color_matrix()]


class TestFiles:
    @settings(deadline=None, max_examples=50)
    @given(st.lists(st.tuples(WORDS, st.dictionaries(WORDS, WORDS, max_size=3)), max_size=3))
    def test_what_is_written_is_read(self, tmp_path_factory, steps):
        written = [
            bf.ScriptStep(name, {key: {"type": "RichString", "value": value} for key, value in parameters.items()})
            for name, parameters in steps
        ]
        path = tmp_path_factory.mktemp("scripts") / "script.mlx"
        bf.save_filter_script(path, written)
        assert bf.read_filter_script(path) == written
        root = ElementTree.parse(path).getroot()  # another parser finds the same
        assert [step.get("name") for step in root] == [step.name for step in written]

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "no element found"),
            ("ply\nformat ascii", "syntax error"),
            ("<FilterScript>", "no element found"),
            ("<html/>", "outermost element is <html>"),
            ("<FilterScript><filter/></FilterScript>", "<filter> without a name"),
            ("<FilterScript><Param name='x'/></FilterScript>", "<Param> within <FilterScript>"),
            ('<FilterScript><filter name="S"><Param name="a"/><Param name="a"/></filter></FilterScript>', "two param"),
            ('<!DOCTYPE F [<!ENTITY a "b">]><FilterScript><filter name="&a;"/></FilterScript>', "an entity 'a'"),
            ('<!DOCTYPE F [<!ENTITY a SYSTEM "file:///etc/passwd">]><FilterScript/>', "an entity 'a'"),
        ],
    )
    def test_other_files_are_refused(self, text, message, tmp_path):
        path = tmp_path / "script.mlx"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(bf.InvalidScriptError, match=re.escape(message)):
            bf.read_filter_script(path)


class TestRunning:
    def test_a_script_of_pymeshlab_gives_the_same_mesh(self, tmp_path):
        """Every kind of parameter: number, flag, text, enumeration, length, point, colour and matrix."""
        ms = pymeshlab.MeshSet()
        ms.create_torus(hsubdiv=30)
        ms.apply_coord_laplacian_smoothing(stepsmoothnum=2, cotangentweight=False)
        ms.meshing_isotropic_explicit_remeshing(targetlen=pymeshlab.PercentageValue(3), iterations=2)
        ms.apply_coord_taubin_smoothing(stepsmoothnum=2)
        ms.compute_scalar_by_function_per_vertex(q="(x < 1) && (y > 0) ? z : x")
        ms.compute_color_from_scalar_per_vertex(colormap="Plasma")
        ms.apply_color_thresholding_per_vertex(color1=pymeshlab.Color(10, 20, 30), threshold=100)
        ms.compute_matrix_from_rotation(rotaxis="custom axis", angle=30, customaxis=np.array([1.0, 2.0, 3.0]))
        ms.set_matrix(transformmatrix=np.diag([1.0, 2.0, 3.0, 1.0]))
        ms.save_filter_script(str(tmp_path / "script.mlx"))
        again = pymeshlab.MeshSet()
        steps = bf.read_filter_script(tmp_path / "script.mlx")
        assert [step.name for step in steps][:2] == ["Torus", "Laplacian Smooth"]
        reports = bf.run_filter_script(again, steps)
        assert {report.by for report in reports} == {"MeshLab"}
        for expected, got in zip(state(ms), state(again), strict=True):
            np.testing.assert_array_equal(got, expected)

    def test_pymeshlab_runs_a_script_with_its_own_filters_after_it_was_read_and_saved(self, tmp_path):
        ms = pymeshlab.MeshSet()
        ms.create_sphere(subdiv=3)
        ms.compute_curvature_principal_directions_per_vertex(method="Quadric Fitting")
        ms.save_filter_script(str(tmp_path / "a.mlx"))
        bf.save_filter_script(tmp_path / "b.mlx", bf.read_filter_script(tmp_path / "a.mlx"))
        again = pymeshlab.MeshSet()
        again.load_filter_script(str(tmp_path / "b.mlx"))
        again.apply_filter_script()
        np.testing.assert_array_equal(
            again.current_mesh().vertex_scalar_array(), ms.current_mesh().vertex_scalar_array()
        )

    def test_our_filters_take_what_they_take_in_python(self, tmp_path):
        path = script(
            tmp_path,
            '<filter name="Torus"/><filter name="compute_curvature_by_bezier_patch_per_vertex">'
            '<Param name="radius" value="8%"/><Param name="degree" value="auto"/><Param name="robust" value="true"/>'
            '<Param name="quality" value="gaussian"/></filter>',
        )
        ms, expected = pymeshlab.MeshSet(), pymeshlab.MeshSet()
        *_, last = bf.run_filter_script(ms, bf.read_filter_script(path))
        expected.create_torus()
        report = bf.compute_curvature_by_bezier_patch_per_vertex(
            expected, radius=pymeshlab.PercentageValue(8), robust=True, quality="gaussian"
        )
        assert last.by == "bezier_filters"
        assert last.report["status"] == report["status"]
        np.testing.assert_array_equal(
            ms.current_mesh().vertex_scalar_array(), expected.current_mesh().vertex_scalar_array()
        )

    def test_parameters_of_every_filter_of_ours_survive_a_script(self, tmp_path):
        """The defaults, written and read back, are the defaults."""
        import inspect

        from bezier_filters.meshlab.scripts import parameters_of, value_of_type

        for function in FILTERS:
            hints = parameters_of(function)
            defaults = {name: inspect.signature(function).parameters[name].default for name in hints}
            step = bf.script_step(function.__name__, **defaults)
            found = {name: value_of_type(hints[name], step.parameters[name]) for name in step.parameters}
            assert found == {name: value for name, value in defaults.items() if value is not None}

    def test_lengths_of_meshlab_need_no_type(self, tmp_path):
        path = script(
            tmp_path,
            '<filter name="Sphere"/><filter name="meshing_isotropic_explicit_remeshing">'
            '<Param name="targetlen" value="0.3"/><Param name="Iterations" value="1"/></filter>',
        )
        ms = pymeshlab.MeshSet()
        bf.run_filter_script(ms, bf.read_filter_script(path))
        assert 0.2 < ms.get_geometric_measures()["avg_edge_length"] < 0.4

    def test_reports_hold_plain_values(self, tmp_path):
        ms = pymeshlab.MeshSet()
        path = script(tmp_path, '<filter name="Box/Cube"/><filter name="get_geometric_measures"/>')
        _, measured = bf.run_filter_script(ms, bf.read_filter_script(path))
        assert measured.report["bbox"] == {"min": [-0.5, -0.5, -0.5], "max": [0.5, 0.5, 0.5]}
        assert measured.report["barycenter"] == [0.0, 0.0, 0.0]

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            ('<filter name="Close hole"/>', "step 2, 'Close hole': unknown filter; did you mean meshing_close_holes"),
            (
                '<filter name="compute_curvature_by_bezier_patch"/>',
                "did you mean compute_curvature_by_bezier_patch_per",
            ),
            ('<filter name="xyzzy"/>', "unknown filter; pymeshlab.print_filter_list()"),
            (
                '<filter name="apply_coord_bezier_patch_smoothing"><Param name="iteration" value="1"/></filter>',
                "unknown parameter 'iteration'; did you mean iterations?",
            ),
            (
                '<filter name="apply_coord_bezier_patch_smoothing"><Param name="method" value="hc"/></filter>',
                "parameter 'method': got 'hc', expected 'auto' or 'paper'",
            ),
            (
                '<filter name="apply_coord_bezier_patch_smoothing"><Param name="noise" value="much"/></filter>',
                "parameter 'noise': got 'much', expected a percentage such as 2% or a number or nothing",
            ),
            (
                '<filter name="apply_coord_bezier_patch_smoothing"><Param name="alpha"/></filter>',
                "parameter 'alpha': has no attribute value=",
            ),
        ],
    )
    def test_mistakes_are_found_before_anything_is_done(self, content, message, tmp_path):
        ms = pymeshlab.MeshSet()
        steps = bf.read_filter_script(script(tmp_path, '<filter name="Sphere"/>' + content))
        with pytest.raises(bf.InvalidScriptError, match=re.escape(message)):
            bf.run_filter_script(ms, steps)
        assert ms.mesh_number() == 0

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            ('<Param name="maxholsize" value="3"/>', "unknown parameter 'maxholsize'; did you mean maxholesize?"),
            ('<Param name="MaxHoleSize" value="many"/>', "step 2, 'Close Holes': Unable to cast"),
            ('<Param name="RefineHole" value="perhaps"/>', "got 'perhaps', expected true or false"),
            ('<Param name="RefineHoleEdgeLen" value="x" type="RichAbsPerc"/>', "got 'x', expected a number"),
        ],
    )
    def test_parameters_of_meshlab_are_checked_before_their_step(self, content, message, tmp_path):
        ms = pymeshlab.MeshSet()
        path = script(tmp_path, f'<filter name="Sphere"/><filter name="Close Holes">{content}</filter>')
        with pytest.raises((bf.InvalidScriptError, BezierFilterError), match=re.escape(message)):
            bf.run_filter_script(ms, bf.read_filter_script(path))
        assert ms.mesh_number() == 1

    def test_names_of_meshlab_lead_to_filters(self):
        filters = set(filter_list())
        assert set(_NEWER_NAMES.values()) <= filters
        assert not set(_NEWER_NAMES) & set(former_filter_names())
        assert check_steps([bf.ScriptStep("Remeshing: Isotropic Explicit Remeshing")]) == [
            "meshing_isotropic_explicit_remeshing"
        ]


class TestCommand:
    def test_steps_saved_by_commands_are_replayed(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        runner, source = CliRunner(), str(SAMPLES / "punched_patch.ply")
        first = ["fill-holes", source, "closed.ply", "--max-diameter", "60%", "--save-script", "steps.mlx"]
        second = ["curvature", "closed.ply", "curved.ply", "--rings", "3", "--save-script", "steps.mlx"]
        for command in (first, second):
            assert runner.invoke(app, command).exit_code == 0
        assert len(bf.read_filter_script("steps.mlx")) == 2
        result = runner.invoke(app, ["run", "steps.mlx", source, "again.ply", "--json"])
        assert result.exit_code == 0
        steps = json.loads(result.stdout)["steps"]
        assert [step["by"] for step in steps] == ["bezier_filters"] * 2
        assert steps[0]["report"]["closed_holes"] == 3
        assert Path("again.ply").read_bytes() == Path("curved.ply").read_bytes()
        text = runner.invoke(app, ["run", "steps.mlx", source, "again.ply"]).stdout
        assert "meshing_close_holes_by_bezier_patch " in text
        assert "wrote again.ply" in text

    def test_nothing_is_written_when_a_step_fails(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        path = script(tmp_path, '<filter name="Compute Ambient"/>')
        result = CliRunner().invoke(app, ["run", str(path), str(SAMPLES / "sphere.ply"), "out.ply"])
        assert isinstance(result.exception, bf.InvalidScriptError)
        assert not Path("out.ply").exists()
