"""Vertices and triangles of mesh objects of other libraries, recognised by their attributes, without imports.

Objects with faces that cannot be read are refused: without faces, a surface would pass as a point cloud.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
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
# words in names of attributes that hold connectivity in some library, in the singular
_CONNECTIVITY_WORDS = frozenset(
    {
        "cell",
        "connectivity",
        "edge",
        "element",
        "entity",
        "entitie",
        "face",
        "hexa",
        "hexahedra",
        "hexahedron",
        "indice",
        "line",
        "polygon",
        "quad",
        "simplice",
        "simplex",
        "strip",
        "tet",
        "tetra",
        "tetrahedra",
        "tetrahedron",
        "topology",
        "tri",
        "triangle",
    }
)
_IGNORED_CELLS = ("vertex", "line")  # cell types of meshio without faces

_Pair = tuple[ArrayLike, ArrayLike | None]  # vertices and faces; no faces are None


@dataclass(frozen=True)
class Placement:
    """Transformation from the coordinates of a layer to those of the viewer: ``matrix @ vertex + shift``."""

    matrix: FloatArray  # (3, 3)
    shift: FloatArray  # (3,)

    def world_coordinates(self, vertices: FloatArray) -> FloatArray:
        """World coordinates of vertices (n, 3) of the layer."""
        return vertices @ self.matrix.T + self.shift

    def layer_coordinates(self, vertices: FloatArray) -> FloatArray:
        """Layer coordinates of vertices (n, 3) of the world."""
        return np.asarray(np.linalg.solve(self.matrix, (vertices - self.shift).T).T, dtype=np.float64)

    def orient(self, faces: IntArray) -> IntArray:
        """Faces (m, 3), reversed if the transformation is a reflection, so that their outside stays; self-inverse."""
        return faces[:, ::-1] if np.linalg.det(self.matrix) < 0.0 else faces


def placement_of_layer(layer: Any) -> Placement:
    """Scale, rotation, shear and translation of a napari layer."""
    shift = np.array(layer.data_to_world((0.0, 0.0, 0.0)), dtype=np.float64)
    columns = [np.array(layer.data_to_world(axis), dtype=np.float64) - shift for axis in np.eye(3)]
    return Placement(np.column_stack(columns), shift)


def mesh_of_object(mesh: Any) -> TriangleMesh:
    """Mesh of an object or a pair of arrays; InvalidMeshError for unknown types and faces other than triangles."""
    vertices, faces = _arrays(mesh)
    return triangle_mesh(vertices, np.empty((0, 3), np.int32) if faces is None else faces)


def _arrays(mesh: Any) -> _Pair:
    if isinstance(mesh, tuple | list):
        return _pair(mesh)
    if hasattr(mesh, "vertex_matrix"):  # pymeshlab
        return mesh.vertex_matrix(), mesh.face_matrix()
    if hasattr(mesh, "IsA") and hasattr(mesh, "GetClassName"):  # VTK, pyvista
        return _read_vtk(mesh)
    if hasattr(getattr(mesh, "dataset", None), "GetPoints"):  # vedo
        return _read_vtk(mesh.dataset)
    if isinstance(getattr(mesh, "geometry", None), Mapping) and hasattr(mesh, "dump"):  # a scene of trimesh
        return _merge_scene(mesh)
    if hasattr(mesh, "data_to_world"):  # a layer of napari
        return _read_layer(mesh)
    if hasattr(mesh, "vertex") and hasattr(mesh, "triangle"):  # Open3D's tensors
        return _numbers(mesh.vertex["positions"]), _numbers(mesh.triangle["indices"])
    if hasattr(mesh, "point") and "positions" in mesh.point:
        return _numbers(mesh.point["positions"]), None
    if hasattr(mesh, "points") and isinstance(getattr(mesh, "cells", None), list):  # meshio
        return mesh.points, _triangles_of_cells(mesh, mesh.cells)
    return _read_attributes(mesh)


def _read_attributes(mesh: Any) -> _Pair:
    """Arrays of trimesh, Open3D and other objects with vertices and faces or triangles."""
    vertices = getattr(mesh, "vertices", getattr(mesh, "points", None))
    if vertices is None or callable(vertices):
        raise InvalidMeshError(f"mesh: got {type(mesh).__name__}, expected {EXPECTED}")
    for name in ("faces", "triangles"):
        if (faces := getattr(mesh, name, None)) is not None and not callable(faces):
            return vertices, faces
    _refuse_unread(mesh, _connectivity_names(mesh, len(vertices)))
    return vertices, None


def _connectivity_names(mesh: Any, vertex_count: int) -> list[str]:
    """Names of attributes that seem to hold connectivity: by their name, or as rows of indices, not one per vertex."""
    names = []
    for name in dir(mesh):
        words = [word.removesuffix("s") for word in name.lower().split("_")]
        if not words[0]:  # private
            continue
        if not _CONNECTIVITY_WORDS.isdisjoint(words):
            value = getattr(mesh, name, None)
            # methods and numbers with longer names do or count something
            if value is not None and (len(words) == 1 or not (callable(value) or isinstance(value, Real | str))):
                names.append(name)
        elif _is_table_of_indices(getattr(mesh, "__dict__", {}).get(name), vertex_count):
            names.append(name)
    return names


def _is_table_of_indices(value: Any, vertex_count: int) -> bool:
    """Whether a value is an integer array of two or more columns, without a row for each vertex as colours have."""
    return isinstance(value, np.ndarray) and (
        value.dtype.kind in "iu" and value.ndim > 1 and value.shape[1] > 1 and len(value) != vertex_count
    )


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


def _read_vtk(mesh: Any) -> _Pair:
    """Points and triangles of a vtkPolyData; polygons and strips are cut into triangles."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    if not mesh.IsA("vtkPolyData"):
        raise InvalidMeshError(
            f"mesh: got {type(mesh).__name__}, which is not a surface; extract it first, with mesh.extract_surface() "
            "in pyvista or a vtkGeometryFilter in VTK"
        )
    to_numpy: Any = vtk_to_numpy  # has no type annotations
    points = np.empty((0, 3)) if mesh.GetPoints() is None else to_numpy(mesh.GetPoints().GetData())
    triangles = vtkTriangleFilter()
    triangles.PassVertsOff()
    triangles.PassLinesOff()
    triangles.SetInputData(mesh)
    triangles.Update()
    polygons = triangles.GetOutput().GetPolys()
    if not polygons.GetNumberOfCells() and mesh.GetNumberOfLines():
        _refuse_unread(mesh, ["lines"])
    corners = to_numpy(polygons.GetConnectivityArray()) if polygons.GetNumberOfCells() else np.empty(0, np.int32)
    return points, corners.reshape(-1, 3)


