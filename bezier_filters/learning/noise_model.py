"""The covariance of the noise along the normal, and what it does to the fits of one ring.

Scanners blur what they measure, so the noise of neighbouring vertices is alike. It counts as a white part and parts
whose correlation falls off with the distance d as exp(-d^2 / (2 l^2)), as white noise does that was averaged over
surroundings of width l / sqrt(2). Distances go by edges, whichever way these are longer: see `RingAnalysis.quadratics`.
"""

from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.learning.ring_analysis import RingAnalysis
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.runtime.cached_property import cached_property

STEEP = 1.02  # mean of 1 / cos^2 of the slopes, below which white noise along the normal counts as that of the heights
# times the standard deviation of correlated noise that was learned: most that it is mistaken by. If it is known to be
# stronger, the rest has so many times the length of what was learned
MISTAKEN, UNSEEN = 2.5, 4.0
FEWEST_RINGS_FOR_SLOPES = 3  # narrower ones have too few points to tell slopes from noise, and count as flat


@dataclass(frozen=True)
class NoiseModel:
    """Noise of the heights: the same everywhere, Gaussian, its covariance a function of the distance."""

    white: float  # variance of the part that is independent from vertex to vertex, length^2
    sills: tuple[float, ...] = ()  # variances of the correlated parts, length^2,
    lengths: tuple[float, ...] = ()  # and over what distances their correlation falls to exp(-1/2)
    heavy: bool = False  # whether it turns single normals so far that they mean nothing
    outliers: float = 0.0  # share of the vertices that are far off what is around them
    given: bool = False  # whether somebody has said how strong it is

    @property
    def variance(self) -> float:
        """Of the noise of one vertex, length^2."""
        return self.white + sum(self.sills)

    @property
    def sigma(self) -> float:
        """Standard deviation of the noise of one vertex, a length."""
        return float(np.sqrt(self.variance))

    @property
    def length(self) -> float:
        """Distance over which the noise is correlated: the mean over its correlated parts; 0 if it is white."""
        return float(np.dot(self.sills, self.lengths) / sum(self.sills)) if self.sills else 0.0

    def times(self, factor: float) -> "NoiseModel":
        """The same noise with `factor` times the variance."""
        return replace(self, white=factor * self.white, sills=tuple(factor * sill for sill in self.sills))

    def covariances(self, points: FloatArray, steepness: FloatArray) -> FloatArray:
        """Of the heights of the points of neighbourhoods, (T, n, 3) to (T, n, n).

        `steepness` (T, n) is 1 / cos of the slope of the surface there.

        Examples
        --------
        >>> points = np.array([[[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]])
        >>> NoiseModel(1.0, (2.0,), (1.0,)).covariances(points, np.ones((1, 2))).round(3)
        array([[[3.   , 0.736],
                [0.736, 3.   ]]])
        """
        squares = squared_distances(points)
        result = np.zeros(squares.shape)
        for sill, length in zip(self.sills, self.lengths, strict=True):  # in place: new arrays take longer than sums
            correlations = -0.5 / length**2 * squares
            np.exp(correlations, out=correlations)
            correlations *= sill
            result += correlations
        places = np.arange(points.shape[1])
        result[:, places, places] += self.white
        result *= steepness[:, :, np.newaxis] * steepness[:, np.newaxis]
        return result


def known_noise(learned: NoiseModel | None, sigma: float) -> NoiseModel:
    """Noise of a given standard deviation: how alike neighbouring vertices are is learned all the same.

    If it is correlated, and much more than could be learned, the rest has not been seen, so it is as long as shape.

    >>> known_noise(NoiseModel(1.0, (3.0,), (0.5,)), 1.0)
    NoiseModel(white=0.25, sills=(0.75,), lengths=(0.5,), heavy=False, outliers=0.0, given=True)
    >>> known_noise(NoiseModel(1.0, (3.0,), (0.5,)), 10.0)
    NoiseModel(white=6.25, sills=(18.75, 75.0), lengths=(0.5, 2.0), heavy=False, outliers=0.0, given=True)
    """
    known = replace(learned or NoiseModel(0.0), given=True)
    if not known.sills or sigma == 0.0:
        return replace(known, white=sigma**2, sills=(), lengths=())
    seen = min(sigma, MISTAKEN * known.sigma)
    known = known.times(seen**2 / known.variance)
    if seen == sigma:
        return known
    rest = sigma**2 - seen**2
    return replace(known, sills=(*known.sills, rest), lengths=(*known.lengths, UNSEEN * max(known.lengths)))


def squared_distances(points: FloatArray) -> FloatArray:
    """Between all points of every neighbourhood, (T, n, d) to (T, n, n).

    |a - b|^2 = -2 a b + |a|^2 + |b|^2 is one product of longer vectors, which needs no other arrays of this size.
    """
    squares = np.square(points).sum(axis=2, keepdims=True)
    ones = np.ones_like(squares)
    left, right = (
        np.concatenate([-2.0 * points, squares, ones], axis=2),
        np.concatenate([points, ones, squares], axis=2),
    )
    result: FloatArray = left @ right.transpose(0, 2, 1)
    return np.maximum(result, 0.0, out=result)


