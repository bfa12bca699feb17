"""Takes noise off a mesh: as a smooth surface or as one with sharp edges, wherever it is which.

There are several estimates of the surface, from smooth to sharp (`candidates`). Stein's estimate of the
risk tells what is best around each vertex, and which of them are worth their while at all.

What holds for a mesh as a whole is learned from parts of it (`learn_plan`) and then done to all of it, or to tile after
tile (`denoise`). A mesh that is not large is its own sample, and learning leaves what was to be found.
"""

from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.learning.noise_model import NoiseModel
from bezier_filters.meshes.adjacency import Adjacency, mean_edge
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.parallel import Progress, report
from bezier_filters.smoothing.candidates import FILTER_ROUNDS, GENTLE, KINDS, SHARPNESS, SMOOTH, Candidate, candidates
from bezier_filters.smoothing.clusters import clusters_of
from bezier_filters.smoothing.correlation import Correlation
from bezier_filters.smoothing.laplacian import Borders
from bezier_filters.smoothing.low_pass import STRENGTHS, LowPassPlan, fit_low_pass, learn_low_pass, strongest
from bezier_filters.smoothing.mesh_parts import LARGEST_WHOLE, MeshPart, SampledParts, sampled_parts, whole_mesh
from bezier_filters.smoothing.noise import (
    NoiseLevels,
    NoisyMesh,
    free_laplacian,
    learn_noise_levels,
    local_sigma,
    roughest,
    roughness,
)
from bezier_filters.smoothing.risk import Estimates, last_gain, local_risks, local_shares, noise_factor, overall_risks
from bezier_filters.smoothing.sliding import Sliding, held_back, sliding_of

# times the mean edge: fine relief of clean scans, in which neighbours differ, too, and which is left alone
DETAIL = 0.01
SMALLEST_NOISE = 1e-4  # times the mean edge: below that there is nothing to take off
GAIN = 1e-3  # times sigma^2: mean decrease of the risk around a vertex below which a further estimate is left out
# around a tile there are the rings in which a low-pass filter fades by so many powers of e, those over which risks
# are averaged, and those that a round of filtering the normals reaches across: measured, for a hundredth of the noise
FADED, AVERAGED, RINGS_PER_ROUND = 7.0, 14, 1.25
HINT = GENTLE + 1  # kind of estimate that may not gain though sharper ones do: strong noise goes in more rounds
STEPS = 6  # of the progress


@dataclass(frozen=True)
class SmoothingPlan:
    """What holds for a mesh as a whole, and how its noise is taken off."""

    center: FloatArray  # (3,): what is taken off the coordinates,
    scale: float  # and what they are then multiplied by: lengths of the plan are in these units
    cluster_pace: float  # see `Clusters`
    noise: NoiseLevels
    low_pass: LowPassPlan
    kinds: tuple[int, ...]  # kinds of estimates that are worth their while
    noise_factor: float  # how much less noise there is than was thought
    overall: FloatArray  # (kinds,): risks of these estimates, see `overall_risks`
    sliding: Sliding


@dataclass(frozen=True)
class Denoised:
    """A mesh without its noise."""

    points: FloatArray  # (n, 3): coordinates
    sharpness: FloatArray  # (n,): 0 where the surface was taken for smooth, 1 where edges were kept as sharp as can be


def remove_noise(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    noise: NoiseModel,
    borders: Borders,
    detail: float | None = None,
    relax: bool = False,
    *,
    threads: int = 1,
    progress: Progress | None = None,
) -> Denoised:
    """Take the noise off a mesh in memory: learn a plan from parts of it, and denoise all of it.

    The noise is that along the normal; `detail` is the length of the shortest waves that keep half of their height.
    All vertices `relax`, that is slide along the surface, only on request (see `sliding`).
    """
    whole, around = whole_mesh(mesh, adjacency), tuple[int, ...]()
    if mesh.vertex_count > LARGEST_WHOLE and noise.sigma > 0.0:
        around = (int(roughest(roughness(whole, noise.sigma, threads=threads), whole.ids)[0]),)
    parts = sampled_parts(mesh, adjacency, around, threads=threads)
    is_whole = parts.part.mesh is mesh
    learned = _learn(parts, noise, borders, detail, relax, threads, progress if is_whole else None)
    if learned is None:
        return Denoised(mesh.vertices.copy(), np.zeros(mesh.vertex_count))
    plan, result = learned
    if is_whole:
        return result
    del parts, learned, result  # for large meshes, memory counts
    return denoise(whole, plan, threads=threads, progress=progress)


