"""The triangle mesh of all array functions, validated once."""

import os
from collections.abc import Callable, Sized
from dataclasses import dataclass
from functools import wraps
from typing import Any, NoReturn, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arguments import brief_repr, checks_arguments, real_array
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.meshes.mesh_objects import MeshLike, arrays_of_object, is_mesh_object

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

# bounds of the largest coordinate, in units of the mesh: fourth powers of lengths and curvatures stay within float64
MIN_COORDINATE, MAX_COORDINATE = 1e-40, 1e40


@dataclass(frozen=True)
class TriangleMesh:
    """Validated vertices and triangles; make it with `triangle_mesh`.

    Attributes
    ----------
    vertices : (n, 3) float64
        Finite coordinates.
    faces : (m, 3) int32
        Vertex indices in 0 .. n-1, counter-clockwise seen from outside.
    """

    vertices: FloatArray
    faces: IntArray

    @property
    def vertex_count(self) -> int:
        """Number of vertices, unreferenced ones included."""
        return len(self.vertices)

    @property
    def face_count(self) -> int:
        """Number of triangles, degenerate ones included."""
        return len(self.faces)


def takes_meshes(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Let a mesh object be the first argument of a function, in place of its first two, vertices and faces.

    Later arguments move up. Paths are refused. The other arguments are checked by their annotations.

    >>> @takes_meshes
    ... def count(vertices, faces=None, factor=1):
    ...     return factor * len(vertices)
    >>> mesh = triangle_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> count(mesh.vertices, mesh.faces, 2), count(mesh, 2)
    (6, 6)
    >>> count("scan.ply")
    Traceback (most recent call last):
        ...
    bezier_filters.errors.InvalidMeshError: vertices: got a str, expected an array of shape (n, 3) or a mesh object; \
`vertices, faces = bezier_filters.mesh_arrays(...)` reads files
    """
    checks = checks_arguments(function)

    @wraps(function)
    def wrapper(*args: Parameters.args, **options: Parameters.kwargs) -> Result:
        first = args[0] if args else options.get("vertices")
        if isinstance(first, str | os.PathLike):
            raise InvalidMeshError(
                f"vertices: got a {type(first).__name__}, expected an array of shape (n, 3) or a mesh object; "
                "`vertices, faces = bezier_filters.mesh_arrays(...)` reads files"
            )
        _refuse_pair(first)
        if not is_mesh_object(first):
            return checks(*args, **options)
        rest, faces = args[1:], options.pop("faces", None)
        if rest and (rest[0] is None or _are_faces(rest[0])):
            faces, rest = rest[0], rest[1:]
        _refuse_faces(first, faces)
        options.pop("vertices", None)
        unwrapped: Any = checks
        return cast("Result", unwrapped(*arrays_of_object(first), *rest, **options))

    return wrapper


def _refuse_pair(first: object) -> None:
    """Refuse a pair of two tables, vertices and faces, in place of vertices."""
    if isinstance(first, tuple | list) and len(first) == 2 and all(_is_table(part) for part in first):
        raise InvalidMeshError(
            f"vertices: got a {type(first).__name__} of two arrays, expected vertices and faces as two arguments: "
            "f(vertices, faces), or f(*pair)"
        )


def _is_table(value: object) -> bool:
    try:
        return np.ndim(cast("ArrayLike", value)) == 2
    except ValueError:  # rows of different lengths
        return False


def _are_faces(value: object) -> bool:
    """Whether an argument after a mesh object seems to be an array of faces, rather than the next argument."""
    if not (hasattr(value, "__array__") or isinstance(value, tuple | list)):
        return False
    try:
        shape = np.shape(cast("ArrayLike", value))
    except ValueError:  # rows of different lengths
        return False
    return len(shape) == 2 and shape[1] == 3


def _refuse_faces(mesh: object, faces: object) -> None:
    """Refuse faces that come with a mesh object."""
    if faces is not None:
        raise InvalidMeshError(
            f"faces: got both a {type(mesh).__name__} and {brief_repr(faces)}, expected the mesh alone"
        )


@takes_meshes
def triangle_mesh(vertices: ArrayLike | MeshLike, faces: ArrayLike | None = None) -> TriangleMesh:
    """Validate arrays and make a mesh of them.

    Parameters
    ----------
    vertices : (n, 3) array_like
        Coordinates; converted to contiguous float64. Or a mesh object of another library, see `mesh_arrays`, and no
        faces.
    faces : (m, 3) array_like of integers
        Vertex indices; converted to contiguous int32.

    Raises
    ------
    InvalidMeshError
        If a shape is wrong, a coordinate is not finite or beyond `MAX_COORDINATE`, all are below `MIN_COORDINATE`, or
        an index is out of range.

    Examples
    --------
    >>> mesh = triangle_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> mesh.face_count
    1
    """
    points = _real_array(vertices)
    triangles = _index_array(faces)
    largest = max(points.max(initial=0.0), -points.min(initial=0.0))
    if not largest <= MAX_COORDINATE:  # or NaN
        _refuse_coordinates(points)
    if 0.0 < largest < MIN_COORDINATE:
        raise InvalidMeshError(
            f"vertices: the largest coordinate is {largest:g}, too small to compute with; scale the mesh to at "
            f"least {MIN_COORDINATE:g}"
        )
    if triangles.size and (triangles.min() < 0 or triangles.max() >= len(points)):
        raise InvalidMeshError(
            f"faces: indices run from {triangles.min()} to {triangles.max()}, "
            f"expected 0 to {len(points) - 1} for {len(points)} vertices"
        )
    return TriangleMesh(points, np.ascontiguousarray(triangles, dtype=np.int32))


def surface_or_points(vertices: ArrayLike | MeshLike, faces: ArrayLike | None = None) -> TriangleMesh:
    """Mesh of vertices and faces, or of a mesh object; without faces a point cloud."""
    if is_mesh_object(vertices):
        _refuse_faces(vertices, faces)
        vertices, faces = arrays_of_object(vertices)
    return triangle_mesh(vertices, [] if faces is None else faces)


def check_has_faces(faces: ArrayLike | None) -> None:
    """Refuse a point cloud where a mesh is needed."""
    if faces is None or (isinstance(faces, Sized) and not len(faces)):
        raise InvalidMeshError("faces: got none; this needs a surface, not a point cloud")


def ensure_mesh(mesh: ArrayLike | MeshLike, faces: ArrayLike | None = None) -> TriangleMesh:
    """Return a TriangleMesh unchanged, or make one of another mesh object, or of vertices and faces."""
    if isinstance(mesh, TriangleMesh):
        _refuse_faces(mesh, faces)
        return mesh
    if faces is None and not is_mesh_object(mesh):
        raise InvalidMeshError(
            f"mesh: got {brief_repr(mesh)}, expected a TriangleMesh (see triangle_mesh) or another mesh object, or "
            "vertices and faces"
        )
    return triangle_mesh(mesh, faces)


def check_selection(selected: BoolArray, n: int, name: str = "selected") -> BoolArray:
    """Validate a selection of n vertices, (n,); InvalidParameterError if it is none."""
    try:
        mask = np.asarray(selected)
    except ValueError as error:
        raise InvalidParameterError(f"{name}: expected bool of shape ({n},); {error}") from None
    if mask.shape != (n,) or mask.dtype != np.bool_:
        raise InvalidParameterError(f"{name}: got {mask.dtype} of shape {mask.shape}, expected bool of shape ({n},)")
    return mask


def _refuse_coordinates(points: FloatArray) -> NoReturn:
    """Raise an error that says what is wrong with coordinates."""
    bad = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
    if bad:
        raise InvalidMeshError(
            f"vertices: {bad} of {len(points)} have a coordinate that is NaN or infinite; remove them first"
        )
    bad = int(np.count_nonzero((np.abs(points) > MAX_COORDINATE).any(axis=1)))
    raise InvalidMeshError(
        f"vertices: {bad} of {len(points)} have a coordinate beyond {MAX_COORDINATE:g}, too large to compute with; "
        "remove them, or scale the mesh"
    )


def _real_array(vertices: object) -> FloatArray:
    try:
        points = real_array(vertices)
    except (TypeError, ValueError) as error:
        raise InvalidMeshError(f"vertices: expected real numbers of shape (n, 3); {error}") from None
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidMeshError(f"vertices: got shape {points.shape}, expected (n, 3)")
    return points


def _index_array(faces: ArrayLike | None) -> IntArray:
    if faces is None:
        raise InvalidMeshError(
            "faces: got None, expected integers of shape (m, 3); this needs a surface: reconstruct one from the points "
            "first, for example with MeshLab's screened Poisson reconstruction"
        )
    try:
        triangles = np.asarray(faces)
    except ValueError as error:
        raise InvalidMeshError(f"faces: expected integers of shape (m, 3), triangles only; {error}") from None
    if triangles.size == 0:
        return np.empty((0, 3), dtype=np.int32)
    if triangles.ndim != 2 or triangles.shape[1] != 3:
        raise InvalidMeshError(f"faces: got shape {triangles.shape}, expected (m, 3); {_remedy(triangles)}")
    if not np.issubdtype(triangles.dtype, np.integer):
        raise InvalidMeshError(f"faces: got dtype {triangles.dtype}, expected integers")
    return triangles


def _remedy(faces: IntArray) -> str:
    """Remedy for faces of another shape."""
    if faces.ndim == 1 and len(faces) % 4 == 0 and (faces[::4] == 3).all():
        return "these are pyvista's, with the number 3 before each: pass mesh.regular_faces, or use mesh_arrays(mesh)"
    if faces.ndim == 2 and faces.shape[1] > 3:
        return "triangulate polygons first"
    return "a row for each triangle"


def check_normals(normals: ArrayLike | None, mesh: TriangleMesh) -> FloatArray | None:
    """Check the normals of a point cloud; those of meshes with faces are refused."""
    if normals is None:
        return None
    if mesh.face_count:
        raise InvalidParameterError("normals: not allowed for a mesh with faces, whose orientation defines the outside")
    return check_vectors(normals, mesh, "normals")


def check_vectors(given: ArrayLike, mesh: TriangleMesh, name: str, *, one_for_all: bool = False) -> FloatArray:
    """Check vectors at the vertices of a mesh."""
    try:
        vectors = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"{name}: expected real numbers of shape (n, 3); {error}") from None
    fits = vectors.shape == mesh.vertices.shape or (one_for_all and vectors.shape == (3,))
    if not fits or not np.isfinite(vectors).all():
        raise InvalidParameterError(
            f"{name}: got shape {vectors.shape}, expected finite numbers of shape {mesh.vertices.shape}"
        )
    return vectors
