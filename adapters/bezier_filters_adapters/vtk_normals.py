"""Normals of VTK's meshes, which are arrays like any other there: those of moved points have to be computed again."""

from typing import Any

from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkFiltersCore import vtkPolyDataNormals

_NAMES = ("normals", "normal")  # in lower case, of arrays that programs write without saying what they are
_AXES = 3


_ALL = slice(None)


def renew_normals(mesh: Any, points: slice = _ALL, cells: slice = _ALL) -> None:
    """Set the normals that a vtkPolyData has, of some points and cells, to those of its polygons as they are now."""
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
    _replace(mesh.GetPointData(), made.GetPointData().GetNormals(), mesh.GetNumberOfPoints(), points)
    _replace(mesh.GetCellData(), made.GetCellData().GetNormals(), mesh.GetNumberOfCells(), cells)


def _replace(data: Any, new: Any, count: int, rows: slice) -> None:
    """Replace some rows of the arrays of normals among some data.

    Where there are no new ones for each row the arrays go away, or stay if not all rows are to be replaced.
    """
    if rows != _ALL:
        if new is not None and new.GetNumberOfTuples() == count:
            for array in _normals(data):
                vtk_to_numpy(array)[rows] = vtk_to_numpy(new)[rows]
        return
    active = data.GetNormals()
    for array in _normals(data):
        name, is_active = array.GetName(), array is active
        data.RemoveArray(name)
        if new is not None and new.GetNumberOfTuples() == count:
            own = new.NewInstance()
            own.DeepCopy(new)
            own.SetName(name)
            data.SetNormals(own) if is_active else data.AddArray(own)


def _normals(data: Any) -> list[Any]:
    """Arrays of normals: the active one, and those with the names of normals."""
    active = data.GetNormals()
    arrays = [data.GetArray(k) for k in range(data.GetNumberOfArrays())]
    return [
        array
        for array in arrays
        if array is not None
        and (array is active or ((array.GetName() or "").lower() in _NAMES and array.GetNumberOfComponents() == _AXES))
    ]
