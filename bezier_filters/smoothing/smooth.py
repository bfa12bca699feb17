"""Smoothing: the function that users call."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.estimation.first_call import first_call
from bezier_filters.kernels.kernel_input import fitted_mesh
from bezier_filters.learning.learn import learn_surface
from bezier_filters.learning.plans import Choices
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import takes_arrays, triangle_mesh
from bezier_filters.runtime.parallel import Progress, thread_count
from bezier_filters.smoothing.smoothing_options import SmoothedBorders, SmoothingMethod, check_smoothing
from bezier_filters.smoothing.smoothing_result import SmoothingResult
from bezier_filters.smoothing.smoothing_run import Held, Movable, finished, part_of, smoothed
from bezier_filters.smoothing.whole_mesh import WholeMesh


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
    check_smoothing(method, iterations, noise, borders)
    mask = _checked_mask(selected, mesh.vertex_count)
    threads = thread_count(threads)
    domain = WholeMesh(mesh, vertex_adjacency(mesh, threads=threads), threads)
    inputs: dict[str, Any] = {} if mask is None else {"selected": {"selected": mask}}
    movable = domain.run(Movable(borders == "fixed"), **inputs).vertices
    with first_call():
        noise_before = noise if noise is not None else noise_of(domain)
        if method == "auto":
            found = smoothed(
                domain,
                movable,
                noise_before,
                noise_of,
                borders,
                iterations=iterations,
                threads=threads,
                progress=progress,
            )
        else:
            found = {"points": mesh.vertices}
            for k in range(iterations):
                patches = _onto_patches(domain.with_points(found), rings, alpha, part_of(progress, k, iterations))
                found = domain.run(Held(), found=patches, movable=movable).vertices
        is_auto = method == "auto"
        keep_volume = is_auto if keep_volume is None else keep_volume
        end = finished(domain, found, movable, keep_volume=keep_volume, keep_faces=is_auto)
        points, volumes = end.points["points"], end.volumes.sum(axis=1)
        return SmoothingResult(
            vertices=points,
            displacement=np.linalg.norm(points - mesh.vertices, axis=1),
            sharpness=found.get("sharpness", np.zeros(mesh.vertex_count)),
            noise_before=noise_before,
            noise_after=noise_of(domain.with_points(end.points)),
            volume_before=float(volumes[0]) if end.volumes.size else None,
            volume_after=float(volumes[1]) if end.volumes.size else None,
            flipped_before=end.faces["flipped before"],
            flipped_after=end.faces["flipped after"],
            degenerate_before=end.faces["degenerate before"],
            degenerate_after=end.faces["degenerate after"],
            new_bad_faces=end.faces["new"],
        )


def noise_of(domain: WholeMesh) -> float | None:
    """Standard deviation of the noise along the normal, learned from the mesh; None if it is too small."""
    arrays, adjacency = fitted_mesh(domain.mesh, adjacency=domain.adjacency, creases=True, threads=domain.threads)
    _, leaf = learn_surface(arrays, adjacency, Choices(), threads=domain.threads)
    return None if leaf is None else leaf.surface.sigma


def _onto_patches(domain: WholeMesh, rings: int, alpha: float, progress: Progress | None) -> dict[str, FloatArray]:
    """The paper's smoothing: "points" (n, 3)."""
    mesh, threads = domain.mesh, domain.threads
    geometry = estimate_vertex_geometry(
        mesh.vertices, mesh.faces, rings=rings, alpha=alpha, smoothness="paper", threads=threads, progress=progress
    )
    return {"points": mesh.vertices + geometry.displacements}


def _checked_mask(selected: BoolArray | None, n: int) -> BoolArray | None:
    if selected is None:
        return None
    mask = np.asarray(selected)
    if mask.shape != (n,) or mask.dtype != np.bool_:
        raise InvalidParameterError(f"selected: got {mask.dtype} of shape {mask.shape}, expected bool of shape ({n},)")
    return mask
