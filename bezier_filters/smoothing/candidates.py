"""Estimates of the surface under the noise, from smooth to sharp.

The first is a low-pass filter. For edges and corners the normals of a more weakly filtered mesh are
filtered, many times, by means that do not reach across what noise cannot explain, and the
vertices follow. In between are fewer rounds.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.low_pass import FittedLowPass, LowPass
from bezier_filters.smoothing.noise import NoisyMesh
from bezier_filters.smoothing.normal_filter import filter_normals, noisy_normals
from bezier_filters.smoothing.probes import OTHER_SIGNS
from bezier_filters.smoothing.vertex_update import move_to_normals

# kinds of estimates: the low-pass filter proper, and one round after a slightly weaker one; then the sharp ones
SMOOTH, GENTLE = 0, 1
FILTER_ROUNDS = (0, 1, 2, 5, 16)  # of filtering the normals, by kind: from the third on after a much weaker filter
SHARPNESS = (0.0, 0.0, 0.33, 0.67, 1.0)  # as reported, by kind
KINDS = range(len(FILTER_ROUNDS))
GENTLE_TOLERANCE, SHARP_TOLERANCE = 2.5, 1.5  # of `filter_normals`
PROBE = 0.1  # times sigma: how far vertices are moved to find their leverages
FEWEST_SAMPLED = 60_000  # vertices times samples of the noise, that normals are filtered by


@dataclass(frozen=True)
class Candidate:
    """An estimate of the surface."""

    kind: int  # which one it is
    moves: SingleArray  # (n, 3): how far each vertex moves
    residuals: SingleArray  # (n,): heights of the measured vertices over it, times the standard deviation of the noise
    leverages: SingleArray  # (n,): how far it follows each vertex


def candidates(
    noisy: NoisyMesh, fitted: FittedLowPass, kinds: Collection[int] = KINDS, *, threads: int = 1
) -> Iterator[Candidate]:
    """Estimates, ever sharper ones, of which the first is the low-pass filter's, and others as they are wanted.

    All of them start with more or less of that filter.
    """
    part, filters, normals = noisy.part, fitted.filters, fitted.shape.normals.astype(np.float32)
    signs = noisy.probes(1, first=OTHER_SIGNS, threads=threads)[:, 0]
    squares = noisy.mean_squares(signs[:, np.newaxis], threads=threads)
    filtered = filters.apply(np.column_stack([part.mesh.vertices, signs]), threads=threads)
    leverages = (signs * filtered[:, 3] / squares).astype(np.float32)
    yield Candidate(SMOOTH, _moves(part.mesh, filtered[:, :3]), fitted.residuals, leverages)
    del fitted, filtered, leverages  # for large meshes, memory counts
    sharp = {kind: FILTER_ROUNDS[kind] for kind in KINDS[GENTLE + 1 :] if kind in kinds}
    if GENTLE in kinds:
        yield from _sharp(noisy, filters.weaker(), normals, signs, squares, {GENTLE: 1}, GENTLE_TOLERANCE, threads)
    if sharp:
        umbrella = umbrella_laplacian(part.mesh, part.adjacency, filters.borders, cut=part.cut, threads=threads)
        filters = filters.weak(umbrella)
        yield from _sharp(noisy, filters, normals, signs, squares, sharp, SHARP_TOLERANCE, threads)


def _sharp(
    noisy: NoisyMesh,
    filters: LowPass,
    normals: SingleArray,
    signs: SingleArray,
    squares: SingleArray,
    rounds: dict[int, int],
    tolerance: float,
    threads: int,
) -> Iterator[Candidate]:
    """Estimates by kind, whose vertices follow normals that were filtered some rounds, after a low-pass filter."""
    mesh, adjacency, sigma = noisy.part.mesh, noisy.part.adjacency, noisy.sigma
    start = _moves(mesh, filters.apply(mesh.vertices, threads=threads))
    samples = filters.apply(_noise_samples(noisy, normals, signs, threads), threads=threads).reshape(
        mesh.vertex_count, -1, 3
    )
    probe = np.float32(PROBE) * samples[:, 0]
    state = noisy_normals(_moved(mesh, start), _moved(mesh, start + probe), samples, threads=threads)
    del samples
    movable, done = ~adjacency.on_boundary, 0  # those at borders stay
    for kind, total in rounds.items():
        state = filter_normals(state, adjacency.faces, total - done, tolerance, threads=threads)
        done = total
        moves, probed = (
            first + move_to_normals(_moved(mesh, first), adjacency, goal, movable, threads=threads)
            for first, goal in ((start, state.normals), (start + probe, state.probed_normals))
        )
        residuals = -np.einsum("ij,ij->i", moves, normals) / sigma
        leverages = np.einsum("ij,ij->i", probed - moves, normals) * signs / (PROBE * sigma * squares)
        yield Candidate(kind, moves, residuals.astype(np.float32), leverages.astype(np.float32))


def _noise_samples(noisy: NoisyMesh, normals: SingleArray, signs: SingleArray, threads: int) -> SingleArray:
    """Coordinates of samples of the noise along the normals side by side, (n, 3 k); the first one goes by the signs."""
    heights = noisy.samples(int(np.clip(FEWEST_SAMPLED // noisy.part.vertex_count, 2, 6)), threads=threads)
    heights[:, 0] = signs
    heights *= noisy.sigma.astype(np.float32)[:, np.newaxis]
    vectors: SingleArray = heights[:, :, np.newaxis] * normals[:, np.newaxis]
    return vectors.reshape(len(vectors), -1)


def _moves(mesh: TriangleMesh, vertices: FloatArray) -> SingleArray:
    """How far vertices are from where they were measured."""
    return (vertices - mesh.vertices).astype(np.float32)


def _moved(mesh: TriangleMesh, moves: SingleArray) -> TriangleMesh:
    return TriangleMesh(mesh.vertices + moves, mesh.faces)
