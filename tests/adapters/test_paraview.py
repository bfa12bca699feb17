"""The plugin in ParaView itself."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from bezier_filters_adapters.filters import LABELS, field_names, parameters_of

ROOT = Path(__file__).parents[2]
PLUGIN = ROOT / "adapters" / "bezier_filters_paraview.py"
VERSION = "import sys; print(*sys.version_info[:2])"
# ParaView's own modules come first: vtk from PyPI would take their place.
SCRIPT = """
import json, sys
import paraview, vtkmodules
sys.path[:0] = {paths!r}
import bezier_filters_adapters.paraview_start
from bezier_filters_adapters.field_colors import field_colors
from paraview import servermanager, simple
from vtkmodules.util.numpy_support import vtk_to_numpy

sphere = simple.Sphere(Radius=2.0, ThetaResolution=20, PhiResolution=20)
told = {{}}
for name in {classes!r}:
    made = getattr(simple, name)(Input=sphere)
    mesh = servermanager.Fetch(made)
    points = mesh.GetPointData()
    columns = [points.GetArrayName(k) for k in range(points.GetNumberOfArrays())]
    hints = made.SMProxy.GetHints()
    told["menu " + name] = hints.FindNestedElementByName("ShowInMenu").GetAttribute("category")
    told["active " + name] = points.GetScalars() and points.GetScalars().GetName()
    told[name] = [made.ListProperties(), columns, mesh.GetNumberOfPoints(), mesh.GetNumberOfPolys()]
curved = simple.BezierCurvature(Input=sphere, rings="2", robust="True")
curved.UpdatePipeline()
told["means"] = curved.PointData["bz_mean_curvature"].GetRange()
told["rings"] = curved.PointData["bz_rings_used"].GetRange()
view = simple.CreateView("RenderView")
shown = simple.Show(curved, view)
values = vtk_to_numpy(servermanager.Fetch(curved).GetPointData().GetScalars())
told["shown"] = list(shown.ColorArrayName)
told["range"] = [shown.LookupTable.RGBPoints[0], shown.LookupTable.RGBPoints[-4]]
told["expected"] = field_colors("bz_mean_curvature", values).limits
shown.LookupTable.RGBPoints = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 1.0]  # as a user may choose
curved.rings = "3"
curved.UpdatePipeline()
told["chosen"] = shown.LookupTable.RGBPoints[:]
curved.rings = "-3"
curved.UpdatePipeline()
told["pymeshlab"] = "pymeshlab" in sys.modules
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def told():
    """What ParaView tells of the filters, and its messages."""
    program = shutil.which("pvpython")
    if program is None:
        pytest.skip("there is no pvpython on this machine")
    plain = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    version = subprocess.run([program, "-c", VERSION], env=plain, capture_output=True, text=True, check=False).stdout
    if version.split() != [*map(str, sys.version_info[:2])]:
        pytest.skip(f"pvpython has another Python than {sys.version_info[:2]}: {version.strip()}")
    paths = [str(ROOT), str(ROOT / "adapters"), sysconfig.get_path("purelib")]
    classes = ["Bezier" + label.title().replace(" ", "") for label in LABELS.values()]
    code = SCRIPT.format(paths=paths, classes=classes)
    done = subprocess.run(
        [program, "--force-offscreen-rendering", "-c", code], env=plain, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1]), done.stderr


def test_the_plugin_compiles():
    compile(PLUGIN.read_text(encoding="utf-8"), PLUGIN, "exec")


@pytest.mark.parametrize("name", LABELS)
def test_filters_have_parameters_and_give_fields(told, name):
    properties, columns, points, polygons = told[0]["Bezier" + LABELS[name].title().replace(" ", "")]
    assert {parameter.name for parameter in parameters_of(name)} <= set(properties)
    assert [column for column in columns if column.startswith("bz_")] == field_names(name)
    assert (points, polygons) == (362, 720)


def test_properties_reach_the_filter(told):
    low, high = told[0]["means"]
    assert 0.45 < low <= high < 0.55
    assert told[0]["rings"][0] == 2


def test_filters_are_in_their_menu_and_show_their_first_field(told):
    for name, label in LABELS.items():
        class_name = "Bezier" + label.title().replace(" ", "")
        assert told[0]["menu " + class_name] == "Bezier filters"
        assert told[0]["active " + class_name] == (None if name == "normals" else field_names(name)[0])


def test_the_first_picture_has_the_limits_of_the_package(told):
    assert told[0]["shown"] == ["POINTS", "bz_mean_curvature"]
    assert told[0]["range"] == pytest.approx(told[0]["expected"])
    low, high = told[0]["expected"]
    assert told[0]["chosen"] == pytest.approx([low, 0.0, 0.0, 0.0, high, 1.0, 0.0, 1.0])


def test_errors_are_messages(told):
    assert "Curvature: rings: got -3" in told[1]


def test_pymeshlab_is_not_loaded(told):
    assert not told[0]["pymeshlab"]
