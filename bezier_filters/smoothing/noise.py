"""Whether the noise of a mesh varies from place to place, and how."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray, SingleArray
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.smoothing.chebyshev import low_pass
from bezier_filters.smoothing.clusters import Clusters, clusters_of
from bezier_filters.smoothing.laplacian import Laplacian, umbrella_laplacian
from bezier_filters.smoothing.mesh_parts import MeshPart
from bezier_filters.smoothing.random_noise import (
    FIRST_STREAM,
    WHITE,
    Correlation,
    random_bits,
    random_signs,
    white_noise,
)

WEAK, MEDIUM = np.array([1.0]), np.array([10.0])  # strengths of the filters that residuals and normals are taken from
STRONG = np.array([100.0])  # strength of the filter that rough places do not follow
ROUGHNESS_RINGS = 32  # around a tile, within which something may be rough
# of clusters, see there, where no mesh tells: on triangles of about one size it is within some hundredths of that
PACE = 0.27
# times the largest roughness: which of such places is taken does not matter, but tiles have to take that of memory
AS_ROUGH = 0.98
LOTS = 101  # which of the random numbers at vertices say what place that is
SPREAD = 2.0  # ratio of high levels to low ones from which on the noise is taken to vary
HIGHEST = 0.8  # quantile of the levels above which creases are looked for
# mean |x| over the squared mean of sqrt(|x|) above which x is not normally distributed, for which it is 1.18
CREASED = 1.21
LEAST = 0.1  # of the highest levels, the lowest
# times the mean edge: fine relief of clean scans, in which neighbours differ, too, and which is left alone
DETAIL = 0.01
LEAST_NOISE = DETAIL + 1e-4  # times the mean edge: below that there is nothing to take off
MEAN_ROOT = 0.822  # mean of sqrt(|x|) for a standard normal x


@dataclass(frozen=True)
class NoiseLevels:
    """How much noise there is, and where."""

    sigma: float | None  # its standard deviation everywhere, a length; None if it varies
    share: float  # of the noise, what a weak filter takes off
    lowest: float  # the lowest level that there may be, a length
    detail: float  # standard deviation of the relief that is left alone, a shorter length
    correlation: Correlation = WHITE  # how alike it is at neighbouring vertices
    factor: float = 1.0  # how much more noise there is, where it varies, than can be seen

    def at(self, roots: SingleArray) -> FloatArray:
        """Standard deviation of the noise at vertices, (n,)."""
        levels = np.full(len(roots), self.sigma) if self.sigma is not None else self.factor * _levels(roots)
        result: FloatArray = np.sqrt(np.maximum(levels, self.lowest) ** 2 - self.detail**2)
        return result


@dataclass(frozen=True)
class NoisyMesh:
    """A mesh, or a part of one, and the noise of its vertices."""

    part: MeshPart
    clusters: Clusters  # of the same mesh
    sigma: FloatArray  # (n,): standard deviation of the noise around every vertex, positive lengths
    correlation: Correlation = WHITE  # how alike the noise of neighbouring vertices is
    laplacian: Laplacian | None = None  # of umbrellas, with free borders: what noise that is alike is made with

    def probes(self, columns: int, *, first: int = 0) -> SingleArray:
        """Noise of variance 1, (n, columns): random signs if it is white."""

        def signs(part: int) -> SingleArray:
            return random_signs(self.part.ids, columns, first=first, stream=FIRST_STREAM + part - 1 if part else 0)

        return self.correlation.apply(signs, self.laplacian)

    def samples(self, columns: int) -> SingleArray:
        """Noise of variance 1 and normal distribution, (n, columns)."""

        def numbers(part: int) -> SingleArray:
            return white_noise(self.part.ids, columns, stream=FIRST_STREAM * (part + 1) if part else 1)

        return self.correlation.apply(numbers, self.laplacian)

    def mean_squares(self, probes: SingleArray) -> SingleArray:
        """Squares of probes (n, columns) around every vertex, summed over the columns, (n,)."""
        squares: SingleArray = np.square(probes).sum(axis=1, dtype=np.float32)
        if not self.correlation.times:
            return squares
        return self.clusters.around([squares])[:, 0]


def learn_noise_levels(
    noisy: NoisyMesh, laplacian: Laplacian, sigma: float, unit: float, *, given: bool = False
) -> tuple[NoiseLevels, FloatArray]:
    """What holds for a mesh as a whole, by the core of a part, and the standard deviation of the noise, (n,).

    The noise has the same level everywhere, sigma, which the mesh has so far, unless it clearly varies. Levels are
    means of what a weak filter takes off, in a way that outliers, such as at edges, matter little to. Where they are
    high for many creases, what it takes off is not normally distributed, as noise is. None is below `LEAST_NOISE`
    before the standard deviation of the relief, `DETAIL`, is taken off it; `unit` is the mean edge. If it varies, sigma
    is its root mean square if that was `given`, and no matter otherwise. The Laplacian is
    that of umbrellas, with free borders.
    """
    least, detail, core = LEAST_NOISE * unit, DETAIL * unit, noisy.part.core
    noise = noisy.samples(1).astype(np.float64)
    taken = noise - low_pass(laplacian, noise, WEAK)
    share = float(np.sqrt(np.square(taken[core]).mean()))
    heights, roots = _taken_off(noisy.part, noisy.clusters, laplacian, share)
    found = _levels(roots[core])
    low, high = np.quantile(found, (0.1, 0.9))
    if high < SPREAD * low or _is_creased(heights[core], found):
        levels = NoiseLevels(sigma, share, least, detail, noisy.correlation)
    else:
        factor = sigma / float(np.sqrt(np.square(found).mean())) if given else 1.0
        lowest = max(least, LEAST * factor * float(high))
        levels = NoiseLevels(None, share, lowest, detail, noisy.correlation, factor)
    return levels, levels.at(roots)


def local_sigma(part: MeshPart, clusters: Clusters, levels: NoiseLevels) -> FloatArray:
    """Standard deviation of the noise around every vertex, (n,)."""
    if levels.sigma is not None:
        return levels.at(np.zeros(len(part.ids), dtype=np.float32))
    laplacian = umbrella_laplacian(part, "free")
    return levels.at(_taken_off(part, clusters, laplacian, levels.share)[1])


def roughness(part: MeshPart, sigma: float, clusters: Clusters | None = None) -> FloatArray:
    """How much more a strong filter takes off around every vertex than a weak one, (n,): most at edges and corners.

    Where a large mesh is roughest, it has to be looked at, lest an edge be smoothed because no sample has met one.
    It goes by ratios, as the noise itself may vary. A tile has `ROUGHNESS_RINGS` around what counts; sigma is the
    standard deviation of the noise of the mesh as a whole. The clusters, if they are known, have the pace `PACE`.
    """
    clusters, laplacian = clusters or clusters_of(part, PACE), umbrella_laplacian(part, "free")
    strong, weak = _heights(part, laplacian, STRONG)
    around = clusters.around([np.square(strong), np.sqrt(np.abs(weak))]).astype(np.float64)
    return around[:, 0] / np.maximum(around[:, 1] ** 4, (LEAST * sigma) ** 2)


def roughest(values: FloatArray, ids: IntArray) -> IntArray:
    """Where it is roughest, as far as some of the vertices tell: places among these, that for all of them first.

    It is drawn by lot from what is nearly as rough as the roughest of all: a tile, whose sums are others, nearly always
    draws what memory draws, where the very largest would be a matter of rounding. The others are what may
    be drawn when there are more vertices: so a few of each tile do.

    >>> values, ids = np.random.default_rng(0).random(10_000), np.arange(10_000, dtype=np.int32)
    >>> few = [k + roughest(values[k : k + 500], ids[k : k + 500]) for k in range(0, 10_000, 500)]
    >>> max(map(len, few)) < 12, ids[roughest(values, ids)[0]] == np.concatenate(few)[
    ...     roughest(values[np.concatenate(few)], ids[np.concatenate(few)])[0]
    ... ]
    (True, np.True_)
    """
    values = np.nan_to_num(values)  # of lengths whose squares are no numbers
    near = np.flatnonzero(values >= AS_ROUGH * values.max())
    near = near[np.argsort(random_bits(ids[near], LOTS))]
    before = np.maximum.accumulate(np.append(-1.0, values[near]))[:-1]
    return near[values[near] > before].astype(np.int32)


def _taken_off(
    part: MeshPart, clusters: Clusters, laplacian: Laplacian, share: float
) -> tuple[FloatArray, SingleArray]:
    """What a weak filter takes off every vertex, over its share of the noise, lengths, and mean roots of it, (n,)."""
    heights = np.abs(_heights(part, laplacian, MEDIUM)[1] / share)
    return heights, np.maximum(clusters.around([np.sqrt(heights)])[:, 0], np.float32(0.0))


def _is_creased(heights: FloatArray, levels: FloatArray) -> bool:
    """Whether creases are what makes heights that a weak filter takes off large where their levels (n,) are highest."""
    highest = (levels >= np.quantile(levels, HIGHEST)) & (levels > 0.0)
    relative = heights[highest] / levels[highest]
    return not (len(relative) and relative.mean() < CREASED * np.sqrt(relative).mean() ** 2)


def _heights(part: MeshPart, laplacian: Laplacian, strength: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of the vertices over the mesh after a filter, and after a weak one, along the normals of the former, (n,)."""
    vertices = part.mesh.vertices
    smooth, weak = (low_pass(laplacian, vertices, one) for one in (strength, WEAK))
    normals = tangent_planes(TriangleMesh(smooth, part.mesh.faces), part.adjacency).normals
    return np.einsum("ij,ij->i", vertices - smooth, normals), np.einsum("ij,ij->i", vertices - weak, normals)


def _levels(roots: SingleArray) -> FloatArray:
    result: FloatArray = np.square(roots.astype(np.float64) / MEAN_ROOT)
    return result
