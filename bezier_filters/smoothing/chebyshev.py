"""Polynomials of an operator on a mesh, by the recurrence of Chebyshev.

A filter f with f(0) = 1 takes off p - f(L) p = g(L) (L p) with g(x) = (1 - f(x)) / x. So the
recurrence runs on the differences L p, which are as small as the noise: single precision then has
an error of some millionths of the noise, and what is constant stays exactly. Four signals run
side by side; a step reads every neighbour once and overwrites the polynomial before the last.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray, RealArray, SingleArray
from bezier_filters.runtime.lean import inner_njit, lean_njit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks
from bezier_filters.smoothing.laplacian import Laplacian

WIDTH = 4
"""Signals that run side by side."""


@dataclass(frozen=True)
class Recurrence:
    """How far the recurrence has come: what the next step starts from.

    Attributes
    ----------
    before, current : (n, 4) float32
        The last two polynomials of the differences; steps overwrite them.
    done : int
        Number of steps that were made.
    """

    before: SingleArray
    current: SingleArray
    done: int = 0


def coefficients(response: Callable[[FloatArray], FloatArray], bound: float, terms: int) -> FloatArray:
    """Of Chebyshev series of functions on [0, bound], (terms, s), from their values (k, s) at k places.

    Examples
    --------
    >>> np.round(coefficients(lambda x: x[:, np.newaxis] ** 2, 2.0, 3), 12).ravel()  # ((x - 1) + 1)^2
    array([1.5, 2. , 0.5])
    """
    angles = (np.arange(4 * terms) + 0.5) * np.pi / (4 * terms)
    cosines = np.cos(np.outer(np.arange(terms), angles))
    result: FloatArray = (2.0 / len(angles)) * cosines @ response(0.5 * bound * (np.cos(angles) + 1.0))
    result[0] *= 0.5
    return result


def groups_of_signals(signals: RealArray) -> Iterator[tuple[slice, RealArray]]:
    """Columns of signals (n, c), four at a time, filled up with zeros, and which ones they are."""
    for first in range(0, signals.shape[1], WIDTH):
        columns = slice(first, min(first + WIDTH, signals.shape[1]))
        group = np.zeros((len(signals), WIDTH), signals.dtype)
        group[:, : columns.stop - first] = signals[:, columns]
        yield columns, group


def differences(laplacian: Laplacian, signals: RealArray, *, threads: int = 1) -> Recurrence:
    """The Laplacian of four signals (n, 4), where the recurrence begins."""
    result = np.zeros(signals.shape, dtype=np.float32)

    def make_task() -> RangeTask:
        return lambda start, stop: _differences(*laplacian.arrays, signals, start, stop, result)

    run_in_chunks(make_task, len(signals), threads=threads)
    return Recurrence(np.zeros_like(result), result)


def add_mixtures(
    laplacian: Laplacian,
    state: Recurrence,
    series: FloatArray,
    shares: SingleArray,
    result: SingleArray,
    *,
    threads: int = 1,
) -> Recurrence:
    """Add to `result` (n, 4) what the next terms of series (terms, s) make of the signals, mixed with shares (n, s).

    Returns the state after them, to go on from with further terms.
    """

    def make_step(
        before: SingleArray, current: SingleArray, row: SingleArray, scale: np.float32, factor: np.float32
    ) -> RangeTask:
        return lambda first, last: _advance_and_mix(
            *laplacian.arrays, scale, factor, before, current, first, last, shares, row, result
        )

    return _run(laplacian, state, series, make_step, threads)


def add_heights(
    laplacian: Laplacian,
    state: Recurrence,
    series: FloatArray,
    directions: SingleArray,
    sums: SingleArray,
    products: SingleArray,
    *,
    threads: int = 1,
) -> Recurrence:
    """Add components of what the next terms of each series (terms, s) make of the signals.

    `sums` (n, s) get the first three signals times the first three columns of `directions` (n, 4), `products` (n, s)
    the fourth times the fourth. Returns the state after these terms.
    """

    def make_step(
        before: SingleArray, current: SingleArray, row: SingleArray, scale: np.float32, factor: np.float32
    ) -> RangeTask:
        return lambda first, last: _advance_and_measure(
            *laplacian.arrays, scale, factor, before, current, first, last, directions, row, sums, products
        )

    return _run(laplacian, state, series, make_step, threads)


MakeStep = Callable[[SingleArray, SingleArray, SingleArray, np.float32, np.float32], RangeTask]


def _run(laplacian: Laplacian, state: Recurrence, series: FloatArray, make_step: MakeStep, threads: int) -> Recurrence:
    """Make steps with T_0, T_1, ... of A = 2 L / bound - 1: factor 0 for the first, 1 for the second, 2 for others."""
    before, current = state.before, state.current
    scale = 2.0 / laplacian.bound
    for k, row in enumerate(series.astype(np.float32), start=state.done):
        task = make_step(before, current, row, np.float32(scale), np.float32(min(k, 2)))
        run_in_chunks(lambda task=task: task, len(current), threads=threads)  # type: ignore[misc]
        if k > 0:
            before, current = current, before
    return Recurrence(before, current, state.done + len(series))


@lean_njit()
def _differences(
    ptr: IntArray,
    indices: IntArray,
    weights: SingleArray,
    rates: SingleArray,
    signals: RealArray,
    start: int,
    stop: int,
    result: SingleArray,
) -> None:
    """Write the Laplacian of vertices start .. stop-1."""
    for i in range(start, stop):
        a, b, c, d = signals[i, 0], signals[i, 1], signals[i, 2], signals[i, 3]
        da, db, dc, dd = 0.0, 0.0, 0.0, 0.0
        for q in range(ptr[i], ptr[i + 1]):
            j, w = indices[q], weights[q]
            da += w * (a - signals[j, 0])
            db += w * (b - signals[j, 1])
            dc += w * (c - signals[j, 2])
            dd += w * (d - signals[j, 3])
        rate = rates[i]
        result[i, 0], result[i, 1], result[i, 2], result[i, 3] = rate * da, rate * db, rate * dc, rate * dd


@inner_njit()
def _advance(
    ptr: IntArray,
    indices: IntArray,
    weights: SingleArray,
    rates: SingleArray,
    scale: np.float32,
    factor: np.float32,
    before: SingleArray,
    current: SingleArray,
    i: int,
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Overwrite T_k-1 at vertex i by T_k+1 = 2 A T_k - T_k-1, or T_1 = A T_0; factor 0 leaves T_0."""
    a, b, c, d = current[i, 0], current[i, 1], current[i, 2], current[i, 3]
    if factor == np.float32(0.0):
        return a, b, c, d
    sa = sb = sc = sd = np.float32(0.0)
    for q in range(ptr[i], ptr[i + 1]):
        j, w = indices[q], weights[q]
        sa += w * current[j, 0]
        sb += w * current[j, 1]
        sc += w * current[j, 2]
        sd += w * current[j, 3]
    rate = factor * scale * rates[i]
    own, kept = rate - factor, factor - np.float32(1.0)
    before[i, 0] = own * a - rate * sa - kept * before[i, 0]
    before[i, 1] = own * b - rate * sb - kept * before[i, 1]
    before[i, 2] = own * c - rate * sc - kept * before[i, 2]
    before[i, 3] = own * d - rate * sd - kept * before[i, 3]
    return before[i, 0], before[i, 1], before[i, 2], before[i, 3]


