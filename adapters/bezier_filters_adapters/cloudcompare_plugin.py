"""CloudCompare: the filters as actions of a plugin that its Python runtime finds once this package is installed."""

from collections.abc import Callable

import numpy as np
import pycc

from bezier_filters.arrays import FloatArray
from bezier_filters.field_arrays import split_vectors
from bezier_filters.fields import SMOOTH
from bezier_filters_adapters.field_colors import field_colors
from bezier_filters_adapters.filled_fields import Fill, Values
from bezier_filters_adapters.filters import ERRORS, FILL_HOLES, LABELS, run


class BezierFilters(pycc.PythonPluginInterface):
    """The actions, which work on the selected mesh with default parameters."""

    def __init__(self) -> None:
        pycc.PythonPluginInterface.__init__(self)

    def getActions(self) -> list[pycc.Action]:
        """One for each filter."""
        return [pycc.Action(name=label, target=_action(name)) for name, label in LABELS.items()]


def _action(name: str) -> Callable[[], None]:
    def action() -> None:
        selected = pycc.GetInstance().getSelectedEntities()
        if len(selected) != 1 or not isinstance(selected[0], pycc.ccMesh):
            pycc.ccLog.Error("Bezier filters: select one mesh")
            return
        try:
            apply(name, selected[0])
        except ERRORS as error:
            pycc.ccLog.Error(f"Bezier filters: {error}")

    return action


def apply(name: str, mesh: pycc.ccMesh, **given: object) -> pycc.ccMesh:
    """Add fields to the cloud of a mesh, or a new mesh to the tree, for scripts, too; return the mesh that has them."""
    corners = (mesh.getTriangleVertIndexes(k) for k in range(mesh.size()))
    faces = [(corner.i1, corner.i2, corner.i3) for corner in corners]
    dialog = pycc.ccProgressDialog()
    dialog.setMethodTitle(f"Bezier filters: {LABELS[name].lower()}")
    dialog.start()
    try:
        points = mesh.getAssociatedCloud().points()
        result = run(name, points, faces, given, lambda share: dialog.update(100.0 * share))
    finally:
        dialog.stop()
    fields = split_vectors(result.fields)  # it knows numbers alone
    if result.fill is not None:
        fields = _grown_fields(mesh.getAssociatedCloud(), result.fill) | fields
    if name in (SMOOTH, FILL_HOLES):
        mesh = _added(result.vertices, result.faces.tolist(), f"{mesh.getName()} {LABELS[name].lower()}")
    cloud = mesh.getAssociatedCloud()
    for column, values in fields.items():
        known = cloud.getScalarFieldIndexByName(column)
        index = cloud.addScalarField(column) if known < 0 else known
        field = cloud.getScalarField(index)
        field.asArray()[:] = values
        field.computeMinAndMax()
    if fields:
        shown = next(iter(split_vectors(result.fields)))
        index = cloud.getScalarFieldIndexByName(shown)
        _set_colors(cloud.getScalarField(index), shown, fields[shown])
        cloud.setCurrentDisplayedScalarField(index)
        mesh.showSF(True)
    pycc.ccLog.Print(result.summary)
    pycc.GetInstance().updateUI()
    return mesh


def _set_colors(field: pycc.ccScalarField, column: str, values: Values) -> None:
    """Colours and limits of a scalar field; of CloudCompare's own maps BWR is closest to Cool Warm."""
    colors, scales = field_colors(column, values), pycc.ccColorScalesManager
    scale = scales.DEFAULT_SCALES.BWR if colors.signed else scales.DEFAULT_SCALES.VIRIDIS
    low, high = colors.limits
    field.setColorScale(scales.GetDefaultScale(scale))
    field.setSymmetricalScale(colors.signed)  # limits are those of the size of values then
    field.setSaturationStart(0.0 if colors.signed else low)
    field.setSaturationStop(high)


def _grown_fields(cloud: pycc.ccPointCloud, fill: Fill) -> dict[str, Values]:
    """Scalar fields of a cloud, with those of new vertices."""
    fields = {}
    for index in range(cloud.getNumberOfScalarFields()):
        name, values = cloud.getScalarFieldName(index), np.array(cloud.getScalarField(index).asArray())
        fields[name] = np.concatenate([values, fill.new_vertex_rows(name, values)])
    return fields


def _added(vertices: FloatArray, faces: list[list[int]], name: str) -> pycc.ccMesh:
    cloud = pycc.ccPointCloud(*vertices.astype(pycc.PointCoordinateType).T)
    mesh = pycc.ccMesh(cloud)
    for face in faces:
        mesh.addTriangle(*face)
    mesh.setName(name)
    mesh.addChild(cloud)
    pycc.GetInstance().addToDB(mesh)
    return mesh
