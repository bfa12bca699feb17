"""The noise of a mesh as filters need it: its local standard deviation, samples of it, and the roughest vertices.

The local level is that of the high-pass residuals |p - f(L) p| along the normals, where f is a weak low-pass filter,
over the fraction of the noise that the filter removes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.meshes.prepared_mesh import mean_square_edges
from bezier_filters.noise.rounding import Rounding
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.sampling.mesh_parts import MeshPart
from bezier_filters.smoothing.chebyshev import low_pass
from bezier_filters.smoothing.clusters import Clusters, clusters_of
from bezier_filters.smoothing.laplacian import Laplacian, umbrella_laplacian
from bezier_filters.smoothing.local_levels import levels_of_roots, local_levels
from bezier_filters.smoothing.random_noise import (
    CORRELATED_NOISE_STREAM,
    WHITE,
    Correlation,
    draw_white_noise,
    random_bits,
    random_signs,
)
from bezier_filters.smoothing.rounding_errors import RoundingErrors, rounding_errors

WEAK_STRENGTH, MEDIUM_STRENGTH = np.array([1.0]), np.array([10.0])  # filter strengths for residuals and for normals
STRONG_STRENGTH = np.array([100.0])  # strength of the filter that rough places do not follow
ROUGHNESS_RINGS = 32  # rings around a tile that its roughness depends on
# `time_scale` of clusters where no mesh gives it: triangles of about one size are within some hundredths of it
DEFAULT_TIME_SCALE = 0.27
# Ratio to the largest roughness that counts as a tie: any such vertex will do, but tiles and memory must pick the same.
ROUGHNESS_TIE_RATIO = 0.98
PROBE_STREAM, SAMPLE_STREAM = 1, 2  # streams of the shifts of `RoundingErrors`
TIE_BREAK_STREAM = 101  # stream of the vertex hashes that break ties
# Quantiles of the levels, and their ratio from which on the noise may vary. With a ratio of 2 depth cameras keep 1.4
# times as much of their noise; with 1.2 levels are searched on meshes of one noise, too, which takes time.
VARIATION_QUANTILES, MIN_LEVEL_RATIO = (0.02, 0.98), 1.5
# Vertices at which patches show whether high levels are noise, least share of the noise there in the levels, and
# largest predicted error of the patches over the levels, both in mean edges. On steps and gradients of the noise .74
# and more, .5 and less; near creases .22 to .59, or else .59 and more.
CHECKED_PLACES, MIN_EXPLAINED_SHARE, MAX_CHECKED_ERROR = 400, 0.6, 0.6
# Largest level over the noise that patches find where levels are high: at edges of three faces levels may be larger.
# With 1 noise on a tenth of a sphere leaves .17 edges instead of .023; with 4 as much, and feet of fins may move more.
MAX_LEVEL_RATIO = 2.0
MIN_LEVEL_FRACTION = 0.1  # least level in the roughness, over the noise of the whole mesh
# standard deviation of fine relief over the mean edge: clean scans have it, and smoothing keeps it
RELIEF_PER_EDGE = 0.01
MIN_NOISE_PER_EDGE = RELIEF_PER_EDGE + 1e-4  # smallest standard deviation of noise over the mean edge


# noise around some vertices and predicted error of patches there, see `learn_noise_at`; None if it is not known
NoiseAt: TypeAlias = Callable[[IntArray], tuple[float, float] | None]


@dataclass(frozen=True)
class NoiseLevels:
    """Global parameters of the local standard deviation of the noise."""

    sigma: float | None  # standard deviation everywhere, a length; None if it varies
    share: float  # fraction of the noise that a weak filter removes
    correlation: Correlation = WHITE  # correlation of neighbouring vertices
    factor: float = 1.0  # ratio of the known to the estimated standard deviation, if the noise varies
    largest: float = np.inf  # bound of estimated levels that vary, a length
    rounding: Rounding | None = None  # how the coordinates are rounded, if that is the noise
    gain: float = 1.0  # root mean square of the errors that `RoundingErrors` draws

    def subtract_relief(self, levels: FloatArray, edges: FloatArray | float) -> FloatArray:
        """Standard deviation of the noise at vertices, (n,), from levels of noise and relief over edges (n,)."""
        excess = np.square(levels / edges) - RELIEF_PER_EDGE**2
        least = MIN_NOISE_PER_EDGE**2 - RELIEF_PER_EDGE**2
        result: FloatArray = np.sqrt(np.maximum(excess, least)) * edges
        return result


@dataclass(frozen=True)
class NoisyMesh:
    """A mesh, or a part of one, and the noise of its vertices."""

    part: MeshPart
    clusters: Clusters  # of the same mesh
    sigma: FloatArray  # (n,): standard deviation of the noise around every vertex, positive lengths
    correlation: Correlation = WHITE  # correlation of the noise of neighbouring vertices
    laplacian: Laplacian | None = None  # umbrella Laplacian with free borders, whose heat flow makes correlated noise
    errors: RoundingErrors | None = None  # if the noise is that of rounded coordinates
    gain: float = 1.0  # see `NoiseLevels`

    @cached_property
    def scale(self) -> FloatArray:
        """Root mean square of the standard deviations around every vertex, (n,): the unit of residuals and risks.

        If it were the standard deviation of the vertex itself, exact vertices next to noisy ones would decide there.
        """
        if np.ptp(self.sigma) == 0.0:
            return self.sigma
        return np.sqrt(self.clusters.average([np.square(self.sigma)])[:, 0].astype(np.float64))

    @cached_property
    def weights(self) -> FloatArray | None:
        """Weights of the vertices in means of risks, see `Estimates`: variances over the squared edges around."""
        if self.scale is self.sigma:
            return None
        return np.square(self.scale / local_edges(self.part, self.clusters))

    @property
    def is_white(self) -> bool:
        """Whether the noise of different vertices is independent."""
        return self.errors is None and not self.correlation.times

    def probes(self, columns: int, *, first: int = 0) -> SingleArray:
        """Noise of variance 1, (n, columns): random signs if it is white."""
        if self.errors is not None:
            return self.errors.draw(columns, first=first, stream=PROBE_STREAM) / np.float32(self.gain)

        def signs(part: int) -> SingleArray:
            return random_signs(
                self.part.ids, columns, first=first, stream=CORRELATED_NOISE_STREAM + part - 1 if part else 0
            )

        return self.correlation.apply(signs, self.laplacian)

    def samples(self, columns: int) -> SingleArray:
        """Noise of variance 1, (n, columns), of normal distribution if it is not that of rounding."""
        if self.errors is not None:
            return self.errors.draw(columns, stream=SAMPLE_STREAM) / np.float32(self.gain)

        def numbers(part: int) -> SingleArray:
            return draw_white_noise(self.part.ids, columns, stream=CORRELATED_NOISE_STREAM * (part + 1) if part else 1)

        return self.correlation.apply(numbers, self.laplacian)

    def mean_squares(self, probes: SingleArray) -> SingleArray:
        """Squares of probes (n, columns) around every vertex, summed over the columns, (n,)."""
        squares: SingleArray = np.square(probes).sum(axis=1, dtype=np.float32)
        if self.is_white:
            return squares
        # vertices without faces have no normal, and no errors of rounding along it
        return np.maximum(self.clusters.average([squares])[:, 0], np.finfo(np.float32).tiny)


def learn_noise_levels(
    noisy: NoisyMesh, laplacian: Laplacian, sigma: float, unit: float, noise_at: NoiseAt, *, given: bool = False
) -> tuple[NoiseLevels, FloatArray]:
    """Learn the noise levels of a mesh from the core of a part, and the standard deviation at its vertices, (n,).

    The noise has the level sigma everywhere, unless the `local_levels` of the high-pass residuals of a weak filter vary
    and patches where they are high show noise there (`noise_at`): creases have large residuals, too. Levels are at
    least `MIN_NOISE_PER_EDGE`; the standard deviation of the relief, `RELIEF_PER_EDGE`, is subtracted from them in
    squares. `unit` is the mean edge. If the noise varies and sigma was `given`, sigma is its root mean square;
    otherwise sigma is not used. `laplacian` is the umbrella Laplacian with free borders.
    """
    core = noisy.part.core
    noise = noisy.samples(1).astype(np.float64)
    removed = noise - low_pass(laplacian, noise, WEAK_STRENGTH)
    share = float(np.sqrt(np.square(removed[core]).mean()))
    roots = _residual_roots(noisy.part, laplacian, share)
    wide = levels_of_roots(noisy.clusters.average([roots])[:, 0])
    low, high = np.quantile(wide[core], VARIATION_QUANTILES)
    levels = NoiseLevels(sigma, share, noisy.correlation)
    if high >= MIN_LEVEL_RATIO * low:
        local = local_levels(roots, noisy.clusters, laplacian)
        is_high = core & (local > np.sqrt(low * high))
        noise_there = _check_noise(noise_at, noisy.part.ids, is_high, local, unit)
        if noise_there is not None:
            local = np.minimum(local, MAX_LEVEL_RATIO * noise_there)
            factor = sigma / float(np.sqrt(np.square(local[core]).mean())) if given else 1.0
            levels = replace(levels, sigma=None, factor=factor, largest=MAX_LEVEL_RATIO * noise_there)
            return levels, levels.subtract_relief(factor * local, local_edges(noisy.part, noisy.clusters))
    return levels, np.full(len(roots), levels.subtract_relief(np.array(sigma), unit))


def rounding_levels(rounding: Rounding, errors: RoundingErrors, measured: MeshPart, sigma: float | None) -> NoiseLevels:
    """The noise of rounded coordinates, of a root mean square `sigma`, a length, if it is given.

    `errors` are those of `measured`, a part before its coordinates are scaled.
    """
    gain, inflation = errors.calibrate(measured.mesh.adjacency.vertices)
    factor = 1.0 if sigma is None else sigma / float(np.sqrt(np.square(errors.sigma[measured.core]).mean()))
    return NoiseLevels(None, 1.0, Correlation(variance_inflation=inflation), factor, rounding=rounding, gain=gain)


def add_rounding_errors(noisy: NoisyMesh, levels: NoiseLevels, errors: RoundingErrors, scale: float) -> NoisyMesh:
    """A mesh with the noise of rounded coordinates; `errors` are those of the mesh before it was scaled."""
    sigma = levels.factor * scale * errors.sigma
    return replace(noisy, sigma=sigma, correlation=levels.correlation, errors=errors, gain=levels.gain)


def apply_noise_levels(
    part: MeshPart, clusters: Clusters, levels: NoiseLevels, unit: float, measured: MeshPart, scale: float
) -> NoisyMesh:
    """A mesh, or a tile, with the noise of the whole mesh, whose mean edge is `unit`.

    `measured` is the part before its coordinates were multiplied by `scale`.
    """
    if levels.rounding is not None and levels.rounding.has_terraces:
        laplacian = umbrella_laplacian(part, "free")
        errors = rounding_errors(measured, levels.rounding, laplacian, unit / scale)
        return add_rounding_errors(NoisyMesh(part, clusters, errors.sigma), levels, errors, scale)
    sigma = local_sigma(part, clusters, levels, unit)
    of_heat = umbrella_laplacian(part, "free") if levels.correlation.times else None
    return NoisyMesh(part, clusters, sigma, levels.correlation, of_heat)


def local_sigma(part: MeshPart, clusters: Clusters, levels: NoiseLevels, unit: float) -> FloatArray:
    """Standard deviation of the noise around every vertex, (n,); `unit` is the mean edge of the whole mesh."""
    if levels.sigma is not None:
        return np.full(len(part.ids), levels.subtract_relief(np.array(levels.sigma), unit))
    laplacian = umbrella_laplacian(part, "free")
    roots = _residual_roots(part, laplacian, levels.share)
    local = levels.factor * np.minimum(local_levels(roots, clusters, laplacian), levels.largest)
    return levels.subtract_relief(local, local_edges(part, clusters))


def local_edges(part: MeshPart, clusters: Clusters) -> FloatArray:
    """Root mean square length of the edges around every vertex, (n,)."""
    squares = clusters.average([mean_square_edges(part.mesh)])[:, 0].astype(np.float64)
    return np.sqrt(np.maximum(squares, np.finfo(np.float32).tiny))


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


def _residual_roots(part: MeshPart, laplacian: Laplacian, share: float) -> SingleArray:
    """Roots of the high-pass residuals of every vertex over their share of noise, (n,)."""
    result: SingleArray = np.sqrt(np.abs(_heights(part, laplacian, MEDIUM_STRENGTH)[1] / share)).astype(np.float32)
    return result


def _check_noise(noise_at: NoiseAt, ids: IntArray, is_high: BoolArray, levels: FloatArray, unit: float) -> float | None:
    """The noise where levels (n,) are high, if patches explain and average it; None near creases: that is shape."""
    chosen = np.flatnonzero(is_high)
    chosen = chosen[np.argsort(random_bits(ids[chosen], TIE_BREAK_STREAM))[:CHECKED_PLACES]]
    found = noise_at(chosen.astype(np.int32)) if len(chosen) else None
    if found is None:
        return None
    level = float(np.median(levels[chosen]))
    explains = found[0] > MIN_EXPLAINED_SHARE * level and found[1] < MAX_CHECKED_ERROR * level / unit
    return found[0] if explains else None


def _heights(part: MeshPart, laplacian: Laplacian, strength: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Heights of the vertices over the mesh after a filter and after a weak one, along normals of the first, (n,)."""
    vertices = part.mesh.vertices
    smooth, weak = (low_pass(laplacian, vertices, one) for one in (strength, WEAK_STRENGTH))
    normals = part.mesh.move(smooth).planes.normals
    return np.einsum("ij,ij->i", vertices - smooth, normals), np.einsum("ij,ij->i", vertices - weak, normals)
