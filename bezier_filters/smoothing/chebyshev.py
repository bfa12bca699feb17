"""Low-pass filters of a mesh as Chebyshev polynomials of a Laplacian.

The filter of order r and strength s is f(L) = 1 / (1 + (s L^4)^(r / 4)) of a Laplacian L. For a symmetric L and r = 4,
x = f(L) p minimises |x - p|^2 + s |L^2 x|^2. Filters of one strength have the same cut-off, L = s^(-1/4), and a steeper
transition for a higher order. A Chebyshev series in L takes a few dozen steps, each a mean over neighbours, and the
steps are the same for all strengths: the scale space of a mesh.

A filter f with f(0) = 1 removes p - f(L) p = g(L) (L p) with g(x) = (1 - f(x)) / x. So the
recurrence runs on the differences L p, which are as small as the noise: the error of single precision
is some millionths of the noise, and constants are preserved exactly. Four signals are filtered together; a
step reads every neighbour once and overwrites the last polynomial but one.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from bezier_filters.arrays import FloatArray, RealArray, SingleArray
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import MAX_CHUNK, run_kernel
from bezier_filters.runtime.rows import Row, add_scaled_row, load_row, scale_row, store_row, zero_row
from bezier_filters.smoothing.laplacian import Laplacian

SIGNALS_PER_PASS = 4  # signals that are filtered together
DEFAULT_ORDER = 4  # order r of the filters by default
LOWEST_ORDER = 2  # order of the least steep filters
# Number of terms of a series, over sqrt(bound / (2 cut-off)) / sin(pi / (2 order)): the series converges as fast as the
# distance of the poles of the filter from the eigenvalues allows.
SERIES_TERMS_FACTOR = 4.6
LOWEST_ORDER_TERMS_FACTOR = 6.5  # the same for the lowest order, which would be several times less accurate

FAST_MATH_FLAGS = {"contract", "reassoc"}  # fused multiply-add, and sums in any order

Signals = TypeVar("Signals", FloatArray, SingleArray)
# Loops below use unsigned indices: signed ones, which may count from the end, take a quarter of the time.


class Step(NamedTuple):
    """Step of the recurrence, from T_k-1 and T_k to T_k+1."""

    scale: np.float32  # factor of the Laplacian in A
    factor: np.float32  # 2, or 1 in the first step
    before: SingleArray  # T_k-1, which is overwritten
    current: SingleArray  # T_k


def coefficients(response: Callable[[FloatArray], FloatArray], bound: float, terms: int) -> FloatArray:
    """Coefficients (terms, s) of the Chebyshev series of functions on [0, bound], from their values (k, s) at k places.

    >>> np.round(coefficients(lambda x: x[:, np.newaxis] ** 2, 2.0, 3), 12).ravel()  # ((x - 1) + 1)^2
    array([1.5, 2. , 0.5])
    """
    angles = (np.arange(4 * terms) + 0.5) * np.pi / (4 * terms)
    cosines = np.cos(np.outer(np.arange(terms), angles))
    result: FloatArray = (2.0 / len(angles)) * cosines @ response(0.5 * bound * (np.cos(angles) + 1.0))
    result[0] *= 0.5
    return result


def low_pass_series(strengths: FloatArray, bound: float, order: int = DEFAULT_ORDER) -> FloatArray:
    """Chebyshev coefficients, (terms, strengths), of (1 - f(x)) / x on [0, bound] for the filters f.

    >>> rows = low_pass_series(np.array([0.0, 10.0]), 2.0)  # at x = 2, where all polynomials are 1
    >>> bool(np.allclose(rows.sum(axis=0), [0.0, 0.5 * (1.0 - 1.0 / 161.0)], atol=1e-3))
    True
    """
    edge = max(float(strengths.max()), 1.0) ** -0.25
    per_root = (SERIES_TERMS_FACTOR if order > LOWEST_ORDER else LOWEST_ORDER_TERMS_FACTOR) / np.sin(
        0.5 * np.pi / order
    )
    terms = max(8, int(np.ceil(per_root * np.sqrt(bound / (2.0 * edge)))))
    scales = strengths**0.25

    def removal_response(x: FloatArray) -> FloatArray:
        """The removed part over x, (1 - f(x)) / x."""
        powers = np.outer(x, scales) ** order
        result: FloatArray = powers / ((1.0 + powers) * x[:, np.newaxis])
        return result

    return coefficients(removal_response, bound, terms)


def low_pass(
    laplacian: Laplacian,
    signals: Signals,
    strengths: FloatArray,
    shares: SingleArray | None = None,
    order: int = DEFAULT_ORDER,
) -> Signals:
    """Filter signals (n, c) by mixtures, with shares (n, s), of filters of some strengths and one order.

    Without shares there is one filter only.
    """
    return _apply_series(laplacian, signals, low_pass_series(strengths, laplacian.bound, order), shares)


def diffuse(laplacian: Laplacian, signals: FloatArray, time: float) -> FloatArray:
    """Signals (n, c) after heat flow exp(-time L): local means, of a squared width of about `time` squared edges."""
    bound = laplacian.bound
    terms = 8 + int(np.ceil(2.0 * np.sqrt(time * bound)))
    rows = coefficients(lambda x: -np.expm1(-time * x[:, np.newaxis]) / x[:, np.newaxis], bound, terms)
    return _apply_series(laplacian, signals, rows, None)


def _apply_series(laplacian: Laplacian, signals: Signals, series: FloatArray, shares: SingleArray | None) -> Signals:
    """Subtract the parts that filters remove, given by series (terms, s) and mixed by shares, four columns at a time.

    Groups of fewer columns are padded with zeros.
    """
    result = signals.copy()
    mixture = np.ones((len(signals), 1), dtype=np.float32) if shares is None else shares
    for first in range(0, signals.shape[1], SIGNALS_PER_PASS):
        group = np.ascontiguousarray(signals[:, first : first + SIGNALS_PER_PASS])  # no copy of four columns
        count = group.shape[1]
        if count < SIGNALS_PER_PASS:
            group = np.hstack([group, np.zeros((len(group), SIGNALS_PER_PASS - count), group.dtype)])
        removed = np.zeros(group.shape, dtype=np.float32)
        _run(laplacian, group, series, _advance_and_mix, (mixture, removed))
        result[:, first : first + count] -= removed[:, :count]
    return result


def accumulate_residuals(
    laplacian: Laplacian,
    signals: RealArray,
    series: FloatArray,
    directions: SingleArray,
    sums: SingleArray,
    products: SingleArray,
) -> None:
    """Accumulate components of the parts of four signals that filters remove, given by series (terms, s).

    `sums` (n, s) add the inner products of the first three removed signals with the first three columns of `directions`
    (n, 4), `products` (n, s) the products of the fourth ones.
    """
    _run(laplacian, signals, series, _advance_and_measure, (directions, sums, products))


def _run(
    laplacian: Laplacian,
    signals: RealArray,
    series: FloatArray,
    kernel: Callable[..., None],
    arrays: tuple[SingleArray, ...],
) -> None:
    """Compute T_0, T_1, ... of A = 2 L / bound - 1, and pass three of them at a time to a kernel.

    The results of the kernel are as large as the signals times the filters, so it runs in every third step only.
    """
    before, current = np.zeros((2, *signals.shape), dtype=np.float32)
    run = partial(run_kernel, chunk=MAX_CHUNK)  # to wake a thread takes as long as 4,000 vertices
    run(_differences, len(signals), laplacian, signals, current)
    scale = np.float32(2.0 / laplacian.bound)
    rows = np.zeros((len(series) + -len(series) % 3, series.shape[1]), dtype=np.float32)  # in threes
    rows[: len(series)] = series
    for k in range(1, len(rows)):
        step = Step(scale, np.float32(min(k, 2)), before, current)
        if k % 3 == 2:
            run(kernel, len(current), laplacian, step, rows[k - 2 : k + 1], *arrays)
        else:
            run(_advance, len(current), laplacian, step)
        before, current = current, before


@jit()
def _differences(laplacian: Laplacian, signals: RealArray, result: SingleArray, start: int, stop: int) -> None:
    """Write the Laplacian of vertices start .. stop-1."""
    for i in range(start, stop):
        a = b = c = d = 0.0
        for q in range(laplacian.indptr[i], laplacian.indptr[i + 1]):
            j, weight = laplacian.indices[q], laplacian.weights[q]
            a += weight * (signals[i, 0] - signals[j, 0])
            b += weight * (signals[i, 1] - signals[j, 1])
            c += weight * (signals[i, 2] - signals[j, 2])
            d += weight * (signals[i, 3] - signals[j, 3])
        rate = laplacian.rates[i]
        result[i, 0], result[i, 1], result[i, 2], result[i, 3] = rate * a, rate * b, rate * c, rate * d


@inner_jit(inline="always")  # a call with so many arrays would take three times as long as its body
def _advance_row(laplacian: Laplacian, step: Step, i: int) -> Row:
    """Overwrite T_k-1 at vertex i by T_k+1 = 2 A T_k - T_k-1, or T_1 = A T_0, whose factor is 1."""
    scale, factor, before, current = step
    total = zero_row()
    for q in range(np.uint32(laplacian.indptr[i]), np.uint32(laplacian.indptr[i + 1])):
        total = add_scaled_row(laplacian.weights[q], load_row(current, laplacian.indices[q]), total)
    rate = factor * scale * laplacian.rates[i]
    own, kept = rate - factor, factor - np.float32(1.0)
    value = add_scaled_row(own, load_row(current, i), scale_row(-rate, total))
    value = add_scaled_row(-kept, load_row(before, i), value)
    store_row(before, i, value)
    return value


@jit(fastmath=FAST_MATH_FLAGS)
def _advance(laplacian: Laplacian, step: Step, start: int, stop: int) -> None:
    for i in range(np.uint32(start), np.uint32(stop)):
        _advance_row(laplacian, step, i)


@jit(fastmath=FAST_MATH_FLAGS)
def _advance_and_mix(
    laplacian: Laplacian, step: Step, rows: SingleArray, shares: SingleArray, result: SingleArray, start: int, stop: int
) -> None:
    for i in range(np.uint32(start), np.uint32(stop)):
        before, value = load_row(step.before, i), _advance_row(laplacian, step, i)
        first = second = third = np.float32(0.0)
        for s in range(rows.shape[1]):
            first += shares[i, s] * rows[0, s]
            second += shares[i, s] * rows[1, s]
            third += shares[i, s] * rows[2, s]
        mixed = add_scaled_row(
            first, before, add_scaled_row(second, load_row(step.current, i), scale_row(third, value))
        )
        store_row(result, i, add_scaled_row(np.float32(1.0), mixed, load_row(result, i)))


@jit(fastmath=FAST_MATH_FLAGS)
def _advance_and_measure(
    laplacian: Laplacian,
    step: Step,
    rows: SingleArray,
    directions: SingleArray,
    sums: SingleArray,
    products: SingleArray,
    start: int,
    stop: int,
) -> None:
    before, current = step.before, step.current
    for i in range(np.uint32(start), np.uint32(stop)):
        x, y, z, w = directions[i, 0], directions[i, 1], directions[i, 2], directions[i, 3]
        first, first_product = before[i, 0] * x + before[i, 1] * y + before[i, 2] * z, before[i, 3] * w
        second, second_product = current[i, 0] * x + current[i, 1] * y + current[i, 2] * z, current[i, 3] * w
        _advance_row(laplacian, step, i)  # overwrites T_k-1
        third, third_product = before[i, 0] * x + before[i, 1] * y + before[i, 2] * z, before[i, 3] * w
        for s in range(rows.shape[1]):
            sums[i, s] += first * rows[0, s] + second * rows[1, s] + third * rows[2, s]
        for s in range(rows.shape[1]):
            products[i, s] += first_product * rows[0, s] + second_product * rows[1, s] + third_product * rows[2, s]
