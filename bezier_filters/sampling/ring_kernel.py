"""Kernel of the ring analysis: residuals and coefficients of the fits of every degree, in SIMD lanes (see `lanes`).

The Gram matrix of the terms and the heights over the points of a neighbourhood is accumulated and factorised by
Cholesky's method; eight neighbourhoods are processed together.
"""

from typing import NamedTuple

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.kernels.lane_algebra import UNROLL_FACTOR, add_moments, factorise_lanes, substitute_back
from bezier_filters.patches.harmonics import HIGHEST_DEGREE
from bezier_filters.runtime.jit import inner_jit, jit, opaque
from bezier_filters.runtime.lanes import LANES, broadcast, lane_array, load, multiply_add, store, where_greater

# relative length of a column orthogonal to the columns before it, below which the points do not determine the term
RANK_TOLERANCE = 3e-5
POINTS_PER_BLOCK = 16  # points whose terms are held at a time


class RingSums(NamedTuple):
    """Results for N neighbourhoods, a row for each; see `RingAnalysis` for the other letters."""

    scores: FloatArray  # (N, m): Q^T z, the components of the heights along the orthonormal terms, a length
    unexplained: FloatArray  # (N, M): squared length of each column of A orthogonal to the terms up to J; 0 for these
    residuals: FloatArray  # (N, J + 1): squared residual of the fit of each degree, length^2,
    freedom: FloatArray  # (N, J + 1): and its degrees of freedom
    # (N, J + 1, G): for the fit of each degree and each group, sums over its terms
    term_squares: FloatArray  # of w a^2, with the coefficient a, a length, and its variance 1 / w under unit noise,
    term_weights: FloatArray  # of w, and
    term_counts: FloatArray  # of 1, for terms that the points determine


class RingWorkspace(NamedTuple):
    """Scratch arrays for one block, flat arrays of lanes."""

    points: FloatArray  # table with rows x, y, height, presence
    terms: FloatArray  # table of the terms, and of the heights as a last row
    gram: FloatArray  # lower triangle of the terms and the heights; then the factor
    coefficients: FloatArray
    column: FloatArray  # of the inverse factor
    variances: FloatArray  # of the coefficients under unit noise
    squared_residual: FloatArray  # (1): squared residual
    full_rank: FloatArray  # (1)
    sums: FloatArray  # (3 G): squares, weights and counts by group, of one degree


