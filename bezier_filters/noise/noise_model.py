"""The covariance of the noise along the normal, and its propagation to the fits of one ring.

Scanners blur their measurements, so the noise of neighbouring vertices is correlated. The model is a nested covariance:
white noise (the nugget) plus components with sill s and range l, C(d) = s exp(-d^2 / (2 l^2)) at distance d. White
noise averaged with a Gaussian of width l / sqrt(2) has this correlation. Distances are measured in edges, which may be
longer in one direction: see `RingAnalysis.quadratics`.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.noise.rounding import Rounding
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.sampling.ring_analysis import RingAnalysis

# mean of 1 / cos^2 of the slopes below which white noise along the normal equals the noise of the heights
STEEP_MEAN_SQUARE = 1.02
# Largest ratio of the true to the estimated standard deviation of correlated noise. If the known standard deviation is
# larger, the remaining variance gets this factor times the longest estimated range.
MAX_UNDERESTIMATION, HIDDEN_RANGE_FACTOR = 2.5, 4.0
MIN_SLOPE_RINGS = 3  # narrower rings have too few points to separate slopes from noise, and count as flat


@dataclass(frozen=True)
class NoiseModel:
    """Noise of the heights: stationary, Gaussian, with an isotropic covariance."""

    white: float  # variance of the white component, length^2
    sills: tuple[float, ...] = ()  # variances of the correlated components, length^2
    lengths: tuple[float, ...] = ()  # their ranges: distances at which the correlation is exp(-1/2)
    heavy: bool = False  # whether single normals are so noisy that they must be smoothed
    outliers: float = 0.0  # share of the vertices that are outliers
    given: bool = False  # whether the user gave the standard deviation
    # how the coordinates are rounded, if that is the noise
    rounding: Rounding | None = field(default=None, repr=False, compare=False)

    @property
    def variance(self) -> float:
        """Variance of the noise of one vertex, length^2."""
        return self.white + sum(self.sills)

    @property
    def sigma(self) -> float:
        """Standard deviation of the noise of one vertex, a length."""
        return float(np.sqrt(self.variance))

    @property
    def length(self) -> float:
        """Range of the noise: the mean over its correlated components weighted by their sills; 0 if it is white."""
        return float(np.dot(self.sills, self.lengths) / sum(self.sills)) if self.sills else 0.0

    def sigma_in_ranges_of(self, other: "NoiseModel") -> float:
        """Standard deviation of the components whose ranges are not longer than those of other noise, a length.

        >>> NoiseModel(0.04, (0.5,), (2.0,)).sigma_in_ranges_of(NoiseModel(1.0))
        0.2
        """
        longest = max(other.lengths, default=0.0)
        known = (sill for sill, length in zip(self.sills, self.lengths, strict=True) if length <= longest)
        return float(np.sqrt(self.white + sum(known)))

    def scale_variance(self, factor: float) -> "NoiseModel":
        """The same noise with `factor` times the variance."""
        return replace(self, white=factor * self.white, sills=tuple(factor * sill for sill in self.sills))

    def covariances(self, points: FloatArray, steepness: FloatArray) -> FloatArray:
        """Covariances of the heights of the points of neighbourhoods, (T, n, 3) to (T, n, n).

        `steepness` (T, n) is 1 / cos of the slope of the surface at the points.

        Examples
        --------
        >>> points = np.array([[[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]])
        >>> NoiseModel(1.0, (2.0,), (1.0,)).covariances(points, np.ones((1, 2))).round(3)
        array([[[3.   , 0.736],
                [0.736, 3.   ]]])
        """
        return self.covariances_of(pairwise_squared_distances(points), steepness)

    def covariances_of(self, squares: FloatArray, steepness: FloatArray) -> FloatArray:
        """The same for the squared distances of the points, (T, n, n)."""
        result = np.zeros(squares.shape)
        for sill, length in zip(self.sills, self.lengths, strict=True):  # in place: new arrays take longer than sums
            correlations = -0.5 / length**2 * squares
            np.exp(correlations, out=correlations)
            correlations *= sill
            result += correlations
        places = np.arange(squares.shape[1])
        result[:, places, places] += self.white
        result *= steepness[:, :, np.newaxis] * steepness[:, np.newaxis]
        return result


NO_NOISE = NoiseModel(0.0)


def rescale_noise(learned: NoiseModel | None, sigma: float) -> NoiseModel:
    """Rescale estimated noise to a known standard deviation, with the estimated correlation.

    If the noise is correlated, and its known standard deviation is more than `MAX_UNDERESTIMATION` times the estimate,
    the remaining variance becomes a component of longer range, which the estimate counted as shape.

    >>> rescale_noise(NoiseModel(1.0, (3.0,), (0.5,)), 1.0)
    NoiseModel(white=0.25, sills=(0.75,), lengths=(0.5,), heavy=False, outliers=0.0, given=True)
    >>> rescale_noise(NoiseModel(1.0, (3.0,), (0.5,)), 10.0)
    NoiseModel(white=6.25, sills=(18.75, 75.0), lengths=(0.5, 2.0), heavy=False, outliers=0.0, given=True)
    """
    known = replace(learned or NoiseModel(0.0), given=True)
    if not known.sills or sigma == 0.0:
        return replace(known, white=sigma**2, sills=(), lengths=())
    seen = min(sigma, MAX_UNDERESTIMATION * known.sigma)
    known = known.scale_variance(seen**2 / known.variance)
    if seen == sigma:
        return known
    rest = sigma**2 - seen**2
    return replace(
        known, sills=(*known.sills, rest), lengths=(*known.lengths, HIDDEN_RANGE_FACTOR * max(known.lengths))
    )


def pairwise_squared_distances(points: FloatArray) -> FloatArray:
    """Squared distances between all points of every neighbourhood, (T, n, d) to (T, n, n).

    |a - b|^2 = -2 a b + |a|^2 + |b|^2 is one product of longer vectors, without other arrays of this size.
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
    """Variances, length^2, that noise causes in the fits of one ring, averaged over neighbourhoods.

    T is the number of the first neighbourhoods; degrees d run from 0 to J; m, M and G are the numbers of terms and
    groups in `RingAnalysis`.
    """

    model: NoiseModel
    analysis: RingAnalysis
    score_variances: FloatArray  # (m,): variances of the scores, see `RingSums`
    residuals: FloatArray  # (J + 1,): mean squared residual of the fit of each degree, per degree of freedom
    # (J + 1, G): variances of the coefficients of each degree over their variances under white noise of variance 1
    coefficients: FloatArray

    @property
    def is_flat(self) -> bool:
        """Whether the slopes are too small to change the variance of the heights."""
        return _is_flat(self.analysis)

    @cached_property
    def covariances(self) -> FloatArray | None:
        """Covariances of the heights of the first points, (T, n, n); None if the noise is white."""
        if not self.model.sills:
            return None
        points, steepness = self.analysis.quadratics(self.analysis.first)
        return self.model.covariances(self.analysis.radius * points, steepness)

    @cached_property
    def variances(self) -> FloatArray:
        """Variances of the heights of the first points under white noise, (T, n) or (1, 1)."""
        if self.is_flat:
            return np.array([[self.model.white]])
        return self.model.white * np.square(self.analysis.quadratics(self.analysis.first)[1])

    def propagate_covariance(self, weighted: FloatArray) -> FloatArray:
        """A^T C A with the covariance C of the first points and matrices A, (T, n, m) to (T, m, m)."""
        if self.covariances is None:
            return weighted.transpose(0, 2, 1) @ (weighted * self.variances[..., np.newaxis])
        return weighted.transpose(0, 2, 1) @ self.covariances @ weighted

    @cached_property
    def grams(self) -> FloatArray:
        """A^T C A for the design matrices A of the first points, (T, m, m)."""
        m = self.analysis.sums.scores.shape[1]
        if self.covariances is None and self.is_flat:
            return self.model.white * self.analysis.first_grams[..., :m]
        return self.propagate_covariance(self.analysis.first_designs[..., :m])

    def transfer_to_region(self, model: NoiseModel, analysis: RingAnalysis) -> "RingNoise":
        """Rescale the variances to a subset of the neighbourhoods, where noise and slopes may differ."""
        if not model.sills and _is_flat(analysis):
            return ring_noise(model, analysis)
        factor = model.variance / self.model.variance
        if not model.sills:
            factor *= analysis.mean_square_steepness / self.analysis.mean_square_steepness
        return RingNoise(
            model, analysis, factor * self.score_variances, factor * self.residuals, factor * self.coefficients
        )


def _is_flat(analysis: RingAnalysis) -> bool:
    """Whether slopes change the variance of white noise along the normal too little to matter."""
    return analysis.rings < MIN_SLOPE_RINGS or analysis.mean_square_steepness < STEEP_MEAN_SQUARE


def ring_noise(noise: NoiseModel, analysis: RingAnalysis) -> RingNoise:
    """Propagate the covariance of the noise to the fits of one ring."""
    m, by_degree = analysis.sums.scores.shape[1], analysis.sums.term_squares.shape[1:]
    if not noise.sills and _is_flat(analysis):
        every = noise.white
        return RingNoise(noise, analysis, np.full(m, every), np.full(by_degree[0], every), np.full(by_degree, every))
    fitted = analysis.noise_sample
    points = float(analysis.sizes[: len(fitted.points)].mean())
    if noise.sills:
        passed = noise.covariances(analysis.radius * fitted.points, fitted.steepness) @ fitted.orthonormal
    else:
        passed = noise.white * np.square(fitted.steepness)[..., np.newaxis] * fitted.orthonormal
    of_pairs = fitted.orthonormal.transpose(0, 2, 1) @ passed
    scores = np.diagonal(of_pairs, axis1=1, axis2=2).mean(axis=0)
    return RingNoise(
        noise,
        analysis,
        scores,
        _residual_variances(analysis.degree, points, noise.variance * analysis.mean_square_steepness, scores),
        _coefficient_variances(analysis, of_pairs, noise.white),
    )


def _residual_variances(highest: int, points: float, variance: float, scores: FloatArray) -> FloatArray:
    """Trace of the covariance less the variances of the scores up to each degree, per degree of freedom, (J + 1,)."""
    counts = np.array([harmonic_basis().term_count(degree) for degree in range(highest + 1)])
    explained = np.array([scores[:count].sum() for count in counts])
    result: FloatArray = np.maximum(points * variance - explained, 0.0) / np.maximum(points - counts, 1.0)
    return result


def _coefficient_variances(analysis: RingAnalysis, of_pairs: FloatArray, white: float) -> FloatArray:
    """The variances `RingNoise.coefficients`; those of white noise for terms that no points determine.

    `of_pairs` (k, m, m) are the covariances of the scores.
    """
    basis = harmonic_basis()
    result = np.zeros(analysis.sums.term_squares.shape[1:])
    for degree in range(analysis.degree + 1):
        count = basis.term_count(degree)
        to_terms = analysis.noise_sample.to_terms[:, :count, :count]
        passed = ((to_terms @ of_pairs[:, :count, :count]) * to_terms).sum(axis=2)
        of_white = np.square(to_terms).sum(axis=2)
        ratios = np.divide(passed, of_white, out=np.zeros_like(passed), where=of_white > 0.0).sum(axis=0)
        seen = np.bincount(basis.groups[:count], weights=(of_white > 0.0).sum(axis=0))
        sums = np.bincount(basis.groups[:count], weights=ratios)
        result[degree, : len(sums)] = np.where(seen > 0.0, sums / np.maximum(seen, 1.0), white)
    return result
