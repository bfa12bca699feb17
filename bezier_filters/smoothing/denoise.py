"""Removes noise from a mesh by a local mixture of smooth and sharp estimates of its surface.

There are several estimates of the surface under the noise, from smooth to sharp (see `candidates`). Stein's unbiased
risk estimate (see `risk`) decides which are used, and with which shares they are mixed around each vertex.

The global parameters are learned from parts of a mesh (`learn_and_denoise`) and then applied to all of it, or tile by
tile (`denoise`). A mesh that is not large is its own sample, and learning already gives the result.
"""

from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.fitting.fallbacks import MAX_EXTRA_RINGS
from bezier_filters.fitting.noise_level import MIN_ROUNDING_PER_EDGE, learn_noise_at
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.noise.rounding import Rounding
from bezier_filters.runtime.parallel import Progress, report
from bezier_filters.sampling.mesh_parts import MAX_WHOLE_VERTICES, MeshPart, sample_parts, whole_mesh
from bezier_filters.smoothing.borders import learn_border_noise, project_border_moves, restrict_borders
from bezier_filters.smoothing.candidates import (
    BILATERAL_ROUNDS,
    ESTIMATE_KINDS,
    KIND_SHARPNESS,
    LOW_PASS_KIND,
    PATCH_KIND,
    PROGRESS_STEPS,
    WEAK_BILATERAL_KIND,
    Candidate,
    candidates,
    learn_patches,
    patch_candidate,
)
from bezier_filters.smoothing.chebyshev import DEFAULT_ORDER
from bezier_filters.smoothing.clusters import Clusters, clusters_of
from bezier_filters.smoothing.laplacian import Borders, umbrella_laplacian
from bezier_filters.smoothing.low_pass import (
    FILTER_STRENGTHS,
    LowPass,
    LowPassPlan,
    fit_low_pass,
    learn_low_pass,
    max_strength,
    shares_of,
)
from bezier_filters.smoothing.move_limits import MAX_MOVE_SIGMAS, limit_moves, small_component_mask
from bezier_filters.smoothing.noise import (
    DEFAULT_TIME_SCALE,
    MIN_NOISE_PER_EDGE,
    NoiseLevels,
    NoisyMesh,
    add_rounding_errors,
    apply_noise_levels,
    learn_noise_levels,
    roughest_vertices,
    roughness,
    rounding_levels,
)
from bezier_filters.smoothing.patch_estimates import EDGE_RINGS, PatchPlan
from bezier_filters.smoothing.random_noise import Correlation
from bezier_filters.smoothing.risk import (
    Estimates,
    local_risks,
    mean_gain,
    noise_factor,
    overall_risks,
    select_estimates,
)
from bezier_filters.smoothing.rounding_errors import SURFACE_STRENGTH, project_on_rounding, rounding_errors
from bezier_filters.smoothing.sliding import TangentialMotion, choose_sliding, restrict_to_normals

MIN_RISK_GAIN = 1e-3  # mean decrease of the risk, over sigma^2, by another estimate
MIN_RETAINED_GAIN = 3e-4  # the same for estimates that sharper ones may have replaced
# Rings around a tile: those in which a low-pass filter decays by exp(-7.5), those over which risks are averaged (see
# `AVERAGING_TIME`), and those per round of the normal filter; measured for errors of a hundredth of the noise.
FADING_EXPONENT, AVERAGING_RINGS, RINGS_PER_ROUND = 7.5, 14, 1.25
FIRST_SHARP_KIND = WEAK_BILATERAL_KIND + 1  # kinds up to this are tried without a gain: strong noise needs more rounds
WEAKER_STEPS = 4  # by which filters between projections are weaker; with 3 or 5 masks keep 1.02 or 1.00 times as much


@dataclass(frozen=True)
class SmoothingOptions:
    """The user's options of noise removal."""

    borders: Borders = "curve"
    detail: float | None = None  # length of the shortest waves that keep half of their height
    relax: bool = False  # whether all vertices slide along the surface, see `sliding`
    sigma: float | None = None  # known standard deviation of the noise along the normal, a length
    # whether what remains of noise in all directions is removed again: it makes faces flatter and sharp edges rounder
    repeats: bool = True
    # whether the faces are those of a point cloud: vertices then stay where they are along the surface, and their
    # patches are an estimate, too
    is_cloud: bool = False


