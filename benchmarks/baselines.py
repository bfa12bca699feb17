"""The methods that the paper compares itself with.

Neither has a public implementation, and neither article was at hand: each docstring says how
the method was read.
"""

from typing import Literal, get_args

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.estimation.vertex_geometry import VertexGeometry
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.runtime.parallel import Progress, RangeTask, run_in_chunks, thread_count

ShapeEquations = Literal["edges", "twists"]
_SMOOTHNESS: dict[ShapeEquations, Smoothness] = {"edges": "paper", "twists": "twists"}
TIE = 1e-6
"""Difference of cosines below which two neighbours are equally opposite: far above rounding."""
ONE_LINE = 0.01
"""Share of the tangents across their main direction, in squares: below, they leave the normal open."""


def razdan_bae(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    rings: int = 2,
    alpha: float = 0.8,
    shape: ShapeEquations = "edges",
    threads: int | None = None,
    progress: Progress | None = None,
) -> VertexGeometry:
    """Normals and curvatures from biquadratic Bezier patches, after Razdan and Bae.

    Solves [alpha A; (1 - alpha) S] b = [alpha z; 0] for the nine control points over the k-ring
    of every vertex (Razdan, Bae, "Curvature estimation scheme for triangle meshes using
    biquadratic Bezier patches", Computer-Aided Design 37, 2005). The exact rows S of that
    article were not available; both readings here have four. Both penalise quadratics, so for
    alpha < 1 the curvature is biased at every resolution.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Coordinates.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    rings : int
        Size of the neighbourhood in edges, at least 1.
    alpha : float
        Weight of the points against the shape equations, in (0, 1].
    shape : {"edges", "twists"}
        ``"edges"``: the second differences of the four boundary polygons, as Li, Barsky and Jin
        have them for degree 3. ``"twists"``: b_ij - b_(i+1)j - b_i(j+1) + b_(i+1)(j+1) = 0,
        Farin's usual shape equations.
    threads, progress
        As in `estimate_vertex_geometry`.

    Returns
    -------
    VertexGeometry
        Curvatures in 1/length, positive where the surface is convex towards its outside. A
        vertex whose neighbourhood does not determine the patch has a fallback, see `status`.

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with finite coordinates.
    InvalidParameterError
        If a parameter is out of range.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    The bias on a sphere, whose mean curvature is 1:

    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=20)
    >>> [round(float(razdan_bae(ball.vertices, ball.faces, alpha=a).mean_curvature.mean()), 2) for a in (0.8, 1)]
    [1.14, 1.0]
    """
    if shape not in _SMOOTHNESS:
        raise InvalidParameterError(f"shape: got {shape!r}, expected one of {get_args(ShapeEquations)}")
    return estimate_vertex_geometry(
        vertices,
        faces,
        rings=rings,
        alpha=alpha,
        degree=2,
        smoothness=_SMOOTHNESS[shape],
        threads=threads,
        progress=progress,
    )