@lean_njit(fastmath={"reassoc", "contract"})
def _advance_and_mix(
    ptr: IntArray,
    indices: IntArray,
    weights: SingleArray,
    rates: SingleArray,
    scale: np.float32,
    factor: np.float32,
    before: SingleArray,
    current: SingleArray,
    start: int,
    stop: int,
    shares: SingleArray,
    row: SingleArray,
    result: SingleArray,
) -> None:
    for i in range(start, stop):
        a, b, c, d = _advance(ptr, indices, weights, rates, scale, factor, before, current, i)
        mixed = np.float32(0.0)
        for s in range(row.shape[0]):
            mixed += shares[i, s] * row[s]
        result[i, 0] += mixed * a
        result[i, 1] += mixed * b
        result[i, 2] += mixed * c
        result[i, 3] += mixed * d


@lean_njit()
def _advance_and_measure(
    ptr: IntArray,
    indices: IntArray,
    weights: SingleArray,
    rates: SingleArray,
    scale: np.float32,
    factor: np.float32,
    before: SingleArray,
    current: SingleArray,
    start: int,
    stop: int,
    directions: SingleArray,
    row: SingleArray,
    sums: SingleArray,
    products: SingleArray,
) -> None:
    for i in range(start, stop):
        a, b, c, d = _advance(ptr, indices, weights, rates, scale, factor, before, current, i)
        height = a * directions[i, 0] + b * directions[i, 1] + c * directions[i, 2]
        other = d * directions[i, 3]
        for s in range(row.shape[0]):
            sums[i, s] += height * row[s]
        for s in range(row.shape[0]):
            products[i, s] += other * row[s]
