"""Sampled neighbourhoods, orthogonalised term by term: the data of an analysis of variance."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.dense import dot, powers
from bezier_filters.harmonics import HIGHEST_DEGREE, harmonic_basis
from bezier_filters.neighbourhood_samples import NeighbourhoodSample
from bezier_filters.parallel import RangeTask, run_in_chunks
from bezier_filters.polynomials import total_degree_space

FREE_DEGREE = 2
"""Height, slope and curvature are what we are after: no prior touches them."""
FEWEST_SAMPLES = 12
FEWEST_POINTS_PER_COEFFICIENT = 1.2
FIRST = 16
"""Neighbourhoods by which plans are compared."""
CANCELLED = 0.3
"""A column that keeps less than this of its length has lost digits."""
UNSEEN = 1e-7
"""A term whose column keeps less than this of its length is not seen by the points."""
CHUNK = 16
"""Neighbourhoods per chunk: each takes up to a millisecond."""


@dataclass(frozen=True)
class RingAnalysis:
    """The k-rings of a sample, orthogonalised term by term, in units of their radius.

    Arrays have a row for each of N neighbourhoods, so that parts of the sample can be looked at.
    Degrees d run from 0 to J; m is the number of terms up to J, G that of their groups, and the
    M terms and their groups are those of `harmonic_basis`.

    Attributes
    ----------
    rings : int
        k.
    radius : float
        Median radius of the neighbourhoods, the unit of x and y below, a length.
    degree : int
        Highest degree J that the neighbourhoods determine.
    independent : float
        Share of the neighbourhoods that count as independent: on a small mesh wide ones overlap.
    centers : (N,) int32
        Vertices whose neighbourhoods these are.
    points : (N, n, 2) float64
        x and y of the points in units of the radius; beyond `sizes`, anything.
    sizes : (N,) int32
        Number of points.
    factors : (N, m, M) float64
        Q^T A for the design matrices A of the neighbourhoods, Q being orthonormal for the m
        terms; upper triangular in its first m columns. Rows of terms that the points do not see are 0.
    parts : (N, m) float64
        Q^T z: what the heights hold of each term, a length.
    unexplained : (N, M) float64
        Squared length of what no term up to J explains of each term; 0 for those up to J.
    residuals, freedom : (N, J + 1) float64
        Squared residual of the fit of each degree, length^2, and its degrees of freedom.
    term_squares, term_weights, term_counts : (N, J + 1, G) float64
        For the fit of each degree and each group, the sums over its terms of w a^2, w and 1: the
        squared coefficient, length^2, the reciprocal of its variance under unit noise, and how many the points see.
    """

    rings: int
    radius: float
    degree: int
    independent: float
    centers: IntArray
    points: FloatArray
    sizes: IntArray
    factors: FloatArray
    parts: FloatArray
    unexplained: FloatArray
    residuals: FloatArray
    freedom: FloatArray
    term_squares: FloatArray
    term_weights: FloatArray
    term_counts: FloatArray

    def where(self, kept: BoolArray) -> "RingAnalysis | None":
        """Only the neighbourhoods that are marked, (N,); None if they are too few."""
        if kept.sum() < FEWEST_SAMPLES:
            return None
        arrays: dict[str, Any] = {
            name: getattr(self, name)[kept] for name in ("centers", "points", "sizes", *Output._fields)
        }
        return replace(self, **arrays)

    @cached_property
    def mean_squares(self) -> FloatArray:
        """Mean squared residual of fits of each degree without prior, (J + 1,), length^2."""
        result: FloatArray = self.residuals.sum(axis=0) / self.freedom.sum(axis=0)
        return result

    @cached_property
    def typical_square(self) -> float:
        """Squared residual per degree of freedom of the fit of degree J, as the median has it, length^2."""
        freedom = np.maximum(self.freedom[:, -1], 1.0)
        # The median of a chi square variable over its mean (Wilson and Hilferty).
        of_mean = (1.0 - 2.0 / (9.0 * freedom)) ** 3
        return float(np.median(self.residuals[:, -1] / freedom / of_mean))

    @cached_property
    def first_designs(self) -> FloatArray:
        """Values of the terms at the points of the first neighbourhoods, (`FIRST`, n, M); 0 beyond `sizes`."""
        count = FIRST
        exponents = total_degree_space(HIGHEST_DEGREE).exponents
        powers_of = [
            np.stack([axis**k for k in range(HIGHEST_DEGREE + 1)]) for axis in np.moveaxis(self.points[:count], 2, 0)
        ]
        monomials = powers_of[0][exponents[:, 0]] * powers_of[1][exponents[:, 1]]
        present = np.arange(self.points.shape[1]) < self.sizes[:count, np.newaxis]
        result: FloatArray = np.moveaxis(monomials * present, 0, 2) @ harmonic_basis().monomials
        return result

    @cached_property
    def energies(self) -> FloatArray:
        """Mean squared diagonal of the factors, (m,): what the points say of each term."""
        m = self.parts.shape[1]
        result: FloatArray = np.square(self.factors[:, np.arange(m), np.arange(m)]).mean(axis=0)
        return result


def analyse_ring(
    sample: NeighbourhoodSample, rings: int, most: int, *, vertex_count: int, threads: int = 1
) -> RingAnalysis | None:
    """Analyse up to `most` of the usable k-rings of a sample; None if too few of them are usable."""
    rows = np.flatnonzero(sample.usable[:, rings])[:most]
    if len(rows) < FEWEST_SAMPLES:
        return None
    basis = harmonic_basis()
    degree = _determined_degree(float(np.percentile(sample.sizes[rows, rings], 20)))
    m = basis.up_to(degree)
    rows = rows[sample.sizes[rows, rings] > m]
    if len(rows) < FEWEST_SAMPLES:
        return None
    sizes = sample.sizes[rows, rings]
    points = sample.points[rows, : sizes.max()]
    present = np.arange(points.shape[1]) < sizes[:, np.newaxis]
    radius = float(np.median(np.sqrt((np.square(points[..., :2]).sum(axis=2) * present).max(axis=1))))
    if not radius > 0.0:
        return None
    by_degree = (len(rows), degree + 1)
    by_group = (*by_degree, int(basis.groups[m - 1]) + 1)
    analysis = RingAnalysis(
        rings,
        radius,
        degree,
        # Neighbourhoods that overlap by half still tell nearly as much as separate ones.
        min(1.0, 2.0 * vertex_count / float(sizes.sum())),
        sample.centers[rows],
        points[..., :2] / radius,
        sizes,
        np.zeros((len(rows), m, len(basis.degrees))),
        np.zeros((len(rows), m)),
        np.zeros((len(rows), len(basis.degrees))),
        *(np.zeros(by_degree) for _ in range(2)),
        *(np.zeros(by_group) for _ in range(3)),
    )
    output = Output(*(getattr(analysis, name) for name in Output._fields))
    exponents = total_degree_space(HIGHEST_DEGREE).exponents
    to_terms = np.ascontiguousarray(basis.monomials.T)

    def make_task() -> RangeTask:
        return lambda start, stop: _analyse(
            points, sizes, 1.0 / radius, exponents, to_terms, basis.degrees, basis.groups, start, stop, output
        )

    run_in_chunks(make_task, len(rows), threads=threads, chunk=CHUNK)
    return analysis


def _determined_degree(points: float) -> int:
    degree = FREE_DEGREE
    while degree < HIGHEST_DEGREE and FEWEST_POINTS_PER_COEFFICIENT * (degree + 2) * (degree + 3) / 2 <= points:
        degree += 1
    return degree


class Output(NamedTuple):
    """The arrays of a `RingAnalysis` that the kernel fills."""

    factors: FloatArray
    parts: FloatArray
    unexplained: FloatArray
    residuals: FloatArray
    freedom: FloatArray
    term_squares: FloatArray
    term_weights: FloatArray
    term_counts: FloatArray


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _analyse(
    points: FloatArray,
    sizes: IntArray,
    scale: float,
    exponents: IntArray,
    to_terms: FloatArray,
    degrees: IntArray,
    groups: IntArray,
    start: int,
    stop: int,
    output: Output,
) -> None:
    """Fill rows start .. stop-1."""
    most, terms = points.shape[1], to_terms.shape[0]
    highest = exponents[terms - 1].max()
    xy = np.empty((2, most))
    heights, monomial = np.empty(most), np.empty(most)
    powers_x, powers_y = np.empty((highest + 1, most)), np.empty((highest + 1, most))
    columns = np.empty((terms, most))
    m = output.parts.shape[1]
    inverse = np.empty((m, m))
    for row in range(start, stop):
        n = sizes[row]
        for p in range(n):
            xy[0, p], xy[1, p] = points[row, p, 0] * scale, points[row, p, 1] * scale
            heights[p] = points[row, p, 2]
        powers(xy[0], n, highest, powers_x)
        powers(xy[1], n, highest, powers_y)
        columns[:] = 0.0
        for k in range(terms):
            a, b = exponents[k, 0], exponents[k, 1]
            for p in range(n):
                monomial[p] = powers_x[a, p] * powers_y[b, p]
            for t in range(terms):
                if to_terms[t, k] != 0.0:
                    _add_multiple(columns[t], to_terms[t, k], monomial, n)
        _orthogonalise(columns, heights, n, output.factors[row], output.parts[row], output.unexplained[row])
        _sum_residuals(dot(heights, heights, n), n, degrees, row, output)
        _sum_coefficients(degrees, groups, inverse, row, output)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _orthogonalise(
    columns: FloatArray, heights: FloatArray, n: int, factors: FloatArray, parts: FloatArray, unexplained: FloatArray
) -> None:
    """Modified Gram-Schmidt; the heights become what no term explains."""
    m, terms = factors.shape
    for t in range(m):
        before = dot(columns[t], columns[t], n)
        length = np.sqrt(before)
        for _ in range(2):
            for s in range(t):
                if factors[s, s] > 0.0:
                    _add_multiple(columns[t], -dot(columns[s], columns[t], n), columns[s], n)
            reduced = np.sqrt(dot(columns[t], columns[t], n))
            small, length = reduced < CANCELLED * length, reduced
            if not small:  # or else a second pass removes what rounding left
                break
        if length <= UNSEEN * np.sqrt(before):
            continue
        factors[t, t] = length
        for p in range(n):
            columns[t, p] /= length
        for s in range(t + 1, terms):
            factors[t, s] = dot(columns[t], columns[s], n)
        parts[t] = dot(columns[t], heights, n)
        _add_multiple(heights, -parts[t], columns[t], n)
    for s in range(m, terms):
        unexplained[s] = dot(columns[s], columns[s], n)
        for t in range(m):
            unexplained[s] -= factors[t, s] ** 2
        unexplained[s] = max(unexplained[s], 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_residuals(left: float, n: int, degrees: IntArray, row: int, output: Output) -> None:
    """Residuals of the fits of degree J, J - 1, ...: what was left, and the parts given back."""
    m, highest = output.parts.shape[1], output.residuals.shape[1] - 1
    output.residuals[row, :] = left
    output.freedom[row, :] = n
    for t in range(m):
        for d in range(highest + 1):
            if degrees[t] > d:
                output.residuals[row, d] += output.parts[row, t] ** 2
            elif output.factors[row, t, t] > 0.0:
                output.freedom[row, d] -= 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_coefficients(degrees: IntArray, groups: IntArray, inverse: FloatArray, row: int, output: Output) -> None:
    """Coefficients of the fits of each degree: the inverse factor, column by column, times the parts."""
    m = output.parts.shape[1]
    factors, parts = output.factors[row], output.parts[row]
    values, variances = np.zeros(m), np.zeros(m)
    inverse[:] = 0.0
    for c in range(m):
        if factors[c, c] > 0.0:
            inverse[c, c] = 1.0 / factors[c, c]
            for r in range(c - 1, -1, -1):
                if factors[r, r] > 0.0:
                    total = 0.0
                    for t in range(r + 1, c + 1):
                        total += factors[r, t] * inverse[t, c]
                    inverse[r, c] = -total / factors[r, r]
            for r in range(c + 1):
                values[r] += inverse[r, c] * parts[c]
                variances[r] += inverse[r, c] ** 2
        if c + 1 == m or degrees[c + 1] > degrees[c]:
            for r in range(c + 1):
                if factors[r, r] > 0.0:
                    weight = 1.0 / variances[r]
                    output.term_squares[row, degrees[c], groups[r]] += weight * values[r] ** 2
                    output.term_weights[row, degrees[c], groups[r]] += weight
                    output.term_counts[row, degrees[c], groups[r]] += 1.0


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _add_multiple(target: FloatArray, factor: float, source: FloatArray, count: int) -> None:
    """Add factor times source to target, over the first `count` entries."""
    for p in range(count):
        target[p] += factor * source[p]