def ring_workspace(most: int) -> RingWorkspace:
    """Scratch arrays for neighbourhoods of up to `most` points."""
    terms = (HIGHEST_DEGREE + 1) * (HIGHEST_DEGREE + 2) // 2
    return RingWorkspace(
        lane_array(4 * most),
        lane_array((terms + 1 + UNROLL_FACTOR) * POINTS_PER_BLOCK),
        lane_array((terms + 1 + UNROLL_FACTOR) * (terms + 2 + UNROLL_FACTOR) // 2),
        lane_array(terms),
        lane_array(terms),
        lane_array(terms),
        lane_array(1),
        lane_array(1),
        lane_array(3 * terms),
    )


@jit()
def analyse_in_lanes(
    points: FloatArray,
    sizes: IntArray,
    scale: float,
    degrees: IntArray,
    groups: IntArray,
    row_starts: IntArray,
    work: RingWorkspace,
    start: int,
    stop: int,
    factors: FloatArray,
    sums: RingSums,
) -> None:
    """Fill rows start .. stop-1 of `factors` and `sums`.

    `points`, `sizes` and the results belong to `RingAnalysis`, with x and y not yet scaled; `degrees` and `groups`
    belong to `harmonic_basis`; `row_starts` are the starts of the rows of a lower triangle.
    """
    terms, m = degrees.shape[0], sums.scores.shape[1]
    highest, stride = degrees[m - 1], points.shape[1]
    for first in range(start, stop, LANES):
        count = opaque(0)
        for lane in range(LANES):
            row = first + lane
            n = sizes[row] if row < stop else 0
            count = max(count, n)
            _gather(points, row, n, scale, stride, lane, work.points)
        for k in range(row_starts[terms + 1]):
            store(work.gram, k, broadcast(0.0))
        for begin in range(0, count, POINTS_PER_BLOCK):
            here = min(POINTS_PER_BLOCK, count - begin)
            _write_terms(work, stride, begin, here, degrees[terms - 1])
            add_moments(work.terms, work.terms, opaque(POINTS_PER_BLOCK), here, row_starts, work.gram)
        for s in range(m, terms):  # squared lengths of the terms beyond J, before the factorisation overwrites them
            store(work.coefficients, s, load(work.gram, row_starts[s] + s))
        factorise_lanes(work.gram, terms + 1, m, RANK_TOLERANCE * RANK_TOLERANCE, work.full_rank)
        substitute_back(work.gram, m, terms, work.coefficients)
        _sum_squared_residuals(work, stride, count, m, highest)
        for lane in range(min(LANES, stop - first)):
            _write_row(work, lane, first + lane, sizes[first + lane], degrees, row_starts, sums)
            _write_factors(work, lane, row_starts, factors[first + lane])
        _write_coefficients(work, degrees, groups, row_starts, first, min(LANES, stop - first), sums)


@inner_jit()
def _gather(points: FloatArray, row: int, count: int, scale: float, stride: int, lane: int, table: FloatArray) -> None:
    """Write the points of a neighbourhood to its lane, padded with absent points."""
    step = LANES * stride
    for p in range(stride):
        place = LANES * p + lane
        present = p < count
        table[place] = points[row, p, 0] * scale if present else 0.0
        table[place + step] = points[row, p, 1] * scale if present else 0.0
        table[place + 2 * step] = points[row, p, 2] if present else 0.0
        table[place + 3 * step] = 1.0 if present else 0.0


@inner_jit()
def _write_terms(work: RingWorkspace, stride: int, begin: int, count: int, highest: int) -> None:
    """Write r^j cos(l phi) and r^j sin(l phi) of some points, and their heights after the last term."""
    terms = work.terms
    last = (highest + 1) * (highest + 2) // 2
    for p in range(count):
        q = begin + p
        x, y = load(work.points, q), load(work.points, stride + q)
        square = multiply_add(x, x, y * y)
        cosine, sine = load(work.points, 3 * stride + q), broadcast(0.0)
        store(terms, p, cosine)
        for j in range(1, highest + 1):
            here, before = j * (j + 1) // 2, (j - 2) * (j - 1) // 2
            cosine, sine = x * cosine - y * sine, multiply_add(x, sine, y * cosine)
            store(terms, here * POINTS_PER_BLOCK + p, cosine)
            store(terms, (here + 1) * POINTS_PER_BLOCK + p, sine)
            for k in range(j - 1):  # terms of lower frequency are r^2 times the terms of degree j - 2
                store(
                    terms,
                    (here + 2 + k) * POINTS_PER_BLOCK + p,
                    square * load(terms, (before + k) * POINTS_PER_BLOCK + p),
                )
        store(terms, last * POINTS_PER_BLOCK + p, load(work.points, 2 * stride + q))


@inner_jit()
def _sum_squared_residuals(work: RingWorkspace, stride: int, count: int, m: int, highest: int) -> None:
    """Sum up the squared residuals of the fit of the highest degree, from the points: no digits cancel."""
    total = broadcast(0.0)
    height = m * POINTS_PER_BLOCK
    for begin in range(0, count, POINTS_PER_BLOCK):
        here = min(POINTS_PER_BLOCK, count - begin)
        _write_terms(work, stride, begin, here, highest)
        for p in range(here):
            difference = load(work.terms, height + p)
            for t in range(m):
                difference = difference - load(work.coefficients, t) * load(work.terms, t * POINTS_PER_BLOCK + p)
            total = multiply_add(difference, difference, total)
    store(work.squared_residual, 0, total)


@inner_jit()
def _write_factors(work: RingWorkspace, lane: int, row_starts: IntArray, factors: FloatArray) -> None:
    """Write the factor of one lane."""
    m, terms = factors.shape
    for t in range(m):
        reciprocal = work.gram[LANES * (row_starts[t] + t) + lane]
        factors[t, t] = 1.0 / reciprocal if reciprocal > 0.0 else 0.0
        for s in range(t + 1, terms):
            factors[t, s] = work.gram[LANES * (row_starts[s] + t) + lane]


@inner_jit()
def _write_row(
    work: RingWorkspace, lane: int, row: int, size: int, degrees: IntArray, row_starts: IntArray, sums: RingSums
) -> None:
    """Write scores, residuals and unexplained squares of one lane."""
    terms, m, highest = degrees.shape[0], sums.scores.shape[1], sums.residuals.shape[1] - 1
    for d in range(highest + 1):
        sums.residuals[row, d] = work.squared_residual[lane]
        sums.freedom[row, d] = size
    for t in range(m):
        reciprocal = work.gram[LANES * (row_starts[t] + t) + lane]
        part = work.gram[LANES * (row_starts[terms] + t) + lane]
        sums.scores[row, t] = part
        for d in range(highest + 1):
            if degrees[t] > d:  # fits of lower degree do not remove this score
                sums.residuals[row, d] += part * part
            elif reciprocal > 0.0:
                sums.freedom[row, d] -= 1.0
    for s in range(m, terms):
        unexplained = work.coefficients[LANES * s + lane]
        for t in range(m):
            unexplained -= work.gram[LANES * (row_starts[s] + t) + lane] ** 2
        sums.unexplained[row, s] = max(unexplained, 0.0)


@inner_jit()
def _write_coefficients(
    work: RingWorkspace,
    degrees: IntArray,
    groups: IntArray,
    row_starts: IntArray,
    first: int,
    count: int,
    sums: RingSums,
) -> None:
    """Sum up the coefficients of the fits of each degree: the inverse factor, column by column, times the scores."""
    terms, m, all_groups = len(degrees), sums.scores.shape[1], sums.term_squares.shape[2]
    zero, one = broadcast(0.0), broadcast(1.0)
    gram, column = work.gram, work.column
    for t in range(m):
        store(work.coefficients, t, zero)
        store(work.variances, t, zero)
    for c in range(m):
        part = load(gram, row_starts[terms] + c)
        store(column, c, load(gram, row_starts[c] + c))
        for r in range(c - 1, -1, -1):
            total = zero
            for t in range(r + 1, c + 1):
                total = multiply_add(load(gram, row_starts[t] + r), load(column, t), total)
            store(column, r, zero - total * load(gram, row_starts[r] + r))
        for r in range(c + 1):
            entry = load(column, r)
            store(work.coefficients, r, multiply_add(entry, part, load(work.coefficients, r)))
            store(work.variances, r, multiply_add(entry, entry, load(work.variances, r)))
        if c + 1 < m and degrees[c + 1] == degrees[c]:
            continue
        for k in range(3 * all_groups):
            store(work.sums, k, zero)
        for r in range(c + 1):
            seen = load(gram, row_starts[r] + r)
            weight = where_greater(seen, zero, one / load(work.variances, r), zero)
            value, place = load(work.coefficients, r), 3 * groups[r]
            store(work.sums, place, multiply_add(weight, value * value, load(work.sums, place)))
            store(work.sums, place + 1, load(work.sums, place + 1) + weight)
            store(work.sums, place + 2, load(work.sums, place + 2) + where_greater(seen, zero, one, zero))
        for lane in range(count):
            for g in range(groups[c] + 1):
                place = LANES * 3 * g + lane
                sums.term_squares[first + lane, degrees[c], g] = work.sums[place]
                sums.term_weights[first + lane, degrees[c], g] = work.sums[place + LANES]
                sums.term_counts[first + lane, degrees[c], g] = work.sums[place + 2 * LANES]
