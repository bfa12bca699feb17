"""Differential geometry at every vertex of a mesh: the function that users call."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.hidden_edges import hides_sharp_edges, noise_free_surface
from bezier_filters.fitting.fallbacks import fit_with_fallbacks, overall_progress
from bezier_filters.fitting.first_call import first_call
from bezier_filters.fitting.mesh_neighbourhoods import MeshNeighbourhoods, mesh_neighbourhoods
from bezier_filters.fitting.model_cache import MAX_CACHED_VERTICES, CachedFit, cache_fit, cache_key, look_up_fit
from bezier_filters.fitting.outlier_removal import rebase_displacements
from bezier_filters.fitting.patch_geometry import PatchGeometry, empty_patch_geometry
from bezier_filters.fitting.point_cloud import point_cloud
from bezier_filters.fitting.region_fits import (
    MIN_MISFIT_RATIO,
    PROBE_COUNT,
    add_regions,
    first_features,
    fit_regions,
)
from bezier_filters.fitting.surface_fit import SurfaceFit, choose_fit
from bezier_filters.fitting.vertex_geometry import FitChoice, VertexGeometry, arrays_of, empty_geometry
from bezier_filters.fitting.viewpoints import ViewpointSide, count_flipped, view_directions
from bezier_filters.kernels.kernel_input import (
    MIN_NEIGHBOURHOOD_WIDTH,
    KernelMesh,
    kernel_mesh,
    prepare_kernel_mesh,
    replace_vertices,
)
from bezier_filters.meshes.mesh import (
    TriangleMesh,
    check_normals,
    check_selection,
    check_vectors,
    surface_or_points,
    takes_meshes,
)
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.spatial_order import SpatialOrder, has_locality, identity_order, sort_spatially
from bezier_filters.meshes.unit_size import normalizes_size
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.runtime.parallel import Progress, runs_on_threads
from bezier_filters.sampling.neighbourhood_samples import draw_from_mesh
from bezier_filters.status import FitStatus
from bezier_filters.surface_model.fit_options import NEEDS_ALPHA, Automatic, Fallbacks, FitOptions, FoldTest
from bezier_filters.surface_model.model_tree import Leaf

# Fractions of the probes with large residuals, see `MIN_MISFIT_RATIO`, and with failed fits, above which the mesh is
# searched for sharp edges under the noise. Noisy blocks, joints, cubes and pyramids exceed one of them; noisy spheres,
# tori and a scan of a bunny exceed neither.
EDGE_MISFIT_FRACTION, EDGE_FAILURE_FRACTION = 0.01, 0.002
# the same with outliers: small ones remain and have large residuals, but their fits do not fail
OUTLIER_MISFIT_RATIO, OUTLIER_MISFIT_FRACTION, OUTLIER_FAILURE_FRACTION = 2.0, 0.06, 0.0007


class Outside(NamedTuple):
    """What is known of the outside of a point cloud."""

    normals: FloatArray | None = None  # (n, 3): outward vectors of any length, zero where unknown
    views: FloatArray | None = None  # (n, 3): unit vectors that normals face


UNKNOWN_OUTSIDE = Outside()


@takes_meshes
@normalizes_size("radius", "noise", "detail", "viewpoint")
@runs_on_threads
def estimate_vertex_geometry(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    *,
    normals: ArrayLike | None = None,
    viewpoint: ArrayLike | None = None,
    viewpoint_side: ViewpointSide = "toward",
    rings: int | Automatic = "auto",
    radius: float | None = None,
    neighbours: int | None = None,
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
    least squares with a smoothness that penalises its higher terms (after Li, Barsky, Jin, "An
    effective third-order local fitting patch and its application", IEEE SMI 2009). Its
    derivatives at the vertex give the geometry.

    By default the patch is a polynomial of some total degree, and the data choose: the noise of the
    mesh and the variation of its surface are learned from a sample of neighbourhoods; they give the
    prior of each higher term, and the neighbourhood and the degree are those with the smallest
    predicted error of normal and curvature. With a number for `alpha` the patch is a tensor product
    over the plane of the vertex normal, and [alpha A; (1 - alpha) S] b = [alpha z; 0] is solved as
    in the paper;
    ``rings=2, alpha=0.8, smoothness="paper"`` is the paper's method to the letter, whose curvature
    is biased at every resolution.

    Without faces the vertices are a point cloud: each point's neighbours are found among the nearest
    points (see `point_cloud`), and all else is as for a mesh. What is outside follows from `normals`, or from the
    places from which the points were seen, or else from the shape: closed bodies have positive volume, sheets look
    towards +z or the axis that they face most.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh or point cloud of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int, optional
        Triangles, counter-clockwise seen from outside; none at all for a point cloud.
    normals : (n, 3) array_like of float, optional
        For point clouds only: vectors of any length that point outwards, zero where the outside is
        unknown. Their side orients the results, and points with opposite ones are no neighbours; their
        directions are not used otherwise.
    viewpoint : (3,) or (n, 3) array_like of float, optional
        For point clouds only, instead of normals: the place of the scanner, or one for each point. Normals face it.
        Parts with a consistent orientation are turned as a whole, as most of their points demand, weighted by the
        cosine between the normal and the direction to the viewpoint: points seen at grazing angle decide nothing.
        Signs differ within a part only where the points on both sides contradict each other as ten points seen along
        their normals do. Points seen from opposite sides of a wall are no neighbours. ``flipped`` of the result counts
        the normals that face away from their viewpoints.
    viewpoint_side : {"toward", "away"}
        Whether normals face the viewpoints, or away from them, as from a place inside a body.
    rings : int or "auto"
        Size of the neighbourhood in edges, at least 1.
    radius : float, optional
        Size of the neighbourhood as a length instead, so that a mesh of varying density, or several
        meshes, are seen at one scale: every vertex within this distance that can be reached along
        edges within it. Balls with too few points are replaced by 2 rings or more
        (`FitStatus.WIDER_RING`). What the data choose is one choice for all vertices then.
    neighbours : int, optional
        For point clouds only, instead of rings or a radius: number of points of every neighbourhood, the point itself
        among them. Tangent planes and fits are those of so many nearest points, whatever the density; points that
        coincide count as one. At least as many as the fit has coefficients that only points determine: 6, or with
        alpha 1 and degree d, (d + 1)^2. Where these are ill posed or fold, rings replace them. What the data choose is
        one choice for all points then.
    alpha : float or "auto"
        Weight of the points against the smoothness, in (0, 1]; 1 fits the points alone.
    degree : int or "auto"
        With a number for `alpha`, degree of the patch in each parameter: 2, 3 or 4, and "auto"
        is 3. Otherwise total degree of the polynomial: 2 to 6. Where nothing can be learned of a mesh, as on one of a
        few vertices, the fit has alpha 0.8 and this degree, 4 at most; ``fit.noise_reason`` says why.
    smoothness : {"third_order", "paper"}
        What S penalises: see `smoothness_matrix`. With ``"paper"``, "auto" stands for the paper's
        settings: 2 rings, alpha 0.8, degree 3.
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
        farthest. The result of ``"paper"`` depends on it; fits that follow the data do not, and refuse it.
    robust : bool, optional
        Whether points with large residuals lose their weight (Tukey's biweight), for scans with
        outliers: one vertex in twenty displaced by many times the noise. It takes about twice as long
        and is slightly less accurate without outliers. By default, fits that follow the data are robust if the data
        show outliers. Then outliers are moved onto the surface around them before the fit.
    noise : float, optional
        Standard deviation of the noise along the normal, a length, if it is known better than it can be estimated. The
        choices and the standard errors follow from it. The correlation of the noise is estimated in any case; if the
        known noise is much stronger than the estimate, the difference gets a longer range. With 0 all variation is
        shape. Not allowed if both the neighbourhood and `alpha` are given.
    detail : float, optional
        Size of the smallest detail to keep, a length: rings whose radius is more than half of it are not chosen,
        unless there are no narrower ones. Not allowed if the neighbourhood is given.
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
        If a parameter is out of range, or if there are both faces and normals, a viewpoint or neighbours.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(radius=2.0)
    >>> geometry = estimate_vertex_geometry(ball.vertices, ball.faces)
    >>> bool(abs(geometry.mean_curvature - 0.5).max() < 1e-4)
    True
    >>> bool((estimate_vertex_geometry(ball).k_min == geometry.k_min).all())
    True
    >>> of_points_alone = estimate_vertex_geometry(ball.vertices)
    >>> bool(abs(of_points_alone.mean_curvature - 0.5).max() < 1e-4)
    True
    >>> from_inside = estimate_vertex_geometry(ball.vertices, viewpoint=(0, 0, 0), neighbours=30)
    >>> bool(abs(from_inside.mean_curvature + 0.5).max() < 1e-3), from_inside.flipped
    (True, 0)
    """
    mesh = surface_or_points(vertices, faces)
    outside = Outside(check_normals(normals, mesh), view_directions(viewpoint, viewpoint_side, mesh))
    if outside.normals is not None and outside.views is not None:
        raise InvalidParameterError("viewpoint: there are normals, which say what is outside; give one of them")
    options = FitOptions(
        rings, alpha, degree, smoothness, robust, noise, detail, radius, fallbacks, fold_test, neighbours
    )
    options.check()
    if neighbours is not None and mesh.face_count:
        raise InvalidParameterError(
            f"neighbours: got {neighbours!r}; that is for point clouds, and meshes with faces have rings"
        )
    if not options.is_fixed and x_axis is not None:
        raise InvalidParameterError(NEEDS_ALPHA)
    if fold_test != "angle" and not mesh.face_count:
        raise InvalidParameterError(f"fold_test: got {fold_test!r}; that is for rings of meshes with faces")
    axes = None if x_axis is None else _directions(x_axis, mesh, "x_axis")
    mask = None if selected is None else check_selection(selected, mesh.vertex_count)
    with first_call():
        ordered, source = _prepare(sort_spatially(mesh), options, outside)
        if axes is not None:
            source = replace(source, mesh=source.mesh._replace(x_axes=axes[ordered.order]))
        geometry = empty_geometry(mesh.vertex_count)
        if conditions:
            geometry = replace(geometry, condition_number=np.zeros(mesh.vertex_count))
        found = _estimate(mesh, ordered, source, options, lambda _: mask, geometry, outside=outside, progress=progress)
    return found if outside.views is None else replace(found, flipped=count_flipped(found.normals, outside.views))


