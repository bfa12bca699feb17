"""Random noise at the vertices of a mesh, by which leverages and what filters leave of noise are found.

It goes by the numbers of the vertices in the whole mesh alone, not by their order, so a tile draws the same as the mesh
that it is a part of. Noise that is alike at neighbouring vertices is made of white noise: heat flow on the mesh
averages it over surroundings, which makes it as smooth as scanners do.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.learning.noise_model import NoiseModel
from bezier_filters.smoothing.chebyshev import diffuse
from bezier_filters.smoothing.laplacian import Laplacian

OTHER_SIGNS = 32  # column from which on random signs are others than those that chose the filters
FIRST_STREAM = 100  # of the random bits that correlated noise is made of
# of a lattice of triangles, where it is known how alike heat flow makes neighbours: its size, and the largest time
GRID, LONGEST = 32, 64.0
AREA = 0.87  # of a mesh per vertex, times the squared mean edge


def random_bits(ids: IntArray, stream: int) -> NDArray[np.uint64]:
    """64 random bits for every number, (n,) (the generator splitmix64 of Steele, Lea and Flood, at the place `id`).

    >>> random_bits(np.array([0, 1], dtype=np.int32), 0)
    array([16294208416658607535,  7960286522194355700], dtype=uint64)
    """
    step = np.uint64(0x9E3779B97F4A7C15)
    with np.errstate(over="ignore"):
        bits = (ids.astype(np.uint64) + np.uint64((stream << 32) + 1)) * step
        bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


def random_signs(ids: IntArray, columns: int, *, first: int = 0, stream: int = 0) -> SingleArray:
    """Random signs, (n, columns), from some column on, of which there are 64."""
    bits = random_bits(ids, stream)
    signs = [bits >> np.uint64(first + k) & np.uint64(1) for k in range(columns)]
    return np.column_stack([2.0 * sign.astype(np.float32) - 1.0 for sign in signs])


def white_noise(ids: IntArray, columns: int, *, stream: int = 1) -> SingleArray:
    """Numbers of the standard normal distribution, (n, columns), by the transform of Box and Muller."""
    result = np.empty((len(ids), columns), dtype=np.float32)
    for k in range(0, columns, 2):
        radius, angle = ((random_bits(ids, stream + k + j) >> np.uint64(11)) * 2.0**-53 for j in range(2))
        radius = np.sqrt(-2.0 * np.log1p(-radius))
        result[:, k] = radius * np.cos(2.0 * np.pi * angle)
        result[:, k + 1 : k + 2] = (radius * np.sin(2.0 * np.pi * angle))[:, np.newaxis]
    return result


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

    def apply(self, draw: Callable[[int], SingleArray], laplacian: Laplacian | None) -> SingleArray:
        """Noise (n, c) made of white noise, drawn for each part by its number: 0 for that which is taken as it is.

        White noise alone needs no Laplacian.
        """
        if laplacian is None or not self.times:
            return draw(0)
        result: FloatArray = self.white * draw(0).astype(np.float64)
        for part, (time, scale) in enumerate(zip(self.times, self.scales, strict=True), 1):
            result += scale * diffuse(laplacian, draw(part).astype(np.float64), time)
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
