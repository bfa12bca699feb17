"""Chooses a fit from sampled neighbourhoods, and refits the regions of a surface that need other ones.

The choice follows from a `SurfaceModel` of samples alone, so that the vertices may be fitted all together or in tiles.
The neighbourhoods are rings of edges, or balls of one radius, a scale that does not depend on the sampling.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from bezier_filters.arrays import BoolArray, ByteArray, FloatArray, IntArray
from bezier_filters.fitting.fallbacks import (
    FitAttempt,
    fallback_chain,
    fit_with_fallbacks,
    overall_progress,
    spec_chain,
)
from bezier_filters.fitting.outlier_removal import move_outliers
from bezier_filters.fitting.vertex_geometry import FitChoice, FitPart, VertexGeometry, arrays_of
from bezier_filters.kernels.graph_geometry import bound_errors
from bezier_filters.kernels.kernel_input import KernelMesh, use_smoothed_normals
from bezier_filters.patches.patch_fit import DEGREES, PatchFit
from bezier_filters.runtime.parallel import Progress, run_kernel
from bezier_filters.status import FitStatus
from bezier_filters.surface_model.fit_spec import COST_EXPONENT, FitConstraints, predict_under_model
from bezier_filters.surface_model.learn import (
    CANDIDATE_RINGS,
    MAX_FLIPPED_FRACTION,
    SampleMode,
    learn_from_samples,
    learn_surface,
)
from bezier_filters.surface_model.model_tree import (
    MAX_TREE_DEPTH,
    MIN_CORRELATED_SPLIT_GAIN,
    Features,
    Leaf,
    Split,
    Tree,
    best_leaf,
    fit_leaf,
    grow_tree,
    leaf_numbers,
    leaves,
    log_error_reduction,
    map_leaves,
)
from bezier_filters.surface_model.neighbourhood_samples import (
    NeighbourhoodSample,
    draw_from_mesh,
    sample_neighbourhoods,
)
from bezier_filters.surface_model.noise_model import NoiseModel
from bezier_filters.surface_model.ring_analysis import MIN_SAMPLES, RingAnalysis

RADIUS_SAMPLES = 150  # neighbourhoods whose radius is measured
# A small region that the first fit does not follow hardly shows in the sample. Among more vertices, the probes, those
# whose residual is at least this ratio times the standard deviation of the noise get their own model.
MIN_MISFIT_RATIO, PROBE_COUNT = 1.4, 2000
# number of such probes, and their largest fraction: if there are more, the sample has enough of them
MIN_MISFIT_COUNT, MAX_MISFIT_FRACTION = 40, 0.3
MIN_MISFIT_GAIN = 0.2  # decrease of the logarithm of the predicted error by that model under white noise
DENSE_OUTLIER_SHARE = 0.1  # share of outliers from which on they flip normals everywhere, as heavy noise does
MAX_ERROR_INCREASE = 2.0  # ratio of the standard error of a region's fit to that of the first fit, if that succeeded
REGION_CHUNK = 1 << 18  # vertices of a region for which both fits are stored at a time
RESIDUAL_FEATURE = 1  # column of `first_features`

# `learn_surface` of a mesh in memory or in a store, with its outliers or (True) without them
LearnSurface = Callable[[FitConstraints, bool], tuple[list[RingAnalysis], Leaf | None]]
# mask (n,) of the vertices at sharp edges hidden by the noise; None if the mesh is not to be searched for them
FindEdges = Callable[[NoiseModel], BoolArray | None]


@dataclass(frozen=True)
class ProbeVertices:
    """Vertices of a mesh, in memory or in tiles, that probe the first fit."""

    drawn: IntArray  # spread over the mesh, in random order
    features: Features  # `first_features` of these vertices and of the sample of the surface model
    sample: Callable[[IntArray, int], NeighbourhoodSample]  # neighbourhoods of vertices up to a number of rings


@dataclass(frozen=True)
class RegionFit:
    """Fit of a region of a surface."""

    rings: int
    degree: int
    noise_sigma: float  # as in `FitPart`
    attempts: tuple[FitAttempt, ...]  # tried in order; empty if the first fit is good enough
    # factors on the standard errors of normal and curvatures where the first fit stays; infinite if unknown
    error_ratios: tuple[float, float]


@dataclass(frozen=True)
class SurfaceFit:
    """Fit of a surface; its size does not depend on the mesh."""

    choice: FitChoice  # for the whole surface
    attempts: tuple[FitAttempt, ...]  # tried in order at every vertex
    steady: bool = False  # whether the frames follow smoothed normals, see `use_smoothed_normals`
    robust: bool = False  # whether points with large residuals lose their weight
    cleaned: bool = False  # whether outliers are moved onto the surface around them first
    regions: Tree[RegionFit] | None = None  # fits of the regions, by the features of the first fit


@dataclass(frozen=True)
class LearnedSurface:
    """Sampled neighbourhoods of a surface, and the model and fit specifications for all of it."""

    analyses: Sequence[RingAnalysis]
    root: Leaf
    constraints: FitConstraints

    @property
    def centers(self) -> IntArray:
        """The sampled vertices, each once, in ascending order."""
        return np.unique(np.concatenate([analysis.centers for analysis in self.analyses]))


def choose_fit(
    learn: LearnSurface,
    rings: int | Literal["auto"],
    fixed: PatchFit | None,
    degrees: tuple[int, ...],
    robust: bool | None = None,
    sigma: float | None = None,
    detail: float | None = None,
) -> tuple[SurfaceFit, LearnedSurface | None]:
    """Choose the parameters that the user left open, one choice for all vertices.

    `rings` or the patch `fixed` are given or chosen by the data, with one of the `degrees`. `learn` is called only if
    one is open; then the fit is robust if there are outliers, unless `robust` is given. `sigma` is the standard
    deviation of the noise, if it is known, `detail` the size of the smallest detail to keep. The second result is the
    input of `add_regions`; None if the surface cannot have regions.
    """
    root, noise = None, None
    if fixed is None or rings == "auto":
        constraints = FitConstraints(
            None if rings == "auto" else rings, degrees, sigma, np.inf if detail is None else 0.5 * detail
        )
        analyses, root = learn_without_outliers(learn, constraints, robust)
        robust = bool(robust) or (robust is None and root is not None and root.surface.noise.outliers > 0.0)
    if root is not None:
        noise, chosen = root.surface.noise, root.chosen
        if fixed is None:
            choice = _add_noise(FitChoice(chosen.rings, chosen.degree, None, None), noise)
            attempts = tuple(spec_chain(root.specs, chosen))
            steady = noise.heavy or noise.outliers > DENSE_OUTLIER_SHARE
            surface_fit = SurfaceFit(choice, attempts, steady, bool(robust), cleaned=bool(robust))
            return surface_fit, LearnedSurface(analyses, root, constraints)
    if rings == "auto":
        rings = 2 if root is None else root.chosen.rings
    fit = fixed or patch_of_degrees(degrees)
    choice = _add_noise(FitChoice(rings, fit.degree, fit.alpha, None), noise)
    return SurfaceFit(choice, tuple(fallback_chain(rings, fit)), choice.noise_heavy, bool(robust)), None


def patch_of_degrees(degrees: tuple[int, ...]) -> PatchFit:
    """The patch for a surface without a model: of the single allowed degree, but 4 at most, or of degree 3."""
    return PatchFit(min(degrees[0], max(DEGREES))) if len(degrees) == 1 else PatchFit()


def _add_noise(choice: FitChoice, noise: NoiseModel | None) -> FitChoice:
    """Add the noise to a choice, if it is known."""
    if noise is None:
        return choice
    return replace(choice, noise_sigma=noise.sigma, noise_length=noise.length, noise_heavy=noise.heavy)


def learn_without_outliers(
    learn: LearnSurface, constraints: FitConstraints, robust: bool | None = None
) -> tuple[list[RingAnalysis], Leaf | None]:
    """Learn a surface without its outliers, if it has any or if the fit is to be robust.

    The noise model keeps the share of the outliers.
    """
    analyses, leaf = learn(constraints, bool(robust))
    if robust is not None or leaf is None or not leaf.surface.noise.outliers:
        return analyses, leaf
    share = leaf.surface.noise.outliers
    analyses, leaf = learn(constraints, True)
    if leaf is None:
        return analyses, None
    surface = replace(leaf.surface, noise=replace(leaf.surface.noise, outliers=share))
    return analyses, replace(leaf, surface=surface)


def surface_learner(mesh: KernelMesh, cleaned: Callable[[], KernelMesh] | None = None) -> LearnSurface:
    """The function that learns the surface of a mesh in memory; `cleaned` gives the mesh without its outliers."""

    def learn(constraints: FitConstraints, without: bool) -> tuple[list[RingAnalysis], Leaf | None]:
        learned_from = (cleaned or partial(move_outliers, mesh))() if without else mesh
        return learn_surface(learned_from, constraints)

    return learn


def add_regions(fit: SurfaceFit, learned: LearnedSurface, places: ProbeVertices) -> SurfaceFit:
    """Add fits for the regions of the surface, if noise or shape vary, by the features of the first fit."""
    root = learned.root
    tree = grow_tree(root, learned.analyses, places.features, learned.constraints)
    if not fit.robust:  # outliers have large residuals, too
        tree = _split_misfit(tree, root, learned.constraints, places)
    return fit if isinstance(tree, Leaf) else replace(fit, regions=map_leaves(tree, partial(_region_fit, root)))


def _split_misfit(tree: Tree[Leaf], root: Leaf, constraints: FitConstraints, places: ProbeVertices) -> Tree[Leaf]:
    """Split off the probes that the first fit does not follow, if the gain of their own model is large enough."""
    threshold = MIN_MISFIT_RATIO * max(leaf.surface.sigma for leaf in leaves(tree))
    misfits = places.drawn[places.features(places.drawn)[:, RESIDUAL_FEATURE] > threshold]
    if not MIN_MISFIT_COUNT <= len(misfits) <= MAX_MISFIT_FRACTION * len(places.drawn):
        return tree

    def sample(rings: int, count: int, _: SampleMode) -> NeighbourhoodSample:
        return places.sample(misfits[:count], rings)

    vertex_count, noise = root.surface.by_rings[0].analysis.vertex_count, root.surface.noise
    analyses, leaf = learn_from_samples(sample, vertex_count, constraints)
    min_gain = MIN_MISFIT_GAIN
    # Large residuals select places where correlated noise happens to be strong, so its variance is overestimated there.
    # If there is no correlated noise elsewhere, it is shape.
    if leaf is not None and leaf.surface.sigma > noise.sigma and (noise.sills or leaf.surface.noise.sills):
        leaf = fit_leaf(analyses, constraints, noise, heavy=noise.heavy)
        min_gain = MIN_CORRELATED_SPLIT_GAIN if noise.sills else MIN_MISFIT_GAIN
    # if the leaf lacks the ring of the first fit, neighbourhoods of that width fold
    if leaf is None or -np.inf < log_error_reduction(root.chosen, leaf) <= min_gain:
        return tree
    return Split(
        RESIDUAL_FEATURE, threshold, tree, grow_tree(leaf, analyses, places.features, constraints, MAX_TREE_DEPTH - 1)
    )


def _region_fit(root: Leaf, leaf: Leaf) -> RegionFit:
    """Fit of a region: its own specification, or that of the whole if another fit is not worth its time."""
    before, spec, there = root.chosen, leaf.chosen, predict_under_model(root.chosen, leaf.surface)
    sigma = leaf.surface.sigma
    ratios = np.inf, np.inf
    # If the fit of the whole is exact, its standard errors are 0 and cannot be rescaled.
    if there is not None and before.normal_noise > 0.0 and before.curvature_noise > 0.0:
        ratios = there.normal_noise / before.normal_noise, there.curvature_noise / before.curvature_noise
        if there.error <= spec.error * (1.0 + (spec.cost - spec.overhead) / there.cost) ** COST_EXPONENT:
            return RegionFit(there.rings, there.degree, sigma, (), ratios)
    return RegionFit(spec.rings, spec.degree, sigma, tuple(spec_chain(leaf.specs, spec)), ratios)


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
        parts.append(FitPart(len(of_part), part.rings, part.degree, part.noise_sigma))
    return replace(fit.choice, parts=tuple(parts))


def _fit_again(
    mesh: KernelMesh, ids: IntArray, part: RegionFit, geometry: VertexGeometry, robust: bool, progress: Progress | None
) -> None:
    """Refit vertices of a region by its own specification; keep a first fit that succeeded with a smaller error.

    The specification is optimal for neighbourhoods without a border. Near a border the result depends more on the
    priors, and on wider rings more on the terms beyond the degree.
    """
    status = geometry.status[mesh.origin[ids]]
    converged = ids[status <= FitStatus.WIDER_RING]
    rows = mesh.origin[converged]
    before = {name: values[rows] for name, values in arrays_of(geometry).items()}
    instead = [one for one in part.attempts if one.status in (FitStatus.OK, FitStatus.NARROWER_RING)]
    for some, attempts in ((status == FitStatus.OK, instead), (status != FitStatus.OK, part.attempts)):
        fit_with_fallbacks(mesh, ids[some], attempts, geometry, robust=robust, progress=progress)
    with np.errstate(over="ignore", invalid="ignore"):  # infinite and undefined errors of the first fit count as worse
        errors = geometry.normal_std[rows] * geometry.mean_curvature_std[rows]
        is_worse = (
            errors
            > MAX_ERROR_INCREASE**2 * np.prod(part.error_ratios) * before["normal_std"] * before["mean_curvature_std"]
        )
    for name, values in arrays_of(geometry).items():
        values[rows[is_worse]] = before[name][is_worse]
    _rescale_errors(mesh, converged[is_worse], geometry, *part.error_ratios)


def _region_numbers(parts: Tree[RegionFit], geometry: VertexGeometry, origin: IntArray, ids: IntArray) -> ByteArray:
    """The number of the region of each vertex, (k,); in chunks, to save memory."""
    numbers = np.empty(len(ids), dtype=np.int8)

    def number(start: int, stop: int) -> None:
        numbers[start:stop] = leaf_numbers(parts, first_features(geometry, origin[ids[start:stop]]))

    run_kernel(number, len(ids))
    return numbers


def _rescale_errors(
    mesh: KernelMesh, ids: IntArray, geometry: VertexGeometry, of_normal: float, of_curvature: float
) -> None:
    """Rescale the standard errors of vertices to those of the same fit under another model."""
    rows, of_both = mesh.origin[ids], (geometry.mean_curvature_std, geometry.gaussian_curvature_std)
    geometry.normal_std[rows] *= of_normal
    for errors in of_both:
        errors[rows] *= of_curvature
    if of_curvature > 1.0:
        run_kernel(bound_errors, len(ids), mesh, ids, *of_both)


def fit_in_balls(
    mesh: KernelMesh,
    ids: IntArray,
    radius: float,
    fit: PatchFit | None,
    degrees: tuple[int, ...],
    geometry: VertexGeometry,
    *,
    sigma: float | None = None,
    robust: bool = False,
    find_edges: FindEdges,
    progress: Progress | None = None,
) -> FitChoice:
    """Fit the vertices `ids` to the balls of a radius, a length, around them.

    If the patch is open, the best specification for the rings of about this radius is used for all vertices.
    """
    constraints = FitConstraints(None, degrees, sigma)
    leaf = None if fit else _learn_balls(mesh, radius, constraints, robust)
    if leaf is not None:
        edges = find_edges(leaf.surface.noise)
        if edges is not None and (edges & ~mesh.barriers).any():
            mesh = mesh._replace(barriers=mesh.barriers | edges)
            leaf = _learn_balls(mesh, radius, constraints, robust)
    if leaf is None:
        fit = fit or patch_of_degrees(degrees)
        attempts = fallback_chain(1, fit, radius)
        choice = FitChoice(0, fit.degree, fit.alpha, None, radius=radius)
    else:
        attempts = spec_chain(leaf.specs, leaf.chosen, radius)
        choice = _add_noise(FitChoice(0, leaf.chosen.degree, None, None, radius=radius), leaf.surface.noise)
        mesh = use_smoothed_normals(mesh) if leaf.surface.noise.heavy else mesh
    fit_with_fallbacks(mesh, ids, list(attempts), geometry, robust=robust, progress=progress)
    return choice


def _learn_balls(mesh: KernelMesh, radius: float, constraints: FitConstraints, robust: bool) -> Leaf | None:
    """Learn the surface; the chosen specification belongs to the ring whose radius is nearest to `radius`."""
    mesh = move_outliers(mesh) if robust else mesh
    wanted = nearest_rings(mesh, radius)
    analyses, leaf = learn_surface(mesh, replace(constraints, rings=wanted))
    if not analyses:
        return None
    nearest = min(analyses, key=lambda analysis: abs(analysis.radius - radius))
    constraints = replace(constraints, rings=nearest.rings)
    return fit_leaf(analyses, constraints) if leaf is None else best_leaf(leaf.surface, leaf.specs, constraints)


def nearest_rings(mesh: KernelMesh, radius: float) -> int:
    """Number of rings whose median radius is nearest to a length, among the rings that can be analysed."""
    ids = draw_from_mesh(mesh, RADIUS_SAMPLES)
    sample = sample_neighbourhoods(mesh, ids, rings=max(CANDIDATE_RINGS), max_flipped_fraction=MAX_FLIPPED_FRACTION)
    distances = np.sqrt(np.square(sample.points[..., :2]).sum(axis=2))
    best, smallest = 1, np.inf
    for rings in range(1, sample.sizes.shape[1]):
        usable = sample.usable[:, rings]
        if usable.sum() < MIN_SAMPLES:
            break
        within = np.arange(distances.shape[1]) < sample.sizes[usable, rings, np.newaxis]
        difference = abs(float(np.median((distances[usable] * within).max(axis=1))) - radius)
        if difference < smallest:
            best, smallest = rings, difference
    return best
