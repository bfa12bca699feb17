"""Refits the regions of a surface that need another fit than the one for all of it.

Noise and shape may vary over a surface. A first fit gives each vertex its features, curvedness and residual, and a
regression tree over these features (`model_tree`) gives each region its own fit.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from bezier_filters.arrays import ByteArray, FloatArray, IntArray
from bezier_filters.fitting.fallbacks import fit_with_fallbacks, overall_progress, spec_chain
from bezier_filters.fitting.outlier_removal import MIN_DEVIATION_PER_EDGE
from bezier_filters.fitting.patch_geometry import PatchGeometry
from bezier_filters.fitting.surface_fit import SurfaceFit
from bezier_filters.fitting.vertex_geometry import FitChoice, FitPart, VertexGeometry, arrays_of
from bezier_filters.kernels.graph_geometry import bound_errors
from bezier_filters.kernels.kernel_input import KernelMesh
from bezier_filters.noise.neighbourhoods import Neighbourhoods
from bezier_filters.runtime.parallel import Progress, run_kernel
from bezier_filters.sampling.neighbourhood_samples import SampleMode
from bezier_filters.status import FitStatus
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.fit_spec import COST_EXPONENT, FitSpec, predict_under_model
from bezier_filters.surface_model.learn import CANDIDATE_RINGS, learn_surface
from bezier_filters.surface_model.model_tree import (
    MAX_TREE_DEPTH,
    MIN_CORRELATED_SPLIT_GAIN,
    MIN_SPLIT_SAMPLES,
    Leaf,
    LearnAt,
    Split,
    Tree,
    fit_leaf,
    grow_tree,
    leaf_numbers,
    leaves,
    log_error_reduction,
    map_leaves,
    separate_magnitudes,
)

PROBE_COUNT = 2000  # vertices with features: a small region hardly shows in the sample of the model
MIN_MISFIT_RATIO = 1.4  # residuals of this many standard deviations of the noise and more are large
# largest fraction of large residuals where noise explains the others: if there are more, the sample has enough of them
MAX_MISFIT_FRACTION = 0.3
# Quantile of the residuals: if even that is large, they are shape, or noise of a part. With 0.5 a torus with ten times
# the noise on one half gets standard errors 2.7 times too large on the other; 0.125 decides alike.
CALM_QUANTILE = 0.25
MIN_MISFIT_GAIN = 0.2  # decrease of the logarithm of the predicted error by a fit of the vertices with large residuals
MAX_ERROR_INCREASE = 2.0  # ratio of the standard error of a region's fit to that of the first fit, if that succeeded
RESIDUAL_FEATURE = 1  # column of `first_features`
REGION_CHUNK = 1 << 18  # vertices of a region for which both fits are stored at a time


def add_regions(
    fit: SurfaceFit,
    whole: Leaf,
    source: Neighbourhoods,
    options: FitOptions,
    probes: IntArray,
    vertices: IntArray,
    features: FloatArray,
) -> SurfaceFit:
    """Add fits for the regions of the surface, if noise or shape vary.

    `features` (k, 2) are the `first_features` of `vertices` (k,), which are in ascending order and include the sample
    of the model and the `probes`, drawn from all vertices.
    """
    mode: SampleMode = "smoothed" if fit.smooth_normals else "plain"

    def learn_at(some: IntArray) -> Leaf | None:
        learned = learn_surface(source, options, at=probes[np.isin(probes, some)], mode=mode)
        leaf = None if learned is None else learned.limit(options)
        return _discard_noise_excess(leaf, whole, options)

    if fit.robust:  # outliers have large residuals, too
        tree = grow_tree(whole, vertices, features, options)
    else:
        tree = _grow_by_residuals(whole, vertices, features, options, learn_at)
    if isinstance(tree, Leaf):
        return fit
    return replace(fit, regions=map_leaves(tree, partial(_region_fit, whole, is_smoothed=fit.smooth_normals)))


def _grow_by_residuals(
    whole: Leaf, vertices: IntArray, features: FloatArray, options: FitOptions, learn_at: LearnAt
) -> Tree[Leaf]:
    """Grow the tree, and split off the vertices with large residuals, if a fit of their own is better there."""
    wider = learn_at if whole.analyses[-1].rings < CANDIDATE_RINGS[-1] else None
    tree = grow_tree(whole, vertices, features, options, wider)
    edge = whole.chosen.radius / whole.chosen.rings
    residuals = np.maximum(features[:, RESIDUAL_FEATURE], MIN_DEVIATION_PER_EDGE * edge)  # on planes they are rounding
    noise = whole.surface.noise
    is_explained = bool(np.quantile(residuals, CALM_QUANTILE) <= MIN_MISFIT_RATIO * noise.sigma)
    if is_explained:
        threshold = MIN_MISFIT_RATIO * max(leaf.surface.sigma for leaf in leaves(tree))
    else:
        threshold = separate_magnitudes(residuals)
    is_misfit = residuals > threshold
    if is_misfit.sum() < MIN_SPLIT_SAMPLES or (is_explained and is_misfit.mean() > MAX_MISFIT_FRACTION):
        return tree
    misfits, min_gain = learn_at(vertices[is_misfit]), MIN_CORRELATED_SPLIT_GAIN if noise.sills else MIN_MISFIT_GAIN
    if misfits is None:
        return tree
    gain = log_error_reduction(whole.chosen, misfits)
    # if the leaf lacks the ring of the first fit, neighbourhoods of that width fold under the noise
    if gain <= min_gain and not (gain == -np.inf and is_explained):
        return tree
    own = grow_tree(misfits, vertices[is_misfit], features[is_misfit], options, wider, MAX_TREE_DEPTH - 1)
    return Split(RESIDUAL_FEATURE, threshold, tree, own)


def _discard_noise_excess(leaf: Leaf | None, whole: Leaf, options: FitOptions) -> Leaf | None:
    """The leaf of a region with no more correlated noise than elsewhere.

    Large residuals select places where correlated noise happens to be strong, so its variance is overestimated there.
    If there is no correlated noise elsewhere, it is shape.
    """
    noise = whole.surface.noise
    if leaf is None or leaf.surface.sigma <= noise.sigma or not (noise.sills or leaf.surface.noise.sills):
        return leaf
    return fit_leaf(leaf.analyses, options, noise, heavy=noise.heavy)


def _region_fit(whole: Leaf, leaf: Leaf, *, is_smoothed: bool = False) -> SurfaceFit:
    """Fit of a region: its own specification, or that of the whole if another fit is not worth its time."""
    before, spec, there = whole.chosen, leaf.chosen, predict_under_model(whole.chosen, leaf.surface)
    choice = FitChoice(spec.rings, spec.degree, None, leaf.surface.sigma)
    ratios = np.inf, np.inf, np.inf
    # If the fit of the whole is exact, its standard errors are 0 and cannot be rescaled.
    if there is not None and min(before.normal_noise, before.curvature_noise, before.height_noise) > 0.0:
        names = ("normal_noise", "curvature_noise", "height_noise")
        of_normal, of_curvature, of_height = (getattr(there, name) / getattr(before, name) for name in names)
        ratios = of_normal, of_curvature, of_height
        if there.error <= spec.error * (1.0 + (spec.cost - spec.overhead) / there.cost) ** COST_EXPONENT:
            choice = replace(choice, rings=there.rings, degree=there.degree)
            return SurfaceFit(choice, (), error_ratios=ratios)
    return SurfaceFit(choice, tuple(spec_chain(leaf.specs, spec, is_smoothed=is_smoothed)), error_ratios=ratios)


def first_features(geometry: VertexGeometry, rows: IntArray) -> FloatArray:
    """Features of the regions from the first fit, (k, 2): curvedness times sqrt(2), and residual."""
    return np.column_stack([np.hypot(geometry.k_min[rows], geometry.k_max[rows]), geometry.residual[rows]])


def fit_regions(
    mesh: KernelMesh, ids: IntArray, fit: SurfaceFit, geometry: VertexGeometry, *, progress: Progress | None = None
) -> FitChoice:
    """Refit the vertices `ids`, in ascending order, that belong to a region with its own fit.

    The results of the first fit are replaced. Returns the choice with the number of vertices of each region.
    """
    if fit.regions is None:
        return fit.choice
    numbers = _region_numbers(fit.regions, geometry, mesh.origin, ids)
    at_the_end = overall_progress(progress, len(ids), len(ids))
    parts = []
    for number, part in enumerate(leaves(fit.regions)):
        of_part = ids[numbers == number]
        if part.attempts:
            for first in range(0, len(of_part), REGION_CHUNK):
                some = of_part[first : first + REGION_CHUNK]
                _fit_again(mesh, some, part, geometry, fit.robust, at_the_end)
        else:
            _rescale_errors(mesh, of_part, geometry, *part.error_ratios)
        parts.append(count_part(part, len(of_part)))
    return replace(fit.choice, parts=tuple(parts))


def count_part(region: SurfaceFit, vertex_count: int) -> FitPart:
    """The fit of a region with the number of its vertices."""
    choice = region.choice
    return FitPart(vertex_count, choice.rings, choice.degree, choice.noise_sigma or 0.0)


def _fit_again(
    mesh: KernelMesh, ids: IntArray, part: SurfaceFit, geometry: VertexGeometry, robust: bool, progress: Progress | None
) -> None:
    """Refit vertices of a region by its own specification; keep a first fit that succeeded with a smaller error.

    The specification is optimal for neighbourhoods without a border. Near a border the result depends more on the
    priors, and on wider rings more on the terms beyond the degree.
    """
    status = geometry.status[mesh.origin[ids]]
    converged = ids[status <= FitStatus.WIDER_RING]
    rows = mesh.origin[converged]
    before = {name: values[rows] for name, values in arrays_of(geometry).items()}
    instead = [one for one in part.attempts if isinstance(one.fit, FitSpec)]
    for some, attempts in ((status == FitStatus.OK, instead), (status != FitStatus.OK, part.attempts)):
        fit_with_fallbacks(mesh, ids[some], attempts, geometry, robust=robust, progress=progress)
    with np.errstate(over="ignore", invalid="ignore"):  # infinite and undefined errors of the first fit count as worse
        errors = geometry.normal_std[rows] * geometry.mean_curvature_std[rows]
        is_worse = (
            errors
            > MAX_ERROR_INCREASE**2
            * np.prod(part.error_ratios[:2])
            * before["normal_std"]
            * before["mean_curvature_std"]
        )
    for name, values in arrays_of(geometry).items():
        values[rows[is_worse]] = before[name][is_worse]
    _rescale_errors(mesh, converged[is_worse], geometry, *part.error_ratios)


def _region_numbers(parts: Tree[SurfaceFit], geometry: VertexGeometry, origin: IntArray, ids: IntArray) -> ByteArray:
    """The number of the region of each vertex, (k,); in chunks, to save memory."""
    numbers = np.empty(len(ids), dtype=np.int8)

    def number(start: int, stop: int) -> None:
        numbers[start:stop] = leaf_numbers(parts, first_features(geometry, origin[ids[start:stop]]))

    run_kernel(number, len(ids))
    return numbers


def _rescale_errors(
    mesh: KernelMesh,
    ids: IntArray,
    geometry: VertexGeometry,
    of_normal: float,
    of_curvature: float,
    of_height: float,
) -> None:
    """Rescale the standard errors of vertices to those of the same fit under another model."""
    rows, of_both = mesh.origin[ids], (geometry.mean_curvature_std, geometry.gaussian_curvature_std)
    geometry.normal_std[rows] *= of_normal
    if isinstance(geometry, PatchGeometry):
        geometry.height_std[rows] *= of_height
    for errors in of_both:
        errors[rows] *= of_curvature
    if of_curvature > 1.0:
        run_kernel(bound_errors, len(ids), mesh, ids, *of_both)
