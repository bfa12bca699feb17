"""Normals of VTK's meshes, which are arrays like any other there: those of moved points have to be computed again."""

from typing import Any

from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkFiltersCore import vtkPolyDataNormals

_NAMES = ("normals", "normal")  # in lower case, of arrays that programs write without saying what they are
_AXES = 3


def renew_normals(mesh: Any) -> None:
    """Set the normals that a vtkPolyData has, of points and of cells, to those of its polygons as they are now."""
    bare = vtkPolyData()
    bare.CopyStructure(mesh)  # without the old normals, which the filter may keep
    normals = vtkPolyDataNormals()
    normals.SetInputData(bare)
    normals.SplittingOff()
    normals.ConsistencyOff()
    normals.AutoOrientNormalsOff()
    normals.ComputePointNormalsOn()
    normals.ComputeCellNormalsOn()
    normals.Update()
    made = normals.GetOutput()
    _replace(mesh.GetPointData(), made.GetPointData().GetNormals(), mesh.GetNumberOfPoints())
    _replace(mesh.GetCellData(), made.GetCellData().GetNormals(), mesh.GetNumberOfCells())


def _replace(data: Any, new: Any, count: int) -> None:
    """Replace the arrays of normals among some data; where there are no new ones for each row they go away."""
    active = data.GetNormals()
    names = [data.GetArrayName(k) for k in range(data.GetNumberOfArrays())]
    for name in names:
        array = data.GetArray(name)
        is_active = active is not None and name == active.GetName()
        if not is_active and not (name and name.lower() in _NAMES and array.GetNumberOfComponents() == _AXES):
            continue
        data.RemoveArray(name)
        if new is not None and new.GetNumberOfTuples() == count:
            own = new.NewInstance()
            own.DeepCopy(new)
            own.SetName(name)
            data.SetNormals(own) if is_active else data.AddArray(own)
