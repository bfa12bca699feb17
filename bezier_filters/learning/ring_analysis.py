"""Sampled neighbourhoods, orthogonalised term by term: the data of an analysis of variance."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numba import config

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.learning.neighbourhood_samples import NeighbourhoodSample
from bezier_filters.learning.ring_lanes import RingSums, RingWorkspace, analyse_in_lanes, ring_workspace
from bezier_filters.learning.ring_reference import analyse_one_by_one, term_values
from bezier_filters.patches.harmonics import HIGHEST_DEGREE, harmonic_basis
from bezier_filters.runtime.lanes import LANES
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks

FREE_DEGREE = 2
"""Height, slope and curvature are what we are after: no prior touches them."""
FEWEST_SAMPLES = 12
FEWEST_POINTS_PER_COEFFICIENT = 1.2
FIRST = 8
"""Neighbourhoods by which plans are compared."""
FACTORED = 64
"""Neighbourhoods of a sample whose factors are kept: a part of the sample has some of them, as its order is random."""
CHUNK = 4 * LANES
"""Neighbourhoods per chunk."""
_ROW_STARTS = np.cumsum(np.arange(len(harmonic_basis().degrees) + 2)).astype(np.int32)


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
    sizes : (N,) int32
        Number of points.
    rows : (N,) int32
        Which rows of the next two arrays belong to these neighbourhoods, if they are part of a sample.
    points : (S, n, 3) float64
        Coordinates of the points, lengths; beyond `sizes`, anything.
    factors : (S', m, M) float64
        Of the first S' of those S neighbourhoods: Q^T A for their design matrices A, Q being
        orthonormal for the m terms; upper triangular in its first m columns. Rows of terms that the
        points do not see are 0.
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
    sizes: IntArray
    rows: IntArray
    points: FloatArray
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
        if kept.sum() < FEWEST_SAMPLES or not (self.rows[kept] < len(self.factors)).any():
            return None
        arrays: dict[str, Any] = {name: getattr(self, name)[kept] for name in _BY_ROW}
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
    def first(self) -> IntArray:
        """The first neighbourhoods, up to `FIRST` of those whose factors are known: T numbers below N."""
        result: IntArray = np.flatnonzero(self.rows < len(self.factors))[:FIRST].astype(np.int32)
        return result

    @cached_property
    def first_points(self) -> FloatArray:
        """Parameters x, y of the first neighbourhoods in units of the radius, (T, n, 2); 0 beyond `sizes`."""
        present = np.arange(self.points.shape[1]) < self.sizes[self.first, np.newaxis]
        result: FloatArray = self.points[self.rows[self.first], :, :2] * (present / self.radius)[..., np.newaxis]
        return result

    @cached_property
    def first_designs(self) -> FloatArray:
        """Values of the terms at the points of the first neighbourhoods, (T, n, M); 0 beyond `sizes`."""
        present = np.arange(self.points.shape[1]) < self.sizes[self.first, np.newaxis]
        result: FloatArray = term_values(*np.moveaxis(self.first_points, 2, 0)) * present[..., np.newaxis]
        return result

    @cached_property
    def first_grams(self) -> FloatArray:
        """Inner products of m and all terms over the points of the first neighbourhoods, (T, m, M)."""
        factors = self.factors[self.rows[self.first]]
        result: FloatArray = factors[..., : factors.shape[1]].transpose(0, 2, 1) @ factors
        return result

    @cached_property
    def rest_profile(self) -> FloatArray:
        """Mean square of what no term follows at the first points, over its mean, (T, n).

        It grows outwards like the first of those terms.
        """
        profile = np.square(self.first_points).sum(axis=2) ** (self.degree + 1)
        result: FloatArray = profile * self.sizes[self.first, np.newaxis] / profile.sum(axis=1, keepdims=True)
        return result

    @cached_property
    def rest_grams(self) -> FloatArray:
        """Inner products of all terms over the first points with that profile as a weight, (T, M, M)."""
        design = self.first_designs
        result: FloatArray = design.transpose(0, 2, 1) @ (design * self.rest_profile[..., np.newaxis])
        return result

    @cached_property
    def energies(self) -> FloatArray:
        """Mean squared diagonal of the first factors, (m,): what the points say of each term."""
        terms = np.arange(self.parts.shape[1])
        result: FloatArray = np.square(self.factors[self.rows[self.first]][:, terms, terms]).mean(axis=0)
        return result


_BY_ROW = (
    "centers",
    "sizes",
    "rows",
    "parts",
    "unexplained",
    "residuals",
    "freedom",
    "term_squares",
    "term_weights",
    "term_counts",
)


def analyse_rings(
    sample: NeighbourhoodSample, most: Mapping[int, int], *, vertex_count: int, threads: int = 1
) -> list[RingAnalysis]:
    """Analyse up to most[k] of the usable k-rings of a sample, for every k for which enough of them are usable."""
    prepared = (_prepare(sample, rings, count, vertex_count) for rings, count in most.items())
    analyses = [analysis for analysis in prepared if analysis is not None]
    chunks = [
        (analysis, start, min(start + CHUNK, len(analysis.rows)))
        for analysis in analyses
        for start in range(0, len(analysis.rows), CHUNK)
    ]

    def make_task() -> RangeTask:
        most_points = max((analysis.points.shape[1] for analysis in analyses), default=0)
        work = None if config.DISABLE_JIT else ring_workspace(most_points)  # type: ignore[attr-defined]

        def run(start: int, stop: int) -> None:
            for chunk in chunks[start:stop]:
                _analyse(*chunk, work)

        return run

    run_in_chunks(make_task, len(chunks), threads=threads, chunk=1)
    return analyses


def _analyse(analysis: RingAnalysis, start: int, stop: int, work: RingWorkspace | None) -> None:
    """Fill rows start .. stop-1 of an analysis."""
    sums = RingSums(*(getattr(analysis, name) for name in RingSums._fields))
    scale = 1.0 / analysis.radius
    if work is None:
        analyse_one_by_one(analysis.points, analysis.sizes, scale, start, stop, sums)
        return
    basis = harmonic_basis()
    analyse_in_lanes(
        analysis.points, analysis.sizes, scale, basis.degrees, basis.groups, _ROW_STARTS, work, start, stop, sums
    )


def _prepare(sample: NeighbourhoodSample, rings: int, most: int, vertex_count: int) -> RingAnalysis | None:
    """An analysis that is still to be filled; None if too few neighbourhoods are usable."""
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
    return RingAnalysis(
        rings,
        radius,
        degree,
        # Neighbourhoods that overlap by half still tell nearly as much as separate ones.
        min(1.0, 2.0 * vertex_count / float(sizes.sum())),
        sample.centers[rows],
        sizes,
        np.arange(len(rows), dtype=np.int32),
        points,
        np.zeros((min(len(rows), FACTORED), m, len(basis.degrees))),
        np.zeros((len(rows), m)),
        np.zeros((len(rows), len(basis.degrees))),
        *(np.zeros(by_degree) for _ in range(2)),
        *(np.zeros(by_group) for _ in range(3)),
    )


def _determined_degree(points: float) -> int:
    degree = FREE_DEGREE
    while degree < HIGHEST_DEGREE and FEWEST_POINTS_PER_COEFFICIENT * (degree + 2) * (degree + 3) / 2 <= points:
        degree += 1
    return degree