@dataclass(frozen=True)
class SmoothingPlan:
    """Global parameters of the noise removal of a mesh."""

    center: FloatArray  # (3,): origin that is subtracted from the coordinates
    scale: float  # factor on the coordinates: lengths of the plan have this unit
    cluster_time_scale: float  # see `Clusters`
    noise: NoiseLevels
    low_pass: LowPassPlan
    kinds: tuple[int, ...]  # kinds of estimates that reduce the risk
    noise_factor: float  # ratio of the actual to the assumed standard deviation of the noise
    overall: FloatArray  # (kinds,): risks of these estimates, see `overall_risks`
    remaining: float  # expected root mean square error over the assumed standard deviation of the noise
    sliding: TangentialMotion
    # standard deviation of the noise across the border, a length; None if its moves are not restricted
    border_sigma: float | None
    is_cloud: bool = False  # see `SmoothingOptions`
    patches: PatchPlan | None = None  # the patches, if they are one of the estimates


@dataclass(frozen=True)
class DenoisedMesh:
    """A mesh without its noise."""

    points: FloatArray  # (n, 3): coordinates
    sharpness: FloatArray  # (n,): 0 where the smooth estimates were used, 1 where the sharpest one was used
    noise: FloatArray  # (n,): standard deviation of the noise, a length; 0 where nothing is known to be noise
    error: FloatArray  # (n,): expected error of the points along the normal, a length


def remove_noise(
    mesh: PreparedMesh,
    noise: NoiseModel,
    options: SmoothingOptions,
    *,
    progress: Progress | None = None,
) -> DenoisedMesh:
    """Remove the noise along the normal from a mesh in memory: learn a plan from parts of it, and denoise all of it."""
    whole, around, clusters = whole_mesh(mesh), tuple[int, ...](), None
    if mesh.vertex_count > MAX_WHOLE_VERTICES and noise.sigma > 0.0:
        clusters = clusters_of(whole, DEFAULT_TIME_SCALE)
        around = (int(roughest_vertices(roughness(whole, noise.sigma, clusters), whole.ids)[0]),)
    parts = sample_parts(mesh, around)
    is_whole = parts.mesh is mesh
    shown = progress if is_whole else None
    learned = learn_and_denoise(parts, noise, options, progress=shown)
    if learned is None:
        n = mesh.vertex_count
        return DenoisedMesh(mesh.vertices.copy(), np.zeros(n), *np.full((2, n), noise.sigma))
    plan, result = learned
    if is_whole:
        return result
    del parts, learned, result  # for large meshes, memory counts
    return denoise(whole, plan, clusters, progress=progress)


