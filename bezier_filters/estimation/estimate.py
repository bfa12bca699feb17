"""Differential geometry at every vertex of a mesh: the function that users call."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.adaptive_fit import (
    LOOKED_AT,
    OFF,
    FindEdges,
    Learn,
    Learned,
    Places,
    SurfaceFit,
    choose_fit,
    first_features,
    fit_in_balls,
    fit_parts,
    learner,
    with_parts,
)
from bezier_filters.estimation.fallbacks import (
    Fallbacks,
    FoldTest,
    fallback_chain,
    fit_with_fallbacks,
    overall_progress,
)
from bezier_filters.estimation.first_call import first_call
from bezier_filters.estimation.fit_options import Automatic, check_detail, check_fit_noise, check_radius, fit_options
from bezier_filters.estimation.noise_free import hides_sharp_edges, noise_free_surface
from bezier_filters.estimation.outlier_removal import measure_from, without_outliers
from bezier_filters.estimation.point_cloud import point_cloud
from bezier_filters.estimation.remembered import LARGEST, LearnedFit, key_of, recall, remember
from bezier_filters.estimation.vertex_geometry import FitChoice, VertexGeometry, arrays_of, empty_geometry
from bezier_filters.kernels.kernel_input import (
    MIN_NEIGHBOURHOOD_WIDTH,
    KernelMesh,
    kernel_mesh,
    prepare_kernel_mesh,
    replace_vertices,
    use_smoothed_normals,
)
from bezier_filters.learning.learn import viewed_sample, why_unlearned
from bezier_filters.learning.neighbourhood_samples import NeighbourhoodSample, draw_from_mesh
from bezier_filters.learning.noise_model import NoiseModel
from bezier_filters.meshes.adjacency import Adjacency, vertex_adjacency
from bezier_filters.meshes.mesh import TriangleMesh, checked_selection, takes_arrays, triangle_mesh
from bezier_filters.meshes.spatial_order import as_it_is, in_spatial_order, is_in_turn
from bezier_filters.meshes.unit_size import normalizes_size
from bezier_filters.patches.fitting import PatchFit
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.runtime.parallel import Progress, runs_on_threads
from bezier_filters.status import FitStatus

# Fits that reach across sharp edges leave more than noise, see `OFF`, or fail, at some shares of the places: on blocks,
# joints, cubes and pyramids with noise one or the other is more, on noisy spheres, tori and a scan of a bunny both less
OFTEN_OFF, OFTEN_FAILED = 0.01, 0.002
# the same where there were outliers: of those the small ones stay, which are off, too, but fits do not fail for them
OFF_BESIDE, OFTEN_OFF_BESIDE, OFTEN_FAILED_BESIDE = 2.0, 0.06, 0.0007


@takes_arrays
@normalizes_size("radius", "noise", "detail")
@runs_on_threads
def estimate_vertex_geometry(
    vertices: ArrayLike,
    faces: ArrayLike | None,
    *,
    normals: ArrayLike | None = None,
    rings: int | Automatic = "auto",
    radius: float | None = None,
    alpha: float | Automatic = "auto",
    degree: int | Automatic = "auto",
    smoothness: Smoothness = "third_order",
    fallbacks: Fallbacks = "sound",
    fold_test: FoldTest = "angle",
    x_axis: ArrayLike | None = None,
    robust: bool | None = None,
    noise: float | None = None,
    detail: float | None = None,
    selected: BoolArray | None = None,
    conditions: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> VertexGeometry:
    """Normals, curvatures, principal directions and torsion of a mesh or a point cloud at its vertices.

    A patch is fitted to the k-ring of every vertex, as a height field over the tangent plane, by
    least squares with a smoothness that holds its higher terms back (after Li, Barsky, Jin, "An
    effective third-order local fitting patch and its application", IEEE SMI 2009). Its
    derivatives at the vertex give the geometry.

    By default the data choose: the noise of the mesh and the variation of its surface are learned
    from a sample of neighbourhoods, and the neighbourhood, the degree and the weight of the
    smoothness are those with the smallest predicted error of normal and curvature. With a number
    for `alpha`, [alpha A; (1 - alpha) S] b = [alpha z; 0] is solved as in the paper;
    ``rings=2, alpha=0.8, smoothness="paper"`` is the paper's method to the letter, whose curvature
    is biased at every resolution.

    Without faces the vertices are a point cloud: each point's neighbours are found among the nearest
    points (see `point_cloud`), and all else is as for a mesh. What is outside follows from `normals`,
    or else from the shape: closed bodies have positive volume, sheets look towards +z or the axis
    that they face most.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Coordinates.
    faces : (m, 3) array_like of int, or None
        Triangles, counter-clockwise seen from outside; none at all for a point cloud.
    normals : (n, 3) array_like of float, optional
        For point clouds only: vectors of any length that tell on which side of each point the outside
        is, zero where that is unknown. Nothing else of them is used.
    rings : int or "auto"
        Size of the neighbourhood in edges, at least 1.
    radius : float, optional
        Size of the neighbourhood as a length instead, so that a mesh of varying density, or several
        meshes, are seen at one scale: every vertex within this distance that can be reached along
        edges within it. Balls with too few points are replaced by 2 rings or more
        (`FitStatus.WIDER_RING`). What the data choose is one choice for all vertices then.
    alpha : float or "auto"
        Weight of the points against the smoothness, in (0, 1]; 1 fits the points alone.
    degree : int or "auto"
        With a number for `alpha`, degree of the patch in each parameter: 2, 3 or 4, and "auto"
        is 3. Otherwise total degree of the polynomial: 2 to 6. Where nothing can be learned of a mesh, as on one of a
        few vertices, the fit has alpha 0.8 and this degree, 4 at most; ``fit.noise_reason`` says why.
    smoothness : {"third_order", "paper", "twists"}
        What S penalises: see `smoothness_matrix`. With ``"paper"``, "auto" stands for the paper's
        settings: 2 rings, alpha 0.8, degree 3. With ``"twists"``, `alpha` must be a number.
    fallbacks : {"sound", "paper"}
        What is tried where the surface folds over the tangent plane, with a number for `alpha`. ``"sound"``: the plane
        of the mean normal of the neighbourhood, then a quadratic fit of the 1-ring. ``"paper"``: the plane of the
        neighbour whose normal is closest, then the patch itself on the 1-ring; only where that determines no patch, as
        it seldom does with six neighbours or fewer, a quadratic. Not with a radius.
    fold_test : {"angle", "crossings"}
        Where the surface counts as folded, with a number for `alpha`. ``"angle"``: a face that touches the
        neighbourhood without its last ring leans 89 degrees or more from the plane. ``"crossings"``, as in the paper:
        two edges between vertices of the neighbourhood cross or touch in the plane, and do not end at one vertex;
        it takes several times as long. Where there are more than 1,000 points, angles decide. Not with a radius, nor
        for point clouds.
    x_axis : (3,) or (n, 3) array_like of float, optional
        Directions of any length, one for all vertices or one each, whose projections are the x axes of the tangent
        planes. By default, and where they are zero or normal to the plane, x points to the neighbour that projects
        farthest. What ``"paper"`` and ``"twists"`` give depends on it; fits that follow the data do not, and refuse it.
    robust : bool, optional
        Whether points far off their patch lose their weight (Tukey's biweight), for scans with
        outliers: one vertex in twenty displaced by many times the noise. It takes some two times as long
        and is slightly less accurate where there are none. By default, fits that follow the data are robust where these
        show outliers. Such fits are those of the mesh with its outliers moved onto the surface around them.
    noise : float, optional
        Standard deviation of the noise along the normal, a length, if it is known better than it can be learned: what
        is chosen and the standard errors follow from it, everywhere on the mesh. How far it is correlated is learned
        all the same, and what is much more than can be learned counts as longer. 0 takes all that there is for shape.
        Not where both the neighbourhood and `alpha` are given.
    detail : float, optional
        Size of the smallest detail to keep, a length: rings whose radius is more than half of it are not chosen,
        unless there are no narrower ones. Not where the neighbourhood is given.
    selected : (n,) bool, optional
        Vertices to estimate; the others get zeros and `FitStatus.SKIPPED`.
    conditions : bool
        Whether the result has the condition number of every fit, which changes nothing else.
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
        a vertex needed a fallback, `status` says which; `fit` says what was chosen.

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with finite coordinates.
    InvalidParameterError
        If a parameter is out of range, or if there are both faces and normals.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(radius=2.0)
    >>> geometry = estimate_vertex_geometry(ball.vertices, ball.faces)
    >>> bool(abs(geometry.mean_curvature - 0.5).max() < 1e-4)
    True
    >>> of_points_alone = estimate_vertex_geometry(ball.vertices, None)
    >>> bool(abs(of_points_alone.mean_curvature - 0.5).max() < 1e-4)
    True
    """
    mesh = triangle_mesh(vertices, [] if faces is None else faces)
    outside = _outside(normals, mesh)
    check_radius(radius, rings)
    rings, fixed, degrees = fit_options(rings, alpha, degree, smoothness)
    check_fit_noise(noise, fixed, rings, radius)
    check_detail(detail, rings, radius)
    if fallbacks not in get_args(Fallbacks):
        raise InvalidParameterError(f"fallbacks: got {fallbacks!r}, expected one of {get_args(Fallbacks)}")
    if fold_test not in get_args(FoldTest):
        raise InvalidParameterError(f"fold_test: got {fold_test!r}, expected one of {get_args(FoldTest)}")
    if fixed is None and (fallbacks != "sound" or fold_test != "angle" or x_axis is not None):
        raise InvalidParameterError(
            "fallbacks, fold_test and x_axis are for fits with a number for alpha; give alpha, or none of them"
        )
    if fold_test != "angle" and (radius is not None or not mesh.face_count):
        raise InvalidParameterError(f"fold_test: got {fold_test!r}; that is for rings of meshes with faces")
    if fallbacks != "sound" and radius is not None:
        raise InvalidParameterError(f"fallbacks: got {fallbacks!r} and a radius; those of the paper are for rings")
    axes = None if x_axis is None else _directions(x_axis, mesh, "x_axis")
    mask = None if selected is None else checked_selection(selected, mesh.vertex_count)

    wanted = _Wanted(
        rings,
        fixed,
        degrees,
        robust,
        noise,
        detail,
        radius=radius,
        fallbacks=fallbacks,
        fold_test=fold_test,
        axes=axes,
        outside=outside,
        conditions=conditions,
    )
    return _estimate(mesh, wanted, lambda _: mask, progress)


def geometry_where(
    mesh: TriangleMesh, adjacency: Adjacency, select: Callable[[float | None], BoolArray]
) -> VertexGeometry:
    """Estimate what the data choose, at some vertices (n,) that are selected once the noise, a length, is known."""
    wanted = _Wanted(*fit_options("auto", "auto", "auto", "third_order"))
    return _estimate(mesh, wanted, select, adjacency=adjacency if is_in_turn(adjacency) else None)


@dataclass(frozen=True)
class _Wanted:
    """What is estimated, and how; see `estimate_vertex_geometry`."""

    rings: int | Automatic
    fixed: PatchFit | None
    degrees: tuple[int, ...]
    robust: bool | None = None
    noise: float | None = None
    detail: float | None = None
    radius: float | None = None
    fallbacks: Fallbacks = "sound"
    fold_test: FoldTest = "angle"
    axes: FloatArray | None = None  # (n, 3)
    outside: FloatArray | None = None  # (n, 3)
    conditions: bool = False


def _estimate(
    given: TriangleMesh,
    wanted: _Wanted,
    select: Callable[[float | None], BoolArray | None],
    progress: Progress | None = None,
    adjacency: Adjacency | None = None,
) -> VertexGeometry:
    """Estimate the geometry of a mesh or a point cloud at vertices that are selected by the noise, if it is known.

    A mesh whose adjacency is known stays in its own order: to sort it does not pay where few vertices are selected.
    """
    with first_call():
        ordered = in_spatial_order(given) if adjacency is None else as_it_is(given)
        mesh, order = ordered.mesh, ordered.order
        if mesh.face_count:
            arrays, adjacency = prepare_kernel_mesh(mesh, ordered, adjacency, creases=wanted.fixed is None)
        else:
            adjacency, planes = point_cloud(mesh, None if wanted.outside is None else wanted.outside[order])
            arrays = kernel_mesh(mesh, adjacency, planes, None, ordered)
        if wanted.axes is not None:
            arrays = arrays._replace(x_axes=wanted.axes[order])
        geometry = empty_geometry(mesh.vertex_count)
        if wanted.conditions:
            geometry = replace(geometry, condition_number=np.zeros(mesh.vertex_count))
        surface: FloatArray | None = None

        def hidden_edges(noise: NoiseModel) -> BoolArray | None:
            nonlocal surface
            if wanted.robust or not given.face_count or not hides_sharp_edges(mesh, adjacency, noise):
                return None
            found, edges = noise_free_surface(given, adjacency if mesh is given else vertex_adjacency(given), noise)
            surface = found.vertices
            result: BoolArray = edges[order]
            return result

        def places(mask: BoolArray | None) -> IntArray:
            return (np.arange(mesh.vertex_count) if mask is None else np.flatnonzero(mask[order])).astype(np.int32)

        if wanted.radius is None:
            options = wanted.rings, wanted.fixed, wanted.degrees, wanted.robust, wanted.noise, wanted.detail
            is_learned = (wanted.fixed is None or wanted.rings == "auto") and given.vertex_count <= LARGEST
            key = (
                key_of(given.vertices, given.faces, wanted.outside, wanted.fallbacks, wanted.fold_test, *options)
                if is_learned
                else None
            )
            known, learned = recall(key), None
            if known is not None:
                fit, surface, fitted = known.fit, known.surface, arrays._replace(barriers=known.stops[order])
                if known.cleaned is not None:
                    fitted = replace_vertices(fitted, adjacency, known.cleaned[order])
            else:
                fit, learned, fitted = _choose(
                    arrays, adjacency, lambda learn: choose_fit(learn, *options), hidden_edges
                )
                if wanted.fixed is None or wanted.rings == "auto":
                    fit = replace(fit, choice=_with_reason(fit.choice, arrays, adjacency))
            if wanted.fixed is not None and (wanted.fallbacks != "sound" or wanted.fold_test != "angle"):
                crossings = wanted.fold_test == "crossings"
                chain = fallback_chain(fit.choice.rings, wanted.fixed, fallbacks=wanted.fallbacks)
                fit = replace(fit, attempts=tuple(replace(one, by_crossings=crossings) for one in chain))
            mask = select(fit.choice.noise_sigma)
            ids = places(mask)
            choice, fit = _fit(fitted, adjacency, ids, fit, learned, geometry, progress)
            if fit.cleaned:
                measure_from(arrays.vertices, fitted, ids, geometry)
            if learned is not None:
                cleaned = ordered.back(fitted.vertices) if fit.cleaned else None
                remember(key, LearnedFit(fit, ordered.back(fitted.barriers), surface, cleaned))
        else:
            mask = select(wanted.noise)
            choice = fit_in_balls(
                arrays,
                adjacency,
                places(mask),
                float(wanted.radius),
                wanted.fixed,
                wanted.degrees,
                geometry,
                sigma=wanted.noise,
                robust=bool(wanted.robust),
                find_edges=hidden_edges,
                progress=progress,
            )
            if wanted.fixed is None:
                choice = _with_reason(choice, arrays, adjacency)
        if mask is not None:
            _clear(geometry, ~mask & (geometry.status != FitStatus.SKIPPED))
        return replace(geometry, fit=choice, noise_free=surface)


def _choose(
    arrays: KernelMesh,
    adjacency: Adjacency,
    choose: Callable[[Learn], tuple[SurfaceFit, Learned | None]],
    find_edges: FindEdges,
) -> tuple[SurfaceFit, Learned | None, KernelMesh]:
    """Choose how to fit a mesh, again if sharp edges come to light; also what of the mesh is fitted."""

    def chosen(arrays: KernelMesh, edges: BoolArray | None = None) -> tuple[SurfaceFit, Learned | None, KernelMesh]:
        cleaned = cache(partial(without_outliers, arrays, adjacency, edges))
        fit, learned = choose(learner(arrays, adjacency, cleaned))
        return fit, learned, cleaned() if fit.cleaned else arrays

    fit, learned, fitted = chosen(arrays)
    if learned is None:
        return fit, learned, fitted
    surface = learned.root.surface
    # among heavy noise nothing is far off
    if fit.choice.noise_heavy or _misses_edges(fitted, fit, surface.sigma):
        edges = find_edges(surface.noise)
        if edges is not None and (edges & ~fitted.barriers).any():
            return chosen(arrays._replace(barriers=arrays.barriers | edges), edges)
    return fit, learned, fitted


def _with_reason(choice: FitChoice, arrays: KernelMesh, adjacency: Adjacency) -> FitChoice:
    """A choice that says why the noise is not known, if it is not."""
    return choice if choice.noise_sigma is not None else replace(choice, noise_reason=why_unlearned(arrays, adjacency))


def _misses_edges(arrays: KernelMesh, fit: SurfaceFit, sigma: float) -> bool:
    """Whether fits leave more than noise, or fail, at some of the vertices, as they do across sharp edges."""
    drawn = np.sort(draw_from_mesh(arrays, LOOKED_AT))
    rows = np.zeros(len(arrays.vertices), dtype=np.int32)
    rows[drawn] = np.arange(len(drawn))
    found = empty_geometry(len(drawn))
    fit_with_fallbacks(arrays._replace(origin=rows), drawn, fit.attempts, found, robust=fit.robust)
    off, often_off, often_failed = OFF, OFTEN_OFF, OFTEN_FAILED
    if fit.cleaned:
        off, often_off, often_failed = OFF_BESIDE, OFTEN_OFF_BESIDE, OFTEN_FAILED_BESIDE
    has_failed = found.status > FitStatus.WIDER_RING
    return bool((found.residual > off * sigma).mean() > often_off or has_failed.mean() > often_failed)


def _fit(
    arrays: KernelMesh,
    adjacency: Adjacency,
    ids: IntArray,
    fit: SurfaceFit,
    learned: Learned | None,
    geometry: VertexGeometry,
    progress: Progress | None,
) -> tuple[FitChoice, SurfaceFit]:
    """Fit vertices, all in one way first, and then the parts of the surface, if there are any; say with what.

    The vertices that parts are found from are fitted, too, so that the parts do not depend on `ids`; what is written
    there means nothing.
    """
    if fit.steady:
        arrays = use_smoothed_normals(arrays)
    drawn = draw_from_mesh(arrays, LOOKED_AT) if learned is not None else ids[:0]
    first = ids
    if learned is not None and len(ids) < len(arrays.vertices):
        first = np.unique(np.concatenate([ids, learned.centers, drawn]))
    of_wanted = overall_progress(progress, 0, len(ids))
    fit_with_fallbacks(arrays, first, fit.attempts, geometry, robust=fit.robust, progress=of_wanted)
    if learned is not None:

        def features(centers: IntArray) -> FloatArray:
            return first_features(geometry, arrays.origin[centers])

        def sample(centers: IntArray, rings: int) -> NeighbourhoodSample:
            return viewed_sample(arrays, adjacency, centers, rings, "plain")

        fit = with_parts(fit, learned, Places(drawn, features, sample))
    return fit_parts(arrays, ids, fit, geometry, progress=progress), fit


def _outside(normals: ArrayLike | None, mesh: TriangleMesh) -> FloatArray | None:
    """The given normals of a point cloud, checked."""
    if normals is None:
        return None
    if mesh.face_count:
        raise InvalidParameterError("normals: got some for a mesh with faces, whose orientation says what is outside")
    return _vectors(normals, mesh, "normals")


def _directions(given: ArrayLike, mesh: TriangleMesh, name: str) -> FloatArray:
    """Unit vectors (n, 3), or zeros, from one for all vertices or one each."""
    vectors = _vectors(given, mesh, name, one_for_all=True)
    vectors = vectors / np.maximum(np.abs(vectors).max(axis=-1, keepdims=True), MIN_NEIGHBOURHOOD_WIDTH)
    vectors /= np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), MIN_NEIGHBOURHOOD_WIDTH)
    return np.broadcast_to(vectors, mesh.vertices.shape)


def _vectors(given: ArrayLike, mesh: TriangleMesh, name: str, *, one_for_all: bool = False) -> FloatArray:
    """Vectors of a mesh's vertices that a user gave, checked."""
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


def _clear(geometry: VertexGeometry, rows: BoolArray) -> None:
    """Forget what is known of some vertices."""
    places = np.flatnonzero(rows)
    for name, values in arrays_of(geometry).items():
        values[places] = int(FitStatus.SKIPPED) if name == "status" else 0
