"""Differential geometry at every vertex of a mesh: the function that users call."""

from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.adjacency import vertex_adjacency
from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.compilation import announce_first_compilation
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fallbacks import fallback_chain, fit_with_fallbacks
from bezier_filters.fit_kernel import fit_vertices
from bezier_filters.fitting import PatchFit
from bezier_filters.frames import tangent_planes
from bezier_filters.mesh import triangle_mesh
from bezier_filters.parallel import Progress, thread_count
from bezier_filters.smoothness import Smoothness
from bezier_filters.status import FitStatus
from bezier_filters.vertex_geometry import VertexGeometry


def estimate_vertex_geometry(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    rings: int = 2,
    alpha: float = 0.8,
    degree: int = 3,
    smoothness: Smoothness = "third_order",
    selected: BoolArray | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> VertexGeometry:
    """Normals, curvatures, principal directions and torsion of a mesh at its vertices.

    A Bezier patch is fitted to the k-ring of every vertex, as a height field over the tangent
    plane, by solving [alpha A; (1 - alpha) S] b = [alpha z; 0] (Li, Barsky, Jin, "An effective
    third-order local fitting patch and its application", IEEE SMI 2009). Its derivatives at
    the vertex give the geometry. ``rings=2, alpha=0.8, smoothness="paper"`` is the paper's method
    to the letter, whose curvature is biased at every resolution; the defaults are consistent.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Coordinates.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    rings : int
        Size of the neighbourhood in edges, at least 1.
    alpha : float
        Weight of the points against the smoothness, in (0, 1]; 1 fits the points alone.
    degree : {2, 3, 4}
        Degree of the patch in each parameter.
    smoothness : {"third_order", "paper"}
        What S penalises: see `smoothness_matrix`.
    selected : (n,) bool, optional
        Vertices to estimate; the others get zeros and `FitStatus.SKIPPED`.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result
        does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` is called from this thread now and then; if it returns False
        the estimate is cancelled.

    Returns
    -------
    VertexGeometry
        Curvatures in 1/length, positive where the surface is convex towards its outside. Where
        a vertex needed a fallback, `status` says which.

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
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(radius=2.0)
    >>> geometry = estimate_vertex_geometry(ball.vertices, ball.faces)
    >>> bool(abs(geometry.mean_curvature - 0.5).max() < 0.01)
    True
    """
    mesh = triangle_mesh(vertices, faces)
    fit = PatchFit(degree, alpha, smoothness)
    if isinstance(rings, bool) or not isinstance(rings, Integral) or rings < 1:
        raise InvalidParameterError(f"rings: got {rings!r}, expected an integer of 1 or more")
    ids = _selected_ids(selected, mesh.vertex_count)
    threads = thread_count(threads)

    announce_first_compilation(fit_vertices)
    adjacency = vertex_adjacency(mesh)
    planes = tangent_planes(mesh, adjacency, threads=threads)
    geometry = empty_geometry(mesh.vertex_count)
    fit_with_fallbacks(
        mesh,
        adjacency,
        planes,
        ids,
        list(fallback_chain(int(rings), fit)),
        geometry,
        threads=threads,
        progress=progress,
    )
    return geometry


def _selected_ids(selected: BoolArray | None, n: int) -> IntArray:
    if selected is None:
        return np.arange(n, dtype=np.int32)
    mask = np.asarray(selected)
    if mask.shape != (n,) or mask.dtype != np.bool_:
        raise InvalidParameterError(f"selected: got {mask.dtype} of shape {mask.shape}, expected bool of shape ({n},)")
    return np.flatnonzero(mask).astype(np.int32)


def empty_geometry(n: int) -> VertexGeometry:
    """Geometry of n vertices that nothing is known of: zeros and `FitStatus.SKIPPED`."""
    return VertexGeometry(
        normals=np.zeros((n, 3)),
        k_min=np.zeros(n),
        k_max=np.zeros(n),
        direction_min=np.zeros((n, 3)),
        direction_max=np.zeros((n, 3)),
        residual=np.zeros(n),
        rings_used=np.zeros(n, dtype=np.int32),
        status=np.full(n, FitStatus.SKIPPED, dtype=np.int32),
    )
