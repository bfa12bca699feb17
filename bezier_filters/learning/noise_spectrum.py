"""Learns the covariance of the noise: what the residuals and the terms of all rings hold, as noise and shape would.

Noise is everywhere, shape only somewhere; and the wider the ring, the more shape is in it, while noise stays what it
is. So the mean squares of terms of degree 3 and more and of residuals, over the flattest of the sampled places, are
explained, ring by ring and degree by degree, as sums of white noise, of noise correlated over some lengths, and of
shape, each with a variance of its own that is not negative.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.learning.noise_model import NoiseModel, pairwise_squared_distances
from bezier_filters.learning.ring_analysis import FREE_DEGREE, RingAnalysis
from bezier_filters.patches.harmonics import HIGHEST_DEGREE, harmonic_basis

# over which noise may be correlated, in edges: 0.35 to 4, of which each second one is twice the other
SQUARED_LENGTHS = tuple(4.0 * 0.5 ** (0.5 * k) for k in range(7, -1, -1))
FLATTEST_FRACTION, FLAT_FRACTION, MAJORITY_FRACTION = 0.1, 0.25, 0.6  # shares of the places that are looked at
MIN_INDEPENDENT_PLACES = 16.0  # of the flattest places, as many as are independent
# Ratio of correlated variances, most places over the flattest, up to which the flattest speak for all: averaged noise
# on tori, stars and ellipsoids gives up to 2.1, detail of the bunny with deleted vertices 2.3 to 18. Halved, noise of
# eight averages counts as detail (H 1.5 times worse); doubled, that detail as noise (normals 1.4 to 3.9 times worse).
HOMOGENEOUS_VARIANCE_RATIO = 1.8
# square of a length, in edges, over which noise may be correlated without being partly white
SHORT_SQUARED_LENGTH = 1.0
# share of noise of greater length that is white at least: what is as smooth as nothing that is measured is shape. Three
# means over neighbours leave 6e-4, eight 2e-4, which are not told from the detail of models
MIN_WHITE_SHARE = 4e-4
MIN_ROUGHNESS_DEGREE = 4  # of the terms that tell how flat a place is
SPECTRUM_RINGS = (2, 3, 4, 5)  # narrower ones leave too few points; wider ones would take long
EXPECTATION_ERROR = 0.05  # relative standard error of what is expected, beside that of what is observed
MAX_CORRELATED_COMPONENTS = 2  # correlated parts of the noise
MIN_DEVIANCE_DROP = 40.0  # of the deviance, by which a part of the noise must lower it: chance does so by about 1
# share of what a part explains of the deviance that a longer one may leave, which leaves less to shape: the model is
# not exact, and between lengths that explain about as much chance would decide
DEVIANCE_SLACK = 0.01
MAX_DEVIANCE = 4.0  # deviance per observation up to which the explanation counts as one,
# and up to which it does if a tenth of the noise is white, as of no shape, and without correlation most is unexplained
MAX_DEVIANCE_WITH_WHITE, LARGE_WHITE_SHARE, MIN_EXPLAINED_DEVIANCE = 6.0, 0.1, 0.8
REWEIGHTING_STEPS = 12  # in which variances and the weights that follow from them settle
LOWEST_RANDOM_DEGREE = FREE_DEGREE + 1


@dataclass(frozen=True)
class Spectrum:
    """Mean squares that were observed, and what each cause would contribute under variance 1.

    There is an entry for every ring, and there for every degree from 3 to the highest, and for what is left.
    """

    observed: FloatArray  # (e,)
    variances: FloatArray  # (e,): of the observed, relative to their squares
    white: FloatArray  # (e,)
    correlated: FloatArray  # (e, lengths)
    shape: FloatArray  # (e, degrees from 3)

    @property
    def is_within_range(self) -> bool:
        """Whether squares of all entries, and of these over the errors of what was observed, are numbers."""
        weights = (1.0 / (self.observed * np.sqrt(self.variances)))[:, np.newaxis]
        entries = np.column_stack([self.observed, self.white, self.correlated, self.shape])
        return bool(np.isfinite(np.square(np.hstack([entries, entries * weights]))).all())


@dataclass(frozen=True)
class Contributions:
    """What causes of variance 1 contribute to the mean squares of one ring: to its m terms, and to what is left.

    Lengths are in units of an edge.
    """

    edge: float
    correlated_parts: FloatArray  # (m, lengths)
    correlated_rest: FloatArray  # (lengths,)
    shape_parts: FloatArray  # (m, degrees from 3)
    shape_rest: FloatArray  # (degrees from 3,)


@np.errstate(all="ignore")
def learn_noise_covariance(analyses: Sequence[RingAnalysis]) -> NoiseModel | None:
    """The covariance of the noise; None if it is white, or if noise and shape do not explain what there is.

    Flat places decide whether there is any, which hold a little less of the noise, too. Most places say how strong it
    is, as long as that is not much more than at the flattest: noise is as strong there, but shape is not. Where most
    places have far more, they have detail of all strengths, and the least detail is what the flattest have: the larger
    the ratio r of both variances, the less of it is noise, and the estimate falls as 1 / r. Where noise itself varies,
    so does its white part, by which r is corrected.

    >>> learn_noise_covariance([]) is None
    True
    """
    used = [one for one in analyses if one.rings in SPECTRUM_RINGS and one.degree >= LOWEST_RANDOM_DEGREE]
    if len(used) < 2:
        return None
    widest, edge = used[-1], used[0].radius / used[0].rings
    causes = [_contributions(one, edge) for one in used]
    rough = _roughness(widest)
    flat = _fit_noise_model(used, causes, _flattest(widest, rough, FLAT_FRACTION), half=True)
    if flat is None:
        return None
    share = max(
        FLATTEST_FRACTION, min(MIN_INDEPENDENT_PLACES / (widest.independent * len(widest.centers)), FLAT_FRACTION)
    )
    # so few places may not show it, but it is no shape
    is_short = max(flat.lengths) <= SHORT_SQUARED_LENGTH**0.5 * edge
    of_flattest = _fit_noise_model(used, causes, _flattest(widest, rough, share), half=True, known=True)
    flattest = of_flattest or (flat if is_short else None)
    if flattest is None:
        return None
    left = widest.sums.residuals[:, -1] / np.maximum(widest.sums.freedom[:, -1], 1.0)
    most = _fit_noise_model(used, causes, _flattest(widest, left, MAJORITY_FRACTION), half=False) or flat
    whiter = max(most.white / flattest.white, 1.0) if flattest.white > 0.0 else 1.0
    ratio = sum(most.sills) / sum(flattest.sills) / whiter
    believed = (1.0 + (ratio / HOMOGENEOUS_VARIANCE_RATIO) ** 6) ** (-1.0 / 3.0)
    return replace(most, sills=tuple(float(believed * sill) for sill in most.sills))


def _fit_noise_model(
    analyses: Sequence[RingAnalysis],
    causes: Sequence[Contributions],
    centers: IntArray,
    *,
    half: bool,
    known: bool = False,
) -> NoiseModel | None:
    """The noise around some vertices, or None as above; by half of the terms, if the others have chosen these.

    If it is known to be no shape, few places do not have to show that it is none.
    """
    places = [one.where(np.isin(one.centers, centers)) for one in analyses]
    entries = [_entries(one, of, half) for one, of in zip(places, causes, strict=True) if one is not None]
    if len(entries) < len(analyses):
        return None
    spectrum, edge = Spectrum(*(np.concatenate(part) for part in zip(*entries, strict=True))), causes[0].edge
    if not (spectrum.observed > 0.0).all() or not spectrum.is_within_range:
        return None  # coordinates of very different sizes are no numbers any more when squared
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
    white, sills = float(variances[0]) * edge**2, variances[1 : 1 + len(chosen)] * edge**2
    long = np.array([SQUARED_LENGTHS[k] > SHORT_SQUARED_LENGTH for k in chosen], dtype=np.bool_)
    is_certain = white >= LARGE_WHITE_SHARE * sills[long].sum() and deviance <= (1.0 - MIN_EXPLAINED_DEVIANCE) * without
    worst = (MAX_DEVIANCE_WITH_WHITE if is_certain else MAX_DEVIANCE) * len(spectrum.observed)
    is_shape = white < MIN_WHITE_SHARE * sills[long].sum() or deviance > worst
    if not sills.any() or (is_shape and not known):
        return None
    parts = [(float(sill), SQUARED_LENGTHS[k] ** 0.5 * edge) for k, sill in zip(chosen, sills, strict=True) if sill]
    return NoiseModel(white, tuple(sill for sill, _ in parts), tuple(length for _, length in parts))


def _roughness(analysis: RingAnalysis) -> FloatArray:
    """How much of high terms every neighbourhood holds, (N,).

    It goes by one term of every pair of a frequency, and what is then looked at by the others, which under noise are
    independent: so noise itself hardly decides where it is looked for.
    """
    basis, m = harmonic_basis(), analysis.sums.parts.shape[1]
    told = _split_mask(m) & (basis.degrees[:m] >= min(MIN_ROUGHNESS_DEGREE, analysis.degree))
    squares = np.square(analysis.sums.parts[:, told])
    usual = np.median(squares, axis=0)
    with np.errstate(over="ignore", invalid="ignore"):  # infinite is rough, too
        result: FloatArray = (squares / np.maximum(usual, np.finfo(np.float64).tiny)).mean(axis=1)
    return result


def _flattest(analysis: RingAnalysis, measure: FloatArray, share: float) -> IntArray:
    """Centers of the share of the neighbourhoods where a measure is smallest."""
    result: IntArray = analysis.centers[measure <= np.quantile(measure, share)]
    return result


def _split_mask(terms: int) -> BoolArray:
    """Which terms tell how flat a place is: one of every pair, (terms,)."""
    groups = harmonic_basis().groups[:terms]
    result: BoolArray = np.append(False, groups[1:] == groups[:-1])
    return result


def _contributions(analysis: RingAnalysis, edge: float) -> Contributions:
    return Contributions(edge, *_noise_contributions(analysis, edge), *_shape_contributions(analysis, edge))


def _noise_contributions(analysis: RingAnalysis, edge: float) -> tuple[FloatArray, FloatArray]:
    """Noise of variance 1 and each length."""
    fitted, m = analysis.looked_at, analysis.sums.parts.shape[1]
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
    """Terms of each degree from 3 that have variance 1 at the distance of an edge."""
    degrees, m = harmonic_basis().degrees, analysis.sums.parts.shape[1]
    squares = np.square(analysis.factors[analysis.rows[analysis.first]]).mean(axis=0)
    unexplained = analysis.sums.unexplained.mean(axis=0) / analysis.sums.freedom[:, -1].mean()
    of_degree = np.array(
        [degrees == degree for degree in range(LOWEST_RANDOM_DEGREE, HIGHEST_DEGREE + 1)], dtype=np.float64
    )
    scales = (analysis.radius / edge) ** (2.0 * np.arange(LOWEST_RANDOM_DEGREE, HIGHEST_DEGREE + 1))
    return squares[:m] @ of_degree.T * scales, of_degree @ unexplained * scales


def _entries(analysis: RingAnalysis, of: Contributions, half: bool) -> tuple[FloatArray, ...]:
    """The entries of a `Spectrum` for one ring: means over the terms of each degree, and what is left."""
    degrees, m = harmonic_basis().degrees, analysis.sums.parts.shape[1]
    looked_at = ~_split_mask(m) if half else np.ones(m, dtype=np.bool_)
    means = np.array(
        [looked_at & (degrees[:m] == degree) for degree in range(LOWEST_RANDOM_DEGREE, analysis.degree + 1)]
    ).astype(float)
    terms = means.sum(axis=1)
    means /= terms[:, np.newaxis]
    freedom = float(analysis.sums.freedom[:, -1].sum())
    counts = np.append(terms * len(analysis.centers), freedom) * analysis.independent
    left = analysis.sums.residuals[:, -1].sum() / freedom
    return (
        np.append(means @ np.square(analysis.sums.parts).mean(axis=0), left) / of.edge**2,
        2.0 / counts + EXPECTATION_ERROR**2,
        np.ones(len(terms) + 1),
        np.vstack([means @ of.correlated_parts, of.correlated_rest]),
        np.vstack([means @ of.shape_parts, of.shape_rest]),
    )


def _fit_variance_components(spectrum: Spectrum, lengths: Sequence[int]) -> tuple[FloatArray, float]:
    """Variances of white noise, of noise of some lengths and of shape, and the deviance that they leave.

    What is observed has errors in proportion to what is expected, which reweighting takes into account.
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
