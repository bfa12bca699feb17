"""Files for other programs: VTP and VTU for ParaView and pyvista, GLB for browsers, and tables; by their suffix."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bezier_filters.arrays import IntArray
from bezier_filters.errors import FieldFileError, InvalidMeshError
from bezier_filters.field_arrays import split_vectors
from bezier_filters.fields import NORMAL, PREFIX, QUALITY
from bezier_filters.files.data_tables import read_csv, read_las, read_npz, write_csv, write_npz
from bezier_filters.files.mesh_data import MeshData
from bezier_filters.files.scan_formats import read_e57, read_pcd, read_pts, read_ptx, read_xyz
from bezier_filters.meshes.mesh_objects import arrays_of_object
from bezier_filters.runtime.extras import import_extra

_NORMALS, _COLORS = "Normals", "RGBA"  # names that ParaView and pyvista give them
_READERS = {".vtp": "vtkXMLPolyDataReader", ".vtu": "vtkXMLUnstructuredGridReader"}


def _write_vtk(path: Path, data: MeshData) -> None:
    """Write a surface, or points."""
    path.write_text(vtk_text(data, is_grid=path.suffix.lower() == ".vtu"), encoding="ascii")


def vtk_text(data: MeshData, *, is_grid: bool, edges: IntArray | None = None) -> str:
    """Text of a VTP file, or as a grid of a VTU file, with faces, edges (e, 2) or points.

    The fitted normals are the active ones, if there are any.
    """
    pyvista = import_extra("pyvista")
    from vtkmodules import vtkIOXML

    vertices, faces = data.vertices, data.faces
    if edges is not None:
        mesh = pyvista.PolyData(vertices, lines=np.insert(edges, 0, 2, axis=1).ravel())
    elif len(faces):
        mesh = pyvista.PolyData.from_regular_faces(vertices, faces)
    else:
        mesh = pyvista.PolyData(vertices)
    for name, values in data.fields.items():
        mesh.point_data[name] = values
    if NORMAL not in data.fields and data.normals is not None:
        mesh.point_data[_NORMALS] = data.normals
    mesh.point_data.active_normals_name = next((n for n in (NORMAL, _NORMALS) if n in mesh.point_data), None)
    if QUALITY in data.fields:
        mesh.point_data.active_scalars_name = QUALITY
    if data.colors is not None:
        mesh.GetPointData().AddArray(pyvista.convert_array(data.colors, name=_COLORS))  # without being active
    writer: Any = vtkIOXML.vtkXMLUnstructuredGridWriter() if is_grid else vtkIOXML.vtkXMLPolyDataWriter()
    writer.SetInputData(mesh.cast_to_unstructured_grid() if is_grid else mesh)
    writer.SetEncodeAppendedData(True)  # as ASCII
    writer.SetWriteToOutputString(True)  # VTK crashes where a disk is full
    writer.Write()
    return str(writer.GetOutputString())


def _read_vtk(path: Path) -> MeshData:
    """Read a surface or points; VTK's messages are left out."""
    import_extra("pyvista")
    from vtkmodules import vtkIOXML
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonCore import vtkObject

    vtk_to_numpy: Any = numpy_support.vtk_to_numpy  # has no type annotations
    reader: Any = getattr(vtkIOXML, _READERS[path.suffix.lower()])()
    shown = vtkObject.GetGlobalWarningDisplay()
    vtkObject.SetGlobalWarningDisplay(0)
    try:
        reader.SetFileName(str(path))
        reader.Update()
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)
    mesh = reader.GetOutput()
    if reader.GetErrorCode() or mesh is None or not mesh.GetNumberOfPoints():
        raise FieldFileError(f"{path} has no points, or is damaged")
    try:
        vertices, faces = arrays_of_object(mesh)
    except InvalidMeshError as error:
        raise FieldFileError(f"{path} holds no surface and no points: {error}") from error
    point_data, numbers = mesh.GetPointData(), dict[str, Any]()
    for k in range(point_data.GetNumberOfArrays()):
        if (array := point_data.GetArray(k)) is not None and array.GetName():
            numbers[array.GetName()] = vtk_to_numpy(array)
    active = point_data.GetNormals()
    normals = numbers.pop(_NORMALS, None) if active is None else vtk_to_numpy(active)
    if active is not None:
        numbers.pop(_NORMALS, None)
    colors = numbers.pop(_COLORS, None)
    fields = {name: values for name, values in numbers.items() if name == QUALITY or name.startswith(PREFIX)}
    left = [name for name in numbers if name not in fields]
    return MeshData(
        np.array(vertices, np.float64),
        np.array(np.empty((0, 3)) if faces is None else faces, np.int32),
        None if normals is None else np.array(normals, np.float64),
        None if colors is None else np.array(colors, np.uint8),
        split_vectors({name: np.array(values) for name, values in fields.items()}),
        (f"arrays that were not read: {', '.join(left)}",) if left else (),
    )


def _write_glb(path: Path, data: MeshData) -> None:
    """Write vertices in single precision, faces, normals and colours."""
    trimesh = import_extra("trimesh")
    if not len(data.faces):
        made = trimesh.PointCloud(data.vertices, colors=data.colors)
        path.write_bytes(trimesh.Scene([made]).export(file_type="glb"))
        return
    normals = data.normals
    made = trimesh.Trimesh(data.vertices, data.faces, vertex_colors=data.colors, vertex_normals=normals, process=False)
    path.write_bytes(made.export(file_type="glb", include_normals=normals is not None))


WRITERS: dict[str, Callable[[Path, MeshData], None]] = {
    ".vtp": _write_vtk,
    ".vtu": _write_vtk,
    ".glb": _write_glb,
    ".csv": write_csv,
    ".npz": write_npz,
}
READERS: dict[str, Callable[[Path], MeshData]] = {
    ".vtp": _read_vtk,
    ".vtu": _read_vtk,
    ".csv": read_csv,
    ".npz": read_npz,
    ".las": read_las,
    ".laz": read_las,
    ".pcd": read_pcd,
    ".pts": read_pts,
    ".ptx": read_ptx,
    ".xyz": read_xyz,
    ".e57": read_e57,
}
