"""The triangle mesh that every array function works on, checked once."""

from dataclasses import dataclass
from functools import cached_property
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidMeshError
from bezier_filters.meshes.array_arguments import takes_arrays

SMALLEST, LARGEST = 1e-40, 1e40
"""Sizes of the largest coordinate between which fourth powers of lengths and curvatures are floating point numbers."""


@dataclass(frozen=True)
class TriangleMesh:
    """Vertices and triangles that are known to fit together; make it with `triangle_mesh`.

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


@takes_arrays
def triangle_mesh(vertices: ArrayLike, faces: ArrayLike) -> TriangleMesh:
    """Check arrays and make a mesh of them.

    Parameters
    ----------
    vertices : (n, 3) array_like
        Coordinates; converted to contiguous float64.
    faces : (m, 3) array_like of integers
        Vertex indices; converted to contiguous int32.

    Raises
    ------
    InvalidMeshError
        If a shape is wrong, a coordinate is not finite or beyond `LARGEST`, all are below `SMALLEST`, or an index is
        out of range.

    Examples
    --------
    >>> mesh = triangle_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> mesh.face_count
    1
    """
    points = _real_array(vertices)
    triangles = _index_array(faces)
    largest = max(points.max(initial=0.0), -points.min(initial=0.0))
    if not largest <= LARGEST:  # or NaN
        _explain(points)
    if 0.0 < largest < SMALLEST:
        raise InvalidMeshError(
            f"vertices: no coordinate is larger than {largest:g}, too small to compute with; scale the mesh to at "
            f"least {SMALLEST:g}"
        )
    if triangles.size and (triangles.min() < 0 or triangles.max() >= len(points)):
        raise InvalidMeshError(
            f"faces: indices run from {triangles.min()} to {triangles.max()}, "
            f"expected 0 to {len(points) - 1} for {len(points)} vertices"
        )
    return TriangleMesh(points, np.ascontiguousarray(triangles, dtype=np.int32))


@dataclass(frozen=True)
class MeshReport:
    """What `inspect_mesh` found; counts of vertices, faces or edges.

    Attributes
    ----------
    unreferenced_vertices : int
        Vertices of no face.
    degenerate_faces : int
        Faces that name a vertex twice or have zero area.
    duplicate_faces : int
        Faces on the same three vertices as an earlier one.
    boundary_edges : int
        Edges of one face only.
    non_manifold_edges : int
        Edges of three or more faces.
    incoherent_edges : int
        Edges that their two faces run through in the same direction.
    mean_edge_length : float
        Mean over the distinct edges, in units of length; 0 without edges.
    """

    unreferenced_vertices: int
    degenerate_faces: int
    duplicate_faces: int
    boundary_edges: int
    non_manifold_edges: int
    incoherent_edges: int
    mean_edge_length: float

    @cached_property
    def is_coherently_oriented(self) -> bool:
        """Whether all neighbouring faces agree on which side is outside."""
        return self.incoherent_edges == 0


def inspect_mesh(mesh: TriangleMesh) -> MeshReport:
    """Count what makes a mesh hard to fit: see `MeshReport`."""
    a, b, c = mesh.faces.T
    twice = (a == b) | (b == c) | (c == a)
    proper = mesh.faces[~twice]
    corners = mesh.vertices[proper]
    flat = ~np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any(axis=1)
    triples = np.sort(mesh.faces, axis=1)
    triples = triples[np.lexsort(triples.T)]
    duplicates = (triples[1:] == triples[:-1]).all(axis=1)

    directed = proper[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    low, high = directed.min(axis=1), directed.max(axis=1)
    edges, edge_of, count = np.unique(low * mesh.vertex_count + high, return_inverse=True, return_counts=True)
    forward = np.bincount(edge_of, weights=directed[:, 0] < directed[:, 1], minlength=len(edges))
    low, high = np.divmod(edges, max(mesh.vertex_count, 1))
    lengths = np.linalg.norm(mesh.vertices[low] - mesh.vertices[high], axis=1)
    return MeshReport(
        unreferenced_vertices=mesh.vertex_count - len(np.unique(mesh.faces)),
        degenerate_faces=int(twice.sum() + flat.sum()),
        duplicate_faces=int(duplicates.sum()),
        boundary_edges=int((count == 1).sum()),
        non_manifold_edges=int((count > 2).sum()),
        incoherent_edges=int(((count == 2) & (forward != 1)).sum()),
        mean_edge_length=float(lengths.mean()) if len(lengths) else 0.0,
    )


def _explain(points: FloatArray) -> NoReturn:
    """Say what is wrong with coordinates."""
    bad = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
    if bad:
        raise InvalidMeshError(
            f"vertices: {bad} of {len(points)} have a coordinate that is NaN or infinite; remove them first"
        )
    bad = int(np.count_nonzero((np.abs(points) > LARGEST).any(axis=1)))
    raise InvalidMeshError(
        f"vertices: {bad} of {len(points)} have a coordinate beyond {LARGEST:g}, too large to compute with; "
        "remove them, or scale the mesh"
    )


def _real_array(vertices: ArrayLike) -> FloatArray:
    try:
        points = np.ascontiguousarray(vertices, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidMeshError(f"vertices: expected real numbers of shape (n, 3); {error}") from None
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidMeshError(f"vertices: got shape {points.shape}, expected (n, 3)")
    return points


def _index_array(faces: ArrayLike) -> IntArray:
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
    """What to do about faces of another shape."""
    if faces.ndim == 1 and len(faces) % 4 == 0 and (faces[::4] == 3).all():
        return "these are pyvista's, with the number 3 before each: pass mesh.regular_faces, or use mesh_arrays(mesh)"
    return "triangulate polygons first"
