"""Estimates of the surface under the noise, from smooth to sharp.

The first is a low-pass filter. For edges and corners the normals of a more weakly filtered mesh are
filtered, many times, by means that do not reach across what noise cannot explain, and the
vertices follow. In between are fewer rounds.
"""

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np

from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.low_pass import LowPass
from bezier_filters.smoothing.normal_filter import NoisyNormals, filter_normals, noisy_normals
from bezier_filters.smoothing.scale_space import Signals
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


class Estimate(NamedTuple):
    """An estimate of the surface, as a mesh on the same vertices."""

    kind: int
    """Which one it is."""
    moves: SingleArray
    """How far each vertex moves, (n, 3)."""
    residuals: SingleArray
    """Heights of the measured vertices over it, times the standard deviation of the noise, (n,)."""
    leverages: SingleArray
    """How far it follows each vertex, (n,)."""


class _Start(NamedTuple):
    """Vertices before they follow the normals."""

    moves: SingleArray
    """How far the filter moved each of them, (n, 3),"""
    probe: SingleArray
    """and the probing steps from there, (n, 3)."""


class Smoother(Protocol):
    """A method of `LowPass`."""

    def __call__(self, signals: Signals, *, threads: int = 1) -> Signals:
        """Signals (n, c) after the filter."""


def surface_estimates(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    low_pass: LowPass,
    levels: FloatArray,
    kinds: frozenset[int],
    *,
    threads: int = 1,
) -> Iterator[Estimate]:
    """Estimates, ever sharper ones, of which the first is the low-pass filter's.

    Parameters
    ----------
    mesh : TriangleMesh
        As measured.
    adjacency : Adjacency
        Of the same mesh.
    low_pass : LowPass
        What every estimate starts with, more or less of it. Nothing holds on to it once the last one has begun.
    levels : (n,) float64
        Standard deviation of the noise around every vertex.
    kinds : frozenset of int
        Those that are wanted besides the first.
    threads : int
        Number of threads.
    """
    normals, signs = low_pass.normals, _signs(mesh.vertex_count)

    def moves(start: SingleArray, goal: SingleArray) -> SingleArray:
        movable = ~adjacency.on_boundary  # those at borders stay
        result = move_to_normals(_moved(mesh, start), adjacency, goal, movable, threads=threads)
        result += start
        return result

    def estimate(kind: int, start: _Start, state: NoisyNormals) -> Estimate:
        moved = moves(start.moves, state.normals)
        probed = moves(start.moves + start.probe, state.probed_normals)
        residuals = -np.einsum("ij,ij->i", moved, normals) / levels
        leverages = np.einsum("ij,ij->i", probed - moved, normals) * signs / (PROBE * levels)
        return Estimate(kind, moved, residuals.astype(np.float32), leverages.astype(np.float32))

    yield _smooth_estimate(mesh, low_pass, signs, threads)
    if GENTLE in kinds:
        start, state = _start(mesh, low_pass.slightly_less_smoothed, normals, levels, threads)
        state = filter_normals(state, adjacency.faces, 1, GENTLE_TOLERANCE, threads=threads)
        yield estimate(GENTLE, start, state)
        del start, state
    if max(kinds, default=SMOOTH) <= GENTLE:
        return
    start, state = _start(mesh, low_pass.weakly_smoothed, normals, levels, threads)
    del low_pass  # what follows is the hungriest part
    done = 0
    for kind, rounds in enumerate(SHARP_ROUNDS[: max(kinds) - GENTLE], start=GENTLE + 1):
        state = filter_normals(state, adjacency.faces, rounds - done, SHARP_TOLERANCE, threads=threads)
        done = rounds
        if kind in kinds:
            yield estimate(kind, start, state)


def _smooth_estimate(mesh: TriangleMesh, low_pass: LowPass, signs: SingleArray, threads: int) -> Estimate:
    smooth = low_pass.smoothed(np.column_stack([mesh.vertices, signs]), threads=threads)
    moves = (smooth[:, :3] - mesh.vertices).astype(np.float32)
    return Estimate(SMOOTH, moves, low_pass.residuals, (signs * smooth[:, 3]).astype(np.float32))


def _signs(n: int) -> SingleArray:
    return np.random.default_rng(1).choice(np.array([-1.0, 1.0]), n).astype(np.float32)


def _start(
    mesh: TriangleMesh, smooth: Smoother, normals: SingleArray, levels: FloatArray, threads: int
) -> tuple[_Start, NoisyNormals]:
    """Filtered vertices and their normals, without and with the probing steps, and what noise does to these.

    The first sample of the noise is that of the probe.
    """
    n = mesh.vertex_count
    count = int(np.clip(FEWEST_SAMPLED // n, 2, 6))
    heights = np.random.default_rng(2).standard_normal((n, count), dtype=np.float32)
    heights[:, 0] = _signs(n)
    heights *= levels.astype(np.float32)[:, np.newaxis]
    vectors: SingleArray = heights[:, :, np.newaxis] * normals[:, np.newaxis]
    noise = smooth(vectors.reshape(n, -1), threads=threads).reshape(n, count, 3)
    moves = (smooth(mesh.vertices, threads=threads) - mesh.vertices).astype(np.float32)
    probe = np.float32(PROBE) * noise[:, 0]
    both = _moved(mesh, moves), _moved(mesh, moves + probe)
    return _Start(moves, probe), noisy_normals(*both, noise, threads=threads)


def _moved(mesh: TriangleMesh, moves: SingleArray) -> TriangleMesh:
    return TriangleMesh(mesh.vertices + moves, mesh.faces)
