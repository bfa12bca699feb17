"""Fills of holes as cells of VTK's meshes, which keep their polygons and their data."""

from collections.abc import Callable
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkDataSetAttributes, vtkPolyData
from vtkmodules.vtkFiltersCore import vtkTriangleFilter

from bezier_filters.arrays import IntArray
from bezier_filters_adapters.filled_fields import NEW, Fill, Values
from bezier_filters_adapters.vtk_fields import set_fields
from bezier_filters_adapters.vtk_normals import renew_normals

_GHOSTS = "vtkGhostType"
_CELLS = "bz_cells"


def triangles_of(mesh: Any) -> tuple[IntArray, IntArray]:
    """Triangles (m, 3) of the polygons and strips of a vtkPolyData, and the cell of each, (m,)."""
    copy = vtkPolyData()
    copy.CopyStructure(mesh)
    cells = numpy_to_vtkIdTypeArray(np.arange(copy.GetNumberOfCells(), dtype=np.int64), deep=True)
    cells.SetName(_CELLS)
    copy.GetCellData().AddArray(cells)
    triangles = vtkTriangleFilter()
    triangles.PassVertsOff()
    triangles.PassLinesOff()
    triangles.SetInputData(copy)
    triangles.Update()
    made = triangles.GetOutput()
    if not made.GetNumberOfPolys():
        return np.empty((0, 3), np.int32), np.empty(0, np.int32)
    corners = vtk_to_numpy(made.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int32)
    return corners, vtk_to_numpy(made.GetCellData().GetArray(_CELLS)).astype(np.int32)


def add_fill(mesh: Any, fill: Fill, cells: IntArray) -> None:
    """Add new vertices and faces to a vtkPolyData, whose old triangles belong to some cells, with rows of its data.

    New faces come after the old polygons; strips, whose cells VTK numbers last, stay behind them. Normals of new points
    and cells are those of the polygons. `NEW` marks the new points and cells.
    """
    points, polygons, faces = vtkPoints(), vtkCellArray(), vtkCellArray()
    points.SetData(numpy_to_vtk(fill.vertices, deep=True))
    if mesh.GetPolys() is not None:
        polygons.DeepCopy(mesh.GetPolys())
    place = mesh.GetNumberOfVerts() + mesh.GetNumberOfLines() + mesh.GetNumberOfPolys()
    old_cells, count = mesh.GetNumberOfCells(), len(fill.new_faces)
    if count:
        faces.SetData(3, numpy_to_vtkIdTypeArray(fill.new_faces.ravel().astype(np.int64), deep=True))
        polygons.Append(faces)
    mesh.SetPoints(points)
    mesh.SetPolys(polygons)
    like_face = cells[fill.like_face()]
    _grow(mesh.GetPointData(), fill.old_vertices, fill.like_vertex(), fill.new_vertex_rows)
    _grow(mesh.GetCellData(), place, like_face, lambda name, values: fill.new_face_rows(name, values, like_face))
    if count:
        renew_normals(mesh, slice(fill.old_vertices, None), slice(place, place + count))
    is_new = np.zeros(old_cells + count, np.uint8)
    is_new[place : place + count] = 1
    set_fields(mesh.GetPointData(), fill.marks())
    set_fields(mesh.GetCellData(), {NEW: is_new})


def _grow(data: Any, place: int, like: IntArray, new_rows: Callable[[str, Values], Values]) -> None:
    """Insert rows into all arrays of some data before a place; which arrays are active stays.

    Arrays of numbers get new rows by their names and values, others those of old rows.
    """
    arrays = [data.GetAbstractArray(k) for k in range(data.GetNumberOfArrays())]
    active = {kind: data.GetAbstractAttribute(kind) for kind in range(vtkDataSetAttributes.NUM_ATTRIBUTES)}
    indices = {kind: k for kind, array in active.items() for k, own in enumerate(arrays) if own is array}
    grown = [_grown(array, place, like, new_rows) for array in arrays]
    if (index := indices.get(vtkDataSetAttributes.GLOBALIDS)) is not None and len(like):
        ids = vtk_to_numpy(grown[index])  # distinct ones
        ids[place : place + len(like)] = vtk_to_numpy(arrays[index]).max() + 1 + np.arange(len(like))
    data.Initialize()
    for array in grown:
        data.AddArray(array)
    for kind, index in indices.items():
        data.SetActiveAttribute(index, kind)


def _grown(array: Any, place: int, like: IntArray, new_rows: Callable[[str, Values], Values]) -> Any:
    """A copy of an array with more rows."""
    count, added, made = array.GetNumberOfTuples(), len(like), array.NewInstance()
    made.SetNumberOfComponents(array.GetNumberOfComponents())
    made.SetNumberOfTuples(count + added)
    made.SetName(array.GetName())
    for k in range(array.GetNumberOfComponents()):
        if array.GetComponentName(k):
            made.SetComponentName(k, array.GetComponentName(k))
    made.InsertTuples(0, place, 0, array)
    made.InsertTuples(place + added, count - place, place, array)
    for k, row in enumerate(like.tolist()):
        made.InsertTuple(place + k, row, array)
    if added and array.IsA("vtkDataArray") and not array.IsA("vtkBitArray"):
        name = array.GetName() or ""
        values = 0 if name == _GHOSTS else new_rows(name, vtk_to_numpy(array))
        vtk_to_numpy(made)[place : place + added] = values
    return made
