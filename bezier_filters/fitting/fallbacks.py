"""Chains of fits: the attempts at a vertex, in order, until one is neither folded nor ill posed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import BoolArray, ByteArray, IntArray
from bezier_filters.fitting.patch_geometry import patch_table
from bezier_filters.fitting.vertex_geometry import VertexGeometry, empty_geometry
from bezier_filters.kernels.crossing_edges import MEAN_PLANE, NEIGHBOUR_PLANE, OWN_PLANE, find_planes
from bezier_filters.kernels.fit_kernel import fit_task
from bezier_filters.kernels.kernel_input import (
    FITTED,
    FOLDED_OVER,
    ILL_POSED,
    OUTCOMES,
    UNTRIED,
    KernelFit,
    KernelMesh,
    VertexResults,
    hubs,
    prepare_kernel_mesh,
    use_nearest_points,
    use_smoothed_normals,
)
from bezier_filters.meshes.diagnosis import MIN_FIT_POINTS
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.spatial_order import sort_spatially
from bezier_filters.patches.patch_fit import PatchFit
from bezier_filters.patches.polynomials import elimination_order, lexicographic_places, row_starts
from bezier_filters.runtime.parallel import Progress, run_in_chunks, run_kernel
from bezier_filters.sampling.neighbourhood_samples import MAX_FLIPPED_FRACTION
from bezier_filters.status import FitStatus
from bezier_filters.surface_model.fit_options import Fallbacks
from bezier_filters.surface_model.fit_spec import FitSpec
from bezier_filters.surface_model.quartic_mean import QUARTIC

MIN_PIVOT = 1e-6  # relative pivot below which the points do not determine a patch: its error stays near 1e-10
MIN_PRIOR_PIVOT = 1e-10  # the same for fits with a prior, which determines the remaining coefficients
MAX_EXTRA_RINGS = 3  # rings by which an ill-posed neighbourhood may grow
# fraction of the usual number of points: a neighbourhood with fewer, at a boundary or a crease, takes more rings
MIN_POINT_FRACTION = 0.75
# practically a plain quadratic: six coefficients that six well-placed points determine
QUADRATIC = PatchFit(degree=2, alpha=0.1)
# the flattest quadratic through points that do not determine all curvatures, as two rows of points
FLATTEST_QUADRATIC = PatchFit(degree=2, alpha=0.1, smoothness="flattest")
MIN_FLAT_PIVOT = 1e-15  # relative pivot for `FLATTEST_QUADRATIC`, below the pivots of its penalty

ROBUST_ROUNDS = 5  # maximum rounds of reweighting; nearly all neighbourhoods converge after two or three


@dataclass(frozen=True)
class FitAttempt:
    """One way to fit a vertex, tried on the vertices whose last outcome is in `after`."""

    status: FitStatus  # status of the vertices that it fits
    after: frozenset[int]  # outcomes, see `kernel_input.OUTCOMES`
    rings: int  # size of the neighbourhood in edges, unless there is a radius
    fit: PatchFit | FitSpec
    # whether the plane is normal to the mean normal of the neighbourhood, not to the vertex normal
    mean_plane: bool = False
    other_plane: bool = False  # whether it is the plane of a neighbour
    # fraction of flipped normals that is allowed; if None, not even a single face may fold
    max_flipped_fraction: float | None = None
    by_crossings: bool = False  # whether, if that is None, edges that cross in the plane make a fold, not faces
    # standard deviation of the heights, a length, for the standard errors of normal and curvatures; 0 for none
    noise: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of normal, curvatures and height
    smooth_normals: bool = False  # whether planes and folds follow normals averaged over neighbours
    ignores_barriers: bool = False  # whether the neighbourhood may reach across sharp edges
    fewest_points: int = 0  # fewer points count as ill posed
    radius: float | None = None  # of the ball that is the neighbourhood, a length
    nearest: bool = False  # whether the neighbourhood are the nearest points, which are its only ring


def fallback_chain(
    rings: int, fit: PatchFit, radius: float | None = None, fallbacks: Fallbacks = "sound", *, nearest: bool = False
) -> Iterator[FitAttempt]:
    """The requested fit and its fallbacks, as in the paper or with a well-posed quadratic on 1-rings.

    Too few or badly placed points take a wider ring; a folded projection takes another plane,
    then the 1-ring. The remaining vertices are fitted by a quadratic, because the paper's system is
    singular on 1-rings of six neighbours or fewer. If there is a radius, its ball is tried before
    the rings; so are the nearest points.
    """
    ill_posed, folded = frozenset({ILL_POSED}), frozenset({FOLDED_OVER})
    yield FitAttempt(FitStatus.OK, frozenset({UNTRIED}), rings, fit, radius=radius, nearest=nearest)
    for more in range(1, MAX_EXTRA_RINGS + 1):
        yield FitAttempt(FitStatus.WIDER_RING, ill_posed, rings + more, fit)
    paper = fallbacks == "paper"
    other = FitAttempt(FitStatus.OTHER_PLANE, folded, rings, fit, mean_plane=not paper, other_plane=paper)
    yield replace(other, radius=radius, nearest=nearest)
    if paper:
        yield FitAttempt(FitStatus.ONE_RING, folded, 1, fit)
        yield FitAttempt(FitStatus.LOWER_DEGREE, ill_posed, 1, QUADRATIC)
    yield from last_resorts(rings)


def last_resorts(rings: int) -> Iterator[FitAttempt]:
    """Quadratic fits for vertices that no other attempt fits."""
    ill_posed, folded = frozenset({ILL_POSED}), frozenset({FOLDED_OVER})
    yield FitAttempt(FitStatus.ONE_RING, folded, 1, QUADRATIC)
    yield FitAttempt(FitStatus.LOWER_DEGREE, ill_posed, max(rings, 2), QUADRATIC)
    yield FitAttempt(FitStatus.LOWER_DEGREE, ill_posed, rings + MAX_EXTRA_RINGS, QUADRATIC)
    for wide in (max(rings, 2), rings + MAX_EXTRA_RINGS):
        yield FitAttempt(FitStatus.LOWER_DEGREE, ill_posed, wide, FLATTEST_QUADRATIC, fewest_points=MIN_FIT_POINTS)
    yield FitAttempt(
        FitStatus.FOLDED, ill_posed | folded, max(rings, 2), QUADRATIC, mean_plane=True, max_flipped_fraction=1.0
    )


def spec_chain(
    specs: Sequence[FitSpec],
    chosen: FitSpec,
    radius: float | None = None,
    *,
    nearest: bool = False,
    is_smoothed: bool = False,
) -> Iterator[FitAttempt]:
    """The chosen specification and its fallbacks: narrower rings where it folds, wider ones where it is ill posed.

    A prior makes nearly every neighbourhood well posed, and noise folds a few faces of a wide one. So these fits use
    the mean plane and tolerate a few flipped normals. Where noise flips more, they follow normals averaged over
    neighbours before they become narrower, unless all normals are averaged (`is_smoothed`). If there is a radius, the
    chosen specification belongs to its ball; the rings tried after a ball have few points, which get equal weights.
    The same holds for a number of nearest points.
    """
    ill_posed, folded = frozenset({ILL_POSED}), frozenset({FOLDED_OVER})

    def spec_attempt(
        status: FitStatus, after: frozenset[int], rings: int, spec: FitSpec, fewest: int = 0
    ) -> FitAttempt:
        return FitAttempt(
            status,
            after,
            rings,
            spec,
            mean_plane=True,
            max_flipped_fraction=MAX_FLIPPED_FRACTION,
            noise=(spec.normal_noise, spec.curvature_noise, spec.height_noise),
            fewest_points=fewest,
        )

    has_rings = radius is None and not nearest
    fewest = int(MIN_POINT_FRACTION * chosen.points) if has_rings else 0
    first = spec_attempt(FitStatus.OK, frozenset({UNTRIED}), 1 if nearest else chosen.rings, chosen, fewest)
    first = replace(first, radius=radius, nearest=nearest)
    yield first
    if chosen.normal_noise > 0.0 and not is_smoothed:
        yield replace(first, status=FitStatus.OTHER_PLANE, after=folded, smooth_normals=True)
    for spec in sorted((spec for spec in specs if spec.rings < chosen.rings), key=lambda spec: -spec.rings):
        yield spec_attempt(FitStatus.NARROWER_RING, folded, spec.rings, spec)
    narrowest, wider = (chosen.rings, chosen) if has_rings else (1, replace(chosen, weight_radius=np.inf))
    for more in range(1, MAX_EXTRA_RINGS + 1):
        yield spec_attempt(
            FitStatus.WIDER_RING, ill_posed, narrowest + more, wider, fewest if more < MAX_EXTRA_RINGS else 0
        )
    for attempt in last_resorts(min(chosen.rings, 2)):
        noise = chosen.normal_noise, chosen.curvature_noise, chosen.height_noise
        yield replace(attempt, noise=noise, ignores_barriers=True)


def fit_with_fallbacks(
    mesh: KernelMesh,
    ids: IntArray,
    attempts: Sequence[FitAttempt],
    geometry: VertexGeometry,
    *,
    robust: bool = False,
    progress: Progress | None = None,
) -> None:
    """Run the attempts on the vertices `ids` and write the results into `geometry`, in rows ``mesh.origin[ids]``.

    A vertex that no attempt fits keeps the result of an earlier call. If there is none, it gets the normal of its faces
    or nearest points, and zero curvature.
    If robust, points with large residuals lose their weight, except in the last resorts, which have too few points.
    """
    if not len(mesh.faces):  # without faces only normals show folds
        attempts = [
            replace(one, max_flipped_fraction=max(one.max_flipped_fraction or 0.0, MAX_FLIPPED_FRACTION))
            for one in attempts
        ]
    has_normal = np.empty(len(ids), dtype=np.bool_)

    def look(start: int, stop: int) -> None:
        has_normal[start:stop] = mesh.normals[ids[start:stop]].any(axis=1)

    run_kernel(look, len(ids))
    geometry.status[mesh.origin[ids[~has_normal]]] = int(FitStatus.ISOLATED)
    unsettled = _select(has_normal, ids)
    outcomes = np.full(len(unsettled), UNTRIED, dtype=np.int8)
    tried = 0
    for attempt in attempts:
        concerned = np.array([outcome in attempt.after for outcome in OUTCOMES])[outcomes]
        if not concerned.any():
            continue
        report = overall_progress(progress, tried, len(ids))
        outcomes[concerned] = _run(attempt, mesh, _select(concerned, unsettled), geometry, robust, report)
        tried = len(ids)
        fitted = concerned & (outcomes == FITTED)
        _give_status(attempt.status, unsettled, fitted, mesh.origin, geometry)
        unsettled, outcomes = unsettled[~fitted], outcomes[~fitted]
        if not len(unsettled):
            return
    never_fitted = unsettled[geometry.status[mesh.origin[unsettled]] == int(FitStatus.SKIPPED)]
    geometry.normals[mesh.origin[never_fitted]] = mesh.normals[never_fitted]
    geometry.status[mesh.origin[never_fitted]] = int(FitStatus.NORMAL_ONLY)


def fit_patches(mesh: TriangleMesh, rings: int, fit: PatchFit, *, progress: Progress | None = None) -> VertexGeometry:
    """Geometry of all vertices of a mesh by one patch fit with its fallbacks."""
    ordered = sort_spatially(mesh)
    arrays = prepare_kernel_mesh(ordered.mesh, ordered, with_barriers=False)
    geometry = empty_geometry(mesh.vertex_count)
    every = np.arange(mesh.vertex_count, dtype=np.int32)
    fit_with_fallbacks(arrays, every, list(fallback_chain(rings, fit)), geometry, progress=progress)
    return geometry


def _give_status(status: FitStatus, ids: IntArray, mask: BoolArray, origin: IntArray, geometry: VertexGeometry) -> None:
    """Set the status of the vertices where a mask is true; in chunks, to save memory."""

    def give(start: int, stop: int) -> None:
        geometry.status[origin[ids[start:stop][mask[start:stop]]]] = status

    run_kernel(give, len(ids))


def _select(mask: BoolArray, ids: IntArray) -> IntArray:
    """The numbers where a mask is true; no copy if it is true everywhere."""
    return ids if mask.all() else ids[mask]


def _run(
    attempt: FitAttempt,
    mesh: KernelMesh,
    ids: IntArray,
    geometry: VertexGeometry,
    robust: bool,
    progress: Progress | None,
) -> ByteArray:
    """Run the kernel on the vertices `ids`; return their outcomes."""
    if attempt.by_crossings and attempt.max_flipped_fraction is None:
        return _run_without_crossings(attempt, mesh, ids, geometry, robust, progress)
    if attempt.smooth_normals:
        mesh = use_smoothed_normals(mesh)
    if attempt.nearest:
        mesh = use_nearest_points(mesh)
    if attempt.ignores_barriers:
        mesh = mesh._replace(barriers=hubs(mesh.ring_ptr))
    outcomes = np.empty(len(ids), dtype=np.int8)
    fit = kernel_fit(attempt, robust=robust)
    results = VertexResults(*(getattr(geometry, name) for name in VertexResults._fields))
    run_in_chunks(
        lambda: fit_task(mesh, fit, ids, results, outcomes, geometry.condition_number, patch_table(geometry)),
        len(ids),
        progress=progress,
    )
    return outcomes


def _run_without_crossings(
    attempt: FitAttempt,
    mesh: KernelMesh,
    ids: IntArray,
    geometry: VertexGeometry,
    robust: bool,
    progress: Progress | None,
) -> ByteArray:
    """Run the kernel over planes in which no edges cross; angles decide if there are too many points for that test."""
    plane = NEIGHBOUR_PLANE if attempt.other_plane else MEAN_PLANE if attempt.mean_plane else OWN_PLANE
    fewest = kernel_fit(attempt).fewest_points
    found, outcomes = find_planes(mesh, ids, attempt.rings, fewest, plane)
    flat, undecided = outcomes == FITTED, outcomes == ILL_POSED
    normals = mesh.normals.copy()
    normals[ids[flat]] = found[flat]
    own = replace(attempt, mean_plane=False, other_plane=False, max_flipped_fraction=1.0)
    outcomes[flat] = _run(own, mesh._replace(normals=normals), ids[flat], geometry, robust, progress)
    outcomes[undecided] = _run(replace(attempt, by_crossings=False), mesh, ids[undecided], geometry, robust, None)
    return outcomes


def kernel_fit(attempt: FitAttempt, *, robust: bool = False) -> KernelFit:
    """Parameters of the kernel for one attempt."""
    fit = attempt.fit
    space = fit.space
    order: IntArray = np.arange(space.dimension, dtype=np.int32)
    if attempt.noise[0] > 0.0:
        space, order = elimination_order(space)
    lower = np.tril_indices(space.dimension)
    quartic, quartic_order = np.empty((0, 5)), np.empty(0, dtype=np.int32)
    weight_scale, weight_power = 0.0, 0
    moment_exponents, moment_place = space.moments
    if isinstance(fit, PatchFit):
        free, square, penalty = fit.free_coefficients, fit.square, fit.monomial_penalty[np.ix_(order, order)][lower]
        prior = np.zeros(len(lower[0]))
        smallest_pivot = MIN_FLAT_PIVOT if fit == FLATTEST_QUADRATIC else MIN_PIVOT
    else:
        free, square, penalty = QUADRATIC.free_coefficients, True, np.zeros(len(lower[0]))
        if np.isfinite(fit.weight_radius):
            weight_scale, weight_power = 1.0 / fit.weight_radius**2, fit.degree + 1
        prior, smallest_pivot = fit.prior[np.ix_(order, order)][lower], MIN_PRIOR_PIVOT
        if fit.quartic != 0.0:
            quartic_order = space.places([(QUARTIC - k, k) for k in range(QUARTIC + 1)])
            quartic = fit.quartic * fit.prior[np.ix_(order[quartic_order], order[quartic_order])]
    entries = np.flatnonzero(prior)
    degrees = space.total_degrees[lower[0]][entries]
    places: IntArray = entries[np.argsort(degrees, kind="stable")].astype(np.int32)
    return KernelFit(
        rings=attempt.rings,
        radius=attempt.radius or 0.0,
        fewest_points=max(free, attempt.fewest_points),
        free=free,
        square=square,
        mean_plane=attempt.mean_plane,
        other_plane=attempt.other_plane,
        max_flipped_fraction=-1.0 if attempt.max_flipped_fraction is None else attempt.max_flipped_fraction,
        highest_power=2 * fit.degree,
        any_axis=isinstance(fit, FitSpec),
        exponents=space.exponents,
        starts=row_starts(space.exponents),
        lexicographic=lexicographic_places(space.exponents),
        moment_starts=row_starts(moment_exponents),
        moment_place=moment_place,
        penalty=penalty,
        prior=prior[places],
        prior_place=places,
        prior_degree=np.sort(degrees).astype(np.int32),
        quartic=quartic,
        quartic_order=quartic_order,
        smallest_pivot=smallest_pivot,
        normal_noise=attempt.noise[0],
        curvature_noise=attempt.noise[1],
        height_noise=attempt.noise[2],
        weight_scale=weight_scale,
        weight_power=weight_power,
        rounds=ROBUST_ROUNDS if robust and fit not in (QUADRATIC, FLATTEST_QUADRATIC) else 0,
    )


def overall_progress(progress: Progress | None, tried: int, total: int) -> Progress | None:
    """Progress of one attempt as progress of the whole chain: repeated attempts count after the last vertex."""
    return None if progress is None else lambda done, _: progress(min(tried + done, total), total)
