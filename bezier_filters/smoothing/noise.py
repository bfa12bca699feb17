"""Estimates the local standard deviation of the noise of a mesh, if it varies, and the roughest vertices.

The local level is a robust mean of the high-pass residuals |p - f(L) p| along the normals, where f is a weak low-pass
filter, over the fraction of the noise that the filter removes.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray, SingleArray
from bezier_filters.sampling.mesh_parts import MeshPart
from bezier_filters.smoothing.chebyshev import low_pass
from bezier_filters.smoothing.clusters import Clusters, clusters_of
from bezier_filters.smoothing.laplacian import Laplacian, umbrella_laplacian
from bezier_filters.smoothing.random_noise import (
    CORRELATED_NOISE_STREAM,
    WHITE,
    Correlation,
    draw_white_noise,
    random_bits,
    random_signs,
)

WEAK_STRENGTH, MEDIUM_STRENGTH = np.array([1.0]), np.array([10.0])  # filter strengths for residuals and for normals
STRONG_STRENGTH = np.array([100.0])  # strength of the filter that rough places do not follow
ROUGHNESS_RINGS = 32  # rings around a tile that its roughness depends on
# `time_scale` of clusters where no mesh gives it: triangles of about one size are within some hundredths of it
DEFAULT_TIME_SCALE = 0.27
# Ratio to the largest roughness that counts as a tie: any such vertex will do, but tiles and memory must pick the same.
ROUGHNESS_TIE_RATIO = 0.98
TIE_BREAK_STREAM = 101  # stream of the vertex hashes that break ties
MIN_LEVEL_RATIO = 2.0  # ratio of the 0.9 to the 0.1 quantile of the levels from which on the noise varies
CREASE_LEVEL_QUANTILE = 0.8  # quantile of the levels above which creases are searched
# mean |x| over the squared mean of sqrt(|x|), above which x is not normal; the normal distribution has 1.18
CREASE_MOMENT_RATIO = 1.21
MIN_LEVEL_FRACTION = 0.1  # lower bound of the levels, over the 0.9 quantile
# standard deviation of fine relief over the mean edge: clean scans have it, and smoothing keeps it
RELIEF_PER_EDGE = 0.01
MIN_NOISE_PER_EDGE = RELIEF_PER_EDGE + 1e-4  # smallest standard deviation of noise over the mean edge
NORMAL_MEAN_ROOT = 0.822  # mean of sqrt(|x|) for a standard normal x


@dataclass(frozen=True)
class NoiseLevels:
    """Global parameters of the local standard deviation of the noise."""

    sigma: float | None  # standard deviation everywhere, a length; None if it varies
    share: float  # fraction of the noise that a weak filter removes
    min_level: float  # lower bound of the levels, a length
    detail: float  # standard deviation of the relief to keep, a shorter length
    correlation: Correlation = WHITE  # correlation of neighbouring vertices
    factor: float = 1.0  # ratio of the known to the estimated standard deviation, if the noise varies

    def sigma_from_roots(self, roots: SingleArray) -> FloatArray:
        """Standard deviation of the noise at vertices, (n,)."""
        levels = np.full(len(roots), self.sigma) if self.sigma is not None else self.factor * _levels(roots)
        result: FloatArray = np.sqrt(np.maximum(levels, self.min_level) ** 2 - self.detail**2)
        return result


@dataclass(frozen=True)
class NoisyMesh:
    """A mesh, or a part of one, and the noise of its vertices."""

    part: MeshPart
    clusters: Clusters  # of the same mesh
    sigma: FloatArray  # (n,): standard deviation of the noise around every vertex, positive lengths
    correlation: Correlation = WHITE  # correlation of the noise of neighbouring vertices
    laplacian: Laplacian | None = None  # umbrella Laplacian with free borders, whose heat flow makes correlated noise

    def probes(self, columns: int, *, first: int = 0) -> SingleArray:
        """Noise of variance 1, (n, columns): random signs if it is white."""

        def signs(part: int) -> SingleArray:
            return random_signs(
                self.part.ids, columns, first=first, stream=CORRELATED_NOISE_STREAM + part - 1 if part else 0
            )

        return self.correlation.apply(signs, self.laplacian)

    def samples(self, columns: int) -> SingleArray:
        """Noise of variance 1 and normal distribution, (n, columns)."""

        def numbers(part: int) -> SingleArray:
            return draw_white_noise(self.part.ids, columns, stream=CORRELATED_NOISE_STREAM * (part + 1) if part else 1)

        return self.correlation.apply(numbers, self.laplacian)

    def mean_squares(self, probes: SingleArray) -> SingleArray:
        """Squares of probes (n, columns) around every vertex, summed over the columns, (n,)."""
        squares: SingleArray = np.square(probes).sum(axis=1, dtype=np.float32)
        if not self.correlation.times:
            return squares
        return self.clusters.average([squares])[:, 0]


def learn_noise_levels(
    noisy: NoisyMesh, laplacian: Laplacian, sigma: float, unit: float, *, given: bool = False
) -> tuple[NoiseLevels, FloatArray]:
    """Learn the noise levels of a mesh from the core of a part, and the standard deviation at its vertices, (n,).

    The noise has the level sigma everywhere, unless it clearly varies. Levels are robust local means of the high-pass
    residuals of a weak filter, in which outliers, such as edges, have little weight. If many creases cause the highest
    levels, the residuals there are not normally distributed as noise is, and the level is constant. Levels are at least
    `MIN_NOISE_PER_EDGE`; the standard deviation of the relief, `RELIEF_PER_EDGE`, is subtracted from them in squares.
    `unit` is the mean edge. If the noise varies and sigma was `given`, sigma is its root mean square; otherwise sigma
    is not used. `laplacian` is the umbrella Laplacian with free borders.
    """
    least, detail, core = MIN_NOISE_PER_EDGE * unit, RELIEF_PER_EDGE * unit, noisy.part.core
    noise = noisy.samples(1).astype(np.float64)
    removed = noise - low_pass(laplacian, noise, WEAK_STRENGTH)
    share = float(np.sqrt(np.square(removed[core]).mean()))
    heights, roots = _high_pass_residuals(noisy.part, noisy.clusters, laplacian, share)
    found = _levels(roots[core])
    low, high = np.quantile(found, (0.1, 0.9))
    if high < MIN_LEVEL_RATIO * low or _is_creased(heights[core], found):
        levels = NoiseLevels(sigma, share, least, detail, noisy.correlation)
    else:
        factor = sigma / float(np.sqrt(np.square(found).mean())) if given else 1.0
        min_level = max(least, MIN_LEVEL_FRACTION * factor * float(high))
        levels = NoiseLevels(None, share, min_level, detail, noisy.correlation, factor)
    return levels, levels.sigma_from_roots(roots)


def local_sigma(part: MeshPart, clusters: Clusters, levels: NoiseLevels) -> FloatArray:
    """Standard deviation of the noise around every vertex, (n,)."""
    if levels.sigma is not None:
        return levels.sigma_from_roots(np.zeros(len(part.ids), dtype=np.float32))
    laplacian = umbrella_laplacian(part, "free")
    return levels.sigma_from_roots(_high_pass_residuals(part, clusters, laplacian, levels.share)[1])


def roughness(part: MeshPart, sigma: float, clusters: Clusters | None = None) -> FloatArray:
    """Local ratio of the squared residuals of a strong and of a weak filter, (n,): largest at edges and corners.

    The sample of a large mesh must include its roughest vertex: otherwise edges would be smoothed if no sample has one.
    A ratio is used because the noise itself may vary. A tile needs `ROUGHNESS_RINGS` around its own vertices; sigma is
    the standard deviation of the noise of the whole mesh. Given clusters must have the time scale `DEFAULT_TIME_SCALE`.
    """
    clusters, laplacian = clusters or clusters_of(part, DEFAULT_TIME_SCALE), umbrella_laplacian(part, "free")
    strong, weak = _heights(part, laplacian, STRONG_STRENGTH)
    around = clusters.average([np.square(strong), np.sqrt(np.abs(weak))]).astype(np.float64)
    return around[:, 0] / np.maximum(around[:, 1] ** 4, (MIN_LEVEL_FRACTION * sigma) ** 2)


def roughest_vertices(values: FloatArray, ids: IntArray) -> IntArray:
    """Indices of the roughest of some vertices first, and of candidates for the roughest of a larger set.

    Ties within 2 % are broken by a vertex hash, so that tiles and memory pick the same vertex; their largest values
    differ by rounding. The candidates of all tiles include the roughest vertex of the mesh, so each tile needs to
    report only a few.

    >>> values, ids = np.random.default_rng(0).random(10_000), np.arange(10_000, dtype=np.int32)
    >>> few = [k + roughest_vertices(values[k : k + 500], ids[k : k + 500]) for k in range(0, 10_000, 500)]
    >>> max(map(len, few)) < 12, ids[roughest_vertices(values, ids)[0]] == np.concatenate(few)[
    ...     roughest_vertices(values[np.concatenate(few)], ids[np.concatenate(few)])[0]
    ... ]
    (True, np.True_)
    """
    values = np.nan_to_num(values)  # squares of lengths may overflow
    near = np.flatnonzero(values >= ROUGHNESS_TIE_RATIO * values.max())
    near = near[np.argsort(random_bits(ids[near], TIE_BREAK_STREAM))]
    before = np.maximum.accumulate(np.append(-1.0, values[near]))[:-1]
    return near[values[near] > before].astype(np.int32)


def _high_pass_residuals(
    part: MeshPart, clusters: Clusters, laplacian: Laplacian, share: float
) -> tuple[FloatArray, SingleArray]:
    """High-pass residuals of every vertex over their share of noise, lengths, and local means of their roots, (n,)."""
    heights = np.abs(_heights(part, laplacian, MEDIUM_STRENGTH)[1] / share)
    return heights, np.maximum(clusters.average([np.sqrt(heights)])[:, 0], np.float32(0.0))


def _is_creased(heights: FloatArray, levels: FloatArray) -> bool:
    """Whether creases cause the highest levels (n,): the high-pass residuals there are not normally distributed."""
    highest = (levels >= np.quantile(levels, CREASE_LEVEL_QUANTILE)) & (levels > 0.0)
    relative = heights[highest] / levels[highest]
    return not (len(relative) and relative.mean() < CREASE_MOMENT_RATIO * np.sqrt(relative).mean() ** 2)


def _heights(part: MeshPart, laplacian: Laplacian, strength: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Heights of the vertices over the mesh after a filter and after a weak one, along normals of the first, (n,)."""
    vertices = part.mesh.vertices
    smooth, weak = (low_pass(laplacian, vertices, one) for one in (strength, WEAK_STRENGTH))
    normals = part.mesh.move(smooth).planes.normals
    return np.einsum("ij,ij->i", vertices - smooth, normals), np.einsum("ij,ij->i", vertices - weak, normals)


def _levels(roots: SingleArray) -> FloatArray:
    result: FloatArray = np.square(roots.astype(np.float64) / NORMAL_MEAN_ROOT)
    return result
