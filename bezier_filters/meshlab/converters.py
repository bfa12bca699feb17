"""Conversion of meshes and results to and from other libraries."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.field_arrays import result_arrays
from bezier_filters.fields import ESTIMATES, NORMAL, SMOOTH
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.meshes.mesh import surface_or_points, takes_meshes
from bezier_filters.meshes.mesh_objects import MeshLike, arrays_of_object
from bezier_filters.runtime.extras import import_extra
from bezier_filters.smoothing.smooth import SmoothingResult

if TYPE_CHECKING:
    import open3d
    import pyvista
    import trimesh

Fields = VertexGeometry | SmoothingResult | Mapping[str, ArrayLike] | None


@takes_meshes
def to_pyvista(
    vertices: ArrayLike | MeshLike, faces: ArrayLike | None = None, fields: Fields = None
) -> "pyvista.PolyData":
    """Make a pyvista mesh that has the fields as point data.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int, or None
        Triangles; None for a point cloud.
    fields : VertexGeometry, SmoothingResult or mapping of arrays, optional
        Fields for the point data, numbers and vectors (n, 3); those of results under the names that they have in files
        and other programs (``"bz_mean_curvature"``, ``"bz_direction_max"``, ...).

    Returns
    -------
    pyvista.PolyData
        With copies of the arrays. The fitted normals of a VertexGeometry are the active normals.

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
    >>> bool((mesh["bz_mean_curvature"] == g.mean_curvature).all())
    True
    """
    library = import_extra("pyvista")
    mesh = surface_or_points(vertices, faces)
    if mesh.face_count:
        result: Any = library.PolyData.from_regular_faces(mesh.vertices.copy(), mesh.faces.copy())
    else:
        result = library.PolyData(mesh.vertices.copy())
    for name, values in _columns(fields, mesh.vertex_count).items():
        result.point_data[name] = values
    if isinstance(fields, VertexGeometry):
        result.point_data.active_normals_name = NORMAL
    return cast("pyvista.PolyData", result)


@takes_meshes
def to_trimesh(
    vertices: ArrayLike | MeshLike, faces: ArrayLike | None = None, fields: Fields = None
) -> "trimesh.Trimesh":
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
    >>> bool((mesh.vertex_attributes["bz_k_max"] == g.k_max).all())
    True
    """
    library = import_extra("trimesh")
    mesh = surface_or_points(vertices, faces)
    columns = _columns(fields, mesh.vertex_count)
    normals = fields.normals.copy() if isinstance(fields, VertexGeometry) else None
    result = library.Trimesh(mesh.vertices.copy(), mesh.faces.copy(), vertex_normals=normals, process=False)
    result.vertex_attributes.update(columns)
    return cast("trimesh.Trimesh", result)


@takes_meshes
def to_open3d(
    vertices: ArrayLike | MeshLike, faces: ArrayLike | None = None, fields: Fields = None
) -> "open3d.t.geometry.TriangleMesh | open3d.t.geometry.PointCloud":
    """Make a mesh of Open3D, with tensors, that has the fields as vertex attributes, and the fitted normals as normals.

    Parameters
    ----------
    vertices, faces, fields
        As for `to_pyvista`.

    Returns
    -------
    open3d.t.geometry.TriangleMesh or open3d.t.geometry.PointCloud
        With copies of the arrays in double precision; a cloud if there are no faces. ``to_legacy()`` makes a mesh
        without fields.

    Raises
    ------
    ImportError
        If Open3D is missing.
    InvalidMeshError, InvalidParameterError
        If the arrays are no mesh, or a field has not one row per vertex.

    Examples
    --------
    >>> import bezier_filters as bf
    >>> mesh = bf.to_open3d(shape, geometry)  # doctest: +SKIP
    >>> mesh.vertex["bz_k_max"].numpy()  # doctest: +SKIP
    """
    library = import_extra("open3d", "open3d")
    mesh = surface_or_points(vertices, faces)
    tensor = library.core.Tensor
    if mesh.face_count:
        result: Any = library.t.geometry.TriangleMesh(tensor(mesh.vertices.copy()), tensor(mesh.faces.copy()))
    else:
        result = library.t.geometry.PointCloud(tensor(mesh.vertices.copy()))
    attributes = result.vertex if mesh.face_count else result.point
    for name, values in _columns(fields, mesh.vertex_count).items():
        attributes[name] = tensor(np.ascontiguousarray(values))
    if isinstance(fields, VertexGeometry):
        attributes["normals"] = tensor(fields.normals.copy())
    return cast("open3d.t.geometry.TriangleMesh", result)


def mesh_arrays(mesh: Any) -> tuple[FloatArray, IntArray]:
    """Vertices (n, 3) and triangles (m, 3) of a mesh of another library, or of a file.

    Parameters
    ----------
    mesh : mesh, pair of arrays, or path
        A `pymeshlab.MeshSet`, of which the current mesh is read, or one of its meshes; a `pyvista.PolyData` or another
        `vtkPolyData`, or a `vtkUnstructuredGrid` of polygons; a mesh or points of vedo, trimesh, MeshLib or Open3D
        (with arrays or tensors); a `trimesh.Scene`, whose meshes are joined, each in its place; a `meshio.Mesh` of
        triangles and quads; a surface layer of napari, in the coordinates of the world, with its scale; a mesh or
        result of this package that has vertices and faces; or a pair ``(vertices, faces)``, of which the faces may be
        None. Polygons are cut into triangles; rows of vertices stay.

        Functions of vertices and faces take all these but pairs and paths themselves, in place of the vertices:
        ``estimate_vertex_geometry(mesh, rings=2)``.

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
    owner = mesh
    if isinstance(mesh, str) or hasattr(mesh, "__fspath__"):
        from bezier_filters.meshlab.mesh_files import load_mesh

        owner = load_mesh(mesh, attributes=False)
    checked = surface_or_points(*arrays_of_object(owner))
    return checked.vertices.copy(), checked.faces.copy()


def _columns(fields: Fields, n: int) -> dict[str, NDArray[Any]]:
    if fields is None:
        return {}
    if isinstance(fields, VertexGeometry | SmoothingResult):
        filters = ESTIMATES if isinstance(fields, VertexGeometry) else (SMOOTH,)
        columns = {name: values.copy() for name, values in result_arrays(fields, *filters).items()}
    else:
        columns = {name: np.array(values) for name, values in fields.items()}
    for name, values in columns.items():
        if values.shape[:1] != (n,):
            raise InvalidParameterError(
                f"fields: {name!r} has the shape {values.shape}, expected {n} rows, one for each vertex"
            )
    return columns
