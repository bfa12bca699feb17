"""Random noise at the vertices of a mesh, as probes for leverages and for the noise that filters leave.

The numbers are hashes of the vertex numbers in the whole mesh, so that a tile draws the same noise as the mesh.
Correlated noise is white noise after heat flow exp(-t L) on the mesh, with a diffusion time t for each range.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.smoothing.chebyshev import diffuse
from bezier_filters.smoothing.laplacian import Laplacian

PROBE_SIGN_COLUMN = 32  # first column of random signs that did not serve to select the filters
CORRELATED_NOISE_STREAM = 100  # first stream of the random bits for correlated noise
# triangular lattice on which the correlation of neighbours after heat flow is computed: its size, and the largest time
LATTICE_SIZE, MAX_DIFFUSION_TIME = 32, 64.0
MIN_CORRELATION = 1e-3  # of neighbours that counts, and difference from 1
AREA_PER_VERTEX = 0.87  # area of a mesh per vertex over the squared mean edge


def random_bits(ids: IntArray, stream: int) -> NDArray[np.uint64]:
    """64 random bits for every number, (n,): output `id` of the generator splitmix64 of Steele, Lea and Flood.

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


def draw_white_noise(ids: IntArray, columns: int, *, stream: int = 1) -> SingleArray:
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
    """Recipe for noise of variance 1: a sum of white noise and of white noise after heat flow."""

    white: float = 1.0  # standard deviation of the white component
    times: tuple[float, ...] = ()  # diffusion times of the correlated components, squared edges
    scales: tuple[float, ...] = ()  # factors on these components
    # n / n_eff: the sum of the squared correlations with all vertices
    variance_inflation: float = 1.0

    @staticmethod
    def calibrate(
        noise: NoiseModel, unit: float, ids: IntArray, laplacian: Laplacian, core: BoolArray
    ) -> "Correlation":
        """Calibrate times and scales for a noise model at the `core` of a mesh with mean edge `unit`, a length."""
        if not noise.sills:
            return WHITE
        times = tuple(_diffusion_time(float(np.exp(-0.5 * (unit / length) ** 2))) for length in noise.lengths)
        shares = np.array(noise.sills) / noise.variance
        white = random_signs(ids, 1, stream=CORRELATED_NOISE_STREAM)
        spreads = [diffuse(laplacian, white.astype(np.float64), time)[core].std() for time in times]
        curvatures = (unit / np.array(noise.lengths)) ** 2
        vertices = (
            2.0 * np.pi / AREA_PER_VERTEX / (curvatures[:, np.newaxis] + curvatures)
        )  # sums of products of two correlations
        variance_inflation = 1.0 + float(shares @ (vertices - 1.0) @ shares)
        scales = tuple(float(np.sqrt(share) / spread) for share, spread in zip(shares, spreads, strict=True))
        return Correlation(float(np.sqrt(noise.white / noise.variance)), times, scales, max(variance_inflation, 1.0))

    def apply(self, draw: Callable[[int], SingleArray], laplacian: Laplacian | None) -> SingleArray:
        """Noise (n, c) from white noise that `draw` returns for each component: 0 is the white one.

        White noise alone needs no Laplacian.
        """
        if laplacian is None or not self.times:
            return draw(0)
        result: FloatArray = self.white * draw(0).astype(np.float64)
        for part, (time, scale) in enumerate(zip(self.times, self.scales, strict=True), 1):
            result += scale * diffuse(laplacian, draw(part).astype(np.float64), time)
        return result.astype(np.float32)


def inflation_by_neighbours(correlation: float) -> float:
    """How many vertices are as informative as an independent one if the errors of neighbours have a correlation.

    The covariance is taken for a Gaussian of the distance.
    """
    curvature = -2.0 * np.log(min(max(correlation, MIN_CORRELATION), 1.0 - MIN_CORRELATION))
    return max(float(np.pi / AREA_PER_VERTEX / curvature), 1.0)


def _diffusion_time(correlation: float) -> float:
    """Diffusion time, squared edges, after which the noise of neighbours on a triangular lattice has a correlation.

    The covariance of white noise after a time t is the heat kernel at 2 t. For short times the lattice kernel has more
    of its mass at the vertex itself than the kernel of a surface, so that neighbours are less correlated.
    """
    x, y = 2.0 * np.pi / LATTICE_SIZE * np.mgrid[:LATTICE_SIZE, :LATTICE_SIZE].reshape(2, -1)
    means = (np.cos(x) + np.cos(y) + np.cos(x + y)) / 3.0  # of its six neighbours, for every wave
    times = np.geomspace(1e-4, MAX_DIFFUSION_TIME, 256)
    waves = np.exp(2.0 * np.outer(times, means - 1.0))
    return float(np.interp(correlation, waves @ means / waves.sum(axis=1), times))


WHITE = Correlation()  # white noise
