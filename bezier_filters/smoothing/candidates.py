"""Estimates of the surface under the noise, from smooth to sharp.

The first is a low-pass filter. For edges and corners the normals of a more weakly filtered mesh are
filtered, many times, by means that do not reach across what noise cannot explain, and the
vertices follow. In between are fewer rounds.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.low_pass import FittedLowPass, LowPass
from bezier_filters.smoothing.normal_filter import filter_normals, noisy_normals
from bezier_filters.smoothing.probes import other_signs, white_noise
from bezier_filters.smoothing.vertex_update import move_to_normals

SMOOTH, GENTLE = 0, 1
"""Kinds of estimates: the low-pass filter proper, and one round after a slightly weaker one; then the sharp ones."""
SHARP_ROUNDS = (2, 5, 16)
"""Numbers of rounds of filtering the normals, after a much weaker filter, at which there are estimates."""
KINDS = range(2 + len(SHARP_ROUNDS))
GENTLE_TOLERANCE, SHARP_TOLERANCE = 2.5, 1.5
"""Of `filter_normals`."""
PROBE = 0.1
"""Times sigma: how far vertices are moved to find their leverages."""
FEWEST_SAMPLED = 60_000
"""Vertices times samples of the noise, that normals are filtered by."""


@dataclass(frozen=True)
class Candidate:
    """An estimate of the surface.

    Attributes
    ----------
    kind : int
        Which one it is.
    moves : (n, 3) float32
        How far each vertex moves.
    residuals : (n,) float32
        Heights of the measured vertices over it, times the standard deviation of the noise.
    leverages : (n,) float32
        How far it follows each vertex.
    """

    kind: int
    moves: SingleArray
    residuals: SingleArray
    leverages: SingleArray


def candidates(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    fitted: FittedLowPass,
    sigma: FloatArray,
    kinds: frozenset[int],
    *,
    threads: int = 1,
) -> Iterator[Candidate]:
    """Estimates, ever sharper ones, of which the first is the low-pass filter's.

    Parameters
    ----------
    mesh : TriangleMesh
        As measured.
    adjacency : Adjacency
        Of the same mesh.
    fitted : FittedLowPass
        What every estimate starts with, more or less of it.
    sigma : (n,) float64
        Standard deviation of the noise around every vertex.
    kinds : frozenset of int
        Those that are wanted besides the first.
    threads : int
        Number of threads.
    """
    n, filters, shape = mesh.vertex_count, fitted.filters, fitted.shape
    signs = other_signs(n)
    filtered = filters.apply(np.column_stack([mesh.vertices, signs]), threads=threads)
    leverages = (signs * filtered[:, 3]).astype(np.float32)
    yield Candidate(SMOOTH, _moves(mesh, filtered[:, :3]), fitted.residuals, leverages)
    del fitted, filtered, leverages  # for large meshes, memory counts
    if not kinds - {SMOOTH}:
        return
    heights = white_noise(n, int(np.clip(FEWEST_SAMPLED // n, 2, 6)))
    heights[:, 0] = signs
    noise = heights * sigma.astype(np.float32)[:, np.newaxis]
    signals = _Signals(sigma, signs, shape.normals.astype(np.float32), noise)
    if GENTLE in kinds:
        yield from _sharp(mesh, adjacency, filters.weaker(), signals, {GENTLE: 1}, GENTLE_TOLERANCE, threads)
    rounds = {kind: rounds for kind, rounds in enumerate(SHARP_ROUNDS, start=GENTLE + 1) if kind in kinds}
    if rounds:
        weak = filters.weak(umbrella_laplacian(mesh, adjacency, filters.borders, threads=threads))
        del filters, shape
        yield from _sharp(mesh, adjacency, weak, signals, rounds, SHARP_TOLERANCE, threads)


@dataclass(frozen=True)
class _Signals:
    """Noise that is like that of the mesh.

    Attributes
    ----------
    sigma : (n,) float64
        Its standard deviation around every vertex.
    signs : (n,) float32
        Random signs.
    normals : (n, 3) float32
        Of the smooth surface.
    heights : (n, k) float32
        Samples along the normals; the first one is sigma times the signs.
    """

    sigma: FloatArray
    signs: SingleArray
    normals: SingleArray
    heights: SingleArray

    def samples(self) -> SingleArray:
        """Coordinates of all samples side by side, (n, 3 k)."""
        vectors: SingleArray = self.heights[:, :, np.newaxis] * self.normals[:, np.newaxis]
        return vectors.reshape(len(vectors), -1)


def _sharp(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    filters: LowPass,
    noise: _Signals,
    rounds: dict[int, int],
    tolerance: float,
    threads: int,
) -> Iterator[Candidate]:
    """Estimates by kind, whose vertices follow normals that were filtered some rounds, after a low-pass filter."""
    start = _moves(mesh, filters.apply(mesh.vertices, threads=threads))
    samples = filters.apply(noise.samples(), threads=threads).reshape(mesh.vertex_count, -1, 3)
    del filters
    probe = np.float32(PROBE) * samples[:, 0]
    state = noisy_normals(_moved(mesh, start), _moved(mesh, start + probe), samples, threads=threads)
    del samples
    movable, done = ~adjacency.on_boundary, 0  # those at borders stay
    for kind, total in rounds.items():
        state = filter_normals(state, adjacency.faces, total - done, tolerance, threads=threads)
        done = total
        moves, probed = (
            first + move_to_normals(_moved(mesh, first), adjacency, normals, movable, threads=threads)
            for first, normals in ((start, state.normals), (start + probe, state.probed_normals))
        )
        residuals = -np.einsum("ij,ij->i", moves, noise.normals) / noise.sigma
        leverages = np.einsum("ij,ij->i", probed - moves, noise.normals) * noise.signs / (PROBE * noise.sigma)
        yield Candidate(kind, moves, residuals.astype(np.float32), leverages.astype(np.float32))


def _moves(mesh: TriangleMesh, vertices: FloatArray) -> SingleArray:
    """How far vertices are from where they were measured."""
    return (vertices - mesh.vertices).astype(np.float32)


def _moved(mesh: TriangleMesh, moves: SingleArray) -> TriangleMesh:
    return TriangleMesh(mesh.vertices + moves, mesh.faces)