def learn_and_denoise(
    parts: MeshPart, noise: NoiseModel, options: SmoothingOptions, *, progress: Progress | None = None
) -> tuple[SmoothingPlan, DenoisedMesh] | None:
    """Learn the global parameters from parts of a mesh, and denoise the parts; None if the noise is negligible.

    One of the parts should be around the roughest vertex of the mesh, see `roughness`.
    """
    vertices, unit = parts.mesh.vertices, parts.mesh.mean_edge
    sigma = noise.sigma
    least = MIN_NOISE_PER_EDGE if noise.rounding is None else MIN_ROUNDING_PER_EDGE
    if not (sigma > least * unit and unit > 0.0):
        return None
    center = vertices.mean(axis=0)
    if np.abs(center).max() <= np.ptp(vertices, axis=0).max():
        center = np.zeros(3)  # near the origin no digits are lost
    scale = float(2.0 ** -np.round(np.log2(unit)))  # single precision has few exponents
    part, sigma, unit = _normalise(parts, center, scale), sigma * scale, unit * scale
    laplacian = umbrella_laplacian(part, "free")
    correlation = Correlation.calibrate(noise, unit / scale, part.ids, laplacian, parts.core)
    noisy = NoisyMesh(part, clusters_of(part), np.full(len(part.ids), sigma), correlation, laplacian)

    def noise_at(vertices: IntArray) -> tuple[float, float] | None:
        there = learn_noise_at(parts.mesh, vertices)
        return None if there is None else (there[0] * scale, there[1])

    if noise.rounding is not None and noise.rounding.has_terraces:
        errors = rounding_errors(parts, noise.rounding, laplacian, unit / scale)
        levels = rounding_levels(noise.rounding, errors, parts, noise.sigma if noise.given else None)
        noisy = add_rounding_errors(noisy, levels, errors, scale)
    else:
        levels, at_vertices = learn_noise_levels(noisy, laplacian, sigma, unit, noise_at, given=noise.given)
        levels, noisy = replace(levels, rounding=noise.rounding), replace(noisy, sigma=at_vertices)
    report(progress, 1, PROGRESS_STEPS)
    detail = None if options.detail is None else options.detail * scale
    low_pass, filters = learn_low_pass(noisy, options.borders, unit, detail)
    # Normal filters would remove long waves like the stronger low-pass filter that `detail` excludes.
    stronger = FILTER_STRENGTHS[low_pass.first + 1 : low_pass.first + 2]
    is_bounded = detail is not None and bool((stronger > max_strength(detail / unit)).any())
    allowed = (LOW_PASS_KIND,) if is_bounded else ESTIMATE_KINDS
    others = candidates(noisy, filters, allowed, progress=progress)
    found, factor, clusters = [next(others)], 1.0, noisy.clusters
    risks = np.zeros((len(clusters.sizes), 1))
    for candidate in others:
        tried = [*found, candidate]
        tried_factor = noise_factor(_stack_estimates(noisy, tried), parts.core)
        estimates = _stack_estimates(noisy, tried, tried_factor)
        overall = overall_risks(estimates, parts.core)
        these = local_risks(clusters, estimates, overall, noisy.correlation.variance_inflation)
        if mean_gain(clusters, these, -1) > MIN_RISK_GAIN:
            found, factor, risks = tried, tried_factor, these
        elif candidate.kind > FIRST_SHARP_KIND:
            break
    patches = None
    if options.is_cloud and not (is_bounded or options.relax or noise.rounding):  # patches do not slide
        base = found[int(overall_risks(_stack_estimates(noisy, found, factor), parts.core).argmin())]
        patches = learn_patches(noisy, base, sigma)
    if patches is not None:
        tried = [*found, patch_candidate(noisy, found, patches)]
        factor = noise_factor(_stack_estimates(noisy, tried), parts.core)
        estimates = _stack_estimates(noisy, tried, factor)
        these = local_risks(
            clusters, estimates, overall_risks(estimates, parts.core), noisy.correlation.variance_inflation
        )
        if mean_gain(clusters, these, -1) > MIN_RISK_GAIN:
            found, risks = tried, these
        else:
            patches, factor = None, noise_factor(_stack_estimates(noisy, found), parts.core)
    # Estimates that were better than weaker ones may not be better than sharper ones.
    kept = set(select_estimates(clusters, risks, MIN_RETAINED_GAIN))
    if patches is not None and len(found) - 1 in kept:
        kept.add(next(k for k, candidate in enumerate(found) if candidate.kind == patches.base))
    found = [found[k] for k in sorted(kept)]
    if found[-1].kind != PATCH_KIND:
        patches = None
    estimates = _stack_estimates(noisy, found, factor)
    overall = overall_risks(estimates, parts.core)
    # Residuals agree with noise times `factor`: Stein's risk of the best estimate is its leverage then.
    leverage = float(estimates.means(parts.core)[1][overall.argmin()])
    remaining = factor * float(np.sqrt(np.clip(leverage, 0.0, 1.0)))
    kinds = tuple(candidate.kind for candidate in found)
    result = _mixture(parts.mesh, noisy, found, factor, overall, remaining, scale)
    if noise.rounding is not None:
        result = _project_on_rounding(parts, result, filters, noise.rounding, center, scale)
    sliding = TangentialMotion.ALL
    if options.is_cloud:
        sliding = TangentialMotion.ALL if options.relax else TangentialMotion.NONE
    elif not options.relax:
        sliding = choose_sliding(parts, result.points, noisy.sigma / scale)
    # where noise turns faces over, normals of the border are unknown
    across = None if noise.heavy or options.is_cloud else learn_border_noise(parts, noise.sigma)
    time_scale = clusters.time_scale
    plan = SmoothingPlan(
        center,
        scale,
        time_scale,
        levels,
        low_pass,
        kinds,
        factor,
        overall,
        remaining,
        sliding,
        across,
        options.is_cloud,
        patches,
    )
    report(progress, PROGRESS_STEPS, PROGRESS_STEPS)
    return plan, _restrict(parts, result, plan)


def denoise(
    part: MeshPart, plan: SmoothingPlan, clusters: Clusters | None = None, *, progress: Progress | None = None
) -> DenoisedMesh:
    """Remove the noise from a mesh, or from a tile with `halo_rings` around its vertices, by a plan.

    The plan is learned by `learn_and_denoise`. The clusters may be given, with any time scale.
    """
    scaled = _normalise(part, plan.center, plan.scale)
    clusters = replace(clusters or clusters_of(scaled, plan.cluster_time_scale), time_scale=plan.cluster_time_scale)
    noisy = apply_noise_levels(scaled, clusters, plan.noise, plan.low_pass.unit, part, plan.scale)
    report(progress, 1, PROGRESS_STEPS)
    filters = fit_low_pass(noisy, plan.low_pass)
    rounding, kept = plan.noise.rounding, filters if plan.noise.rounding is not None else None
    estimates = candidates(noisy, filters, plan.kinds, progress=progress)
    del filters  # for large meshes, memory counts
    found = list(estimates)
    if plan.patches is not None:
        found.append(patch_candidate(noisy, found, plan.patches))
    result = _mixture(part.mesh, noisy, found, plan.noise_factor, plan.overall, plan.remaining, plan.scale)
    if rounding is not None and kept is not None:
        result = _project_on_rounding(part, result, kept, rounding, plan.center, plan.scale)
    report(progress, PROGRESS_STEPS, PROGRESS_STEPS)
    return _restrict(part, result, plan)