def estimate_patches(mesh: TriangleMesh, options: FitOptions, progress: Progress | None = None) -> PatchGeometry:
    """Estimate the geometry at all vertices of a mesh with faces, and keep the patches."""
    with first_call():
        ordered, source = _prepare(sort_spatially(mesh), options)
        geometry = empty_patch_geometry(mesh.vertex_count, options.highest_total_degree)
        found = _estimate(mesh, ordered, source, options, lambda _: None, geometry, progress=progress)
    return cast("PatchGeometry", found)


def geometry_where(mesh: PreparedMesh, select: Callable[[float | None], BoolArray]) -> VertexGeometry:
    """Estimate with automatic choices at vertices (n,) that `select` chooses by the noise, a length."""
    with first_call():
        # sorting does not pay if few vertices are selected
        ordered = identity_order(mesh) if has_locality(mesh.adjacency) else sort_spatially(mesh)
        ordered, source = _prepare(ordered, FitOptions())
        return _estimate(mesh, ordered, source, FitOptions(), select, empty_geometry(mesh.vertex_count))


def _prepare(
    ordered: SpatialOrder, options: FitOptions, outside: Outside = UNKNOWN_OUTSIDE
) -> tuple[SpatialOrder, MeshNeighbourhoods]:
    """Prepare a mesh, or a point cloud whose outside is given, and its neighbourhoods."""
    if not ordered.mesh.face_count:
        normals, views = (None if vectors is None else vectors[ordered.order] for vectors in outside)
        adjacency, planes, nearest = point_cloud(ordered.mesh, normals, views, options.neighbours)
        return ordered, MeshNeighbourhoods(kernel_mesh(ordered.mesh, adjacency, planes, None, ordered, nearest))
    mesh = prepare_mesh(ordered.mesh)
    ordered = replace(ordered, mesh=mesh)
    if options.is_fixed:
        return ordered, MeshNeighbourhoods(prepare_kernel_mesh(mesh, ordered, with_barriers=False))
    return ordered, mesh_neighbourhoods(mesh, ordered)