def _merge_scene(scene: Any) -> _Pair:
    """All meshes of a scene, or all its points, transformed and merged."""
    parts = [mesh_of_object(part) for part in scene.dump()]
    if not parts:
        raise InvalidMeshError(f"mesh: got {type(scene).__name__}, which is empty")
    if 0 < sum(part.face_count > 0 for part in parts) < len(parts):
        raise InvalidMeshError(
            f"mesh: got {type(scene).__name__} with both meshes and point clouds; pass one of its geometries"
        )
    starts = np.cumsum([0] + [part.vertex_count for part in parts[:-1]])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return np.vstack([part.vertices for part in parts]), np.vstack(faces)


def _read_layer(layer: Any) -> _Pair:
    """Vertices of a surface layer in world coordinates, and faces with the orientation seen there."""
    if not hasattr(layer, "vertices") or not hasattr(layer, "faces"):
        raise InvalidMeshError(f"mesh: got {type(layer).__name__}, expected a surface layer, or {EXPECTED}")
    mesh, placement = triangle_mesh(layer.vertices, layer.faces), placement_of_layer(layer)
    return placement.world_coordinates(mesh.vertices), placement.orient(mesh.faces)


def _triangles_of_cells(mesh: Any, cells: Sequence[Any]) -> NDArray[Any]:
    """Triangles of polygons, or of meshio's cell blocks, concatenated."""
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
    """Array of an Open3D tensor on any device."""
    return np.asarray(tensor.cpu().numpy())