@dataclass(frozen=True)
class RingNoise:
    """What noise does to the fits of one ring, on average.

    T are its first neighbourhoods; degrees d run from 0 to J; m terms, M of them in all and G groups are those of
    `RingAnalysis`. All are variances, length^2.
    """

    model: NoiseModel
    analysis: RingAnalysis
    parts: FloatArray  # (m,): of what the heights hold of each term, see `RingSums`
    residuals: FloatArray  # (J + 1,): mean square that the fit of each degree leaves, per degree of freedom
    # (J + 1, G): of the coefficients of each degree, over what they would be under white noise of variance 1
    coefficients: FloatArray

    @property
    def is_flat(self) -> bool:
        """Whether slopes do not matter, by which white heights differ."""
        return _is_flat(self.analysis)

    @cached_property
    def covariances(self) -> FloatArray | None:
        """Of the heights of the first points, (T, n, n); None if the noise is white."""
        if not self.model.sills:
            return None
        points, steepness = self.analysis.quadratics(self.analysis.first)
        return self.model.covariances(self.analysis.radius * points, steepness)

    @cached_property
    def variances(self) -> FloatArray:
        """Of the heights of the first points, if the noise is white, (T, n) or (1, 1)."""
        if self.is_flat:
            return np.array([[self.model.white]])
        return self.model.white * np.square(self.analysis.quadratics(self.analysis.first)[1])

    def through(self, weighted: FloatArray) -> FloatArray:
        """A^T covariance A for matrices A with a row for each of the first points, (T, n, m) to (T, m, m)."""
        if self.covariances is None:
            return weighted.transpose(0, 2, 1) @ (weighted * self.variances[..., np.newaxis])
        return weighted.transpose(0, 2, 1) @ self.covariances @ weighted

    @cached_property
    def grams(self) -> FloatArray:
        """What comes through the design matrices of the first points, (T, m, m)."""
        m = self.analysis.sums.parts.shape[1]
        if self.covariances is None and self.is_flat:
            return self.model.white * self.analysis.first_grams[..., :m]
        return self.through(self.analysis.first_designs[..., :m])

    def of_part(self, model: NoiseModel, analysis: RingAnalysis) -> "RingNoise":
        """The same for some of the neighbourhoods, where the noise has another strength, and slopes may be others."""
        if not model.sills and _is_flat(analysis):
            return ring_noise(model, analysis)
        factor = model.variance / self.model.variance
        if not model.sills:
            factor *= analysis.steep / self.analysis.steep
        return RingNoise(model, analysis, factor * self.parts, factor * self.residuals, factor * self.coefficients)


def _is_flat(analysis: RingAnalysis) -> bool:
    """Whether slopes do not matter to white noise along the normal."""
    return analysis.rings < FEWEST_RINGS_FOR_SLOPES or analysis.steep < STEEP


def ring_noise(noise: NoiseModel, analysis: RingAnalysis) -> RingNoise:
    """Find out what noise does to the fits of one ring."""
    m, by_degree = analysis.sums.parts.shape[1], analysis.sums.term_squares.shape[1:]
    if not noise.sills and _is_flat(analysis):
        every = noise.white
        return RingNoise(noise, analysis, np.full(m, every), np.full(by_degree[0], every), np.full(by_degree, every))
    fitted = analysis.looked_at
    points = float(analysis.sizes[: len(fitted.points)].mean())
    if noise.sills:
        passed = noise.covariances(analysis.radius * fitted.points, fitted.steepness) @ fitted.orthonormal
    else:
        passed = noise.white * np.square(fitted.steepness)[..., np.newaxis] * fitted.orthonormal
    of_pairs = fitted.orthonormal.transpose(0, 2, 1) @ passed
    parts = np.diagonal(of_pairs, axis1=1, axis2=2).mean(axis=0)
    return RingNoise(
        noise,
        analysis,
        parts,
        _of_residuals(analysis.degree, points, noise.variance * analysis.steep, parts),
        _of_coefficients(analysis, of_pairs, noise.white),
    )


def _of_residuals(highest: int, points: float, variance: float, parts: FloatArray) -> FloatArray:
    """Trace of the covariance less what the parts of each degree take of it, per degree of freedom, (J + 1,)."""
    counts = np.array([harmonic_basis().term_count(degree) for degree in range(highest + 1)])
    taken = np.array([parts[:count].sum() for count in counts])
    result: FloatArray = np.maximum(points * variance - taken, 0.0) / np.maximum(points - counts, 1.0)
    return result


def _of_coefficients(analysis: RingAnalysis, of_pairs: FloatArray, white: float) -> FloatArray:
    """See `RingNoise.coefficients`; as white noise, for terms that no points see.

    `of_pairs` (k, m, m) are the covariances of the orthonormal terms.
    """
    basis = harmonic_basis()
    result = np.zeros(analysis.sums.term_squares.shape[1:])
    for degree in range(analysis.degree + 1):
        count = basis.term_count(degree)
        to_terms = analysis.looked_at.to_terms[:, :count, :count]
        passed = ((to_terms @ of_pairs[:, :count, :count]) * to_terms).sum(axis=2)
        of_white = np.square(to_terms).sum(axis=2)
        ratios = np.divide(passed, of_white, out=np.zeros_like(passed), where=of_white > 0.0).sum(axis=0)
        seen = np.bincount(basis.groups[:count], weights=(of_white > 0.0).sum(axis=0))
        sums = np.bincount(basis.groups[:count], weights=ratios)
        result[degree, : len(sums)] = np.where(seen > 0.0, sums / np.maximum(seen, 1.0), white)
    return result