def ouyang_feng_normals(vertices: ArrayLike, faces: ArrayLike, *, threads: int | None = None) -> FloatArray:
    """Vertex normals from tangents of curves through opposite neighbours, after OuYang and Feng.

    Every neighbour is paired with the one most opposite to it in the tangent plane; the parabola
    through both and the vertex, with chord lengths as parameters, has a unit tangent t there. The
    normal n minimises the variance of the dot products n . t (OuYang, Feng, "On the normal vector
    estimation for point cloud data from smooth surfaces", Computer-Aided Design 37, 2005).

    The reading: the mesh's 1-ring stands for the article's local Voronoi mesh. The parabola has
    no direction of travel, so t and -t count alike; their mean is zero, and n is the eigenvector of
    sum t t^T with the smallest eigenvalue, turned to the side of the mean face normal. Every
    neighbour gives one tangent: equally opposite partners share its weight. Where no partner is
    more than a right angle away, as in corners, the tangent is the chord. Tangents along one line
    leave the normal open; the mean face normal is taken. The normals of a closed mesh with its
    vertices on a sphere are exact.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Coordinates.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result
        does not depend on it.

    Returns
    -------
    (n, 3) float64
        Unit normals, outward; zero where no face has an area or the face normals cancel out.

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with finite coordinates.
    InvalidParameterError
        If `threads` is out of range.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(jitter=0.3)
    >>> bool(np.abs(ouyang_feng_normals(ball.vertices, ball.faces) - ball.normals).max() < 1e-12)
    True
    """
    mesh = triangle_mesh(vertices, faces)
    threads = thread_count(threads)
    adjacency = vertex_adjacency(mesh)
    face_means = tangent_planes(mesh, adjacency, threads=threads).normals
    scatter = np.zeros((mesh.vertex_count, 3, 3))
    rows = adjacency.vertices

    def make_task() -> RangeTask:
        capacity = int(rows.lengths.max(initial=0))
        edges, directions = np.empty((capacity, 3)), np.empty((capacity, 3))
        return lambda start, stop: _scatter_tangents(
            mesh.vertices, rows.indptr, rows.indices, face_means, start, stop, edges, directions, scatter
        )

    run_in_chunks(make_task, mesh.vertex_count, threads=threads)
    spreads, axes = np.linalg.eigh(scatter)
    normals: FloatArray = axes[:, :, 0]
    side = np.einsum("ni,ni->n", normals, face_means)
    normals = np.where(side[:, np.newaxis] < 0.0, -normals, normals)
    decided = spreads[:, 1] > ONE_LINE * spreads[:, 2]
    return np.where((decided & face_means.any(axis=1))[:, np.newaxis], normals, face_means)


@njit(cache=True, nogil=True, error_model="numpy")
def _scatter_tangents(
    vertices: FloatArray,
    ring_ptr: IntArray,
    ring_indices: IntArray,
    face_means: FloatArray,
    start: int,
    stop: int,
    edges: FloatArray,
    directions: FloatArray,
    scatter: FloatArray,
) -> None:
    """Write sum t t^T of the unit tangents t into scatter[start:stop], (n, 3, 3).

    `edges` and `directions`, (largest valence, 3), are work space.
    """
    for i in range(start, stop):
        count = 0
        for q in range(ring_ptr[i], ring_ptr[i + 1]):
            edge, direction = edges[count], directions[count]
            height = 0.0
            for k in range(3):
                edge[k] = vertices[ring_indices[q], k] - vertices[i, k]
                height += edge[k] * face_means[i, k]
            for k in range(3):
                direction[k] = edge[k] - height * face_means[i, k]
            length = _length(direction)
            if length > 0.0:  # a neighbour straight above has no opposite
                direction /= length
                count += 1
        for a in range(count):
            lowest = 0.0
            for b in range(count):
                lowest = min(lowest, _cosine(directions, a, b))
            if lowest > -TIE:
                _add_square(edges[a], 1.0, scatter[i])
                continue
            ties = 0
            for b in range(count):
                ties += _cosine(directions, a, b) <= lowest + TIE
            ahead = _length(edges[a])
            for b in range(count):
                if _cosine(directions, a, b) <= lowest + TIE:
                    back = _length(edges[b])
                    tangent = edges[a] * (back * back) - edges[b] * (ahead * ahead)
                    _add_square(tangent, 1.0 / ties, scatter[i])


@njit(cache=True, nogil=True, error_model="numpy")
def _cosine(directions: FloatArray, a: int, b: int) -> float:
    return float(
        directions[a, 0] * directions[b, 0] + directions[a, 1] * directions[b, 1] + directions[a, 2] * directions[b, 2]
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _length(vector: FloatArray) -> float:
    return float(np.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]))


@njit(cache=True, nogil=True, error_model="numpy")
def _add_square(vector: FloatArray, weight: float, scatter: FloatArray) -> None:
    """Add weight t t^T of the unit vector t along a vector, if it has a length."""
    square = vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]
    if square > 0.0:
        for r in range(3):
            for c in range(3):
                scatter[r, c] += weight * vector[r] * vector[c] / square