def _estimate(
    given: TriangleMesh,
    ordered: SpatialOrder,
    source: MeshNeighbourhoods,
    options: FitOptions,
    select: Callable[[float | None], BoolArray | None],
    geometry: VertexGeometry,
    *,
    outside: Outside = UNKNOWN_OUTSIDE,
    progress: Progress | None = None,
) -> VertexGeometry:
    """Estimate the geometry at vertices that `select` chooses by the noise, None if unknown; fills `geometry`.

    The fit is looked up, or chosen and stored, with the regions that the first fit shows. The order of the vertices is
    part of its key, because sums are rounded in that order.
    """
    is_cached = options.is_learned and given.vertex_count <= MAX_CACHED_VERTICES
    key = cache_key(given.vertices, given.faces, ordered.order, *outside, options) if is_cached else None
    known, whole, measured = look_up_fit(key), None, source.mesh.vertices
    if known is None:
        fit, whole, source, noise_free = _choose(given, ordered, source, options)
    else:
        fit, noise_free = known.fit, known.noise_free
        fitted = source.mesh._replace(barriers=known.barriers[ordered.order])
        if known.cleaned is not None:
            fitted = replace_vertices(fitted, known.cleaned[ordered.order])
        source = MeshNeighbourhoods(fitted)
    mask = select(fit.choice.noise_sigma)
    ids = (np.arange(given.vertex_count) if mask is None else np.flatnonzero(mask[ordered.order])).astype(np.int32)
    choice, fit = _fit(source, ids, fit, whole, options, geometry, progress)
    if fit.cleaned:
        rebase_displacements(measured, source.mesh, ids, geometry)
    if whole is not None and is_cached:
        cleaned = ordered.restore_order(source.mesh.vertices) if fit.cleaned else None
        cache_fit(key, CachedFit(fit, ordered.restore_order(source.mesh.barriers), noise_free, cleaned))
    if mask is not None:
        _clear(geometry, ~mask & (geometry.status != FitStatus.SKIPPED))
    # the cache keeps an array of its own
    return replace(geometry, fit=choice, noise_free=None if noise_free is None else noise_free.copy())


