"""Dense algebra for eight neighbourhoods at a time: powers, moments, normal equations, derivatives.

Arrays are flat arrays of lanes (see `lanes`); a table with rows of `stride` lanes has entry (k, p)
at k stride + p. Loops are unrolled into four independent sums, so that additions do not wait for each other.
"""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.runtime.jit import inner_jit
from bezier_filters.runtime.lanes import Lanes, broadcast, load, multiply_add, square_root, store, where_greater

UNROLL_FACTOR = 4  # number of independent sums; tables are padded by this many rows or points


@inner_jit()
def raise_powers(table: FloatArray, stride: int, count: int, highest: int) -> None:
    """Fill rows k = 1 .. highest of a table with row 0 times the k-th power of row 1."""
    for p in range(count):
        base = load(table, stride + p)
        power = load(table, p)
        for k in range(1, highest + 1):
            power = power * base
            store(table, k * stride + p, power)


@inner_jit()
def add_moments(
    left: FloatArray, right: FloatArray, stride: int, count: int, starts: IntArray, sums: FloatArray
) -> None:
    """Add the products of row a of one table and row b of another, summed over points, for many (a, b).

    Row a of the left table is paired with rows b = 0 .. starts[a + 1] - starts[a] - 1 of the right one. Their product,
    summed over the first `count` of `stride` lanes, is added to entry starts[a] + b. The right table is padded by
    `UNROLL_FACTOR` - 1 rows of any content, and `sums` by as many entries.
    """
    rows = starts.shape[0] - 1
    # Blocks of two rows and four columns: their eight sums stay in registers over all points.
    for a in range(0, rows, 2):
        row, stop, stop_of_next = a * stride, starts[a + 1], starts[min(a + 2, rows)]
        for b in range(0, max(stop - starts[a], stop_of_next - stop), UNROLL_FACTOR):
            k, next_k, other = starts[a] + b, stop + b, b * stride
            s0, s1, s2, s3 = load(sums, k), load(sums, k + 1), load(sums, k + 2), load(sums, k + 3)
            if next_k < stop_of_next:
                t0, t1, t2, t3 = (
                    load(sums, next_k),
                    load(sums, next_k + 1),
                    load(sums, next_k + 2),
                    load(sums, next_k + 3),
                )
                for p in range(count):
                    f, g = load(left, row + p), load(left, row + stride + p)
                    x0, x1 = load(right, other + p), load(right, other + stride + p)
                    x2, x3 = load(right, other + 2 * stride + p), load(right, other + 3 * stride + p)
                    s0, t0 = multiply_add(f, x0, s0), multiply_add(g, x0, t0)
                    s1, t1 = multiply_add(f, x1, s1), multiply_add(g, x1, t1)
                    s2, t2 = multiply_add(f, x2, s2), multiply_add(g, x2, t2)
                    s3, t3 = multiply_add(f, x3, s3), multiply_add(g, x3, t3)
                _store_group(sums, next_k, stop_of_next, t0, t1, t2, t3)
            else:
                for p in range(count):
                    f = load(left, row + p)
                    s0 = multiply_add(f, load(right, other + p), s0)
                    s1 = multiply_add(f, load(right, other + stride + p), s1)
                    s2 = multiply_add(f, load(right, other + 2 * stride + p), s2)
                    s3 = multiply_add(f, load(right, other + 3 * stride + p), s3)
            _store_group(sums, k, stop, s0, s1, s2, s3)


@inner_jit()
def _store_group(sums: FloatArray, k: int, stop: int, s0: Lanes, s1: Lanes, s2: Lanes, s3: Lanes) -> None:
    """Write up to four sums to entries k .. stop-1."""
    if k < stop:
        store(sums, k, s0)
    if k + 1 < stop:
        store(sums, k + 1, s1)
    if k + 2 < stop:
        store(sums, k + 2, s2)
    if k + 3 < stop:
        store(sums, k + 3, s3)


