"""Orthogonal decompositions A = Q R of the design matrices of sampled neighbourhoods: data of an analysis of variance.

The columns of A are the terms of `harmonic_basis` at the points of a neighbourhood, by ascending degree. The scores
Q^T z of the heights z give residuals and coefficients of the fits of all degrees.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyvander

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.patches.harmonics import HIGHEST_DEGREE, harmonic_basis
from bezier_filters.patches.polynomials import total_degree_space
from bezier_filters.runtime.cached_property import cached_property
from bezier_filters.runtime.lanes import LANES
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks
from bezier_filters.sampling.neighbourhood_samples import NeighbourhoodSample
from bezier_filters.sampling.ring_kernel import RingSums, analyse_in_lanes, ring_workspace

FREE_DEGREE = 2  # terms up to this degree, height, slope and curvature, are fixed effects without a prior
MIN_SAMPLES = 12
MIN_POINTS_PER_COEFFICIENT = 1.2
COMPARISON_SAMPLE_SIZE = 8  # neighbourhoods over which predicted errors are averaged
NOISE_SAMPLE_SIZE = 24  # neighbourhoods over which the effect of noise is averaged
ANALYSIS_CHUNK = 4 * LANES  # neighbourhoods per chunk
# times the largest diagonal entry of the normal equations, added to the diagonal: points on a line are singular
QUADRATIC_RIDGE = 1e-12
# lower bound of the second moment of a neighbourhood across its axis over that along it
MIN_MOMENT_RATIO = 1e-4
_ROW_STARTS = np.cumsum(np.arange(len(harmonic_basis().degrees) + 2)).astype(np.int32)


class FittedPoints(NamedTuple):
    """Points of k neighbourhoods on quadratic fits, and the orthonormal terms at them."""

    points: FloatArray  # (k, n, 3), in units of the radius; narrow neighbourhoods are stretched, see `_equalize_widths`
    steepness: FloatArray  # (k, n): 1 / cos of the slope, by which noise along the normal moves heights; 0 beyond sizes
    # (k, n, m): orthonormal combinations Q of the terms; 0 for terms that the points do not determine
    orthonormal: FloatArray
    to_terms: FloatArray  # (k, m, m): upper triangular; Q is the design matrix times this


@dataclass(frozen=True)
class RingAnalysis:
    """The k-rings of a sample, orthogonalised term by term, in units of their radius.

    Arrays have a row for each of N neighbourhoods, so that subsets of the sample can be analysed.
    Degrees d run from 0 to J; m is the number of terms up to J and G that of their groups (degree and frequency);
    M is the number of all terms of `harmonic_basis`.
    """

    rings: int  # k
    radius: float  # median radius of the neighbourhoods, the unit of x and y below, a length
    degree: int  # highest degree J that the neighbourhoods determine
    vertex_count: int  # of the mesh
    noise_floor: float  # least variance of its noise, length^2
    independent_fraction: float  # effective share of independent neighbourhoods: on a small mesh wide ones overlap
    centers: IntArray  # (N,): vertices whose neighbourhoods these are
    sizes: IntArray  # (N,): number of points
    reaches: FloatArray  # (N,): distance of the farthest of them, a length
    # (N,): rows of the next two arrays that belong to these neighbourhoods, if they are a subset
    rows: IntArray
    points: FloatArray  # (S, n, 3): coordinates of the points, lengths; beyond `sizes`, anything
    # (S, m, M): R = Q^T A for the design matrices A of S neighbourhoods, with orthonormal Q for the m terms; upper
    # triangular in its first m columns, and 0 in rows of terms that the points do not determine
    factors: FloatArray
    sums: RingSums

    def subset(self, kept: BoolArray) -> "RingAnalysis | None":
        """The neighbourhoods where a mask (N,) is true; None if they are too few."""
        if kept.sum() < MIN_SAMPLES:
            return None
        sums = RingSums(*(array[kept] for array in self.sums))
        of_each = {name: getattr(self, name)[kept] for name in ("centers", "sizes", "reaches", "rows")}
        return replace(self, sums=sums, **of_each)

    @cached_property
    def mean_squares(self) -> FloatArray:
        """Mean squared residual of fits of each degree without prior, (J + 1,), length^2."""
        result: FloatArray = self.sums.residuals.sum(axis=0) / self.sums.freedom.sum(axis=0)
        return result

    @cached_property
    def median_square(self) -> float:
        """Squared residual per degree of freedom of the fit of degree J by its median, or the noise floor, length^2."""
        freedom = np.maximum(self.sums.freedom[:, -1], 1.0)
        # The median of a chi square variable over its mean (Wilson and Hilferty).
        of_mean = (1.0 - 2.0 / (9.0 * freedom)) ** 3
        return max(float(np.median(self.sums.residuals[:, -1] / freedom / of_mean)), self.noise_floor)

    @cached_property
    def first(self) -> IntArray:
        """The first neighbourhoods, up to `COMPARISON_SAMPLE_SIZE`: T numbers below N."""
        return np.arange(min(COMPARISON_SAMPLE_SIZE, len(self.rows)), dtype=np.int32)

    @cached_property
    def first_points(self) -> FloatArray:
        """Parameters x, y of the first neighbourhoods in units of the radius, (T, n, 2); 0 beyond `sizes`."""
        return self.parameters(self.first)

    @cached_property
    def first_designs(self) -> FloatArray:
        """Values of the terms at the points of the first neighbourhoods, (T, n, M); 0 beyond `sizes`."""
        return self.designs(self.first)

    def parameters(self, numbers: IntArray) -> FloatArray:
        """Parameters x, y of k neighbourhoods in units of the radius, (k, n, 2); 0 beyond `sizes`."""
        return self.points[self.rows[numbers], :, :2] * (self._present(numbers) / self.radius)[..., np.newaxis]

    def designs(self, numbers: IntArray) -> FloatArray:
        """Values of the terms at the points of k neighbourhoods, (k, n, M); 0 beyond `sizes`."""
        return term_values(*np.moveaxis(self.parameters(numbers), 2, 0)) * self._present(numbers)[..., np.newaxis]

    def quadratics(self, numbers: IntArray) -> tuple[FloatArray, FloatArray]:
        """Points of k neighbourhoods on quadratic fits, (k, n, 3) in units of the radius, and their steepness.

        Narrow neighbourhoods are stretched, see `_equalize_widths`. The terms are 1, x, y, x^2 - y^2, 2 x y and
        x^2 + y^2, the first ones of `designs`. The steepness (k, n) is 1 / cos of the slope: the ratio of the noise of
        the heights to the noise along the normal.
        """
        parameters, present = self.parameters(numbers), self._present(numbers)
        x, y = np.moveaxis(parameters, 2, 0)
        xx, yy = x * x, y * y
        design = np.stack([present.astype(np.float64), x, y, xx - yy, 2.0 * (x * y), xx + yy], axis=-1)
        heights = self.points[self.rows[numbers], :, 2:] * (present / self.radius)[..., np.newaxis]
        transposed = design.transpose(0, 2, 1)
        inner, places = transposed @ design, np.arange(design.shape[2])
        inner[:, places, places] += QUADRATIC_RIDGE * inner[:, places, places].max(axis=1, keepdims=True)
        a = np.linalg.solve(inner, transposed @ heights)
        slope_x = a[:, 1] + 2.0 * ((a[:, 5] + a[:, 3]) * x + a[:, 4] * y)
        slope_y = a[:, 2] + 2.0 * ((a[:, 5] - a[:, 3]) * y + a[:, 4] * x)
        points = np.concatenate([_equalize_widths(parameters), design @ a], axis=2)
        return points, np.sqrt(1.0 + slope_x**2 + slope_y**2)

    @cached_property
    def noise_sample_quadratics(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """The first neighbourhoods, up to `NOISE_SAMPLE_SIZE`, with their `quadratics`; no steepness beyond `sizes`."""
        numbers: IntArray = np.arange(min(NOISE_SAMPLE_SIZE, len(self.rows)), dtype=np.int32)
        points, steepness = self.quadratics(numbers)
        return numbers, points, steepness * self._present(numbers)

    @cached_property
    def mean_square_steepness(self) -> float:
        """Mean square of the steepness over the points of `noise_sample_quadratics`."""
        numbers, _, steepness = self.noise_sample_quadratics
        return float(np.square(steepness).sum() / self.sizes[numbers].sum())

    @cached_property
    def noise_sample(self) -> FittedPoints:
        """The orthonormal terms at the points of `noise_sample_quadratics`."""
        numbers, points, steepness = self.noise_sample_quadratics
        m = self.sums.scores.shape[1]
        factors = self.factors[self.rows[numbers], :, :m]
        diagonal = np.einsum("kii->ki", factors)
        seen = diagonal > 0.0
        diagonal[~seen] = 1.0
        to_terms = np.linalg.inv(factors) * seen[:, np.newaxis]
        return FittedPoints(points, steepness, self.designs(numbers)[..., :m] @ to_terms, to_terms)

    def _present(self, numbers: IntArray) -> BoolArray:
        return np.arange(self.points.shape[1]) < self.sizes[numbers, np.newaxis]

    @cached_property
    def first_grams(self) -> FloatArray:
        """Inner products of m terms with all terms over the points of the first neighbourhoods, (T, m, M)."""
        factors = self.factors[self.rows[self.first]]
        return factors[..., : factors.shape[1]].transpose(0, 2, 1) @ factors

    @cached_property
    def rest_profile(self) -> FloatArray:
        """Mean square of the variation beyond all terms at the first points, relative to its mean, (T, n).

        It grows outwards as r^(2 J + 2), like the terms of degree J + 1.
        """
        profile = np.square(self.first_points).sum(axis=2) ** (self.degree + 1)
        result: FloatArray = profile * self.sizes[self.first, np.newaxis] / profile.sum(axis=1, keepdims=True)
        return result

    @cached_property
    def rest_grams(self) -> FloatArray:
        """Inner products of all terms over the first points with weights `rest_profile`, (T, M, M)."""
        design = self.first_designs
        return design.transpose(0, 2, 1) @ (design * self.rest_profile[..., np.newaxis])

    @cached_property
    def energies(self) -> FloatArray:
        """Mean squared diagonal of the first factors, (m,): the information of the points on each term."""
        terms = np.arange(self.sums.scores.shape[1])
        result: FloatArray = np.square(self.factors[self.rows[self.first]][:, terms, terms]).mean(axis=0)
        return result


def analyse_rings(
    sample: NeighbourhoodSample, most: Mapping[int, int], *, vertex_count: int, noise_floor: float = 0.0
) -> list[RingAnalysis]:
    """Analyse up to most[k] of the usable k-rings of a sample, for every k for which enough of them are usable."""
    prepared = (_prepare(sample, rings, count, vertex_count, noise_floor) for rings, count in most.items())
    analyses = [analysis for analysis in prepared if analysis is not None]
    chunks = [
        (analysis, start, min(start + ANALYSIS_CHUNK, len(analysis.rows)))
        for analysis in analyses
        for start in range(0, len(analysis.rows), ANALYSIS_CHUNK)
    ]

    basis = harmonic_basis()

    def make_task() -> RangeTask:
        work = ring_workspace(max(analysis.points.shape[1] for analysis in analyses))

        @np.errstate(all="ignore")  # lanes without a neighbourhood; compiled code does not warn
        def run(start: int, stop: int) -> None:
            for analysis, first, last in chunks[start:stop]:
                analyse_in_lanes(
                    analysis.points,
                    analysis.sizes,
                    1.0 / analysis.radius,
                    basis.degrees,
                    basis.groups,
                    _ROW_STARTS,
                    work,
                    first,
                    last,
                    analysis.factors,
                    analysis.sums,
                )

        return run

    if chunks:
        run_in_chunks(make_task, len(chunks), chunk=1)
    return analyses


def term_values(x: FloatArray, y: FloatArray, degree: int = HIGHEST_DEGREE) -> FloatArray:
    """Values of the terms of `harmonic_basis` up to a degree at points of any shape (...), (..., M)."""
    exponents = total_degree_space(degree).exponents
    powers_x, powers_y = (polyvander(axis, degree) for axis in (x, y))
    monomials = powers_x[..., exponents[:, 0]] * powers_y[..., exponents[:, 1]]
    return monomials @ harmonic_basis().monomials[: len(exponents), : len(exponents)]


def _prepare(
    sample: NeighbourhoodSample, rings: int, most: int, vertex_count: int, noise_floor: float
) -> RingAnalysis | None:
    """Allocate an analysis; None if too few neighbourhoods are usable."""
    rows = np.flatnonzero(sample.usable[:, rings])[:most]
    if len(rows) < MIN_SAMPLES:
        return None
    basis = harmonic_basis()
    degree = _highest_degree(float(np.percentile(sample.sizes[rows, rings], 20)))
    m = basis.term_count(degree)
    rows = rows[sample.sizes[rows, rings] > m]
    if len(rows) < MIN_SAMPLES:
        return None
    sizes = sample.sizes[rows, rings]
    points = sample.points[rows, : sizes.max()]
    present = np.arange(points.shape[1]) < sizes[:, np.newaxis]
    x, y, z = np.moveaxis(points, 2, 0)
    flat = (x * x + y * y) * present
    radius = float(np.median(np.sqrt(flat.max(axis=1))))
    if not radius > 0.0:
        return None
    by_degree = (len(rows), degree + 1)
    by_group = (*by_degree, int(basis.groups[m - 1]) + 1)
    return RingAnalysis(
        rings,
        radius,
        degree,
        vertex_count,
        noise_floor,
        # Neighbourhoods that overlap by half are still nearly as informative as separate ones.
        min(1.0, 2.0 * vertex_count / float(sizes.sum())),
        sample.centers[rows],
        sizes,
        np.sqrt((flat + z * z * present).max(axis=1)),
        np.arange(len(rows), dtype=np.int32),
        points,
        np.zeros((len(rows), m, len(basis.degrees))),
        RingSums(
            np.zeros((len(rows), m)),
            np.zeros((len(rows), len(basis.degrees))),
            *(np.zeros(by_degree) for _ in range(2)),
            *(np.zeros(by_group) for _ in range(3)),
        ),
    )


def _equalize_widths(parameters: FloatArray) -> FloatArray:
    """Stretch the parameters (k, n, 2) of k neighbourhoods to equal widths in all directions, at the same mean square.

    A scanner blurs over a fixed number of samples, so the noise is isotropic in edges: a surface seen from the side has
    longer edges in one direction.
    """
    values, axes = np.linalg.eigh(parameters.transpose(0, 2, 1) @ parameters)
    values = np.maximum(values, MIN_MOMENT_RATIO * values[:, 1:])
    stretches = np.sqrt(values.mean(axis=1, keepdims=True) / values)
    result: FloatArray = parameters @ (axes * stretches[:, np.newaxis] @ axes.transpose(0, 2, 1))
    return result


def _highest_degree(points: float) -> int:
    degree = FREE_DEGREE
    while degree < HIGHEST_DEGREE and MIN_POINTS_PER_COEFFICIENT * (degree + 2) * (degree + 3) / 2 <= points:
        degree += 1
    return degree