def _choose(
    given: TriangleMesh, ordered: SpatialOrder, source: MeshNeighbourhoods, options: FitOptions
) -> tuple[SurfaceFit, Leaf | None, MeshNeighbourhoods, FloatArray | None]:
    """Choose the fit of a mesh, again if sharp edges are found under its noise.

    Returns the fit, the model of the surface if it was learned, the neighbourhoods to fit, and the denoised vertices
    (n, 3) if they were needed.
    """
    noise_free: FloatArray | None = None
    fit, whole = choose_fit(source, options)
    fitted = source.clean if fit.cleaned else source
    if whole is not None and given.face_count and not options.robust:
        noise = whole.surface.noise
        # under heavy noise no residual is large
        is_suspect = not options.has_rings or noise.heavy or _misses_edges(fitted.mesh, fit, noise.sigma)
        if is_suspect and hides_sharp_edges(prepare_mesh(ordered.mesh), noise):
            surface, hidden_barriers = noise_free_surface(prepare_mesh(given), noise)
            noise_free, hidden_barriers = surface.vertices, hidden_barriers[ordered.order]
            if (hidden_barriers & ~fitted.mesh.barriers).any():
                mesh = source.mesh._replace(barriers=source.mesh.barriers | hidden_barriers)
                source = replace(source, mesh=mesh, hidden_barriers=hidden_barriers)
                fit, whole = choose_fit(source, options)
                fitted = source.clean if fit.cleaned else source
    return fit, whole, fitted, noise_free


