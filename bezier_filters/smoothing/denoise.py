"""Takes noise off a mesh: as a smooth surface or as one with sharp edges, wherever it is which.

There are several estimates of the surface under the noise, from smooth to sharp (`candidates`). The first is a low-pass
filter. For edges and corners the normals of a more weakly filtered mesh are filtered, many times, by means that do not
reach across what noise cannot explain, and the vertices follow. In between are fewer rounds. Stein's estimate of the
risk tells what is best around each vertex, and which of them are worth their while at all.

What holds for a mesh as a whole is learned from parts of it (`learn_plan`) and then done to all of it, or to tile after
tile (`denoise`). A mesh that is not large is its own sample, and learning leaves what was to be found.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.learning.noise_model import NoiseModel
from bezier_filters.meshes.adjacency import Adjacency, mean_edge
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.parallel import Progress, report
from bezier_filters.smoothing.clusters import Clusters, clusters_of
from bezier_filters.smoothing.laplacian import Borders, umbrella_laplacian
from bezier_filters.smoothing.low_pass import (
    STRENGTHS,
    LowPass,
    LowPassPlan,
    fit_low_pass,
    learn_low_pass,
    shares_of,
    strongest,
)
from bezier_filters.smoothing.mesh_parts import LARGEST_WHOLE, MeshPart, sampled_parts, whole_mesh
from bezier_filters.smoothing.noise import (
    LEAST_NOISE,
    PACE,
    NoiseLevels,
    NoisyMesh,
    learn_noise_levels,
    local_sigma,
    roughest,
    roughness,
)
from bezier_filters.smoothing.normal_filter import NoisyNormals, filter_normals, move_to_normals, noisy_normals
from bezier_filters.smoothing.random_noise import OTHER_SIGNS, Correlation
from bezier_filters.smoothing.risk import (
    Estimates,
    gain_of,
    local_risks,
    noise_factor,
    overall_risks,
    worthwhile,
)
from bezier_filters.smoothing.sliding import Sliding, held_back, sliding_of

# kinds of estimates: the low-pass filter proper, and one round after a slightly weaker one; then the sharp ones
SMOOTH, GENTLE = 0, 1
FILTER_ROUNDS = (0, 1, 2, 5, 16)  # of filtering the normals, by kind: from the third on after a much weaker filter
SHARPNESS = (0.0, 0.0, 0.33, 0.67, 1.0)  # as reported, by kind
KINDS = range(len(FILTER_ROUNDS))
GENTLE_TOLERANCE, SHARP_TOLERANCE = 3.2, 1.65  # of `filter_normals`
PROBE = 0.1  # times sigma: how far vertices are moved to find their leverages
PAIRS_SAMPLED = 30_000  # about so many vertices times pairs of samples of the noise, that normals are filtered by
GAIN = 1e-3  # times sigma^2: mean decrease of the risk around a vertex below which a further estimate is left out
SUPERFLUOUS = 3e-4  # the same for one that sharper ones may have replaced
# around a tile there are the rings in which a low-pass filter fades by so many powers of e, those over which risks
# are averaged (`SURROUNDINGS` of clusters), and those that a round of filtering the normals reaches across: measured,
# for a hundredth of the noise
FADED, AVERAGED, RINGS_PER_ROUND = 7.5, 14, 1.25
HINT = GENTLE + 1  # kind of estimate that may not gain though sharper ones do: strong noise goes in more rounds
STEPS = 6  # of the progress


@dataclass(frozen=True)
class SmoothingOptions:
    """What a user may decide about how noise is taken off."""

    borders: Borders = "curve"
    detail: float | None = None  # length of the shortest waves that keep half of their height
    relax: bool = False  # whether all vertices slide along the surface, see `sliding`
    sigma: float | None = None  # standard deviation of the noise along the normal, a length, where that is known


@dataclass(frozen=True)
class Candidate:
    """An estimate of the surface."""

    kind: int  # which one it is
    moves: SingleArray  # (n, 3): how far each vertex moves
    residuals: SingleArray  # (n,): heights of the measured vertices over it, times the standard deviation of the noise
    leverages: SingleArray  # (n,): how far it follows each vertex


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
    options: SmoothingOptions,
    *,
    progress: Progress | None = None,
) -> Denoised:
    """Take the noise along the normal off a mesh in memory: learn a plan from parts of it, and denoise all of it."""
    whole, around, clusters = whole_mesh(mesh, adjacency), tuple[int, ...](), None
    if mesh.vertex_count > LARGEST_WHOLE and noise.sigma > 0.0:
        clusters = clusters_of(whole, PACE)
        around = (int(roughest(roughness(whole, noise.sigma, clusters), whole.ids)[0]),)
    parts = sampled_parts(mesh, adjacency, around)
    is_whole = parts.mesh is mesh
    shown = progress if is_whole else None
    learned = learn_plan(parts, noise, options, progress=shown)
    if learned is None:
        return Denoised(mesh.vertices.copy(), np.zeros(mesh.vertex_count))
    plan, result = learned
    if is_whole:
        return result
    del parts, learned, result  # for large meshes, memory counts
    return denoise(whole, plan, clusters, progress=progress)


def learn_plan(
    parts: MeshPart, noise: NoiseModel, options: SmoothingOptions, *, progress: Progress | None = None
) -> tuple[SmoothingPlan, Denoised] | None:
    """Learn what holds for a mesh as a whole, and what it makes of the parts; None if there is no noise to speak of.

    One of the parts should be around the roughest place of the mesh, see `roughness`.
    """
    vertices, unit = parts.mesh.vertices, mean_edge(parts.mesh, parts.adjacency)
    sigma = noise.sigma
    if not (sigma > LEAST_NOISE * unit and unit > 0.0):
        return None
    center = vertices.mean(axis=0)
    if np.abs(center).max() <= np.ptp(vertices, axis=0).max():
        center = np.zeros(3)  # it is not so far from the origin that digits would be lost
    scale = float(2.0 ** -np.round(np.log2(unit)))  # single precision has few exponents
    part, sigma, unit = _normalised(parts, center, scale), sigma * scale, unit * scale
    laplacian = umbrella_laplacian(part, "free")
    correlation = Correlation.of(noise, unit / scale, part.ids, laplacian, parts.core)
    noisy = NoisyMesh(part, clusters_of(part), np.full(len(part.ids), sigma), correlation, laplacian)
    levels, at_vertices = learn_noise_levels(noisy, laplacian, sigma, unit, given=noise.given)
    noisy = replace(noisy, sigma=at_vertices)
    report(progress, 1, STEPS)
    detail = None if options.detail is None else options.detail * scale
    low_pass, filters = learn_low_pass(noisy, options.borders, unit, detail)
    # Filters of the normals do to hidden waves what a stronger low-pass filter does that may not be taken.
    stronger = STRENGTHS[low_pass.first + 1 : low_pass.first + 2]
    is_bounded = detail is not None and bool((stronger > strongest(detail / unit)).any())
    allowed = (SMOOTH,) if is_bounded else KINDS
    others = candidates(noisy, filters, allowed, progress=progress)
    found, factor, clusters = [next(others)], 1.0, noisy.clusters
    risks = np.zeros((len(clusters.sizes), 1))
    for candidate in others:
        tried = [*found, candidate]
        less_noise = noise_factor(_side_by_side(tried), parts.core)
        estimates = _side_by_side(tried, less_noise)
        overall = overall_risks(estimates, parts.core)
        these = local_risks(clusters, estimates, overall, correlation.alike)
        if gain_of(clusters, these, -1) > GAIN:
            found, factor, risks = tried, less_noise, these
        elif candidate.kind > HINT:
            break
    # What was better than weaker filters may not be, beside sharper ones.
    found = [found[k] for k in worthwhile(clusters, risks, SUPERFLUOUS)]
    overall = overall_risks(_side_by_side(found, factor), parts.core)
    kinds = tuple(candidate.kind for candidate in found)
    mesh, adjacency = parts.mesh, parts.adjacency
    result = _mixture(mesh, noisy, found, factor, overall, scale)
    sliding = Sliding.ALL
    if not options.relax:
        sliding = sliding_of(parts, result.points, at_vertices / scale)
    plan = SmoothingPlan(center, scale, clusters.pace, levels, low_pass, kinds, factor, overall, sliding)
    report(progress, STEPS, STEPS)
    return plan, replace(result, points=held_back(mesh, adjacency, result.points, sliding))


def denoise(
    part: MeshPart, plan: SmoothingPlan, clusters: Clusters | None = None, *, progress: Progress | None = None
) -> Denoised:
    """Take the noise off a mesh, or off a tile of it with `rings_around` what is wanted, by a plan of `learn_plan`.

    Its clusters may be known, at any pace.
    """
    scaled = _normalised(part, plan.center, plan.scale)
    clusters = replace(clusters or clusters_of(scaled, plan.cluster_pace), pace=plan.cluster_pace)
    correlation, at_vertices = plan.noise.correlation, local_sigma(scaled, clusters, plan.noise)
    laplacian = umbrella_laplacian(scaled, "free") if correlation.times else None
    noisy = NoisyMesh(scaled, clusters, at_vertices, correlation, laplacian)
    report(progress, 1, STEPS)
    estimates = candidates(noisy, fit_low_pass(noisy, plan.low_pass), plan.kinds, progress=progress)
    found = list(estimates)
    result = _mixture(part.mesh, noisy, found, plan.noise_factor, plan.overall, plan.scale)
    report(progress, STEPS, STEPS)
    return replace(result, points=held_back(part.mesh, part.adjacency, result.points, plan.sliding))


def rings_around(plan: SmoothingPlan | None) -> int:
    """Rings around a tile that its vertices depend on, as far as matters."""
    if plan is None:
        return 2
    filters = plan.low_pass
    # What a filter makes of a vertex fades away edge by edge, which its poles tell, slowest where edges are short.
    edge = filters.strengths.max() ** -0.25 / filters.haste
    fading = 2.0 * np.sqrt(edge) * np.sin(0.5 * np.pi / filters.order)
    return int(np.ceil(FADED / fading + AVERAGED + RINGS_PER_ROUND * FILTER_ROUNDS[max(plan.kinds)]))


def _normalised(part: MeshPart, center: FloatArray, scale: float) -> MeshPart:
    return replace(part, mesh=TriangleMesh((part.mesh.vertices - center) * scale, part.mesh.faces))


def _side_by_side(found: list[Candidate], factor: float = 1.0) -> Estimates:
    """Residuals and leverages of all estimates, with less noise by a factor."""
    residuals = np.column_stack([candidate.residuals for candidate in found])
    leverages = np.column_stack([candidate.leverages for candidate in found])
    return Estimates(residuals if factor == 1.0 else residuals / np.float32(factor), leverages)


def _mixture(
    mesh: TriangleMesh, noisy: NoisyMesh, found: list[Candidate], factor: float, overall: FloatArray, scale: float
) -> Denoised:
    """Estimates mixed by their risks around every vertex."""
    shares = np.ones((mesh.vertex_count, 1), dtype=np.float32)
    if len(found) > 1:
        shares = shares_of(noisy, _side_by_side(found, factor), overall)
    points = mesh.vertices.copy()
    for k, candidate in enumerate(found):
        points += shares[:, [k]] * (candidate.moves / np.float64(scale))  # which may be beyond single precision
    return Denoised(points, np.einsum("ns,s->n", shares, np.array([SHARPNESS[candidate.kind] for candidate in found])))


def candidates(
    noisy: NoisyMesh, filters: LowPass, kinds: Collection[int], *, progress: Progress | None = None
) -> Iterator[Candidate]:
    """Estimates, ever sharper ones, of which the first is the low-pass filter's, and others as they are wanted.

    All of them start with more or less of that filter.
    """
    part = noisy.part
    report(progress, 2, STEPS)
    signs = noisy.probes(1, first=OTHER_SIGNS)[:, 0]
    squares = noisy.mean_squares(signs[:, np.newaxis])
    filtered = filters.apply(np.column_stack([part.mesh.vertices, signs]))
    leverages = (signs * filtered[:, 3] / squares).astype(np.float32)
    yield Candidate(SMOOTH, _moves(part.mesh, filtered[:, :3]), filters.residuals, leverages)
    del filtered, leverages  # for large meshes, memory counts
    sharp = {kind: FILTER_ROUNDS[kind] for kind in KINDS[GENTLE + 1 :] if kind in kinds}
    if GENTLE in kinds:
        begun = [_begun(noisy, filters.next_weaker(), signs)]  # lists hand over what they hold: nothing else keeps it
        yield from _sharp(noisy, begun.pop(), squares, {GENTLE: 1}, GENTLE_TOLERANCE, progress)
    if sharp:
        weak = filters.weak(umbrella_laplacian(part, filters.borders))
        begun = [_begun(noisy, weak, signs)]
        del filters, weak
        yield from _sharp(noisy, begun.pop(), squares, sharp, SHARP_TOLERANCE, progress)


class _Begun(NamedTuple):
    """What sharp estimates begin with: a mesh after a low-pass filter."""

    normals: SingleArray  # (n, 3): of a smooth surface, along which noise is measured
    signs: SingleArray  # (n,): of the probe
    start: SingleArray  # (n, 3): moves
    probe: SingleArray  # (n, 3): what moves the mesh of which one sees how far estimates follow the data
    state: NoisyNormals


def _begun(noisy: NoisyMesh, filters: LowPass, signs: SingleArray) -> _Begun:
    """Filter the mesh, the probe and samples of the noise."""
    mesh, normals = noisy.part.mesh, filters.normals
    start = _moves(mesh, filters.apply(mesh.vertices))
    heights = noisy.samples(2 * int(np.clip(np.round(PAIRS_SAMPLED / noisy.part.vertex_count), 1, 3)))
    heights[:, 0] = signs
    heights *= noisy.sigma.astype(np.float32)[:, np.newaxis]
    samples: SingleArray = heights[:, :, np.newaxis] * normals[:, np.newaxis]
    samples = filters.apply(samples.reshape(len(samples), -1)).reshape(samples.shape)
    probe = np.float32(PROBE) * samples[:, 0]
    state = noisy_normals(_moved(mesh, start), noisy.part.adjacency, _moved(mesh, start + probe), samples)
    return _Begun(normals, signs, start, probe, state)


def _sharp(
    noisy: NoisyMesh,
    begun: _Begun,
    squares: SingleArray,
    rounds: dict[int, int],
    tolerance: float,
    progress: Progress | None,
) -> Iterator[Candidate]:
    """Estimates by kind, whose vertices follow normals that were filtered some rounds."""
    mesh, adjacency, sigma = noisy.part.mesh, noisy.part.adjacency, noisy.sigma
    normals, signs, start, probe, state = begun
    del begun
    movable, done = ~adjacency.on_boundary, 0  # those at borders stay
    for kind, total in rounds.items():
        state = filter_normals(state, total - done, tolerance)
        done = total
        moves, probed = (
            first + move_to_normals(_moved(mesh, first), adjacency, goal, movable)
            for first, goal in ((start, state.normals), (start + probe, state.probed_normals))
        )
        residuals = (-np.einsum("ij,ij->i", moves, normals) / sigma).astype(np.float32)
        probed -= moves
        leverages = np.einsum("ij,ij->i", probed, normals) * signs / (PROBE * sigma * squares)
        del probed
        leverages = leverages.astype(np.float32)
        report(progress, min(2 + kind, STEPS - 1), STEPS)
        yield Candidate(kind, moves, residuals, leverages)


def _moves(mesh: TriangleMesh, vertices: FloatArray) -> SingleArray:
    """How far vertices are from where they were measured."""
    return (vertices - mesh.vertices).astype(np.float32)


def _moved(mesh: TriangleMesh, moves: SingleArray) -> TriangleMesh:
    return TriangleMesh(mesh.vertices + moves, mesh.faces)
