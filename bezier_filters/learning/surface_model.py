"""What a sample of neighbourhoods says about a surface: its noise, and how fast it varies.

Over a neighbourhood the height is a polynomial plus noise of standard deviation sigma. Terms of
total degree 3 and more count as random, with one variance per degree and angular frequency (see
`harmonics`); height, slope and curvature are free. The variances follow from the coefficients of
fits of every degree, over a sample: a coefficient is that term, a share of later ones and noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.learning.noise_model import NoiseModel, RingNoise, ring_noise
from bezier_filters.learning.quartic_mean import QuarticMean, learn_quartic_mean
from bezier_filters.learning.ring_analysis import FREE_DEGREE, RingAnalysis
from bezier_filters.learning.variances import (
    CORRELATED_NOISE_ERROR,
    PRIOR_RANGE,
    UPPER_PRIOR_RANGE,
    posterior_mean_variance,
)
from bezier_filters.patches.harmonics import HIGHEST_DEGREE, harmonic_basis

MIN_NOISE_RINGS = 2  # narrower rings leave too few points for a fit of high degree to tell noise from shape
# standard errors by which one estimate of a variance must be above another to be taken instead
SIGNIFICANT_STANDARD_ERRORS = 4.0


@dataclass(frozen=True)
class RingModel:
    """The surface as its k-rings see it."""

    analysis: RingAnalysis
    noise: RingNoise
    # (M,): of the terms, for coordinates in units of the radius, length^2; 0 for the free degrees
    variances: FloatArray
    cautious: FloatArray  # (M,): the same with less doubt that a term is there at all: what may be, for standard errors
    unmodelled: float  # mean square of the heights that is neither noise nor any of the terms, length^2
    quartic: QuarticMean  # of the terms of degree 4, given those of degree 2


@dataclass(frozen=True)
class SurfaceModel:
    """Noise and smoothness of a surface, or of a part of it."""

    noise: NoiseModel  # of the heights
    by_rings: tuple[RingModel, ...]  # in ascending order of k

    @property
    def sigma(self) -> float:
        """Standard deviation of the noise, a length."""
        return self.noise.sigma


def learn_model(
    analyses: Sequence[RingAnalysis],
    correlated: NoiseModel | None = None,
    whole: SurfaceModel | None = None,
    known: Sequence[RingModel] = (),
) -> SurfaceModel:
    """Find the variances that noise leaves to the surface, from analyses in ascending order of rings.

    The noise is `correlated`, or else that of the whole of which this is a part at another strength, or white. Where a
    ring says little of a variance, the next wider one, which sees more of the term, is listened to, and the whole
    with the same rings and possibly wider ones. What noise does to a ring is found out once: for the whole, and for
    each strength that it is found to have there.
    """
    noise = _noise(analyses, whole) if correlated is None else correlated
    basis = harmonic_basis()
    free = basis.degrees <= FREE_DEGREE
    of_whole = {} if whole is None else {model.analysis.rings: model.variances for model in whole.by_rings}
    if whole is not None:
        known = [model for model in whole.by_rings if noise.sills or not model.noise.is_flat]
        known = known if whole.noise.variance > 0.0 else ()
    else:
        known = [model for model in known if model.noise.model == noise]
    known_rings = {model.analysis.rings: model for model in known}
    models: list[RingModel] = []
    wider_errors = np.zeros(len(free))
    for analysis in reversed(analyses):
        alike = known_rings.get(analysis.rings)
        if alike is None:
            of_ring = ring_noise(noise, analysis)
        else:
            of_ring = alike.noise if whole is None else alike.noise.of_part(noise, analysis)
        values, errors = _term_variances(analysis, of_ring)
        if models:
            scale = (analysis.radius / models[-1].analysis.radius) ** (2.0 * basis.degrees)
            values, errors = _shrink(values, errors, scale * models[-1].variances, scale * wider_errors)
        if analysis.rings in of_whole:
            values, errors = _shrink(values, errors, of_whole[analysis.rings], np.zeros(len(values)))
        believed, cautious = (
            _enforce_decay(
                np.where(free | np.isinf(errors), 0.0, posterior_mean_variance(values, errors, odds)), values, errors
            )
            for odds in (PRIOR_RANGE, UPPER_PRIOR_RANGE)
        )
        modelled = float((analysis.sums.unexplained @ believed).sum() / analysis.sums.freedom[:, -1].sum())
        unmodelled = max(float(analysis.mean_squares[-1]) - of_ring.residuals[-1] - modelled, 0.0)
        quartic = alike.quartic if alike is not None and whole is None else learn_quartic_mean(of_ring)
        models.append(RingModel(analysis, of_ring, believed, cautious, unmodelled, quartic))
        wider_errors = errors
    return SurfaceModel(noise, tuple(reversed(models)))


def _noise(analyses: Sequence[RingAnalysis], whole: SurfaceModel | None) -> NoiseModel:
    """That of the whole times a factor, as `estimate_white_noise` is found, or else that.

    The factor is 1 at most: where a part, chosen for its residuals or its curvature, has more than the correlated noise
    of the whole, that is detail.
    """
    if whole is None or not whole.noise.sills:
        return estimate_white_noise(analyses)
    expected = {model.analysis.rings: float(model.noise.residuals[-1]) for model in whole.by_rings}
    return whole.noise.times(min(1.0, *(one.typical_square / expected[one.rings] for one in _reliable(analyses))))


def estimate_white_noise(analyses: Sequence[RingAnalysis]) -> NoiseModel:
    """What explains the smallest residual of the highest degree, which is larger where there is shape beyond that."""
    return NoiseModel(min(analysis.typical_square for analysis in _reliable(analyses)))


def _reliable(analyses: Sequence[RingAnalysis]) -> Sequence[RingAnalysis]:
    return [analysis for analysis in analyses if analysis.rings >= MIN_NOISE_RINGS] or analyses


def _enforce_decay(believed: FloatArray, values: FloatArray, errors: FloatArray) -> FloatArray:
    """Variances that fall off with the degree, unless the data are sure of more.

    Over a neighbourhood that polynomials follow, a term is not larger than those one degree lower,
    or than a quarter of those two degrees lower, as on a sphere of the neighbourhood's own radius.
    """
    degrees = harmonic_basis().degrees
    result = believed.copy()
    curved = degrees == FREE_DEGREE
    largest = {FREE_DEGREE - 1: 0.0, FREE_DEGREE: float((values + SIGNIFICANT_STANDARD_ERRORS * errors)[curved].max())}
    for degree in range(FREE_DEGREE + 1, HIGHEST_DEGREE + 1):
        most = max(largest[degree - 1], largest[degree - 2] / 16.0)
        unsure = (degrees == degree) & (values < SIGNIFICANT_STANDARD_ERRORS * errors)
        result[unsure] = np.minimum(result[unsure], most)
        largest[degree] = float(result[degrees == degree].max())
    return result


def _term_variances(analysis: RingAnalysis, of_ring: RingNoise) -> tuple[FloatArray, FloatArray]:
    """Variances of all terms as one ring shows them, and their standard errors, infinite if it does not.

    The coefficient of a term follows from a fit of any degree that has it: a low one leaves it
    with less noise, a high one with less of later terms, whose share may have either sign. Of
    the estimates of its variance, the one is taken that is surely the largest.
    """
    squares, weights, counts = (
        part.sum(axis=0) for part in (analysis.sums.term_squares, analysis.sums.term_weights, analysis.sums.term_counts)
    )
    noise = of_ring.coefficients
    beyond_white = noise - of_ring.model.white
    with np.errstate(divide="ignore", invalid="ignore"):
        values = (squares - noise * counts) / weights
        errors = noise * np.sqrt(2.0 * counts / analysis.independent) / weights
        if (beyond_white != 0.0).any():
            of_model = _running_maximum(beyond_white) if of_ring.model.sills else beyond_white
            errors = np.hypot(errors, CORRELATED_NOISE_ERROR * of_model * counts / weights)
    surely = np.where(counts > 0.0, values - SIGNIFICANT_STANDARD_ERRORS * errors, -np.inf)
    best = surely.argmax(axis=0), np.arange(counts.shape[1])
    found = counts[best] > 0.0
    basis, m = harmonic_basis(), analysis.sums.parts.shape[1]
    result, uncertainty = np.zeros(len(basis.groups)), np.full(len(basis.groups), np.inf)
    result[:m] = np.where(found, values[best], 0.0)[basis.groups[:m]]
    uncertainty[:m] = np.where(found, errors[best], np.inf)[basis.groups[:m]]
    return result, uncertainty


def _running_maximum(values: FloatArray) -> FloatArray:
    """The larger of values (J + 1, G) and of their means over the groups of the degree before.

    A Gaussian covariance leaves next to nothing to high degrees, and what real noise leaves there is no share of that.
    """
    basis, result = harmonic_basis(), values.copy()
    degrees = np.zeros(values.shape[1], dtype=np.int32)
    degrees[basis.groups[basis.groups < len(degrees)]] = basis.degrees[basis.groups < len(degrees)]
    for degree in range(FREE_DEGREE + 1, int(degrees.max()) + 1):
        here = degrees == degree
        result[:, here] = np.maximum(result[:, here], values[:, degrees == degree - 1].mean(axis=1, keepdims=True))
    return result


def _shrink(
    values: FloatArray, errors: FloatArray, hints: FloatArray, hint_errors: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Estimates improved by those of another ring or of the whole, which may differ by as much as they are large.

    A hint of 0 is none.
    """
    hint_errors = np.hypot(hints, hint_errors)
    use = (hints > 0.0) & np.isfinite(hint_errors)
    known = use & np.isfinite(errors)
    share = np.divide(errors, np.hypot(errors, hint_errors), out=np.ones_like(errors), where=known) ** 2
    better = np.where(known, np.where(known, errors, 0.0) * np.sqrt(1.0 - share), hint_errors)
    return np.where(use, values + share * (hints - values), values), np.where(use, better, errors)
