"""The surface model: a random-effects polynomial regression with variance components by the method of moments.

Over a neighbourhood of radius 1 the height is z = sum a_jl r^j e^(il phi) + noise of standard deviation sigma. The
terms of degree j <= 2, height, slope and curvature, are fixed effects. The terms of degree 3 and more are random
effects with one variance per degree j and angular frequency l (see `harmonics`). A coefficient of a fit is the term, a
share of terms of higher degree, and noise. So its mean square over a sample less the expected noise estimates the
variance of the term (method of moments). The estimates are shrunk (empirical Bayes, see `posterior_mean_variance`)
towards those of wider rings and of the whole mesh, and bounded so that they decay with the degree.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.noise.noise_model import NoiseModel, RingNoise, ring_noise
from bezier_filters.patches.harmonics import HIGHEST_DEGREE, harmonic_basis
from bezier_filters.sampling.ring_analysis import FREE_DEGREE, RingAnalysis
from bezier_filters.surface_model.quartic_mean import QuarticMean, learn_quartic_mean
from bezier_filters.surface_model.variances import (
    CORRELATED_NOISE_ERROR,
    PRIOR_RANGE,
    UPPER_PRIOR_RANGE,
    posterior_mean_variance,
)

MIN_NOISE_RINGS = 2  # narrower rings have too few points for a fit of high degree to separate noise from shape
# standard errors by which one estimate of a variance must exceed another to replace it
SIGNIFICANT_STANDARD_ERRORS = 4.0


@dataclass(frozen=True)
class RingModel:
    """Variance components of one ring."""

    analysis: RingAnalysis
    noise: RingNoise
    # (M,): variances of the terms, for coordinates in units of the radius, length^2; 0 for the free degrees
    variances: FloatArray
    # (M,): upper variances for standard errors, with a weaker shrinkage to 0
    upper_variances: FloatArray
    unmodelled: float  # mean square of the heights that neither noise nor the terms explain, length^2
    quartic: QuarticMean  # mean of the terms of degree 4 given the terms of degree 2


@dataclass(frozen=True)
class SurfaceModel:
    """Noise and variance components of a surface, or of a region of it."""

    noise: NoiseModel  # noise of the heights
    by_rings: tuple[RingModel, ...]  # in ascending order of k

    @property
    def sigma(self) -> float:
        """Standard deviation of the noise, a length."""
        return self.noise.sigma


def learn_surface_model(
    analyses: Sequence[RingAnalysis],
    correlated: NoiseModel | None = None,
    whole: SurfaceModel | None = None,
    known: Sequence[RingModel] = (),
) -> SurfaceModel:
    """Estimate the variance components from analyses in ascending order of rings.

    The noise is `correlated` if given; else the noise of the `whole` mesh at another strength, or white noise. The
    variances of a ring are shrunk towards those of the next wider ring, which has more information on the term, and
    towards those of the same ring of the whole. The effect of noise on a ring is computed once for the whole, and
    rescaled for its regions.
    """
    noise = _estimate_noise(analyses, whole) if correlated is None else correlated
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
        known_model = known_rings.get(analysis.rings)
        if known_model is None:
            of_ring = ring_noise(noise, analysis)
        else:
            of_ring = known_model.noise if whole is None else known_model.noise.transfer_to_region(noise, analysis)
        values, errors = _term_variances(analysis, of_ring)
        if models:
            scale = (analysis.radius / models[-1].analysis.radius) ** (2.0 * basis.degrees)
            values, errors = _shrink(values, errors, scale * models[-1].variances, scale * wider_errors)
        if analysis.rings in of_whole:
            values, errors = _shrink(values, errors, of_whole[analysis.rings], np.zeros(len(values)))
        variances, upper_variances = (
            _enforce_decay(
                np.where(free | np.isinf(errors), 0.0, posterior_mean_variance(values, errors, odds)), values, errors
            )
            for odds in (PRIOR_RANGE, UPPER_PRIOR_RANGE)
        )
        variances, upper_variances = (
            _extrapolate_decay(of_terms, values, np.isinf(errors)) for of_terms in (variances, upper_variances)
        )
        modelled = float((analysis.sums.unexplained @ variances).sum() / analysis.sums.freedom[:, -1].sum())
        unmodelled = max(float(analysis.mean_squares[-1]) - of_ring.residuals[-1] - modelled, 0.0)
        quartic = known_model.quartic if known_model is not None and whole is None else learn_quartic_mean(of_ring)
        models.append(RingModel(analysis, of_ring, variances, upper_variances, unmodelled, quartic))
        wider_errors = errors
    return SurfaceModel(noise, tuple(reversed(models)))


def _estimate_noise(analyses: Sequence[RingAnalysis], whole: SurfaceModel | None) -> NoiseModel:
    """Noise of the whole times a factor, if it is correlated; else white noise.

    The factor is 1 at most: a region, chosen for its residuals or its curvature, with more variance than the correlated
    noise of the whole has detail.
    """
    if whole is None or not whole.noise.sills:
        return estimate_white_noise(analyses)
    expected = {model.analysis.rings: float(model.noise.residuals[-1]) for model in whole.by_rings}
    return whole.noise.scale_variance(
        min(1.0, *(one.median_square / expected[one.rings] for one in _reliable_analyses(analyses)))
    )


def estimate_white_noise(analyses: Sequence[RingAnalysis]) -> NoiseModel:
    """White noise with the smallest median squared residual of all rings, to which shape adds in the others."""
    return NoiseModel(min(analysis.median_square for analysis in _reliable_analyses(analyses)))


def _reliable_analyses(analyses: Sequence[RingAnalysis]) -> Sequence[RingAnalysis]:
    return [analysis for analysis in analyses if analysis.rings >= MIN_NOISE_RINGS] or analyses


def _enforce_decay(variances: FloatArray, values: FloatArray, errors: FloatArray) -> FloatArray:
    """Bound the variances so that they decay with the degree, except where the data are significant.

    Where polynomials converge, a term is not larger than the terms one degree lower, or than a quarter of the terms two
    degrees lower (its variance than a sixteenth), as on a sphere whose radius is that of the neighbourhood.
    """
    degrees = harmonic_basis().degrees
    result = variances.copy()
    curved = degrees == FREE_DEGREE
    largest = {FREE_DEGREE - 1: 0.0, FREE_DEGREE: float((values + SIGNIFICANT_STANDARD_ERRORS * errors)[curved].max())}
    for degree in range(FREE_DEGREE + 1, HIGHEST_DEGREE + 1):
        most = max(largest[degree - 1], largest[degree - 2] / 16.0)
        unsure = (degrees == degree) & (values < SIGNIFICANT_STANDARD_ERRORS * errors)
        result[unsure] = np.minimum(result[unsure], most)
        largest[degree] = float(result[degrees == degree].max())
    return result


def _extrapolate_decay(variances: FloatArray, values: FloatArray, is_unknown: BoolArray) -> FloatArray:
    """Extrapolate the variances to terms of degrees that no fit has, as those of lower degrees decay.

    The mean variance of a degree is to that two degrees lower as that is to the one four degrees lower, as long as that
    is a decay. The terms of degree 2 have no variance, but mean squares, among the `values`.
    """
    degrees, result = harmonic_basis().degrees, variances.copy()
    means = [
        float(np.where(degrees > FREE_DEGREE, result, values)[degrees == degree].mean())
        for degree in range(HIGHEST_DEGREE + 1)
    ]
    for degree in range(FREE_DEGREE + 2, HIGHEST_DEGREE + 1):
        here = is_unknown & (degrees == degree)
        lower, lowest = means[degree - 2], means[degree - 4]
        if here.any() and lowest > 0.0 and lower > 0.0:
            result[here] = means[degree] = lower * min(lower / lowest, 1.0)
    return result


def _term_variances(analysis: RingAnalysis, of_ring: RingNoise) -> tuple[FloatArray, FloatArray]:
    """Moment estimates of the variances of all terms from one ring, and their standard errors; infinite if unknown.

    Every fit whose degree includes a term estimates its coefficient. A low degree has less noise, a high one less
    confounding with higher terms, whose share may have either sign. Of the estimates of a variance the one with the
    largest lower bound, estimate less `SIGNIFICANT_STANDARD_ERRORS` standard errors, is used.
    """
    squares, weights, counts = (
        part.sum(axis=0) for part in (analysis.sums.term_squares, analysis.sums.term_weights, analysis.sums.term_counts)
    )
    noise = of_ring.coefficients
    beyond_white = noise - of_ring.model.white
    with np.errstate(divide="ignore", invalid="ignore"):
        values = (squares - noise * counts) / weights
        errors = noise * np.sqrt(2.0 * counts / analysis.independent_fraction) / weights
        if (beyond_white != 0.0).any():
            of_model = _running_maximum(beyond_white) if of_ring.model.sills else beyond_white
            errors = np.hypot(errors, CORRELATED_NOISE_ERROR * of_model * counts / weights)
    surely = np.where(counts > 0.0, values - SIGNIFICANT_STANDARD_ERRORS * errors, -np.inf)
    best = surely.argmax(axis=0), np.arange(counts.shape[1])
    found = counts[best] > 0.0
    basis, m = harmonic_basis(), analysis.sums.scores.shape[1]
    result, uncertainty = np.zeros(len(basis.groups)), np.full(len(basis.groups), np.inf)
    result[:m] = np.where(found, values[best], 0.0)[basis.groups[:m]]
    uncertainty[:m] = np.where(found, errors[best], np.inf)[basis.groups[:m]]
    return result, uncertainty


def _running_maximum(values: FloatArray) -> FloatArray:
    """Maximum of values (J + 1, G) and of their means over the groups of the preceding degree.

    A Gaussian covariance contributes next to nothing to high degrees; real noise contributes more.
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
    """Shrink estimates towards hints, estimates of another ring or of the whole: the inverse-variance weighted mean.

    The true values of both may differ by as much as the hint; a hint of 0 is not used.
    """
    hint_errors = np.hypot(hints, hint_errors)
    use = (hints > 0.0) & np.isfinite(hint_errors)
    known = use & np.isfinite(errors)
    share = np.divide(errors, np.hypot(errors, hint_errors), out=np.ones_like(errors), where=known) ** 2
    better = np.where(known, np.where(known, errors, 0.0) * np.sqrt(1.0 - share), hint_errors)
    return np.where(use, values + share * (hints - values), values), np.where(use, better, errors)
