"""Conversion of meshes and results to and from pyvista, trimesh and pymeshlab."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fields import ESTIMATES, SMOOTH, fields_of
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.meshes.mesh import TriangleMesh, takes_arrays, triangle_mesh
from bezier_filters.meshes.mesh_objects import mesh_of_object
from bezier_filters.smoothing.smooth import SmoothingResult

if TYPE_CHECKING:
    import pyvista
    import trimesh

Fields = VertexGeometry | SmoothingResult | Mapping[str, ArrayLike] | None


@takes_arrays
def to_pyvista(vertices: ArrayLike, faces: ArrayLike | None, fields: Fields = None) -> "pyvista.PolyData":
    """Make a pyvista mesh that has the fields as point data.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Coordinates.
    faces : (m, 3) array_like of int, or None
        Triangles; None for a point cloud.
    fields : VertexGeometry, SmoothingResult or mapping of arrays, optional
        Fields for the point data, under their attribute names (``"mean_curvature"``, ``"direction_max"``, ...).

    Returns
    -------
    pyvista.PolyData
        With copies of the arrays.

    Raises
    ------
    ImportError
        If pyvista is missing.
    InvalidMeshError, InvalidParameterError
        If the arrays are no mesh, or a field has not one row per vertex.

    Examples
    --------
    >>> import bezier_filters as bf
    >>> shape = bf.surfaces.torus()
    >>> g = bf.estimate_vertex_geometry(shape.vertices, shape.faces)
    >>> mesh = to_pyvista(shape.vertices, shape.faces, g)
    >>> bool((mesh["mean_curvature"] == g.mean_curvature).all())
    True
    """
    library = _library("pyvista")
    mesh = _mesh(vertices, faces)
    if mesh.face_count:
        result: Any = library.PolyData.from_regular_faces(mesh.vertices.copy(), mesh.faces.copy())
    else:
        result = library.PolyData(mesh.vertices.copy())
    for name, values in _columns(fields, mesh.vertex_count).items():
        result.point_data[name] = values
    return cast("pyvista.PolyData", result)


@takes_arrays
def to_trimesh(vertices: ArrayLike, faces: ArrayLike, fields: Fields = None) -> "trimesh.Trimesh":
    """Make a trimesh mesh that has the fields as vertex attributes, and the fitted normals as vertex normals.

    Parameters
    ----------
    vertices, faces, fields
        As for `to_pyvista`.

    Returns
    -------
    trimesh.Trimesh
        With copies of the arrays, without merging or removal: row i is vertex i.

    Raises
    ------
    ImportError
        If trimesh is missing.
    InvalidMeshError, InvalidParameterError
        If the arrays are no mesh, or a field has not one row per vertex.

    Examples
    --------
    >>> import bezier_filters as bf
    >>> shape = bf.surfaces.torus()
    >>> g = bf.estimate_vertex_geometry(shape.vertices, shape.faces)
    >>> mesh = to_trimesh(shape.vertices, shape.faces, g)
    >>> bool((mesh.vertex_attributes["k_max"] == g.k_max).all())
    True
    """
    library = _library("trimesh")
    mesh = _mesh(vertices, faces)
    columns = _columns(fields, mesh.vertex_count)
    normals = fields.normals.copy() if isinstance(fields, VertexGeometry) else None
    result = library.Trimesh(mesh.vertices.copy(), mesh.faces.copy(), vertex_normals=normals, process=False)
    result.vertex_attributes.update(columns)
    return cast("trimesh.Trimesh", result)


def mesh_arrays(mesh: Any) -> tuple[FloatArray, IntArray]:
    """Vertices (n, 3) and triangles (m, 3) of a mesh of another library, or of a file.

    Parameters
    ----------
    mesh : mesh, pair of arrays, or path
        A `pymeshlab.MeshSet`, of which the current mesh is read, or one of its meshes; a `pyvista.PolyData` or another
        `vtkPolyData`; a mesh or points of vedo, trimesh or Open3D (with arrays or tensors); a `trimesh.Scene`, whose
        meshes are joined, each in its place; a `meshio.Mesh` of triangles and quads; a surface layer of napari, in the
        coordinates of the world, with its scale; or a pair ``(vertices, faces)``, of which the faces may be None.
        Polygons are cut into triangles; rows of vertices stay.

    Returns
    -------
    vertices, faces : (n, 3) float64, (m, 3) int32
        Copies; no faces for a point cloud.

    Raises
    ------
    InvalidMeshError
        If it is none of these, its faces cannot be read, or its arrays are not a mesh.
    BezierFilterError
        If the file cannot be read.

    Examples
    --------
    >>> import pyvista
    >>> vertices, faces = mesh_arrays(pyvista.Sphere())
    >>> vertices.shape, faces.shape
    ((842, 3), (1680, 3))
    """
    owner = mesh  # a mesh of pymeshlab lives only as long as its MeshSet
    if isinstance(mesh, str) or hasattr(mesh, "__fspath__"):
        from bezier_filters.meshlab.mesh_files import load_mesh

        owner = load_mesh(mesh, attributes=False)
    checked = mesh_of_object(owner.current_mesh() if hasattr(owner, "current_mesh") else owner)
    return checked.vertices.copy(), checked.faces.copy()


def _mesh(vertices: ArrayLike, faces: ArrayLike | None) -> TriangleMesh:
    return triangle_mesh(vertices, np.empty((0, 3), np.int32) if faces is None else faces)


def _columns(fields: Fields, n: int) -> dict[str, NDArray[Any]]:
    if fields is None:
        return {}
    if isinstance(fields, VertexGeometry | SmoothingResult):
        filters = ESTIMATES if isinstance(fields, VertexGeometry) else (SMOOTH,)
        names = dict.fromkeys(field.source for field in fields_of(*filters) if field.attribute is not None)
        columns = {name: np.array(getattr(fields, name)) for name in names}
    else:
        columns = {name: np.array(values) for name, values in fields.items()}
    for name, values in columns.items():
        if values.shape[:1] != (n,):
            raise InvalidParameterError(
                f"fields: {name!r} has the shape {values.shape}, expected {n} rows, one for each vertex"
            )
    return columns


def _library(name: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError as error:
        raise ImportError(f'{name} is missing: pip install "bezier-filters[convert]" ({error})') from error