def learn_plan(
    parts: SampledParts,
    noise: NoiseModel,
    borders: Borders,
    detail: float | None = None,
    relax: bool = False,
    *,
    threads: int = 1,
) -> SmoothingPlan | None:
    """Learn what holds for a mesh as a whole; None if there is no noise that is worth taking off.

    One of its parts should be around its roughest place, see `roughness`. The others are as for `remove_noise`.
    """
    learned = _learn(parts, noise, borders, detail, relax, threads, None)
    return None if learned is None else learned[0]


def _learn(
    parts: SampledParts,
    noise: NoiseModel,
    borders: Borders,
    smallest: float | None,
    relax: bool,
    threads: int,
    progress: Progress | None,
) -> tuple[SmoothingPlan, Denoised] | None:
    """The plan, and what it makes of the parts."""
    vertices, unit = parts.part.mesh.vertices, mean_edge(parts.part.mesh, parts.part.adjacency, threads=threads)
    sigma = noise.sigma
    if not (sigma > (DETAIL + SMALLEST_NOISE) * unit and unit > 0.0):
        return None
    center = vertices.mean(axis=0)
    if np.abs(center).max() <= np.ptp(vertices, axis=0).max():
        center = np.zeros(3)  # it is not so far from the origin that digits would be lost
    scale = float(2.0 ** -np.round(np.log2(unit)))  # single precision has few exponents
    part, sigma, unit = _normalised(parts.part, center, scale), sigma * scale, unit * scale
    clusters = clusters_of(part)
    least, detail = (DETAIL + SMALLEST_NOISE) * unit, DETAIL * unit
    correlation = Correlation.of(noise, unit / scale, part.ids, free_laplacian(part, threads), parts.core)
    levels, at_vertices = learn_noise_levels(
        part, clusters, parts.core, sigma, correlation, unit, least, detail, given=noise.given, threads=threads
    )
    noisy = NoisyMesh(part, clusters, at_vertices, correlation)
    report(progress, 1, STEPS)
    smallest = None if smallest is None else smallest * scale
    low_pass, fitted = learn_low_pass(noisy, parts.core, borders, unit, smallest, threads=threads)
    report(progress, 2, STEPS)
    found, factor, overall = list[Candidate](), 1.0, np.zeros(1)
    risks: FloatArray | None = None
    # Filters of the normals do to hidden waves what a stronger low-pass filter does that may not be taken.
    stronger = STRENGTHS[low_pass.first + 1 : low_pass.first + 2]
    is_bounded = smallest is not None and bool((stronger > strongest(smallest / unit)).any())
    allowed = (SMOOTH,) if is_bounded else KINDS
    for candidate in candidates(noisy, fitted, allowed, threads=threads):
        if candidate.kind == SMOOTH:
            found = [candidate]
            continue
        report(progress, min(2 + candidate.kind, STEPS - 1), STEPS)
        tried = [*found, candidate]
        less_noise = noise_factor(*_side_by_side(tried, 1.0).means(parts.core))
        estimates = _side_by_side(tried, less_noise)
        these = overall_risks(estimates, parts.core)
        those = local_risks(clusters, estimates, these, correlation.alike, threads=threads)
        if last_gain(clusters, those) > GAIN:
            found, factor, overall, risks = tried, less_noise, these, those
        elif candidate.kind > HINT:
            break
    kinds = tuple(candidate.kind for candidate in found)
    shares = None
    if risks is not None:
        shares = local_shares(clusters, risks, part.vertex_count, correlation.alike, threads=threads)
    mesh, adjacency = parts.part.mesh, parts.part.adjacency
    result = _mixture(mesh, found, shares, scale)
    sliding = Sliding.ALL
    if not relax:
        sliding = sliding_of(mesh, adjacency, result.points, at_vertices / scale, parts.core, threads=threads)
    plan = SmoothingPlan(center, scale, clusters.pace, levels, low_pass, kinds, factor, overall, sliding)
    report(progress, STEPS, STEPS)
    return plan, replace(result, points=held_back(mesh, adjacency, result.points, sliding, threads=threads))


