"""Smoothing: the function that users call."""

from numbers import Integral, Real
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.estimation.first_call import first_call
from bezier_filters.kernels.kernel_input import kernel_mesh
from bezier_filters.learning.learn import learn_surface
from bezier_filters.learning.plans import Choices
from bezier_filters.meshes.adjacency import Adjacency, vertex_adjacency
from bezier_filters.meshes.array_arguments import takes_arrays
from bezier_filters.meshes.creases import crease_vertices
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh, triangle_mesh
from bezier_filters.runtime.lean import lean_njit
from bezier_filters.runtime.parallel import Progress, RangeTask, run_in_chunks, thread_count
from bezier_filters.smoothing.automatic_smoothing import denoise
from bezier_filters.smoothing.flips import BadFaces, bad_faces, without_new_flips
from bezier_filters.smoothing.smoothing_result import SmoothingResult
from bezier_filters.smoothing.volume import ClosedParts, closed_parts, part_volumes, with_volumes

SmoothingMethod = Literal["auto", "paper"]
SmoothedBorders = Literal["curve", "fixed"]


@takes_arrays
def smooth(
    vertices: ArrayLike,
    faces: ArrayLike,
    method: SmoothingMethod = "auto",
    *,
    iterations: int = 1,
    noise: float | None = None,
    borders: SmoothedBorders = "curve",
    keep_volume: bool | None = None,
    rings: int = 2,
    alpha: float = 0.8,
    selected: BoolArray | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SmoothingResult:
    """Take the noise off a mesh and keep its shape, its volume and its edges.

    By default nothing is to be chosen. The noise is learned from the mesh, as `estimate_vertex_geometry` does,
    and where there is none, nothing moves. A filter is then best whose expected distance from the true
    surface, which the noise and the result tell (Stein's estimate of the risk), is smallest: its
    kind and its strength follow from that, for the mesh and around every vertex. Surfaces that are smooth
    but for the noise take a low-pass filter, sharp edges one of the face normals that
    does not reach across what noise cannot explain.

    ``method="paper"`` is the paper's: every vertex p_i moves to the point B(u_i, v_i) of its patch, all from the
    old mesh (Li, Barsky, Jin, "An effective third-order local fitting patch and its application", IEEE SMI 2009).

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Coordinates.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    method : {"auto", "paper"}
        How to smooth.
    iterations : int
        How many times, at least 1; once is enough for ``"auto"``.
    noise : float, optional
        Standard deviation of the noise along the normal, a length, if it is known better than it can
        be learned; 0 leaves the mesh as it is. For ``"auto"`` only.
    borders : {"curve", "fixed"}
        Whether border vertices are smoothed along the border, or stay; with ``"paper"`` they move to their patches
        unless they are fixed.
    keep_volume : bool, optional
        Whether each closed part keeps its volume: what smoothing took or gave is spread over it along
        the normals, in proportion to how far the surroundings moved. By default with ``"auto"`` only.
    rings, alpha : int, float
        Neighbourhood and weight of the points, in (0, 1], for ``"paper"`` only.
    selected : (n,) bool, optional
        Vertices that may move; all by default.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result
        does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` is called from this thread now and then; if it returns False
        the smoothing is cancelled.

    Returns
    -------
    SmoothingResult

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
    >>> import numpy as np
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=20)
    >>> noise = np.random.default_rng(0).normal(scale=0.01, size=len(ball.vertices))
    >>> result = smooth(ball.vertices * (1.0 + noise[:, np.newaxis]), ball.faces)
    >>> error = np.linalg.norm(result.vertices, axis=1) - 1.0
    >>> bool(error.std() < 0.2 * noise.std()), round(result.volume_ratio, 6)
    (True, 1.0)
    """
    mesh = triangle_mesh(vertices, faces)
    _check(method, iterations, noise, borders)
    movable = _movable(selected, mesh.vertex_count)
    threads = thread_count(threads)
    adjacency = vertex_adjacency(mesh)
    if borders == "fixed":
        movable = movable & ~adjacency.on_boundary
    with first_call():
        noise_before = noise if noise is not None else noise_of(mesh, adjacency, threads=threads)
        points, sharpness = mesh.vertices, np.zeros(mesh.vertex_count)
        for k in range(iterations):
            current = TriangleMesh(points, mesh.faces)
            report = _part_of(progress, k, iterations)
            if method == "paper":
                points = _onto_patches(current, rings, alpha, threads, report)
            else:
                sigma = noise_before if k == 0 else noise_of(current, adjacency, threads=threads)
                unit = mean_edge(current, adjacency, threads=threads)
                denoised = denoise(current, adjacency, sigma or 0.0, unit, borders, threads=threads, progress=report)
                points, sharpness = denoised.vertices, np.maximum(sharpness, denoised.sharpness)
            points = np.where(movable[:, np.newaxis], points, mesh.vertices)
        parts = closed_parts(mesh, adjacency)
        before = bad_faces(mesh, adjacency, threads=threads)
        if method == "auto":
            points = _finished(mesh, adjacency, parts, points, before, movable, keep_volume is not False, threads)
        elif keep_volume:
            points = _with_old_volumes(mesh, adjacency, parts, points, movable)
        return _result(mesh, adjacency, parts, points, sharpness, noise_before, before, threads)


def noise_of(mesh: TriangleMesh, adjacency: Adjacency, *, threads: int = 1) -> float | None:
    """Standard deviation of the noise along the normal, learned from the mesh; None if it is too small."""
    planes = tangent_planes(mesh, adjacency, threads=threads)
    stops = crease_vertices(mesh, adjacency, planes, threads=threads)
    _, leaf = learn_surface(kernel_mesh(mesh, adjacency, planes, stops), adjacency, Choices(), threads=threads)
    return None if leaf is None else leaf.surface.sigma


def mean_edge(mesh: TriangleMesh, adjacency: Adjacency, *, threads: int = 1) -> float:
    """Mean length of the edges; 0 if there are none."""
    rows = adjacency.vertices
    lengths = np.zeros(mesh.vertex_count)

    def make_task() -> RangeTask:
        return lambda start, stop: _sum_lengths(mesh.vertices, rows.indptr, rows.indices, start, stop, lengths)

    run_in_chunks(make_task, mesh.vertex_count, threads=threads)
    return float(lengths.sum()) / max(len(rows.indices), 1)


@lean_njit()
def _sum_lengths(
    vertices: FloatArray, ptr: IntArray, indices: IntArray, start: int, stop: int, lengths: FloatArray
) -> None:
    """Write the sum of the lengths of the edges at vertices start .. stop-1."""
    for i in range(start, stop):
        for q in range(ptr[i], ptr[i + 1]):
            j = indices[q]
            x, y, z = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
            lengths[i] += np.sqrt(x * x + y * y + z * z)


def _onto_patches(mesh: TriangleMesh, rings: int, alpha: float, threads: int, progress: Progress | None) -> FloatArray:
    """The paper's smoothing."""
    geometry = estimate_vertex_geometry(
        mesh.vertices, mesh.faces, rings=rings, alpha=alpha, smoothness="paper", threads=threads, progress=progress
    )
    result: FloatArray = mesh.vertices + geometry.displacements
    return result


def _finished(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    parts: ClosedParts,
    points: FloatArray,
    before: BadFaces,
    movable: BoolArray,
    keep_volume: bool,
    threads: int,
) -> FloatArray:
    """The smoothed vertices with their old volumes and no new bad faces."""
    if keep_volume:
        points = _with_old_volumes(mesh, adjacency, parts, points, movable)
    return without_new_flips(mesh, adjacency, points, before, threads=threads)


def _with_old_volumes(
    mesh: TriangleMesh, adjacency: Adjacency, parts: ClosedParts, points: FloatArray, movable: BoolArray
) -> FloatArray:
    if not parts.count:
        return points
    rows = adjacency.vertices
    neighbours = csr_array(
        (np.ones(len(rows.indices), np.float32), rows.indices, rows.indptr), shape=2 * (len(points),)
    )
    moves = points - mesh.vertices
    squares = np.einsum("ij,ij->i", moves, moves)
    amounts = np.sqrt((neighbours @ squares + squares) / (rows.lengths + 1.0)) * movable
    return with_volumes(TriangleMesh(points, mesh.faces), parts, part_volumes(mesh, parts), amounts)


def _result(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    parts: ClosedParts,
    points: FloatArray,
    sharpness: FloatArray,
    noise_before: float | None,
    before: BadFaces,
    threads: int,
) -> SmoothingResult:
    smoothed = TriangleMesh(points, mesh.faces)
    after = bad_faces(smoothed, adjacency, threads=threads)
    volumes = [float(part_volumes(m, parts).sum()) if parts.count else None for m in (mesh, smoothed)]
    return SmoothingResult(
        vertices=points,
        displacement=np.linalg.norm(points - mesh.vertices, axis=1),
        sharpness=sharpness,
        noise_before=noise_before,
        noise_after=noise_of(smoothed, adjacency, threads=threads),
        volume_before=volumes[0],
        volume_after=volumes[1],
        flipped_before=int(before.flipped.sum()),
        flipped_after=int(after.flipped.sum()),
        degenerate_before=int(before.degenerate.sum()),
        degenerate_after=int(after.degenerate.sum()),
        new_bad_faces=int(after.new_since(before).sum()),
    )


def _part_of(progress: Progress | None, k: int, total: int) -> Progress | None:
    """Progress of the k-th of several iterations as that of the whole."""
    if progress is None:
        return None
    return lambda done, of: progress(k * of + done, total * of)


def _movable(selected: BoolArray | None, n: int) -> BoolArray:
    if selected is None:
        return np.ones(n, dtype=np.bool_)
    mask = np.asarray(selected)
    if mask.shape != (n,) or mask.dtype != np.bool_:
        raise InvalidParameterError(f"selected: got {mask.dtype} of shape {mask.shape}, expected bool of shape ({n},)")
    return mask


def _check(method: object, iterations: object, noise: object, borders: object) -> None:
    if method not in ("auto", "paper"):
        raise InvalidParameterError(f"method: got {method!r}, expected 'auto' or 'paper'")
    if isinstance(iterations, bool) or not isinstance(iterations, Integral) or iterations < 1:
        raise InvalidParameterError(f"iterations: got {iterations!r}, expected an integer of 1 or more")
    is_length = isinstance(noise, Real) and not isinstance(noise, bool) and 0.0 <= float(noise) < np.inf
    if noise is not None and not is_length:
        raise InvalidParameterError(f"noise: got {noise!r}, expected a length of 0 or more, or None to learn it")
    if noise is not None and method == "paper":
        raise InvalidParameterError("noise: the paper's method does not use it; leave it out")
    if borders not in ("curve", "fixed"):
        raise InvalidParameterError(f"borders: got {borders!r}, expected 'curve' or 'fixed'")
