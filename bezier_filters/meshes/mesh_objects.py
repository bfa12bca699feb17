"""Vertices and triangles of the meshes of other libraries, by the attributes that these have: none is imported for it.

An object whose faces are not understood is refused: without them, a surface would be taken for a point cloud.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidMeshError
from bezier_filters.meshes.mesh import TriangleMesh, triangle_mesh

EXPECTED = (
    "a mesh of pyvista, VTK, vedo, trimesh, Open3D, meshio, napari or pymeshlab, a pair (vertices, faces), or the path "
    "of a file"
)
# other attributes in which libraries keep connectivity
_UNREAD = (
    "polygons",
    "tris",
    "tetras",
    "quads",
    "simplices",
    "elements",
    "entities",
    "topology",
    "lines",
    "edges",
    "cells",
)
_TRIANGLE, _QUAD = 3, 4  # corners
_IGNORED_CELLS = ("vertex", "line")  # types of meshio that are no faces

_Pair = tuple[ArrayLike, ArrayLike | None]  # vertices and faces; no faces are None


@dataclass(frozen=True)
class Placement:
    """Where a viewer shows the vertices of a layer: ``matrix @ vertex + shift``."""

    matrix: FloatArray  # (3, 3)
    shift: FloatArray  # (3,)

    def to_world(self, vertices: FloatArray) -> FloatArray:
        """Vertices (n, 3) in the coordinates of the world."""
        return vertices @ self.matrix.T + self.shift

    def to_data(self, vertices: FloatArray) -> FloatArray:
        """Vertices (n, 3) of the world in the coordinates of the layer."""
        return np.asarray(np.linalg.solve(self.matrix, (vertices - self.shift).T).T, dtype=np.float64)

    def orient(self, faces: IntArray) -> IntArray:
        """Faces (m, 3) with their outside where it was, though a mirror image turns them over; its own inverse."""
        return faces[:, ::-1] if np.linalg.det(self.matrix) < 0.0 else faces


def placement_of_layer(layer: Any) -> Placement:
    """Scale, rotation, shear and translation of a layer of napari."""
    shift = np.array(layer.data_to_world((0.0, 0.0, 0.0)), dtype=np.float64)
    columns = [np.array(layer.data_to_world(axis), dtype=np.float64) - shift for axis in np.eye(3)]
    return Placement(np.column_stack(columns), shift)


def mesh_of_object(mesh: Any) -> TriangleMesh:
    """The mesh that an object holds, or a pair of arrays; InvalidMeshError if it is not known, or not all triangles."""
    vertices, faces = _arrays(mesh)
    return triangle_mesh(vertices, np.empty((0, 3), np.int32) if faces is None else faces)


def _arrays(mesh: Any) -> _Pair:
    if isinstance(mesh, tuple | list):
        return _pair(mesh)
    if hasattr(mesh, "vertex_matrix"):  # pymeshlab
        return mesh.vertex_matrix(), mesh.face_matrix()
    if hasattr(mesh, "IsA") and hasattr(mesh, "GetClassName"):  # VTK, pyvista
        return _of_vtk(mesh)
    if hasattr(getattr(mesh, "dataset", None), "GetPoints"):  # vedo
        return _of_vtk(mesh.dataset)
    if isinstance(getattr(mesh, "geometry", None), Mapping) and hasattr(mesh, "dump"):  # a scene of trimesh
        return _joined(mesh)
    if hasattr(mesh, "data_to_world"):  # a layer of napari
        return _in_world(mesh)
    if hasattr(mesh, "vertex") and hasattr(mesh, "triangle"):  # Open3D's tensors
        return _numbers(mesh.vertex["positions"]), _numbers(mesh.triangle["indices"])
    if hasattr(mesh, "point") and "positions" in mesh.point:
        return _numbers(mesh.point["positions"]), None
    if hasattr(mesh, "points") and isinstance(getattr(mesh, "cells", None), list):  # meshio
        return mesh.points, _triangles_of_cells(mesh, mesh.cells)
    return _by_attributes(mesh)


def _by_attributes(mesh: Any) -> _Pair:
    """Those of trimesh and Open3D, and of whatever else has vertices and faces, or triangles."""
    vertices = getattr(mesh, "vertices", getattr(mesh, "points", None))
    if vertices is None or callable(vertices):
        raise InvalidMeshError(f"mesh: got {type(mesh).__name__}, expected {EXPECTED}")
    for name in ("faces", "triangles"):
        if (faces := getattr(mesh, name, None)) is not None and not callable(faces):
            return vertices, faces
    if hasattr(mesh, "faces"):  # None
        return vertices, None
    _refuse_unread(mesh, [name for name in _UNREAD if hasattr(mesh, name)])
    return vertices, None


def _refuse_unread(mesh: Any, names: Sequence[str]) -> None:
    if names:
        raise InvalidMeshError(
            f"mesh: got {type(mesh).__name__}, whose {', '.join(names)} cannot be read as triangles; pass a pair "
            "(vertices, faces), with the faces as indices of shape (m, 3)"
        )


def _pair(pair: Sequence[Any]) -> _Pair:
    if len(pair) != len(("vertices", "faces")):
        raise InvalidMeshError(f"mesh: got a {type(pair).__name__} of {len(pair)}, expected {EXPECTED}")
    return pair[0], pair[1]


def _of_vtk(mesh: Any) -> _Pair:
    """Points and triangles of a vtkPolyData; polygons and strips are cut into triangles."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    if not mesh.IsA("vtkPolyData"):
        raise InvalidMeshError(
            f"mesh: got {type(mesh).__name__}, which is no surface; take that first, with mesh.extract_surface() in "
            "pyvista or a vtkGeometryFilter in VTK"
        )
    to_numpy: Any = vtk_to_numpy  # which has no types
    points = np.empty((0, 3)) if mesh.GetPoints() is None else to_numpy(mesh.GetPoints().GetData())
    triangles = vtkTriangleFilter()
    triangles.PassVertsOff()
    triangles.PassLinesOff()
    triangles.SetInputData(mesh)
    triangles.Update()
    polygons = triangles.GetOutput().GetPolys()
    corners = to_numpy(polygons.GetConnectivityArray()) if polygons.GetNumberOfCells() else np.empty(0, np.int32)
    return points, corners.reshape(-1, 3)