def _misses_edges(mesh: KernelMesh, fit: SurfaceFit, sigma: float) -> bool:
    """Whether residuals are larger than the noise, or fits fail, at so many probes that sharp edges are likely."""
    drawn = np.sort(draw_from_mesh(mesh, PROBE_COUNT))
    rows = np.zeros(len(mesh.vertices), dtype=np.int32)
    rows[drawn] = np.arange(len(drawn))
    found = empty_geometry(len(drawn))
    fit_with_fallbacks(mesh._replace(origin=rows), drawn, fit.attempts, found, robust=fit.robust)
    ratio, misfits, failures = MIN_MISFIT_RATIO, EDGE_MISFIT_FRACTION, EDGE_FAILURE_FRACTION
    if fit.cleaned:
        ratio, misfits, failures = OUTLIER_MISFIT_RATIO, OUTLIER_MISFIT_FRACTION, OUTLIER_FAILURE_FRACTION
    has_failed = found.status > FitStatus.WIDER_RING
    return bool((found.residual > ratio * sigma).mean() > misfits or has_failed.mean() > failures)


def _fit(
    source: MeshNeighbourhoods,
    ids: IntArray,
    fit: SurfaceFit,
    whole: Leaf | None,
    options: FitOptions,
    geometry: VertexGeometry,
    progress: Progress | None,
) -> tuple[FitChoice, SurfaceFit]:
    """Fit vertices, all with one choice first, and then the regions of the surface; return the choice and the fit.

    The sample and the probes are fitted, too, so that the regions do not depend on `ids`; their rows of `geometry` are
    to be ignored.
    """
    arrays, first = source.smooth_mesh if fit.smooth_normals else source.mesh, ids
    has_regions = whole is not None and options.has_rings
    if whole is not None and has_regions:
        probes = draw_from_mesh(arrays, PROBE_COUNT)
        sampled = np.union1d(whole.centers, probes).astype(np.int32)
        if len(ids) < len(arrays.vertices):
            first = np.union1d(ids, sampled).astype(np.int32)
    first_progress = overall_progress(progress, 0, len(ids))
    fit_with_fallbacks(arrays, first, fit.attempts, geometry, robust=fit.robust, progress=first_progress)
    if whole is not None and has_regions:
        features = first_features(geometry, arrays.origin[sampled])
        fit = add_regions(fit, whole, source, options, probes, sampled, features)
    choice = fit_regions(arrays, ids, fit, geometry, progress=progress)
    return replace(choice, parts=tuple(part for part in choice.parts if part.vertices)), fit


def _directions(given: ArrayLike, mesh: TriangleMesh, name: str) -> FloatArray:
    """Unit vectors (n, 3), or zeros, from one for all vertices or one each."""
    vectors = check_vectors(given, mesh, name, one_for_all=True)
    vectors = vectors / np.maximum(np.abs(vectors).max(axis=-1, keepdims=True), MIN_NEIGHBOURHOOD_WIDTH)
    vectors /= np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), MIN_NEIGHBOURHOOD_WIDTH)
    return np.broadcast_to(vectors, mesh.vertices.shape)


def _clear(geometry: VertexGeometry, rows: BoolArray) -> None:
    """Reset the rows of some vertices."""
    rows_of_mask = np.flatnonzero(rows)
    for name, values in arrays_of(geometry).items():
        values[rows_of_mask] = int(FitStatus.SKIPPED) if name == "status" else 0
