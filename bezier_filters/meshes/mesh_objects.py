"""Vertices and triangles of mesh objects of other libraries, recognised by their attributes.

A library is imported only where an object of it was given. Objects with faces that cannot be read are refused: without
faces, a surface would pass as a point cloud.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidMeshError

EXPECTED = (
    "a mesh of pyvista, VTK, vedo, trimesh, Open3D, MeshLib, meshio, napari or pymeshlab, a pair (vertices, faces), or "
    "the path of a file"
)
# attributes of mesh objects that arrays do not have
_MESH_ATTRIBUTES = (
    "current_mesh",
    "vertex_matrix",
    "points",
    "point",
    "vertices",
    "vertex",
    "GetPoints",
    "geometry",
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

# VTK's numbers of triangles, polygons and quads, which are stored alike, and of single points
_SURFACE_CELLS, _POINT_CELL = (5, 7, 9), 1
Pair = tuple[Any, Any]  # vertices and faces, not checked; no faces are None


class _HasPoints(Protocol):
    """A mesh or point cloud of pyvista, vedo, meshio, MeshLib or Open3D."""

    @property
    def points(self) -> Any: ...


class _HasVertices(Protocol):
    """A mesh of trimesh, Open3D or this package."""

    @property
    def vertices(self) -> Any: ...


class _HasTensors(Protocol):
    """A mesh of Open3D with tensors."""

    @property
    def vertex(self) -> Any: ...


class _HasPointTensors(Protocol):
    """A point cloud of Open3D with tensors."""

    @property
    def point(self) -> Any: ...


class _IsVtk(Protocol):
    """A mesh of VTK."""

    def GetPoints(self) -> Any: ...


class _IsPymeshlab(Protocol):
    """A mesh of pymeshlab."""

    def vertex_matrix(self) -> Any: ...


class _HasMeshes(Protocol):
    """A MeshSet of pymeshlab."""

    def current_mesh(self) -> Any: ...


class _IsScene(Protocol):
    """A scene of trimesh."""

    @property
    def geometry(self) -> Any: ...


MeshLike: TypeAlias = (
    _HasPoints | _HasVertices | _HasTensors | _HasPointTensors | _IsVtk | _IsPymeshlab | _HasMeshes | _IsScene
)
"""A mesh object of another library, or of this one, in place of vertices and faces."""


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


def is_mesh_object(value: object) -> bool:
    """Whether a value seems to be a mesh object, rather than an array of vertices."""
    return not hasattr(value, "__array__") and any(hasattr(value, name) for name in _MESH_ATTRIBUTES)


def arrays_of_object(mesh: Any) -> Pair:
    """Vertices and faces of an object or a pair; InvalidMeshError for unknown types and faces other than triangles.

    The arrays are not checked, and may be views of the object. Of a point cloud the faces are None.
    """
    vertices, faces = _arrays(mesh)
    is_empty = faces is None or (hasattr(faces, "__len__") and not len(faces))
    return vertices, None if is_empty else faces


def _arrays(mesh: Any) -> Pair:
    if isinstance(mesh, tuple | list):
        return _pair(mesh)
    if hasattr(mesh, "current_mesh"):  # a MeshSet
        current = mesh.current_mesh()  # lives only as long as its MeshSet
        return current.vertex_matrix(), current.face_matrix()
    if hasattr(mesh, "vertex_matrix"):  # pymeshlab
        return mesh.vertex_matrix(), mesh.face_matrix()
    if hasattr(mesh, "IsA") and hasattr(mesh, "GetClassName"):  # VTK, pyvista
        return _read_vtk(mesh)
    if hasattr(getattr(mesh, "dataset", None), "GetPoints"):  # vedo
        return _read_vtk(mesh.dataset)
    if type(mesh).__module__.partition(".")[0] == "meshlib":
        return _read_meshlib(mesh)
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


def _read_attributes(mesh: Any) -> Pair:
    """Arrays of trimesh, Open3D and other objects with vertices and faces or triangles."""
    vertices = getattr(mesh, "vertices", getattr(mesh, "points", None))
    if vertices is None or callable(vertices):
        raise InvalidMeshError(f"mesh: got {type(mesh).__name__}, expected {EXPECTED}")
    for name in ("faces", "triangles"):
        if (faces := getattr(mesh, name, None)) is not None and not callable(faces):
            return vertices, faces
    if type(mesh).__module__.partition(".")[0] == "bezier_filters":  # a result of smoothing
        raise InvalidMeshError(
            f"mesh: got {type(mesh).__name__}, which has no faces; pass its vertices and the faces that were smoothed"
        )
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


def _pair(pair: Sequence[Any]) -> Pair:
    if len(pair) != len(("vertices", "faces")):
        raise InvalidMeshError(f"mesh: got a {type(pair).__name__} of {len(pair)}, expected {EXPECTED}")
    return pair[0], pair[1]


def _read_vtk(mesh: Any) -> Pair:
    """Points and triangles of a surface of VTK; polygons and strips are cut into triangles."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    surface = _polygons_of_grid(mesh) if mesh.IsA("vtkUnstructuredGrid") else mesh
    if surface is None or not surface.IsA("vtkPolyData"):
        raise InvalidMeshError(
            f"mesh: got {type(mesh).__name__}, which is not a surface; extract it first, with mesh.extract_surface() "
            "in pyvista or a vtkGeometryFilter in VTK"
        )
    to_numpy: Any = vtk_to_numpy  # has no type annotations
    points = np.empty((0, 3)) if surface.GetPoints() is None else to_numpy(surface.GetPoints().GetData())
    triangles = vtkTriangleFilter()
    triangles.PassVertsOff()
    triangles.PassLinesOff()
    triangles.SetInputData(surface)
    triangles.Update()
    polygons = triangles.GetOutput().GetPolys()
    if not polygons.GetNumberOfCells() and surface.GetNumberOfLines():
        _refuse_unread(mesh, ["lines"])
    corners = to_numpy(polygons.GetConnectivityArray()) if polygons.GetNumberOfCells() else np.empty(0, np.int32)
    return points, corners.reshape(-1, 3)


