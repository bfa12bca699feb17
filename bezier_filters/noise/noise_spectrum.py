"""Proposes a covariance of the noise: variance components of the scores and residuals of several rings.

Noise is stationary, while shape varies over the mesh and grows with the ring. So the flattest of the sampled
neighbourhoods show the noise best. For every ring and degree, the mean squares of their scores of degree 3 and more and
of their residuals are modelled as a sum of white noise, correlated noise of several ranges, and shape terms. The
variances of these components follow by non-negative least squares with weights from the expected mean squares (NNLS).
Ranges enter by forward selection, as long as the deviance drops enough.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.noise.noise_model import NoiseModel, pairwise_squared_distances
from bezier_filters.patches.harmonics import HIGHEST_DEGREE, harmonic_basis
from bezier_filters.sampling.ring_analysis import FREE_DEGREE, RingAnalysis

# squared candidate ranges, in squared edges, in steps of sqrt(2)
SQUARED_LENGTHS = tuple(4.0 * 0.5 ** (0.5 * k) for k in range(7, -1, -1))
FLATTEST_FRACTION, FLAT_FRACTION, MAJORITY_FRACTION = 0.1, 0.25, 0.6  # quantiles of the neighbourhoods by roughness
MIN_INDEPENDENT_PLACES = 16.0  # effective number of independent neighbourhoods among the flattest
# Ratio of the correlated variances, of the majority to the flattest, up to which the noise counts as homogeneous.
# Averaged noise on tori, stars and ellipsoids gives up to 2.1, detail of the bunny with deleted vertices 2.3 to 18.
# Halved, noise of eight averages counts as detail (H 1.5 times worse); doubled, this detail counts as noise (normals
# 1.4 to 3.9 times worse).
HOMOGENEOUS_VARIANCE_RATIO = 1.8
# Least nugget over the variance: every measurement has some white noise, of which averages on regular meshes show none.
# Half and twice it change the level of such noise by 5 %.
MIN_NUGGET = 0.005
# Fraction of the deviance that noise must explain if its nugget is smaller, as shape may look like it then: 98 % and
# more for averages on regular meshes, 90 % and less on clean surfaces.
MIN_EXPLAINED_DEVIANCE = 0.95
MIN_ROUGHNESS_DEGREE = 4  # lowest degree of the terms that measure roughness
SPECTRUM_RINGS = (2, 3, 4, 5)  # narrower rings have too few points; wider ones take too long
EXPECTATION_ERROR = 0.05  # relative model error of the expected mean squares, added to their sampling error
MAX_CORRELATED_COMPONENTS = 2  # correlated components of the noise
MIN_DEVIANCE_DROP = 40.0  # drop of the deviance by a component of the noise; chance gives about 1
# Fraction of the drop that a longer range may miss. The longest of about equal ranges is used, which explains more by
# noise and less by shape; otherwise chance would decide between them.
DEVIANCE_SLACK = 0.01
REWEIGHTING_STEPS = 12  # iterations of variances and weights
LOWEST_RANDOM_DEGREE = FREE_DEGREE + 1


@dataclass(frozen=True)
class Spectrum:
    """Observed mean squares, and the contributions of each component at variance 1.

    Each ring has an entry for every degree from 3 to the highest, and one for the residuals.
    """

    observed: FloatArray  # (e,)
    variances: FloatArray  # (e,): relative variances of the observed mean squares
    white: FloatArray  # (e,)
    correlated: FloatArray  # (e, lengths)
    shape: FloatArray  # (e, degrees from 3)

    @property
    def is_within_range(self) -> bool:
        """Whether the squares of all entries, and of the entries over the standard errors, are finite."""
        weights = (1.0 / (self.observed * np.sqrt(self.variances)))[:, np.newaxis]
        entries = np.column_stack([self.observed, self.white, self.correlated, self.shape])
        return bool(np.isfinite(np.square(np.hstack([entries, entries * weights]))).all())


@dataclass(frozen=True)
class Contributions:
    """Contributions of components of variance 1 to the mean squares of one ring: of its m scores, and of its residuals.

    Lengths are in units of an edge.
    """

    edge: float
    correlated_scores: FloatArray  # (m, lengths)
    correlated_residual: FloatArray  # (lengths,)
    shape_scores: FloatArray  # (m, degrees from 3)
    shape_residual: FloatArray  # (degrees from 3,)


@np.errstate(all="ignore")
def propose_noise_models(analyses: Sequence[RingAnalysis]) -> tuple[NoiseModel, NoiseModel] | None:
    """Propose correlated noise: all that most places show, and the part that is not detail; None if it is white.

    Flat neighbourhoods decide whether there is correlated noise. Selected for small values, they underestimate its
    variance a little. So the variance is that of the majority of the neighbourhoods, as long as it is not much larger
    than that of the flattest: noise is equal in both, shape is not. If the ratio r of the two correlated variances is
    larger, the majority has detail of all amplitudes, and the flattest have the least of it. Then only part of the
    variance is noise: it is multiplied by (1 + (r / r0)^6)^(-1/3) with r0 = `HOMOGENEOUS_VARIANCE_RATIO`. If the noise
    itself varies over the mesh, so does its white component, and r is divided by the ratio of the white variances.

    >>> propose_noise_models([]) is None
    True
    """
    used = [one for one in analyses if one.rings in SPECTRUM_RINGS and one.degree >= LOWEST_RANDOM_DEGREE]
    if len(used) < 2:
        return None
    widest, edge = used[-1], used[0].radius / used[0].rings
    causes = [_contributions(one, edge) for one in used]
    rough = _roughness(widest)
    flat = _fit_noise_model(used, causes, _flattest_centers(widest, rough, FLAT_FRACTION), half=True)
    if flat is None:
        return None
    share = max(
        FLATTEST_FRACTION,
        min(MIN_INDEPENDENT_PLACES / (widest.independent_fraction * len(widest.centers)), FLAT_FRACTION),
    )
    flattest = _fit_noise_model(used, causes, _flattest_centers(widest, rough, share), half=True) or flat
    residual_squares = widest.sums.residuals[:, -1] / np.maximum(widest.sums.freedom[:, -1], 1.0)
    calm = _flattest_centers(widest, residual_squares, MAJORITY_FRACTION)
    majority = _fit_noise_model(used, causes, calm, half=False) or flat
    white_ratio = max(majority.white / flattest.white, 1.0)
    ratio = sum(majority.sills) / sum(flattest.sills) / white_ratio
    trusted_share = (1.0 + (ratio / HOMOGENEOUS_VARIANCE_RATIO) ** 6) ** (-1.0 / 3.0)
    return majority, replace(majority, sills=tuple(float(trusted_share * sill) for sill in majority.sills))


def _fit_noise_model(
    analyses: Sequence[RingAnalysis], causes: Sequence[Contributions], centers: IntArray, *, half: bool
) -> NoiseModel | None:
    """Fit the noise of the neighbourhoods of some centers; None if it is white, or does not explain them.

    `half` uses only the scores that did not select the centers.
    """
    places = [one.subset(np.isin(one.centers, centers)) for one in analyses]
    entries = [_spectrum_rows(one, of, half) for one, of in zip(places, causes, strict=True) if one is not None]
    if len(entries) < len(analyses):
        return None
    spectrum, edge = Spectrum(*(np.concatenate(part) for part in zip(*entries, strict=True))), causes[0].edge
    if not (spectrum.observed > 0.0).all() or not spectrum.is_within_range:
        return None  # squares of coordinates of very different sizes overflow
    chosen: list[int] = []
    variances, deviance = _fit_variance_components(spectrum, chosen)
    without = deviance
    while len(chosen) < MAX_CORRELATED_COMPONENTS and deviance > MIN_DEVIANCE_DROP:
        tried = {
            k: _fit_variance_components(spectrum, [*chosen, k]) for k in range(len(SQUARED_LENGTHS)) if k not in chosen
        }
        least = min(one[1] for one in tried.values())
        if deviance - least < MIN_DEVIANCE_DROP:
            break
        best = max(k for k, one in tried.items() if one[1] - least <= DEVIANCE_SLACK * (deviance - least))
        variances, deviance = tried[best]
        chosen.append(best)
    white, sills = float(variances[0]), variances[1 : 1 + len(chosen)]
    least_white = MIN_NUGGET * float(sills.sum())
    if not sills.any() or (white < least_white and deviance > (1.0 - MIN_EXPLAINED_DEVIANCE) * without):
        return None
    parts = [(float(sill), SQUARED_LENGTHS[k] ** 0.5) for k, sill in zip(chosen, sills, strict=True) if sill]
    model = NoiseModel(
        max(white, least_white), tuple(sill for sill, _ in parts), tuple(edge * length for _, length in parts)
    )
    return model.scale_variance(edge**2)


def _roughness(analysis: RingAnalysis) -> FloatArray:
    """Roughness of every neighbourhood: the mean of its squared scores of high degree over their medians, (N,).

    One score of every cosine-sine pair measures roughness; the other ones measure the noise. Under noise the two are
    independent, so that the selection of flat neighbourhoods hardly biases the estimate.
    """
    basis, m = harmonic_basis(), analysis.sums.scores.shape[1]
    is_selector = _split_mask(m) & (basis.degrees[:m] >= min(MIN_ROUGHNESS_DEGREE, analysis.degree))
    squares = np.square(analysis.sums.scores[:, is_selector])
    usual = np.median(squares, axis=0)
    with np.errstate(over="ignore", invalid="ignore"):  # infinite is rough, too
        result: FloatArray = (squares / np.maximum(usual, np.finfo(np.float64).tiny)).mean(axis=1)
    return result


def _flattest_centers(analysis: RingAnalysis, measure: FloatArray, share: float) -> IntArray:
    """Centers of the fraction of the neighbourhoods with the smallest values of a measure."""
    result: IntArray = analysis.centers[measure <= np.quantile(measure, share)]
    return result


def _split_mask(terms: int) -> BoolArray:
    """Mask of the terms that measure roughness, one of every pair, (terms,)."""
    groups = harmonic_basis().groups[:terms]
    result: BoolArray = np.append(False, groups[1:] == groups[:-1])
    return result


def _contributions(analysis: RingAnalysis, edge: float) -> Contributions:
    return Contributions(edge, *_noise_contributions(analysis, edge), *_shape_contributions(analysis, edge))


def _noise_contributions(analysis: RingAnalysis, edge: float) -> tuple[FloatArray, FloatArray]:
    """Contributions of noise of variance 1 and each range."""
    fitted, m = analysis.noise_sample, analysis.sums.scores.shape[1]
    free = analysis.sizes[: len(fitted.points)] - m
    # single precision is far more than the model error, and takes half the time
    steeper = (fitted.steepness[..., np.newaxis] * fitted.orthonormal).astype(np.float32)
    total = np.square(fitted.steepness).sum(axis=1)
    squares = pairwise_squared_distances(fitted.points * (analysis.radius / edge)).astype(np.float32)
    of_parts, of_rest = np.zeros((m, len(SQUARED_LENGTHS))), np.zeros(len(SQUARED_LENGTHS))
    for first in (-1, -2):
        correlation = np.exp(np.float32(-0.5 / SQUARED_LENGTHS[first]) * squares)
        for k in range(len(SQUARED_LENGTHS) + first, -1, -2):
            parts = ((correlation @ steeper) * steeper).sum(axis=1, dtype=np.float64)
            of_parts[:, k] = parts.mean(axis=0)
            of_rest[k] = max(((total - parts.sum(axis=1)) / free).mean(), 0.0)  # rounding may leave less
            correlation *= correlation  # that of half the squared length
    return of_parts, of_rest


def _shape_contributions(analysis: RingAnalysis, edge: float) -> tuple[FloatArray, FloatArray]:
    """Contributions of terms of each degree from 3 with variance 1 at the distance of an edge."""
    degrees, m = harmonic_basis().degrees, analysis.sums.scores.shape[1]
    squares = np.square(analysis.factors[analysis.rows[analysis.first]]).mean(axis=0)
    unexplained = analysis.sums.unexplained.mean(axis=0) / analysis.sums.freedom[:, -1].mean()
    of_degree = np.array(
        [degrees == degree for degree in range(LOWEST_RANDOM_DEGREE, HIGHEST_DEGREE + 1)], dtype=np.float64
    )
    scales = (analysis.radius / edge) ** (2.0 * np.arange(LOWEST_RANDOM_DEGREE, HIGHEST_DEGREE + 1))
    return squares[:m] @ of_degree.T * scales, of_degree @ unexplained * scales


def _spectrum_rows(analysis: RingAnalysis, of: Contributions, half: bool) -> tuple[FloatArray, ...]:
    """The entries of a `Spectrum` for one ring: means over the terms of each degree, and over the residuals."""
    degrees, m = harmonic_basis().degrees, analysis.sums.scores.shape[1]
    noise_sample = ~_split_mask(m) if half else np.ones(m, dtype=np.bool_)
    means = np.array(
        [noise_sample & (degrees[:m] == degree) for degree in range(LOWEST_RANDOM_DEGREE, analysis.degree + 1)]
    ).astype(float)
    terms = means.sum(axis=1)
    means /= terms[:, np.newaxis]
    freedom = float(analysis.sums.freedom[:, -1].sum())
    counts = np.append(terms * len(analysis.centers), freedom) * analysis.independent_fraction
    left = analysis.sums.residuals[:, -1].sum() / freedom
    return (
        np.append(means @ np.square(analysis.sums.scores).mean(axis=0), left) / of.edge**2,
        2.0 / counts + EXPECTATION_ERROR**2,
        np.ones(len(terms) + 1),
        np.vstack([means @ of.correlated_scores, of.correlated_residual]),
        np.vstack([means @ of.shape_scores, of.shape_residual]),
    )


def _fit_variance_components(spectrum: Spectrum, lengths: Sequence[int]) -> tuple[FloatArray, float]:
    """Fit the variances of white noise, of noise of some ranges and of shape (NNLS); also return the deviance.

    The standard errors of the observed mean squares are proportional to the expected ones, so the weights are iterated.
    """
    causes = np.column_stack([spectrum.white, spectrum.correlated[:, list(lengths)], spectrum.shape])
    expected = spectrum.observed
    variances = np.zeros(causes.shape[1])
    for _ in range(REWEIGHTING_STEPS):
        weights = 1.0 / (expected * np.sqrt(spectrum.variances))
        variances = nnls(causes * weights[:, np.newaxis], spectrum.observed * weights, maxiter=1000)[0]
        expected = np.maximum(0.5 * (expected + causes @ variances), np.finfo(np.float64).tiny)
    misfit = np.square((spectrum.observed - expected) * weights)
    return variances, float(misfit.sum())
