"""Fields and parameters have one table each: what is derived from it, and what must agree with it."""

import inspect
import re
import subprocess
import sys
from pathlib import Path
from typing import get_args, get_type_hints

import pytest
import typer

from bezier_filters.cli.commands import app
from bezier_filters.fields import ESTIMATES, FIELDS, columns, qualities
from bezier_filters.fitting.vertex_geometry import empty_geometry
from bezier_filters.meshlab.meshset import PercentageValue, PureValue
from bezier_filters.meshlab.scripts import FILTERS
from bezier_filters.parameters import LENGTH_TYPE, PARAMETERS, QUALITY_OF

ROOT = Path(__file__).parents[2]
COMMANDS = {
    "apply_coord_bezier_patch_smoothing": "smooth",
    "meshing_close_holes_by_bezier_patch": "fill-holes",
    "meshing_bridge_holes_by_bezier_patch": "bridge",
    "meshing_replace_selection_by_bezier_patch": "replace",
    "meshing_surface_subdivision_by_bezier_patch": "subdivide",
    "meshing_remeshing_by_bezier_patch": "remesh",
    "compute_normal_by_bezier_patch_per_vertex": "normals",
    "compute_curvature_by_bezier_patch_per_vertex": "curvature",
    "compute_torsion_by_bezier_patch_per_vertex": "torsion",
    "compute_selection_by_bezier_crease_per_edge": "creases",
    "compute_texmap_by_bezier_patch": "bake",
    "generate_polyline_by_bezier_patch_direction": "lines",
    "compute_deviation_by_bezier_patch_per_vertex": "compare",
    "get_surface_measures_by_bezier_patch": "measure",
}
OF_FILTERS_ALONE = {"ms", "onselected", "newfaceselected", "polylines", "textname", "refmesh"}
KINDS = {
    "bool": bool,
    "int": int,
    "float": float,
    "str": str,
    "(float, float)": tuple[float, float],
    "(float, float, float)": tuple[float, float, float],
    LENGTH_TYPE: PercentageValue | PureValue | float,
}


def words(kind):
    return set(re.findall(r'"(\w+)"', kind))


@pytest.mark.parametrize("function", FILTERS)
def test_signatures_agree_with_the_table(function):
    table = PARAMETERS[COMMANDS[function.__name__]]
    signature = inspect.signature(function).parameters
    assert signature.keys() - OF_FILTERS_ALONE == {parameter.name for parameter in table}
    hints = get_type_hints(function)
    for parameter in table:
        assert signature[parameter.name].default == parameter.default, parameter
        assert signature[parameter.name].kind is inspect.Parameter.KEYWORD_ONLY
        hint = hints[parameter.name]
        if parameter.kind in KINDS:
            expected = KINDS[parameter.kind]
            assert hint == (expected if parameter.default is not None else expected | None), parameter
        elif parameter.name == "quality":
            assert hint == str | None
        elif words(parameter.kind):
            allowed = {word for part in (hint, *get_args(hint)) for word in get_args(part)}
            assert words(parameter.kind) <= allowed, parameter
            assert parameter.name != "method" or words(parameter.kind) == allowed, parameter


@pytest.mark.parametrize("function", FILTERS)
def test_docstrings_have_every_parameter_and_column(function):
    name = COMMANDS[function.__name__]
    for parameter in inspect.signature(function).parameters:
        assert re.search(rf"^{parameter} : .*\n    \S", function.__doc__, re.MULTILINE), parameter
    for field in FIELDS:
        listed = field.column if not field.component else f"``_{field.name[-1]}``"
        assert name not in field.filters or listed in function.__doc__
    assert not re.search(r"see `[A-Z]+`", function.__doc__)


@pytest.mark.parametrize("function", FILTERS)
def test_commands_have_every_parameter(function):
    name = COMMANDS[function.__name__]
    options = {option.name: option for option in typer.main.get_command(app).commands[name].params}
    for parameter in PARAMETERS[name]:
        if parameter.name != "progress":
            assert options[parameter.name].help == parameter.help or parameter.name == "color"


def test_fields_of_estimates_are_numbers_of_each_vertex():
    geometry = empty_geometry(4)
    for name in ESTIMATES:
        assert all(values.shape == (4,) for values in columns(name, geometry).values())
    assert len({field.column for field in FIELDS}) == len(FIELDS)


def test_the_page_of_filters_names_every_quality():
    page = (ROOT / "docs" / "filters" / "index.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `([\w-]+)` \|(.*)$", page, re.MULTILINE))
    assert rows.keys() == set(COMMANDS.values())
    for name in QUALITY_OF:
        assert all(re.search(rf"\b{word}\b", rows[name]) for word in qualities(name))


DUMMY = """
import sys
from pathlib import Path
import bezier_filters.fields as table
table.FIELDS += (
    table.Field("dummy", "dummy curvature", "1/length", (table.CURVATURE,), quality="dummy", attribute="k_max"),
)
import numpy as np
import pymeshlab
import typer
import bezier_filters as bf
from bezier_filters.cli.commands import app
from bezier_filters.parameters import QUALITY_OF
from bezier_filters.pictures.field_panels import read_mesh_file

curvature = bf.compute_curvature_by_bezier_patch_per_vertex
assert "- ``bz_dummy``: dummy curvature [1/length]" in curvature.__doc__
assert '"plan", "dummy"}' in curvature.__doc__
ms = pymeshlab.MeshSet()
ms.create_sphere(subdiv=3)
ms.save_current_mesh("ball.ply")
report = curvature(ms, rings=2, alpha=0.8, quality="dummy")
assert "bz_dummy" in report["attributes"] and report["unit"] == "1/length", report

command = typer.main.get_command(app).commands["curvature"]
assert "plan or dummy." in next(option.help for option in command.params if option.name == "quality")
fixed = ["ball.ply", "out.ply", "--rings", "2", "--alpha", "0.8", "--quality", "dummy"]
for arguments in (["curvature"], ["scale", "curvature", "--scheduler", "synchronous", "--column", "dummy"]):
    Path("out.ply").unlink(missing_ok=True)
    app([*arguments, *fixed], standalone_mode=False)
    file = read_mesh_file(Path("out.ply"))
    np.testing.assert_array_equal(file.columns["quality"], file.columns["bz_dummy"])
    assert file.field("bz_dummy").label == "dummy curvature"
"""


def test_a_new_line_in_the_table_is_a_field_everywhere(tmp_path):
    """In filter, docstring, command, tiles and pictures: in a process that adds it before anything else is imported."""
    done = subprocess.run([sys.executable, "-c", DUMMY], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
