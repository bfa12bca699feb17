"""Estimates of the surface under the noise, from smooth to sharp.

The first is a low-pass filter. For edges and corners the normals of a more weakly filtered mesh are
filtered, many times, by means that do not reach across what noise cannot explain, and the
vertices follow. In between are fewer rounds.
"""

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np

from bezier_filters.adjacency import Adjacency
from bezier_filters.arrays import FloatArray, SingleArray
from bezier_filters.low_pass import LowPass
from bezier_filters.mesh import TriangleMesh
from bezier_filters.normal_filter import NoisyNormals, filter_normals, noisy_normals
from bezier_filters.scale_space import Signals
from bezier_filters.vertex_update import move_to_normals

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


class Smoother(Protocol):
    """A method of `LowPass`."""

    def __call__(self, signals: Signals, *, threads: int = 1) -> Signals:
        """Signals (n, c) after the filter."""


def smooth_estimate(mesh: TriangleMesh, low_pass: LowPass, *, threads: int = 1) -> Estimate:
    """The low-pass filter's."""
    signs = _signs(mesh.vertex_count)
    smooth = low_pass.smoothed(np.column_stack([mesh.vertices, signs]), threads=threads)
    moves = (smooth[:, :3] - mesh.vertices).astype(np.float32)
    return Estimate(SMOOTH, moves, low_pass.residuals, (signs * smooth[:, 3]).astype(np.float32))


def sharper_estimates(
    mesh: TriangleMesh,
    adjacency: Adjacency,
    low_pass: LowPass,
    levels: FloatArray,
    kinds: frozenset[int],
    *,
    threads: int = 1,
) -> Iterator[Estimate]:
    """The other estimates, ever sharper ones.

    Parameters
    ----------
    mesh : TriangleMesh
        As measured.
    adjacency : Adjacency
        Of the same mesh.
    low_pass : LowPass
        What every estimate starts with, more or less of it.
    levels : (n,) float64
        Standard deviation of the noise around every vertex.
    kinds : frozenset of int
        Those that are wanted.
    threads : int
        Number of threads.
    """
    normals, signs = low_pass.normals, _signs(mesh.vertex_count)

    def estimate(kind: int, state: NoisyNormals) -> Estimate:
        movable = ~adjacency.on_boundary  # those at borders stay
        moved, probed = (
            start.vertices - mesh.vertices + move_to_normals(start, adjacency, goal, movable, threads=threads)
            for start, goal in ((state.mesh, state.normals), (state.probe, state.probed_normals))
        )
        residuals = -np.einsum("ij,ij->i", moved, normals) / levels
        leverages = np.einsum("ij,ij->i", probed - moved, normals) * signs / (PROBE * levels)
        return Estimate(kind, *(x.astype(np.float32) for x in (moved, residuals, leverages)))

    if GENTLE in kinds:
        gentle = _start(mesh, low_pass.slightly_less_smoothed, normals, levels, threads)
        yield estimate(GENTLE, filter_normals(gentle, adjacency.faces, 1, GENTLE_TOLERANCE, threads=threads))
        del gentle
    if max(kinds, default=SMOOTH) <= GENTLE:
        return
    sharp = _start(mesh, low_pass.weakly_smoothed, normals, levels, threads)
    done = 0
    for kind, rounds in enumerate(SHARP_ROUNDS[: max(kinds) - GENTLE], start=GENTLE + 1):
        sharp = filter_normals(sharp, adjacency.faces, rounds - done, SHARP_TOLERANCE, threads=threads)
        done = rounds
        yield estimate(kind, sharp)


def _signs(n: int) -> FloatArray:
    return np.random.default_rng(1).choice(np.array([-1.0, 1.0]), n)


def _start(mesh: TriangleMesh, smooth: Smoother, normals: FloatArray, levels: FloatArray, threads: int) -> NoisyNormals:
    """Normals of the filtered vertices, without and with the probing steps, and what samples of the noise do to them.

    The first sample is that of the probe.
    """
    n = mesh.vertex_count
    count = int(np.clip(FEWEST_SAMPLED // n, 2, 6))
    heights = np.random.default_rng(2).standard_normal((n, count), dtype=np.float32)
    heights[:, 0] = _signs(n)
    heights *= levels.astype(np.float32)[:, np.newaxis]
    vectors: SingleArray = heights[:, :, np.newaxis] * normals.astype(np.float32)[:, np.newaxis]
    noise = smooth(vectors.reshape(n, -1), threads=threads).reshape(n, count, 3)
    points = smooth(mesh.vertices, threads=threads)
    probe = TriangleMesh(points + PROBE * noise[:, 0], mesh.faces)
    return noisy_normals(TriangleMesh(points, mesh.faces), probe, noise, threads=threads)
