"""Estimates of the surface under the noise, from smooth to sharp, and by patches.

The first is a low-pass filter f(L) of the vertices. For edges and corners, a weak low-pass filter is followed by rounds
of a bilateral filter of the face normals, which does not average over differences that noise cannot explain, and the
vertices follow the normals. More rounds give sharper estimates. Point clouds also have their patches.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.runtime.parallel import Progress, report
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.low_pass import LowPass
from bezier_filters.smoothing.noise import NoisyMesh
from bezier_filters.smoothing.normal_filter import NoisyNormals, filter_normals, move_to_normals, noisy_normals
from bezier_filters.smoothing.patch_estimates import PatchPlan, choose_patch_fit, move_to_patches, patch_arrays
from bezier_filters.smoothing.random_noise import PROBE_SIGN_COLUMN

# kinds of estimates: the low-pass filter; one bilateral round after a slightly weaker low-pass filter; sharp ones
LOW_PASS_KIND, WEAK_BILATERAL_KIND = 0, 1
BILATERAL_ROUNDS = (0, 1, 2, 5, 16)  # rounds of `filter_normals` by kind; sharp kinds start from a much weaker filter
PATCH_KIND = len(BILATERAL_ROUNDS)  # the patches of the vertices
KIND_SHARPNESS = (0.0, 0.0, 0.33, 0.67, 1.0, 0.0)  # reported sharpness by kind
ESTIMATE_KINDS = range(len(BILATERAL_ROUNDS))
WEAK_BILATERAL_TOLERANCE, SHARP_BILATERAL_TOLERANCE = 3.2, 1.65  # tolerances of `filter_normals`
PROBE_SIGMAS = 0.1  # displacement of the probe that measures leverages, over sigma
NOISE_PAIR_BUDGET = 30_000  # vertices times pairs of noise samples that pass through the normal filter
PROGRESS_STEPS = 6  # steps that `progress` reports


@dataclass(frozen=True)
class Candidate:
    """An estimate of the surface."""

    kind: int  # index of `BILATERAL_ROUNDS`
    moves: SingleArray  # (n, 3): displacements of the vertices
    residuals: SingleArray  # (n,): heights of the measured vertices over it, in standard deviations of the noise
    leverages: SingleArray  # (n,): derivatives of the estimate by its own vertex


def candidates(
    noisy: NoisyMesh, filters: LowPass, kinds: Collection[int], *, progress: Progress | None = None
) -> Iterator[Candidate]:
    """Estimates of the given kinds in ascending sharpness; the first is the low-pass filter.

    All others start with a weaker low-pass filter.
    """
    part = noisy.part
    report(progress, 2, PROGRESS_STEPS)
    signs = noisy.probes(1, first=PROBE_SIGN_COLUMN)[:, 0]
    squares = noisy.mean_squares(signs[:, np.newaxis])
    filtered = filters.apply(np.column_stack([part.mesh.vertices, signs]))
    leverages = (signs * filtered[:, 3] / squares).astype(np.float32)
    yield Candidate(LOW_PASS_KIND, _moves(part.mesh, filtered[:, :3]), filters.residuals, leverages)
    del filtered, leverages  # for large meshes, memory counts
    sharp = {kind: BILATERAL_ROUNDS[kind] for kind in ESTIMATE_KINDS[WEAK_BILATERAL_KIND + 1 :] if kind in kinds}
    if WEAK_BILATERAL_KIND in kinds:
        # `pop` passes on the only reference, so that the memory is freed early
        prefiltered = [_prefilter(noisy, filters.next_weaker(), signs)]
        yield from _sharp_candidates(
            noisy, prefiltered.pop(), squares, {WEAK_BILATERAL_KIND: 1}, WEAK_BILATERAL_TOLERANCE, progress
        )
    if sharp:
        weak = filters.prefilter(umbrella_laplacian(part, filters.borders))
        prefiltered = [_prefilter(noisy, weak, signs)]
        del filters, weak
        yield from _sharp_candidates(noisy, prefiltered.pop(), squares, sharp, SHARP_BILATERAL_TOLERANCE, progress)


def learn_patches(noisy: NoisyMesh, base: Candidate, sigma: float) -> PatchPlan | None:
    """Choose the fit of patches that end at the sharp edges of an estimate; None if the surface cannot be learned."""
    mesh = noisy.part.mesh
    fit = choose_patch_fit(patch_arrays(mesh, _move(mesh, base.moves))[0], sigma)
    return None if fit is None else PatchPlan(fit, base.kind)


def patch_candidate(noisy: NoisyMesh, found: Sequence[Candidate], plan: PatchPlan) -> Candidate:
    """The patches of the vertices; near sharp edges, and where patches need other neighbourhoods, their base."""
    mesh, sigma = noisy.part.mesh, noisy.sigma
    base = next(candidate for candidate in found if candidate.kind == plan.base)
    surface = _move(mesh, base.moves)
    normals, (arrays, near) = surface.planes.normals, patch_arrays(mesh, surface)
    signs = noisy.probes(1, first=PROBE_SIGN_COLUMN)[:, 0]
    squares = noisy.mean_squares(signs[:, np.newaxis])
    probe = (PROBE_SIGMAS * sigma * signs)[:, np.newaxis] * normals
    here = move_to_patches(arrays, near, plan.fit)
    there = move_to_patches(arrays._replace(vertices=mesh.vertices + probe), near, plan.fit)
    has_patch = here.has_patch & there.has_patch
    change = np.einsum("ij,ij->i", probe + there.moves - here.moves, normals)
    leverages = change * signs * sigma / (PROBE_SIGMAS * noisy.scale**2 * squares)
    residuals = -np.einsum("ij,ij->i", here.moves, normals) / noisy.scale
    return Candidate(
        PATCH_KIND,
        np.where(has_patch[:, np.newaxis], here.moves, base.moves).astype(np.float32),
        np.where(has_patch, residuals, base.residuals).astype(np.float32),
        np.where(has_patch, leverages, base.leverages).astype(np.float32),
    )


class _Prefiltered(NamedTuple):
    """Start of the sharp estimates: a mesh after a low-pass filter."""

    normals: SingleArray  # (n, 3): normals of a smooth surface, along which noise is measured
    signs: SingleArray  # (n,): signs of the probe
    start: SingleArray  # (n, 3): displacements by the low-pass filter
    probe: SingleArray  # (n, 3): displacements of the probe, a second mesh that measures the leverages
    state: NoisyNormals


def _prefilter(noisy: NoisyMesh, filters: LowPass, signs: SingleArray) -> _Prefiltered:
    """Filter the mesh, the probe and samples of the noise."""
    mesh, normals = noisy.part.mesh, filters.normals
    start = _moves(mesh, filters.apply(mesh.vertices))
    heights = noisy.samples(2 * int(np.clip(np.round(NOISE_PAIR_BUDGET / noisy.part.vertex_count), 1, 3)))
    heights[:, 0] = signs
    heights *= noisy.sigma.astype(np.float32)[:, np.newaxis]
    samples: SingleArray = heights[:, :, np.newaxis] * normals[:, np.newaxis]
    samples = filters.apply(samples.reshape(len(samples), -1)).reshape(samples.shape)
    probe = np.float32(PROBE_SIGMAS) * samples[:, 0]
    state = noisy_normals(_move(mesh, start), _move(mesh, start + probe), samples)
    return _Prefiltered(normals, signs, start, probe, state)


def _sharp_candidates(
    noisy: NoisyMesh,
    prefiltered: _Prefiltered,
    squares: SingleArray,
    rounds: dict[int, int],
    tolerance: float,
    progress: Progress | None,
) -> Iterator[Candidate]:
    """Estimates by kind, whose vertices follow normals after the given rounds of the bilateral filter."""
    mesh, sigma = noisy.part.mesh, noisy.sigma
    normals, signs, start, probe, state = prefiltered
    del prefiltered
    movable, done = ~mesh.adjacency.on_boundary, 0  # border vertices stay
    for kind, total in rounds.items():
        state = filter_normals(state, total - done, tolerance)
        done = total
        moves, probed = (
            first + move_to_normals(_move(mesh, first), goal, movable)
            for first, goal in ((start, state.normals), (start + probe, state.probed_normals))
        )
        residuals = (-np.einsum("ij,ij->i", moves, normals) / noisy.scale).astype(np.float32)
        probed -= moves
        leverages = np.einsum("ij,ij->i", probed, normals) * signs * sigma / (PROBE_SIGMAS * noisy.scale**2 * squares)
        del probed
        leverages = leverages.astype(np.float32)
        report(progress, min(2 + kind, PROGRESS_STEPS - 1), PROGRESS_STEPS)
        yield Candidate(kind, moves, residuals, leverages)


def _moves(mesh: PreparedMesh, vertices: FloatArray) -> SingleArray:
    """Displacements of vertices from their measured positions."""
    return (vertices - mesh.vertices).astype(np.float32)


def _move(mesh: PreparedMesh, moves: SingleArray) -> PreparedMesh:
    return mesh.move(mesh.vertices + moves)
