"""Decides between white and correlated noise by the restricted likelihood of sampled neighbourhoods.

The contrasts y = Q^T z of a neighbourhood, with Q orthogonal to all quadratics in the tangent plane, contain noise and
the shape beyond a quadratic (restricted likelihood; Patterson, Thompson, "Recovery of inter-block information when
block sizes are unequal", Biometrika 1971). The correlation of noise is the same everywhere, while the amplitude of
shape differs from place to place. So the contrasts are Gaussian with the covariance

    Q^T (sigma^2 R + a S) Q,    S = exp(-d^2 / (2 L^2)),

with the correlation R of the noise model, and at each place a variance sigma^2 of noise and a variance a of shape of
range L. The joint distribution of (sigma^2, a) over the places is estimated on a grid by nonparametric maximum
likelihood (Laird, "Nonparametric maximum likelihood estimation of a mixing distribution", JASA 1978).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.noise.noise_model import NoiseModel, pairwise_squared_distances
from bezier_filters.noise.noise_spectrum import propose_noise_models
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.sampling.ring_analysis import FREE_DEGREE, RingAnalysis

EVIDENCE_RINGS = 3  # ring of the neighbourhoods: 31 contrasts of 37 heights, from which level and correlation follow
# The constants were halved and doubled on 56 meshes: clean, rocker arms with white noise, and averaged noise.
MAX_PLACES = 64  # neighbourhoods: half and twice as many decide alike
# Range L of shape, edges: about that of the residuals of quadratics in a 3-ring. From 2.2 to 4.5 all is decided alike;
# with 1.5 shape resembles noise, and noise of eight averages counts as white; with 6 detail of rocker arms is noise.
SHAPE_RANGE = 3.0
# Log likelihood by which correlated noise must explain the places better than white noise. It is 28 to 300 for averaged
# noise, -65 to 3 for detail of rocker arms; half and twice it decide alike.
MIN_EVIDENCE = 10.0
# grids of the variances of noise and of shape, whose ratios from one to the next are about 1.4 and 3
LEVEL_COUNT, AMPLITUDE_COUNT = 28, 20
# ends of these grids: the lowest over the smallest mean square of a place, the highest ones over the largest
LOWEST_LEVEL, HIGHEST_LEVEL, HIGHEST_AMPLITUDE = 0.02, 3.0, 300.0
# Factors on the nugget of the proposal: one that is too small makes a model unlikely that is right otherwise. Without
# the second one, one of nine meshes with noise of eight averages counts as white; with 4 all is decided alike.
NUGGET_FACTORS = (1.0, 2.0)
MIXTURE_STEPS = 30  # iterations of expectation maximisation for the distribution of levels and amplitudes
EIGENVALUE_FLOOR = 1e-9  # of the largest one: noise of long range hardly shows in some contrasts


class Contrasts(NamedTuple):
    """Contrasts of N places with as many points each, and what their covariance depends on. Lengths are edges."""

    values: FloatArray  # (N, k): y = Q^T z
    of_noise: FloatArray  # (N, k, n): Q^T times the steepness of the points
    of_shape: FloatArray  # (N, k, n): Q^T
    squares: FloatArray  # (N, n, n): squared distances of the points
    independent_share: float  # effective share of independent places


def learn_noise_covariance(analyses: Sequence[RingAnalysis]) -> NoiseModel | None:
    """Estimate the covariance of the noise; None if it is white, or if nothing shows that it is correlated.

    Correlated noise that the spectrum proposes must explain the places better than white noise.

    >>> learn_noise_covariance([]) is None
    True
    """
    places = next((one for one in analyses if one.rings == EVIDENCE_RINGS and one.degree > FREE_DEGREE), None)
    proposed = propose_noise_models(analyses) if places is not None else None
    if places is None or proposed is None:
        return None
    model, without_detail = proposed
    edge = places.radius / places.rings
    contrasts = _contrasts(places, edge)
    with np.errstate(all="ignore"):
        white = noise_evidence(contrasts, NoiseModel(1.0), edge)
        tried = [noise_evidence(contrasts, replace(model, white=one * model.white), edge) for one in NUGGET_FACTORS]
    return without_detail if max(tried) - white > MIN_EVIDENCE else None


def noise_evidence(contrasts: Contrasts, model: NoiseModel, edge: float) -> float:
    """Log likelihood of noise with the correlation of a model, whose level may differ from place to place."""
    values, of_noise, of_shape, squares, independent_share = contrasts
    steepness = np.ones(squares.shape[:2])  # `of_noise` includes it
    unit = model.scale_variance(1.0 / model.variance)
    correlation = unit.covariances_of(squares * edge**2, steepness)
    noise = of_noise @ correlation @ of_noise.transpose(0, 2, 1)
    shape = of_shape @ np.exp(-0.5 / SHAPE_RANGE**2 * squares) @ of_shape.transpose(0, 2, 1)
    # whiten by the noise and diagonalise shape: all variances are then sigma^2 + a * excess
    eigenvalues, vectors = np.linalg.eigh(noise)
    eigenvalues = np.maximum(eigenvalues, EIGENVALUE_FLOOR * eigenvalues[:, -1:])
    whitening = vectors / np.sqrt(eigenvalues)[:, np.newaxis]
    excess, vectors = np.linalg.eigh(whitening.transpose(0, 2, 1) @ shape @ whitening)
    excess = np.maximum(excess, 0.0)
    scores = vectors.transpose(0, 2, 1) @ (whitening.transpose(0, 2, 1) @ values[..., np.newaxis])
    mean_squares = np.square(values).mean(axis=1)
    most = max(float(mean_squares.max()), np.finfo(np.float64).tiny ** 0.5)
    least = max(LOWEST_LEVEL * float(mean_squares.min()), most * np.finfo(np.float64).eps ** 1.5)
    amplitudes = np.append(0.0, np.geomspace(least, HIGHEST_AMPLITUDE * most, AMPLITUDE_COUNT - 1))
    levels = np.geomspace(least, HIGHEST_LEVEL * most, LEVEL_COUNT)
    logarithms = np.zeros((len(values), LEVEL_COUNT, AMPLITUDE_COUNT))
    for k in range(excess.shape[1]):  # contrast by contrast, to save memory
        variances = levels[:, np.newaxis] + amplitudes * excess[:, k, np.newaxis, np.newaxis]
        logarithms -= 0.5 * (np.log(variances) + np.square(scores[:, k])[..., np.newaxis] / variances)
    total = _mixture_likelihood(logarithms.reshape(len(values), -1)) - 0.5 * float(np.log(eigenvalues).sum())
    return independent_share * total


def _mixture_likelihood(logarithms: FloatArray) -> float:
    """Log likelihood of a mixture of C components with the most likely weights; theirs at every place are (N, C)."""
    largest = logarithms.max(axis=1, keepdims=True)
    likelihoods = np.exp(logarithms - largest)
    weights = np.full(likelihoods.shape[1], 1.0 / likelihoods.shape[1])
    for _ in range(MIXTURE_STEPS):
        posterior = likelihoods * weights
        posterior /= posterior.sum(axis=1, keepdims=True)
        weights = posterior.mean(axis=0)
    return float((np.log(likelihoods @ weights) + largest[:, 0]).sum())


def _contrasts(analysis: RingAnalysis, edge: float) -> Contrasts:
    """Contrasts of the first places; all have as many points, the nearest ones."""
    count = int(np.percentile(analysis.sizes, 20))
    numbers = np.flatnonzero(analysis.sizes >= count)[:MAX_PLACES].astype(np.int32)
    points, steepness = (array[:, :count] for array in analysis.quadratics(numbers))
    fixed = harmonic_basis().term_count(FREE_DEGREE)
    design = analysis.designs(numbers)[:, :count, :fixed]
    heights = analysis.points[analysis.rows[numbers], :count, 2] / edge
    across = np.linalg.qr(design, mode="complete")[0][:, :, fixed:].transpose(0, 2, 1)
    values = (across @ heights[..., np.newaxis])[..., 0]
    squares = pairwise_squared_distances(points * (analysis.radius / edge))
    share = min(1.0, analysis.vertex_count / (len(numbers) * count))
    return Contrasts(values, across * steepness[:, np.newaxis], across, squares, share)