def _joined(scene: Any) -> _Pair:
    """All meshes of a scene in their places, or all its points."""
    parts = [mesh_of_object(part) for part in scene.dump()]
    if not parts:
        raise InvalidMeshError(f"mesh: got {type(scene).__name__}, in which there is nothing")
    if 0 < sum(part.face_count > 0 for part in parts) < len(parts):
        raise InvalidMeshError(
            f"mesh: got {type(scene).__name__}, which has meshes and point clouds; pass one of its geometries"
        )
    starts = np.cumsum([0] + [part.vertex_count for part in parts[:-1]])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return np.vstack([part.vertices for part in parts]), np.vstack(faces)


def _in_world(layer: Any) -> _Pair:
    """Vertices of a surface layer where the viewer shows them, with its scale; faces as they are seen there."""
    if not hasattr(layer, "vertices") or not hasattr(layer, "faces"):
        raise InvalidMeshError(f"mesh: got {type(layer).__name__}, expected a surface layer, or {EXPECTED}")
    mesh, placement = triangle_mesh(layer.vertices, layer.faces), placement_of_layer(layer)
    return placement.to_world(mesh.vertices), placement.orient(mesh.faces)


def _triangles_of_cells(mesh: Any, cells: Sequence[Any]) -> NDArray[Any]:
    """Triangles of polygons, or of meshio's blocks of cells, one after the other."""
    found = [np.empty((0, 3), np.int64)]
    for cell in cells:
        kind = getattr(cell, "type", "polygon")
        polygons = np.asarray(cell.data) if hasattr(cell, "data") else np.asarray(cell)[np.newaxis]
        if kind in _IGNORED_CELLS:
            continue
        if kind not in ("triangle", "quad", "polygon") or polygons.ndim != len(("cell", "corner")):
            _refuse_unread(mesh, [f"cells of the type {kind!r}"])
        found += [polygons[:, [0, k, k + 1]] for k in range(1, polygons.shape[1] - 1)]
    return np.vstack(found)


def _numbers(tensor: Any) -> NDArray[Any]:
    """A tensor of Open3D, on any device."""
    return np.asarray(tensor.cpu().numpy())
