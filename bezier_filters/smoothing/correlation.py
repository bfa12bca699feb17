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

FIRST_STREAM = 100
"""Of the random bits that correlated noise is made of."""
SQUARED_EDGE = 1.1
"""Mean square of the edges of an irregular mesh, over the square of their mean."""
AREA = 0.87
"""Of a mesh per vertex, times the squared mean edge."""


@dataclass(frozen=True)
class Correlation:
    """How noise of variance 1 is made of white noise: some of it is taken as it is, some after heat flow.

    Attributes
    ----------
    white : float
        Standard deviation of the part that is independent from vertex to vertex.
    times : tuple of float
        Times of the heat flow, squared edges, that make the other parts.
    scales : tuple of float
        What these are then multiplied by.
    alike : float
        Mean number of vertices whose noise is that of one: the sum of the squared correlations.
    """

    white: float = 1.0
    times: tuple[float, ...] = ()
    scales: tuple[float, ...] = ()
    alike: float = 1.0

    @staticmethod
    def of(noise: NoiseModel, unit: float, ids: IntArray, laplacian: Laplacian, core: BoolArray) -> "Correlation":
        """That of a noise, where the mean edge is `unit`, a length, measured at the `core` of a mesh."""
        if not noise.sills:
            return WHITE
        # Noise averaged twice over surroundings of some variance is alike over twice that.
        times = tuple((length / unit) ** 2 / SQUARED_EDGE for length in noise.lengths)
        shares = np.array(noise.sills) / noise.variance
        white = random_signs(ids, 1, stream=FIRST_STREAM)
        spreads = [diffuse(laplacian, white.astype(np.float64), time)[core].std() for time in times]
        areas = np.pi * np.array(noise.lengths) ** 2 / (AREA * unit**2)
        alike = float((1.0 - shares.sum()) ** 2 + (shares**2 * areas).sum())
        scales = tuple(float(np.sqrt(share) / spread) for share, spread in zip(shares, spreads, strict=True))
        return Correlation(float(np.sqrt(noise.white / noise.variance)), times, scales, max(alike, 1.0))

    def apply(self, white: SingleArray, others: list[SingleArray], laplacian: Laplacian, threads: int) -> SingleArray:
        """Noise (n, c) made of white noise, and of other white noise for every part."""
        result: FloatArray = self.white * white.astype(np.float64)
        for time, scale, other in zip(self.times, self.scales, others, strict=True):
            result += scale * diffuse(laplacian, other.astype(np.float64), time, threads=threads)
        return result.astype(np.float32)


WHITE = Correlation()
"""That of noise that is independent from vertex to vertex."""


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
