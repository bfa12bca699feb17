"""The methods that the paper compares itself with.

None of the three has a public implementation, and none of the articles was at hand: each docstring
says how the method was read.
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fitting.fallbacks import fit_patches
from bezier_filters.fitting.vertex_geometry import FitChoice, VertexGeometry
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.half_edges import face_neighbours
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.patches.patch_fit import PatchFit
from bezier_filters.runtime.parallel import Progress, RangeTask, run_in_chunks, runs_on_threads

ShapeEquations = Literal["edges", "twists"]
TIE = 1e-6
"""Difference of cosines below which two neighbours are equally opposite: far above rounding."""
ONE_LINE = 0.01
"""Share of the tangents across their main direction, in squares: below, they leave the normal open."""
SCALES = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
"""Widths of Gaussians, in mean distances between the centroids of faces that share an edge."""
REACH = 2.5
"""Widths of a Gaussian up to which faces have a weight."""


@dataclass(frozen=True)
class TwistFit(PatchFit):
    """A fit whose smoothness rows are the twists of the control net."""

    @property
    def smoothness_rows(self) -> FloatArray:
        """Rows S, see `control_net_twists`."""
        return control_net_twists(self.degree)


def control_net_twists(degree: int) -> FloatArray:
    """Twists b_ij - b_(i+1)j - b_i(j+1) + b_(i+1)(j+1) of the control net, shape (d^2, (d+1)^2).

    They vanish if every mesh of the control net is a parallelogram.
    """
    differences = np.diff(np.eye(degree + 1), axis=0)
    return np.asarray(np.kron(differences, differences), dtype=np.float64)


@runs_on_threads
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
    if shape not in get_args(ShapeEquations):
        raise InvalidParameterError(f"shape: got {shape!r}, expected one of {get_args(ShapeEquations)}")
    fit = PatchFit(2, alpha, "paper") if shape == "edges" else TwistFit(2, alpha, "paper")
    geometry = fit_patches(triangle_mesh(vertices, faces), rings, fit, progress=progress)
    return replace(geometry, fit=FitChoice(rings, 2, alpha, None))


@runs_on_threads
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
    adjacency = vertex_adjacency(mesh)
    face_means = tangent_planes(mesh, adjacency).normals
    scatter = np.zeros((mesh.vertex_count, 3, 3))
    rows = adjacency.vertices

    def make_task() -> RangeTask:
        capacity = int(rows.lengths.max(initial=0))
        edges, directions = np.empty((capacity, 3)), np.empty((capacity, 3))
        return lambda start, stop: _scatter_tangents(
            mesh.vertices, rows.indptr, rows.indices, face_means, start, stop, edges, directions, scatter
        )

    run_in_chunks(make_task, mesh.vertex_count)
    spreads, axes = np.linalg.eigh(scatter)
    normals: FloatArray = axes[:, :, 0]
    side = np.einsum("ni,ni->n", normals, face_means)
    normals = np.where(side[:, np.newaxis] < 0.0, -normals, normals)
    decided = spreads[:, 1] > ONE_LINE * spreads[:, 2]
    return np.where((decided & face_means.any(axis=1))[:, np.newaxis], normals, face_means)


def adaptive_gaussian_smoothing(
    vertices: ArrayLike, faces: ArrayLike, *, rounds: int = 10, noise: float | None = None
) -> FloatArray:
    """Vertices of a mesh smoothed by adaptive Gaussian filtering of its normals, after Ohtake, Belyaev and Seidel.

    Every round replaces the normal of every face T by the mean of those around it, with weights A(S) G(d(T, S)) of area
    and of a Gaussian of the distance; its width s is the one of `SCALES` with the smallest c / s^2 + V(s), where
    V is the weighted variance of the normals. Then every vertex P takes the step of the mean of
    ((C_T - P) . m_T) m_T over its faces, weighed by area, C_T the centroid and m_T the mean normal (Ohtake, Belyaev,
    Seidel, "Mesh smoothing by adaptive and anisotropic Gaussian filter applied to mesh normals", VMV 2002).

    The reading: distances are those along centroids of faces that share an edge. The article leaves c to the user;
    here, without `noise`, it is the median over the faces of V(s) s^2 of the narrowest Gaussian, the variance that
    noise leaves if it falls off with the number of faces, before the first round.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Coordinates.
    faces : (m, 3) array_like of int
        Triangles.
    rounds : int
        How often.
    noise : float, optional
        The article's c, for widths in mean distances of neighbouring centroids.

    Returns
    -------
    (n, 3) float64

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with finite coordinates.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=16)
    >>> noisy = ball.vertices * (1.0 + 0.01 * np.random.default_rng(0).standard_normal((len(ball.vertices), 1)))
    >>> smooth = adaptive_gaussian_smoothing(noisy, ball.faces)
    >>> bool(np.linalg.norm(smooth, axis=1).std() < 0.5 * np.linalg.norm(noisy, axis=1).std())
    True
    """
    mesh = triangle_mesh(vertices, faces)
    points, beside = mesh.vertices.copy(), face_neighbours(mesh.faces)
    rows = vertex_adjacency(mesh).faces
    for _ in range(rounds if mesh.face_count else 0):
        corners = points[mesh.faces]
        centroids = corners.mean(axis=1)
        normals = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        normals /= np.maximum(areas, 1e-300)[:, np.newaxis]
        unit = _mean_step(centroids, beside)
        means, variances = gaussian_means(centroids / unit, areas, normals, beside, np.array(SCALES))
        if noise is None:
            noise = float(np.median(variances[:, 0])) * SCALES[0] ** 2
        best = np.argmin(noise / np.square(SCALES) + variances, axis=1)
        filtered = means[np.arange(len(means)), best]
        moves = np.zeros_like(points)
        _add_moves(points, centroids, areas, filtered, rows.indptr, rows.indices, moves)
        points += moves
    return points


def _mean_step(centroids: FloatArray, beside: IntArray) -> float:
    """Mean distance between the centroids of faces that share an edge."""
    face, side = np.nonzero(beside >= 0)
    steps = np.linalg.norm(centroids[face] - centroids[beside[face, side]], axis=1)
    return float(steps.mean()) if len(steps) and steps.any() else 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def gaussian_means(
    centroids: FloatArray, areas: FloatArray, normals: FloatArray, beside: IntArray, widths: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Unit mean normals (m, s, 3) around each face by Gaussians of some widths, and the variances (m, s)."""
    m, count = len(centroids), len(widths)
    means, variances = np.zeros((m, count, 3)), np.zeros((m, count))
    distances = np.full(m, np.inf)
    room = m + 1  # the queue is never full
    queue = np.empty(room, dtype=np.int32)
    waiting = np.zeros(m, dtype=np.bool_)
    found = np.empty(m, dtype=np.int32)
    reach = REACH * widths.max()
    for start in range(m):
        first, last, reached = 0, 1, 1
        queue[0], found[0] = start, start
        distances[start] = 0.0
        waiting[start] = True
        while first != last:  # shortest paths, each face again whenever a shorter one to it is found
            face = queue[first]
            first = (first + 1) % room
            waiting[face] = False
            for k in range(3):
                other = beside[face, k]
                if other < 0:
                    continue
                along = distances[face] + _length(centroids[other] - centroids[face])
                if along > reach or along >= distances[other]:
                    continue
                if distances[other] == np.inf:
                    found[reached] = other
                    reached += 1
                distances[other] = along
                if not waiting[other]:
                    waiting[other] = True
                    queue[last] = other
                    last = (last + 1) % room
        for s in range(count):
            total, mean = 0.0, means[start, s]
            for q in range(reached):
                ratio = distances[found[q]] / widths[s]
                if ratio <= REACH:
                    weight = areas[found[q]] * np.exp(-0.5 * ratio * ratio)
                    total += weight
                    mean += weight * normals[found[q]]
            length = _length(mean)
            if total > 0.0 and length > 0.0:
                variances[start, s] = 1.0 - (length / total) ** 2  # mean of |n - mean|^2 of unit vectors
                mean /= length
        for q in range(reached):
            distances[found[q]] = np.inf
    return means, variances


@njit(cache=True, nogil=True, error_model="numpy")
def _add_moves(
    points: FloatArray,
    centroids: FloatArray,
    areas: FloatArray,
    normals: FloatArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    moves: FloatArray,
) -> None:
    """Write the step of every vertex."""
    for i in range(len(points)):
        total = 0.0
        for q in range(face_ptr[i], face_ptr[i + 1]):
            f = face_indices[q]
            height = 0.0
            for k in range(3):
                height += (centroids[f, k] - points[i, k]) * normals[f, k]
            moves[i] += areas[f] * height * normals[f]
            total += areas[f]
        if total > 0.0:
            moves[i] /= total


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
