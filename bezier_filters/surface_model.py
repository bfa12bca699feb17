"""What a sample of neighbourhoods says about a surface: its noise, and how fast it varies.

Over a neighbourhood the height is a polynomial plus noise of standard deviation sigma. Terms of
total degree j >= 3 count as random; height, slope and curvature are free. A prior that does not
prefer directions has one variance per degree j and angular frequency l of the terms
r^j cos(l phi), r^j sin(l phi), l = j, j - 2, ...: the round ones (l = 0) act on the mean curvature,
those with l = 2 on the difference of the principal curvatures. The variances follow from an
analysis of variance: after orthogonalisation term by term, what the heights hold of a term is
noise plus that term and later ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import comb

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.neighbourhood_samples import NeighbourhoodSample
from bezier_filters.polynomials import total_degree_space

FREE_DEGREE = 2
"""Slope and curvature are what we are after: no prior touches them."""
MODEL_DEGREE = 8
"""Degrees of the model; those that a fit leaves out are its bias."""
SIGNIFICANT = 3.0
"""Standard errors by which a term must rise above the noise to be believed."""
FEWEST_SAMPLES = 12
FEWEST_POINTS_PER_COEFFICIENT = 1.2


@dataclass(frozen=True)
class RingAnalysis:
    """The k-rings of a sample, orthogonalised degree by degree, in units of their radius.

    Attributes
    ----------
    rings : int
        k.
    radius : float
        Median radius of the neighbourhoods, the unit of x and y below, a length.
    degree : int
        Highest degree J that the neighbourhoods determine.
    factors : (N, m, M) float64
        Q^T A for the design matrices A of the neighbourhoods, Q being orthonormal for the m terms
        up to degree J; upper triangular in its first m columns. The M columns are the terms of
        `harmonic_basis`.
    mean_squares : (J + 1,) float64
        Mean squared residual of fits of each degree without prior, length^2.
    part_squares : (m,) float64
        Mean square of what the heights hold of each term, length^2.
    energies : (m,) float64
        What that would be if the term had the variance 1 and all others 0.
    """

    rings: int
    radius: float
    degree: int
    factors: FloatArray
    mean_squares: FloatArray
    part_squares: FloatArray
    energies: FloatArray


@dataclass(frozen=True)
class RingModel:
    """The surface as its k-rings see it.

    Attributes
    ----------
    analysis : RingAnalysis
    variances : (M,) float64
        Of the terms, for coordinates in units of the radius, length^2; 0 for the free degrees.
    """

    analysis: RingAnalysis
    variances: FloatArray


@dataclass(frozen=True)
class SurfaceModel:
    """Noise and smoothness of a surface.

    Attributes
    ----------
    sigma : float
        Standard deviation of the noise of the heights, a length.
    by_rings : tuple of RingModel
        In ascending order of k.
    """

    sigma: float
    by_rings: tuple[RingModel, ...]


@dataclass(frozen=True)
class HarmonicBasis:
    """Terms r^j cos(l phi), r^j sin(l phi) up to `MODEL_DEGREE`, by ascending degree.

    Attributes
    ----------
    degrees, frequencies : (M,) int32
        j and l of every term.
    monomials : (M, M) float64
        Column k holds the coefficients of term k for the monomials of `total_degree_space`.
    """

    degrees: IntArray
    frequencies: IntArray
    monomials: FloatArray


@cache
def harmonic_basis() -> HarmonicBasis:
    """The terms of the model."""
    place = {tuple(pair): k for k, pair in enumerate(total_degree_space(MODEL_DEGREE).exponents.tolist())}
    degrees, frequencies, columns = [], [], []
    for degree in range(MODEL_DEGREE + 1):
        for frequency in range(degree, -1, -2):
            half = (degree - frequency) // 2
            term = np.zeros(len(place), dtype=np.complex128)  # (x^2 + y^2)^half (x + i y)^frequency
            for n in range(half + 1):
                for k in range(frequency + 1):
                    pair = (2 * (half - n) + frequency - k, 2 * n + k)
                    term[place[pair]] += comb(half, n) * comb(frequency, k) * 1j**k
            for part in (term.real, term.imag)[: 2 if frequency else 1]:
                degrees.append(degree)
                frequencies.append(frequency)
                columns.append(part)
    return HarmonicBasis(np.array(degrees, np.int32), np.array(frequencies, np.int32), np.column_stack(columns))


def analyse_ring(sample: NeighbourhoodSample, rings: int, most: int) -> RingAnalysis | None:
    """Analyse up to `most` of the k-rings of a sample; None if too few of them are usable."""
    points, present = sample.ring(rings)
    points, present = points[:most], present[:most]
    if len(points) < FEWEST_SAMPLES:
        return None
    sizes = present.sum(axis=1)
    degree = _determined_degree(float(np.percentile(sizes, 20)))
    basis = harmonic_basis()
    m = int((basis.degrees <= degree).sum())
    enough = sizes > m
    points, present, sizes = points[enough], present[enough], sizes[enough]
    if len(points) < FEWEST_SAMPLES or degree <= FREE_DEGREE:
        return None
    radius = float(np.median(np.sqrt(np.square(points[..., :2]).sum(axis=2).max(axis=1))))
    if not radius > 0.0:
        return None
    design = (_monomials(points[..., :2] / radius) @ basis.monomials) * present[..., np.newaxis]
    q, _ = np.linalg.qr(design[..., :m])
    transposed = q.transpose(0, 2, 1)
    heights = points[..., 2, np.newaxis]
    parts = transposed @ heights
    left = np.square(heights - q @ parts).sum()
    factors = transposed @ design
    part_squares = np.square(parts[..., 0]).mean(axis=0)
    # Residuals of fits of degree J, J - 1, ...: what was left, and the parts given back.
    by_degree = np.bincount(basis.degrees[:m], weights=part_squares)
    given_back = np.cumsum(np.append(0.0, by_degree[:0:-1]))[::-1]
    freedom = np.cumsum(np.append(0, np.arange(degree + 1, 1, -1)))[::-1]
    return RingAnalysis(
        rings=rings,
        radius=radius,
        degree=degree,
        factors=factors,
        mean_squares=(left / len(points) + given_back) / ((sizes - m).mean() + freedom),
        part_squares=part_squares,
        energies=np.square(factors[:, np.arange(m), np.arange(m)]).mean(axis=0),
    )


def learn_noise(analyses: Sequence[RingAnalysis]) -> SurfaceModel:
    """Find the noise, and the variances that it leaves to the surface.

    The noise is the smallest residual of a fit of the highest degree: where a neighbourhood is
    wide enough for degrees beyond, they show as a larger residual. The variance of a term takes
    in what later ones look like over the ring, which errs on the side of less smoothing; of all
    rings at least as wide, the one that says least is believed.

    Parameters
    ----------
    analyses : sequence of RingAnalysis
        In ascending order of k, at least one.
    """
    reliable = [analysis for analysis in analyses if analysis.rings >= 3] or analyses
    noise = min(float(analysis.mean_squares[-1]) for analysis in reliable)
    basis = harmonic_basis()
    models: list[RingModel] = []
    unit = analyses[0].radius
    smallest = np.full(len(basis.degrees), np.inf)  # variances so far, for coordinates in this unit
    for analysis in reversed(analyses):
        m = len(analysis.part_squares)
        # Both terms of a frequency have one variance.
        group = basis.degrees * (MODEL_DEGREE + 1) + basis.frequencies
        size = np.bincount(group[:m])
        surplus = np.bincount(group[:m], weights=analysis.part_squares - noise)
        energy = np.bincount(group[:m], weights=analysis.energies)
        by_chance = SIGNIFICANT * noise * np.sqrt(2.0 * size / len(analysis.factors))
        believed = np.where(surplus > by_chance, surplus, 0.0) / np.maximum(energy, 1e-300)
        # Every estimate errs upwards, a narrow ring's by the noise of terms that it hardly sees.
        to_unit = (unit / analysis.radius) ** (2.0 * basis.degrees)
        smallest[:m] = np.minimum(smallest[:m], believed[group[:m]] * to_unit[:m])
        known = np.isfinite(smallest) & (basis.degrees > FREE_DEGREE)
        variances = np.where(known, smallest, 0.0) / to_unit
        models.append(RingModel(analysis, variances))
    return SurfaceModel(float(np.sqrt(noise)), tuple(reversed(models)))


def _determined_degree(points: float) -> int:
    degree = FREE_DEGREE
    while degree < MODEL_DEGREE and FEWEST_POINTS_PER_COEFFICIENT * (degree + 2) * (degree + 3) / 2 <= points:
        degree += 1
    return degree


def _monomials(xy: FloatArray) -> FloatArray:
    """Monomials (..., M) of points (..., 2) up to `MODEL_DEGREE`."""
    powers = np.stack([xy**k for k in range(MODEL_DEGREE + 1)], axis=-1)
    a, b = total_degree_space(MODEL_DEGREE).exponents.T
    columns: FloatArray = powers[..., 0, a] * powers[..., 1, b]
    return columns