def denoise(part: MeshPart, plan: SmoothingPlan, *, threads: int = 1, progress: Progress | None = None) -> Denoised:
    """Take the noise off a mesh, or off a tile of it with `rings_around` what is wanted, by a plan of `learn_plan`."""
    scaled = _normalised(part, plan.center, plan.scale)
    clusters = clusters_of(scaled, plan.cluster_pace)
    at_vertices, alike = local_sigma(scaled, clusters, plan.noise, threads=threads), plan.noise.correlation.alike
    noisy = NoisyMesh(scaled, clusters, at_vertices, plan.noise.correlation)
    report(progress, 1, STEPS)
    fitted = fit_low_pass(noisy, plan.low_pass, threads=threads)
    report(progress, 2, STEPS)
    estimates, found = candidates(noisy, fitted, plan.kinds, threads=threads), list[Candidate]()
    del fitted  # for large meshes, memory counts
    for candidate in estimates:
        found.append(candidate)
        report(progress, min(2 + candidate.kind, STEPS - 1), STEPS)
    shares = None
    if len(found) > 1:
        risks = local_risks(clusters, _side_by_side(found, plan.noise_factor), plan.overall, alike, threads=threads)
        shares = local_shares(clusters, risks, part.vertex_count, alike, threads=threads)
    result = _mixture(part.mesh, found, shares, plan.scale)
    report(progress, STEPS, STEPS)
    return replace(result, points=held_back(part.mesh, part.adjacency, result.points, plan.sliding, threads=threads))


def rings_around(plan: SmoothingPlan | None) -> int:
    """Rings around a tile that its vertices depend on, as far as matters."""
    if plan is None:
        return 2
    filters = plan.low_pass
    # What a filter makes of a vertex fades away edge by edge, which its poles tell, slowest where edges are short.
    edge = filters.strengths[: filters.used].max() ** -0.25 / filters.haste
    fading = 2.0 * np.sqrt(edge) * np.sin(0.5 * np.pi / filters.order)
    return int(np.ceil(FADED / fading + AVERAGED + RINGS_PER_ROUND * FILTER_ROUNDS[max(plan.kinds)]))


def _normalised(part: MeshPart, center: FloatArray, scale: float) -> MeshPart:
    return replace(part, mesh=TriangleMesh((part.mesh.vertices - center) * scale, part.mesh.faces))


def _side_by_side(found: list[Candidate], factor: float) -> Estimates:
    """Residuals and leverages of all estimates, with less noise by a factor."""
    residuals = np.column_stack([candidate.residuals for candidate in found])
    leverages = np.column_stack([candidate.leverages for candidate in found])
    return Estimates(residuals if factor == 1.0 else residuals / np.float32(factor), leverages)


def _mixture(mesh: TriangleMesh, found: list[Candidate], shares: SingleArray | None, scale: float) -> Denoised:
    """Estimates mixed by their shares; there is only one if these are None."""
    if shares is None:
        shares = np.ones((mesh.vertex_count, 1), dtype=np.float32)
    points = mesh.vertices.copy()
    for k, candidate in enumerate(found):
        points += shares[:, [k]] * (candidate.moves / np.float64(scale))  # which may be beyond single precision
    return Denoised(points, np.einsum("ns,s->n", shares, np.array([SHARPNESS[candidate.kind] for candidate in found])))