def _polygons_of_grid(grid: Any) -> Any:
    """A vtkPolyData with the polygons or points of an unstructured grid; None if it has other cells, or both."""
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    kinds = {grid.GetCellType(k) for k in range(grid.GetNumberOfCells())}
    surface = vtkPolyData()
    surface.SetPoints(grid.GetPoints())
    if kinds and kinds != {_POINT_CELL}:
        if not kinds.issubset(_SURFACE_CELLS):
            return None
        surface.SetPolys(grid.GetCells())
    return surface


def _read_meshlib(mesh: Any) -> Pair:
    """Points and triangles of a mesh, or the points of a cloud, of MeshLib."""
    from importlib import import_module

    library: Any = import_module("meshlib.mrmeshnumpy")
    if hasattr(mesh, "topology") and hasattr(mesh, "points"):
        faces = library.getNumpyFaces(mesh.topology)
        exist = library.getNumpyBitSet(mesh.topology.getValidFaces())  # rows of removed faces are zeros
        return library.getNumpyVerts(mesh), faces[exist[: len(faces)]]
    if hasattr(mesh, "validPoints"):
        return library.toNumpyArray(mesh.points), None
    raise InvalidMeshError(f"mesh: got {type(mesh).__name__}, expected {EXPECTED}")


def _merge_scene(scene: Any) -> Pair:
    """All meshes of a scene, or all its points, transformed and merged."""
    parts = [arrays_of_object(part) for part in scene.dump()]
    if not parts:
        raise InvalidMeshError(f"mesh: got {type(scene).__name__}, which is empty")
    with_faces = [faces for _, faces in parts if faces is not None]
    if 0 < len(with_faces) < len(parts):
        raise InvalidMeshError(
            f"mesh: got {type(scene).__name__} with both meshes and point clouds; pass one of its geometries"
        )
    vertices = [np.asarray(points) for points, _ in parts]
    starts = np.cumsum([0] + [len(points) for points in vertices[:-1]])
    faces = [np.asarray(corners) + start for corners, start in zip(with_faces, starts, strict=False)]
    return np.vstack(vertices), np.vstack(faces) if faces else None


def _read_layer(layer: Any) -> Pair:
    """Vertices of a surface layer in world coordinates, and faces with the orientation seen there."""
    if not hasattr(layer, "vertices") or not hasattr(layer, "faces"):
        raise InvalidMeshError(f"mesh: got {type(layer).__name__}, expected a surface layer, or {EXPECTED}")
    vertices, faces = np.asarray(layer.vertices, np.float64), np.asarray(layer.faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3:  # a layer in the plane, or in time
        raise InvalidMeshError(f"mesh: got a surface layer of shape {vertices.shape}, expected vertices (n, 3)")
    placement = placement_of_layer(layer)
    return placement.world_coordinates(vertices), placement.orient(faces)


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
