"""ParaView: the filters in the menu "Bezier filters"; Tools > Manage Plugins > Load New loads this file.

Output has a field as its active scalars, which ParaView shows first, with the package's own colours and limits.
"""

from collections.abc import Callable
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from paraview import print_error
from paraview.util.vtkAlgorithm import VTKPythonAlgorithmBase, smdomain, smhint, smproperty, smproxy
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkPolyData

from bezier_filters.fields import SMOOTH
from bezier_filters.parameters import Parameter
from bezier_filters_adapters.field_colors import field_colors
from bezier_filters_adapters.filters import (
    ERRORS,
    HELP,
    LABELS,
    default_of,
    kind_of,
    parameters_of,
    run,
)
from bezier_filters_adapters.paraview_colors import set_color_map
from bezier_filters_adapters.vtk_fields import choose_scalars, set_fields
from bezier_filters_adapters.vtk_fills import add_fill, triangles_of
from bezier_filters_adapters.vtk_normals import renew_normals

_ELEMENTS: dict[object, str] = {bool: "Int", int: "Int", float: "Double"}


def _property(parameter: Parameter) -> str:
    """A parameter as ParaView wants it."""
    kind, default = kind_of(parameter), default_of(parameter)
    element, domain = _ELEMENTS.get(kind, "String"), '<BooleanDomain name="bool"/>' if kind is bool else ""
    if isinstance(kind, tuple):
        words = "".join(f'<String value="{word}"/>' for word in kind)
        domain = f'<StringListDomain name="words">{words}</StringListDomain>'
    shown = int(default) if kind is bool else default
    return (
        f'<{element}VectorProperty name="{parameter.name}" label="{parameter.name}" number_of_elements="1" '
        f'command="set_{parameter.name}" default_values={quoteattr(str(shown))}>{domain}'
        f"<Documentation>{escape(parameter.help)}</Documentation></{element}VectorProperty>"
    )


def _setter(parameter: Parameter) -> Callable[..., None]:
    def setter(self: Any, value: object) -> None:
        self.given[parameter.name] = bool(value) if kind_of(parameter) is bool else value
        self.Modified()

    setter.__name__ = f"set_{parameter.name}"
    decorated: Callable[..., None] = smproperty.xml(_property(parameter))(setter)
    return decorated


def _filter(name: str, class_name: str) -> Any:
    """The class of a filter."""

    def __init__(self: Any) -> None:
        VTKPythonAlgorithmBase.__init__(self, nInputPorts=1, nOutputPorts=1, outputType="vtkPolyData")
        self.given = {}

    def RequestData(self: Any, request: Any, inputs: Any, outputs: Any) -> int:
        source, target = vtkPolyData.GetData(inputs[0]), vtkPolyData.GetData(outputs)
        try:
            self.SetProgressText(LABELS[name])
            _apply(name, source, target, self.given, self.UpdateProgress)
        except ERRORS as error:
            print_error(f"{LABELS[name]}: {error}")
            return 0
        return 1

    body = {"__module__": __name__, "__doc__": HELP[name], "__init__": __init__, "RequestData": RequestData}
    setters = {f"set_{parameter.name}": _setter(parameter) for parameter in parameters_of(name)}
    made = type(class_name, (VTKPythonAlgorithmBase,), body | setters)
    made = smdomain.datatype(dataTypes=["vtkPolyData"], composite_data_supported=False)(made)
    made = smproperty.input(name="Input", port_index=0)(made)
    made = smhint.xml('<ShowInMenu category="Bezier filters"/>')(made)  # after the input, which would take it
    return smproxy.filter(name=class_name, label=f"Bezier {LABELS[name].title()}")(made)


def _apply(
    name: str, source: Any, target: Any, given: dict[str, object], show_share: Callable[[float], object]
) -> None:
    if source.GetPoints() is None:  # nothing came in
        return
    faces, cells = triangles_of(source)
    result = run(name, vtk_to_numpy(source.GetPoints().GetData()), faces, given, show_share)
    target.ShallowCopy(source)
    if result.fill is not None:
        add_fill(target, result.fill, cells)
    else:
        if name == SMOOTH:
            points = vtkPoints()
            points.SetData(numpy_to_vtk(result.vertices, deep=True))
            target.SetPoints(points)
            renew_normals(target)
        set_fields(target.GetPointData(), result.fields)
    shown = choose_scalars(target.GetPointData(), name, result.fields)
    if shown is not None:
        set_color_map(shown, field_colors(shown, result.fields[shown]))


BezierNormals = _filter("normals", "BezierNormals")
BezierCurvature = _filter("curvature", "BezierCurvature")
BezierTorsion = _filter("torsion", "BezierTorsion")
BezierSmooth = _filter("smooth", "BezierSmooth")
BezierFillHoles = _filter("fill-holes", "BezierFillHoles")
BezierCreases = _filter("creases", "BezierCreases")