@inner_jit()
def factorise_lanes(
    matrix: FloatArray, rows: int, columns: int, smallest_pivot: float, is_full_rank: FloatArray
) -> None:
    """Cholesky factors of eight symmetric positive semidefinite matrices, or of their first columns.

    `matrix` is the packed lower triangle, row by row; it may have further rows, such as right-hand sides, and is padded
    by `UNROLL_FACTOR` rows of any content. Its first `columns` are replaced by those of the factor, with reciprocal
    diagonal. A column whose pivot is below the fraction `smallest_pivot` of its diagonal entry is linearly dependent
    and set to 0. The one entry of `is_full_rank` becomes 1 for matrices without such columns, else 0.
    """
    zero, one = broadcast(0.0), broadcast(1.0)
    full_rank = one
    # Two columns at a time: every entry of the rows below, once loaded, serves both sums.
    if columns % 2 == 1:  # the first alone, then pairs
        before = load(matrix, 0)
        scale = where_greater(before, broadcast(smallest_pivot) * before, one / square_root(before), zero)
        full_rank = where_greater(scale, zero, one, zero)
        store(matrix, 0, scale)
        for i in range(1, rows):
            store(matrix, i * (i + 1) // 2, load(matrix, i * (i + 1) // 2) * scale)
    for j in range(columns % 2, columns, 2):
        row_j = j * (j + 1) // 2
        row_l = row_j + j + 1
        least_j, least_l = (
            broadcast(smallest_pivot) * load(matrix, row_j + j),
            broadcast(smallest_pivot) * load(matrix, row_l + j + 1),
        )
        scale_j, across, scale_l = one, zero, one
        for i in range(j, rows, UNROLL_FACTOR):
            r0 = i * (i + 1) // 2
            r1, r2, r3 = r0 + i + 1, r0 + 2 * i + 3, r0 + 3 * i + 6
            s0, s1, s2, s3 = zero, zero, zero, zero
            t0, t1, t2, t3 = zero, zero, zero, zero
            for k in range(j):
                of_j, of_l = load(matrix, row_j + k), load(matrix, row_l + k)
                x0, x1, x2, x3 = load(matrix, r0 + k), load(matrix, r1 + k), load(matrix, r2 + k), load(matrix, r3 + k)
                s0, t0 = multiply_add(of_j, x0, s0), multiply_add(of_l, x0, t0)
                s1, t1 = multiply_add(of_j, x1, s1), multiply_add(of_l, x1, t1)
                s2, t2 = multiply_add(of_j, x2, s2), multiply_add(of_l, x2, t2)
                s3, t3 = multiply_add(of_j, x3, s3), multiply_add(of_l, x3, t3)
            if i == j:
                pivot = load(matrix, row_j + j) - s0
                full_rank = where_greater(pivot, least_j, full_rank, zero)
                scale_j = where_greater(pivot, least_j, one / square_root(pivot), zero)
                across = (load(matrix, row_l + j) - s1) * scale_j
                pivot = load(matrix, row_l + j + 1) - t1 - across * across
                full_rank = where_greater(pivot, least_l, full_rank, zero)
                scale_l = where_greater(pivot, least_l, one / square_root(pivot), zero)
                store(matrix, row_j + j, scale_j)
                store(matrix, row_l + j, across)
                store(matrix, row_l + j + 1, scale_l)
            else:
                _eliminate(matrix, r0 + j, s0, t0, scale_j, across, scale_l)
                if i + 1 < rows:
                    _eliminate(matrix, r1 + j, s1, t1, scale_j, across, scale_l)
            if i + 2 < rows:
                _eliminate(matrix, r2 + j, s2, t2, scale_j, across, scale_l)
            if i + 3 < rows:
                _eliminate(matrix, r3 + j, s3, t3, scale_j, across, scale_l)
    store(is_full_rank, 0, full_rank)


@inner_jit()
def _eliminate(
    matrix: FloatArray, place: int, s: Lanes, t: Lanes, scale_j: Lanes, across: Lanes, scale_l: Lanes
) -> None:
    """Replace two entries from `place` on by those of the factor; s and t are products with earlier columns."""
    x = (load(matrix, place) - s) * scale_j
    store(matrix, place, x)
    store(matrix, place + 1, (load(matrix, place + 1) - t - x * across) * scale_l)


@inner_jit()
def substitute_back(factors: FloatArray, order: int, last: int, solution: FloatArray) -> None:
    """Solve L^T x = b for factors from `factorise_lanes`, with b in row `last`; x is 0 where a column of L is 0."""
    for i in range(order):
        store(solution, i, load(factors, last * (last + 1) // 2 + i))
    for i in range(order - 1, -1, -1):
        row = i * (i + 1) // 2
        found = load(solution, i) * load(factors, row + i)
        store(solution, i, found)
        for k in range(i):
            store(solution, k, load(solution, k) - load(factors, row + k) * found)


@inner_jit()
def substitute_forward(factors: FloatArray, order: int, last: int, first: int) -> None:
    """Solve L y = b for factors from `factorise_lanes`, with b in row `last`, which y replaces.

    Entries of b before `first` are 0 and are not read.
    """
    b = last * (last + 1) // 2
    for i in range(first, order):
        row, total = i * (i + 1) // 2, load(factors, b + i)
        for k in range(first, i):
            total = total - load(factors, row + k) * load(factors, b + k)
        store(factors, b + i, total * load(factors, row + i))


@inner_jit()
def add_squared_residuals(
    coefficients: FloatArray,
    starts: IntArray,
    points: FloatArray,
    stride: int,
    count: int,
    total: FloatArray,
    residuals: FloatArray | None,
) -> None:
    """Add the squared differences between a polynomial and heights to the one entry of `total`, by Horner's scheme.

    The coefficient of s^a t^b is entry starts[a] + b. `points` is a table with rows s, t, height and a factor of the
    difference, 0 for padding; up to `UNROLL_FACTOR` - 1 more than `count` of `stride` lanes are read. `residuals`, if
    given, receives the differences, and zeros for padding.
    """
    zero = broadcast(0.0)
    total0, total1, total2, total3 = load(total, 0), zero, zero, zero
    for p in range(0, count, UNROLL_FACTOR):
        s0, s1, s2, s3 = load(points, p), load(points, p + 1), load(points, p + 2), load(points, p + 3)
        q = stride + p
        t0, t1, t2, t3 = load(points, q), load(points, q + 1), load(points, q + 2), load(points, q + 3)
        v0, v1, v2, v3 = zero, zero, zero, zero
        for a in range(starts.shape[0] - 2, -1, -1):
            h0, h1, h2, h3 = zero, zero, zero, zero
            for k in range(starts[a + 1] - 1, starts[a] - 1, -1):
                c = load(coefficients, k)
                h0 = multiply_add(h0, t0, c)
                h1 = multiply_add(h1, t1, c)
                h2 = multiply_add(h2, t2, c)
                h3 = multiply_add(h3, t3, c)
            v0 = multiply_add(v0, s0, h0)
            v1 = multiply_add(v1, s1, h1)
            v2 = multiply_add(v2, s2, h2)
            v3 = multiply_add(v3, s3, h3)
        z, here = q + stride, q + 2 * stride
        v0 = (v0 - load(points, z)) * load(points, here)
        v1 = (v1 - load(points, z + 1)) * load(points, here + 1)
        v2 = (v2 - load(points, z + 2)) * load(points, here + 2)
        v3 = (v3 - load(points, z + 3)) * load(points, here + 3)
        total0 = multiply_add(v0, v0, total0)
        total1 = multiply_add(v1, v1, total1)
        total2 = multiply_add(v2, v2, total2)
        total3 = multiply_add(v3, v3, total3)
        if residuals is not None:
            store(residuals, p, v0)
            store(residuals, p + 1, v1)
            store(residuals, p + 2, v2)
            store(residuals, p + 3, v3)
    store(total, 0, (total0 + total1) + (total2 + total3))


@inner_jit()
def differentiate(coefficients: FloatArray, starts: IntArray, where: FloatArray, jets: FloatArray) -> None:
    """Partial derivatives of a polynomial, entry 4 r + q of `jets`: r times by s and q times by t, r + q <= 3.

    The coefficient of s^a t^b is entry starts[a] + b, and `where` has the two entries s and t. Horner's scheme with
    derivatives (Knuth, "The art of computer programming", vol. 2, 4.6.4): d_q is that of order q by t, over q!, and
    s_rq that of order r of it by s, over r!.
    """
    zero, s, t = broadcast(0.0), load(where, 0), load(where, 1)
    s00, s01, s02, s03, s10, s11, s12, s20, s21, s30 = zero, zero, zero, zero, zero, zero, zero, zero, zero, zero
    for a in range(starts.shape[0] - 2, -1, -1):
        d0, d1, d2, d3 = zero, zero, zero, zero
        for k in range(starts[a + 1] - 1, starts[a] - 1, -1):
            d3, d2, d1 = multiply_add(d3, t, d2), multiply_add(d2, t, d1), multiply_add(d1, t, d0)
            d0 = multiply_add(d0, t, load(coefficients, k))
        s30, s20, s10 = multiply_add(s30, s, s20), multiply_add(s20, s, s10), multiply_add(s10, s, s00)
        s21, s11, s12 = multiply_add(s21, s, s11), multiply_add(s11, s, s01), multiply_add(s12, s, s02)
        s00, s01 = multiply_add(s00, s, d0), multiply_add(s01, s, d1)
        s02, s03 = multiply_add(s02, s, d2), multiply_add(s03, s, d3)
    two, six = broadcast(2.0), broadcast(6.0)
    store(jets, 0, s00)
    store(jets, 1, s01)
    store(jets, 2, two * s02)
    store(jets, 3, six * s03)
    store(jets, 4, s10)
    store(jets, 5, s11)
    store(jets, 6, two * s12)
    store(jets, 8, two * s20)
    store(jets, 9, two * s21)
    store(jets, 12, six * s30)


@inner_jit()
def sort_lanes(values: FloatArray, count: int) -> None:
    """Sort the first `count` entries of each of the eight sequences in ascending order.

    A sorting network, whose exchanges do not depend on the values: Batcher's merge exchange (Knuth, "The art of
    computer programming", vol. 3, 5.2.2, algorithm M).
    """
    largest = 1
    while 2 * largest < count:
        largest *= 2
    p = largest
    while p > 0:
        q, r, d = largest, 0, p
        while True:
            for i in range(count - d):
                if i & p == r:
                    a, b = load(values, i), load(values, i + d)
                    store(values, i, where_greater(a, b, b, a))
                    store(values, i + d, where_greater(a, b, a, b))
            if q == p:
                break
            q, r, d = q // 2, p, q - p
        p //= 2


@inner_jit()
def condition_numbers(factors: FloatArray, order: int, column: FloatArray, result: FloatArray) -> None:
    """Condition numbers of eight systems, one entry, from the factors of `factorise_lanes`.

    The normal equations of a fit have the matrix G = L L^T. With the columns of the stacked system scaled to unit
    length, as if D = diag(G) were the identity, its condition number in the Frobenius norm is

        kappa = |D^(-1/2) L|_F |L^(-1) D^(1/2)|_F = sqrt(m sum_ij (L^-1)_ij^2 D_j),

    which is at least the one in the spectral norm and at most m times it (Demmel, "Applied Numerical Linear
    Algebra", 1997, section 3.5: scaling the columns is optimal up to a factor of sqrt(m)). The relative error of
    the coefficients is a small multiple of kappa^2 times the unit roundoff. kappa is m, the order, or more.
    `column` is scratch of `order` entries.
    """
    total = broadcast(0.0)
    for j in range(order):
        row = j * (j + 1) // 2
        reciprocal = load(factors, row + j)
        diagonal = broadcast(1.0) / (reciprocal * reciprocal)
        for k in range(j):
            diagonal = multiply_add(load(factors, row + k), load(factors, row + k), diagonal)
        store(column, j, reciprocal)
        length = reciprocal * reciprocal
        for i in range(j + 1, order):
            below = i * (i + 1) // 2
            entry = broadcast(0.0)
            for k in range(j, i):
                entry = entry - load(factors, below + k) * load(column, k)
            entry = entry * load(factors, below + i)
            store(column, i, entry)
            length = multiply_add(entry, entry, length)
        total = multiply_add(length, diagonal, total)
    store(result, 0, square_root(broadcast(np.float64(order)) * total))
