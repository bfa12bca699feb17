"""Noise that is alike at neighbouring vertices, made of white noise: by it is found what filters leave of a scanner's.

Heat flow on the mesh averages white noise over surroundings, which makes it as smooth as scanners do.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.learning.noise_model import NoiseModel
from bezier_filters.smoothing.chebyshev import diffuse
from bezier_filters.smoothing.laplacian import Laplacian
from bezier_filters.smoothing.probes import random_signs, white_noise

FIRST_STREAM = 100  # of the random bits that correlated noise is made of
# of a lattice of triangles, where it is known how alike heat flow makes neighbours: its size, and the largest time
GRID, LONGEST = 32, 64.0
AREA = 0.87  # of a mesh per vertex, times the squared mean edge


@dataclass(frozen=True)
class Correlation:
    """How noise of variance 1 is made of white noise: some of it is taken as it is, some after heat flow."""

    white: float = 1.0  # standard deviation of the part that is independent from vertex to vertex
    times: tuple[float, ...] = ()  # times of the heat flow, squared edges, that make the other parts
    scales: tuple[float, ...] = ()  # what these are then multiplied by
    alike: float = 1.0  # mean number of vertices whose noise is that of one: the sum of the squared correlations

    @staticmethod
    def of(noise: NoiseModel, unit: float, ids: IntArray, laplacian: Laplacian, core: BoolArray) -> "Correlation":
        """That of a noise, where the mean edge is `unit`, a length, measured at the `core` of a mesh."""
        if not noise.sills:
            return WHITE
        times = tuple(_time_until_alike(float(np.exp(-0.5 * (unit / length) ** 2))) for length in noise.lengths)
        shares = np.array(noise.sills) / noise.variance
        white = random_signs(ids, 1, stream=FIRST_STREAM)
        spreads = [diffuse(laplacian, white.astype(np.float64), time)[core].std() for time in times]
        curvatures = (unit / np.array(noise.lengths)) ** 2
        vertices = 2.0 * np.pi / AREA / (curvatures[:, np.newaxis] + curvatures)  # sums of products of two correlations
        alike = 1.0 + float(shares @ (vertices - 1.0) @ shares)
        scales = tuple(float(np.sqrt(share) / spread) for share, spread in zip(shares, spreads, strict=True))
        return Correlation(float(np.sqrt(noise.white / noise.variance)), times, scales, max(alike, 1.0))

    def apply(self, white: SingleArray, others: list[SingleArray], laplacian: Laplacian, threads: int) -> SingleArray:
        """Noise (n, c) made of white noise, and of other white noise for every part."""
        result: FloatArray = self.white * white.astype(np.float64)
        for time, scale, other in zip(self.times, self.scales, others, strict=True):
            result += scale * diffuse(laplacian, other.astype(np.float64), time, threads=threads)
        return result.astype(np.float32)


def _time_until_alike(correlation: float) -> float:
    """Of the heat flow, squared edges, after which the noise of neighbours on a lattice of triangles is so alike.

    White noise after a time t is as alike as heat from one vertex is spread after 2 t. Much of that is still at the
    vertex itself, so neighbours are less alike, for short times, than heat flow on a surface would make them.
    """
    x, y = 2.0 * np.pi / GRID * np.mgrid[:GRID, :GRID].reshape(2, -1)
    means = (np.cos(x) + np.cos(y) + np.cos(x + y)) / 3.0  # of its six neighbours, for every wave
    times = np.geomspace(1e-4, LONGEST, 256)
    waves = np.exp(2.0 * np.outer(times, means - 1.0))
    return float(np.interp(correlation, waves @ means / waves.sum(axis=1), times))


WHITE = Correlation()  # that of noise that is independent from vertex to vertex


def correlated_signs(
    ids: IntArray, columns: int, correlation: Correlation, laplacian: Laplacian, *, first: int = 0, threads: int = 1
) -> SingleArray:
    """Noise of variance 1 made of random signs, (n, columns)."""
    signs = random_signs(ids, columns, first=first)
    if not correlation.times:
        return signs
    others = [random_signs(ids, columns, first=first, stream=FIRST_STREAM + k) for k in range(len(correlation.times))]
    return correlation.apply(signs, others, laplacian, threads)


def correlated_noise(
    ids: IntArray, columns: int, correlation: Correlation, laplacian: Laplacian, *, threads: int = 1
) -> SingleArray:
    """Noise of variance 1 and normal distribution, (n, columns)."""
    noise = white_noise(ids, columns)
    if not correlation.times:
        return noise
    others = [white_noise(ids, columns, stream=FIRST_STREAM * (k + 2)) for k in range(len(correlation.times))]
    return correlation.apply(noise, others, laplacian, threads)