def _project_on_rounding(
    part: MeshPart, found: DenoisedMesh, filters: LowPass, rounding: Rounding, center: FloatArray, scale: float
) -> DenoisedMesh:
    """The nearest smooth surface that rounding allows; the filters are for coordinates less a center, times a scale."""
    weak = filters.weaken(WEAKER_STEPS)
    points = project_on_rounding(
        part.mesh, found.points, rounding, lambda x: weak.apply((x - center) * scale) / scale + center
    )
    return replace(found, points=points)


def halo_rings(plan: SmoothingPlan | None) -> int:
    """Rings around a tile that its vertices depend on, up to a hundredth of the noise."""
    if plan is None:
        return 2
    filters = plan.low_pass

    def fading(strength: float, order: int) -> float:
        """Rings over which the response to an impulse decays by exp(-1), at a rate given by the poles of the filter."""
        return float(0.5 * np.sqrt(strength**0.25 * filters.max_diffusivity) / np.sin(0.5 * np.pi / order))

    strongest = filters.strengths.max()
    rings = fading(strongest, filters.order)
    patch_rings = 0 if plan.patches is None else plan.patches.fit.choice.rings + MAX_EXTRA_RINGS + EDGE_RINGS
    of_normals = RINGS_PER_ROUND * max(BILATERAL_ROUNDS[kind] for kind in plan.kinds if kind != PATCH_KIND)
    if plan.noise.rounding is not None:
        weaker = strongest * FILTER_STRENGTHS[1] / FILTER_STRENGTHS[1 + WEAKER_STEPS]
        rings += fading(SURFACE_STRENGTH, DEFAULT_ORDER) + fading(weaker, filters.order)
    return int(np.ceil(FADING_EXPONENT * rings + AVERAGING_RINGS + of_normals + patch_rings))


def _normalise(part: MeshPart, center: FloatArray, scale: float) -> MeshPart:
    return replace(part, mesh=part.mesh.move((part.mesh.vertices - center) * scale))


def _restrict(part: MeshPart, found: DenoisedMesh, plan: SmoothingPlan) -> DenoisedMesh:
    """Restrict the moves of a mesh to its normals, to a multiple of the noise, and to components of enough vertices."""
    sliding = plan.sliding
    noise = np.where(small_component_mask(part), 0.0, found.noise)
    points = restrict_to_normals(part.mesh, found.points, sliding)
    if plan.is_cloud:
        points = points if sliding == TangentialMotion.ALL else project_border_moves(part.mesh, points)
    elif plan.border_sigma is not None:
        points = restrict_borders(part.mesh, points, plan.border_sigma, slides=sliding == TangentialMotion.ALL)
    return replace(found, points=limit_moves(part.mesh.vertices, points, MAX_MOVE_SIGMAS * noise), noise=noise)


def _stack_estimates(noisy: NoisyMesh, found: list[Candidate], factor: float = 1.0) -> Estimates:
    """Residuals and leverages of all estimates, for noise rescaled by a factor."""
    residuals = np.column_stack([candidate.residuals for candidate in found])
    leverages = np.column_stack([candidate.leverages for candidate in found])
    return Estimates(residuals if factor == 1.0 else residuals / np.float32(factor), leverages, noisy.weights)


def _mixture(
    mesh: PreparedMesh,
    noisy: NoisyMesh,
    found: list[Candidate],
    factor: float,
    overall: FloatArray,
    remaining: float,
    scale: float,
) -> DenoisedMesh:
    """Mix estimates by their risks around every vertex; `remaining` is the expected error over the noise."""
    shares = np.ones((mesh.vertex_count, 1), dtype=np.float32)
    if len(found) > 1:
        shares = shares_of(noisy, _stack_estimates(noisy, found, factor), overall)
    points = mesh.vertices.copy()
    for k, candidate in enumerate(found):
        points += shares[:, [k]] * (candidate.moves / np.float64(scale))  # a scale that may exceed single precision
    sharpness = np.einsum("ns,s->n", shares, np.array([KIND_SHARPNESS[candidate.kind] for candidate in found]))
    sigma = noisy.sigma / scale
    return DenoisedMesh(points, sharpness, sigma, remaining * sigma)
