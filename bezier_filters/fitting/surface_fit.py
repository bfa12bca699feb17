"""Chooses the fit of a surface from sampled neighbourhoods.

The choice follows from a `SurfaceModel` of samples alone, so that the vertices may be fitted all together or in tiles.
The neighbourhoods are rings of edges, balls of one radius, a scale that does not depend on the sampling, or in point
clouds a number of nearest points.
"""

from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.fitting.fallbacks import FitAttempt, fallback_chain, spec_chain
from bezier_filters.fitting.vertex_geometry import FitChoice
from bezier_filters.noise.neighbourhoods import Neighbourhoods
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.patches.patch_fit import DEGREES, PatchFit
from bezier_filters.sampling.ring_analysis import MIN_SAMPLES
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.fit_spec import FitSpec
from bezier_filters.surface_model.learn import (
    CANDIDATE_RINGS,
    explain_unknown_surface,
    learn_surface,
    learn_without_outliers,
)
from bezier_filters.surface_model.model_tree import Leaf, Tree

SIZE_SAMPLES = 150  # neighbourhoods whose radius or number of points is measured
DENSE_OUTLIER_SHARE = 0.1  # share of outliers from which on they flip normals everywhere, as heavy noise does


@dataclass(frozen=True)
class SurfaceFit:
    """Fit of a surface, or of a region of it; its size does not depend on the mesh."""

    choice: FitChoice
    attempts: tuple[FitAttempt, ...]  # tried in order at every vertex; empty for a region that keeps the first fit
    smooth_normals: bool = False  # whether the frames follow smoothed normals, see `use_smoothed_normals`
    robust: bool = False  # whether points with large residuals lose their weight
    cleaned: bool = False  # whether outliers are moved onto the surface around them first
    with_barriers: bool = True  # whether neighbourhoods end at the sharp edges of the mesh: for tiles
    regions: "Tree[SurfaceFit] | None" = None  # fits of the regions, by the features of the first fit
    # factors on the standard errors of normal, curvatures and height where a region keeps the first fit; infinite if
    # unknown
    error_ratios: tuple[float, float, float] = (1.0, 1.0, 1.0)


def choose_fit(source: Neighbourhoods, options: FitOptions) -> tuple[SurfaceFit, Leaf | None]:
    """Choose the parameters that the options leave open, one choice for all vertices.

    The fit is robust if there are outliers, unless `robust` is given. The second result is the surface
    model, to which regions may be added; None if nothing was learned, or all parameters are given.
    """
    if not options.has_rings:
        return _choose_sized_fit(source, options)
    learned = learn_without_outliers(source, options) if options.is_learned else None
    whole = None if learned is None else learned.limit(options)
    robust = bool(options.robust)
    if whole is None:
        noise, rings = None, 2
    else:
        noise, rings = whole.surface.noise, whole.chosen.rings
        robust = robust or (options.robust is None and noise.outliers > 0.0)
        if options.patch is None:
            choice = _add_noise(FitChoice(rings, whole.chosen.degree, None, None), noise)
            smooth_normals = noise.heavy or noise.outliers > DENSE_OUTLIER_SHARE
            attempts = tuple(spec_chain(whole.specs, whole.chosen, is_smoothed=smooth_normals))
            return SurfaceFit(choice, attempts, smooth_normals, robust, cleaned=robust), whole
    rings = options.ring_count or rings
    fit = options.patch or patch_of_degrees(options.degrees)
    choice = _add_noise(FitChoice(rings, fit.degree, fit.alpha, None), noise)
    if options.is_learned and noise is None:
        choice = replace(choice, noise_reason=explain_unknown_surface(source))
    crossings = options.fold_test == "crossings"
    chain = fallback_chain(rings, fit, fallbacks=options.fallbacks)
    return SurfaceFit(
        choice, tuple(replace(one, by_crossings=crossings) for one in chain), choice.noise_heavy, robust
    ), None


def _choose_sized_fit(source: Neighbourhoods, options: FitOptions) -> tuple[SurfaceFit, Leaf | None]:
    """Choose the fit to the balls of a radius around all vertices, or to a number of nearest points.

    If the patch is open, it is the best one for the rings of about this radius, or number of points.
    """
    radius, nearest, robust = options.radius, options.neighbours is not None, bool(options.robust)
    leaf = None if options.is_fixed else _learn_sized(source.clean if robust else source, options)
    if leaf is not None:
        noise = leaf.surface.noise
        choice = FitChoice(0, leaf.chosen.degree, None, None, radius=radius, neighbours=options.neighbours)
        choice = _add_noise(choice, noise)
        attempts = tuple(spec_chain(leaf.specs, leaf.chosen, radius, nearest=nearest, is_smoothed=noise.heavy))
        return SurfaceFit(choice, attempts, noise.heavy, robust), leaf
    fit = options.patch or patch_of_degrees(options.degrees)
    choice = FitChoice(0, fit.degree, fit.alpha, None, radius=radius, neighbours=options.neighbours)
    if options.is_learned:
        choice = replace(choice, noise_reason=explain_unknown_surface(source))
    return SurfaceFit(choice, tuple(fallback_chain(1, fit, radius, nearest=nearest)), robust=robust), None


def _learn_sized(source: Neighbourhoods, options: FitOptions) -> Leaf | None:
    """Learn the surface; the chosen specification belongs to the ring whose size is nearest to the given one."""
    in_rings = replace(options, radius=None, neighbours=None)
    leaf = learn_surface(source, replace(in_rings, rings=_nearest_rings(source, options)))
    if leaf is None:
        return None

    def difference(spec: FitSpec) -> float:
        return abs(spec.points - options.neighbours if options.neighbours else spec.radius - (options.radius or 0.0))

    return leaf.limit(replace(in_rings, rings=min(leaf.specs, key=difference).rings))


def patch_of_degrees(degrees: tuple[int, ...]) -> PatchFit:
    """The patch for a surface without a model: of the single allowed degree, but 4 at most, or of degree 3."""
    return PatchFit(min(degrees[0], max(DEGREES))) if len(degrees) == 1 else PatchFit()


def _add_noise(choice: FitChoice, noise: NoiseModel | None) -> FitChoice:
    """Add the noise to a choice, if it is known."""
    if noise is None:
        return choice
    return replace(choice, noise_sigma=noise.sigma, noise_length=noise.length, noise_heavy=noise.heavy)


def _nearest_rings(source: Neighbourhoods, options: FitOptions) -> int:
    """Number of rings whose median radius, or number of points, is nearest to the given one.

    It is one of the rings that can be analysed.
    """
    sample = source.sample(source.draw(SIZE_SAMPLES), max(CANDIDATE_RINGS), "plain")
    distances = np.sqrt(np.square(sample.points[..., :2]).sum(axis=2))
    best, smallest = 1, np.inf
    for rings in range(1, sample.sizes.shape[1]):
        usable = sample.usable[:, rings]
        if usable.sum() < MIN_SAMPLES:
            break
        sizes = sample.sizes[usable, rings]
        if options.neighbours is not None:
            difference = abs(float(np.median(sizes)) - options.neighbours)
        else:
            within = np.arange(distances.shape[1]) < sizes[:, np.newaxis]
            difference = abs(float(np.median((distances[usable] * within).max(axis=1))) - (options.radius or 0.0))
        if difference < smallest:
            best, smallest = rings, difference
    return best
