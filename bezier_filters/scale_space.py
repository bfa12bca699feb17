"""Low-pass filters of many strengths at once: the scale space of a mesh.

The filter of strength s is 1 / (1 + s L^4) of a Laplacian L: x minimises, for a symmetric L,
|x - p|^2 + s |L^2 x|^2. As a Chebyshev series in L it takes some dozen steps, each a mean over
neighbours, and the steps are the same for all strengths.
"""

from collections.abc import Callable

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.laplacian import Laplacian
from bezier_filters.lean import lean_njit
from bezier_filters.parallel import RangeTask, run_in_chunks

STRENGTHS: FloatArray = np.concatenate([[0.0], 10.0 ** np.arange(-1.0, 6.1, 0.5)])
"""Of the filters; 0 leaves everything as it is."""
ORDER = 4
TERMS = 16.0
"""Of a series, times the square root of half the range of the eigenvalues over the end of the pass band."""

Step = Callable[[FloatArray, FloatArray], None]
"""``step(values, coefficients)`` takes the next Chebyshev polynomial T_k(L) p and its coefficient for each strength."""


def series(strengths: FloatArray, bound: float) -> FloatArray:
    """Chebyshev coefficients of the filters on [0, bound], (terms, strengths).

    Examples
    --------
    >>> coefficients = series(np.array([0.0, 10.0]), 2.0)
    >>> at_zero = (coefficients * (-1.0) ** np.arange(len(coefficients))[:, np.newaxis]).sum(axis=0)
    >>> bool(np.allclose(at_zero, 1.0, atol=1e-12))
    True
    """
    edge = max(float(strengths.max()), 1.0) ** (-1.0 / ORDER)
    terms = max(8, int(np.ceil(TERMS * np.sqrt(bound / (2.0 * edge)))))
    result = chebyshev_coefficients(lambda x: 1.0 / (1.0 + np.outer(x**ORDER, strengths)), bound, terms)
    result[0] += 1.0 - (-1.0) ** np.arange(terms) @ result  # what is constant stays exactly
    return result


def chebyshev_coefficients(response: Callable[[FloatArray], FloatArray], bound: float, terms: int) -> FloatArray:
    """Of functions on [0, bound], (terms, s), from their values (k, s) at k places."""
    angles = (np.arange(4 * terms) + 0.5) * np.pi / (4 * terms)
    cosines = np.cos(np.outer(np.arange(terms), angles))
    result: FloatArray = (2.0 / len(angles)) * cosines @ response(0.5 * bound * (np.cos(angles) + 1.0))
    result[0] *= 0.5
    return result


def diffused(laplacian: Laplacian, signals: FloatArray, time: float, *, threads: int = 1) -> FloatArray:
    """Signals (n, c) after heat flow, exp(-time L): means over the surroundings, some `time` edges squared wide."""
    bound = laplacian.bound
    terms = 8 + int(np.ceil(2.0 * np.sqrt(time * bound)))
    coefficients = chebyshev_coefficients(lambda x: np.exp(-time * x)[:, np.newaxis], bound, terms)
    result = np.zeros_like(signals)

    def add(values: FloatArray, row: FloatArray) -> None:
        result[:] += row[0] * values

    run_series(laplacian, signals, coefficients, add, threads=threads)
    return result


def run_series(
    laplacian: Laplacian, signals: FloatArray, coefficients: FloatArray, step: Step, *, threads: int = 1
) -> None:
    """Hand the Chebyshev polynomials of a Laplacian applied to signals (n, c) to `step`, one after the other."""
    bound = laplacian.bound
    before, current = np.zeros_like(signals), np.ascontiguousarray(signals)
    for k, row in enumerate(coefficients):
        if k > 0:
            following = np.empty_like(current)
            _advance_all(laplacian, bound, 1.0 if k == 1 else 2.0, before, current, following, threads)
            before, current = current, following
        step(current, row)


def filtered(
    laplacian: Laplacian, signals: FloatArray, strengths: FloatArray, shares: FloatArray, *, threads: int = 1
) -> FloatArray:
    """Signals (n, c) filtered by mixtures of filters that differ from vertex to vertex.

    Parameters
    ----------
    laplacian : Laplacian
    signals : (n, c) float64
    strengths : (s,) float64
        Of the filters.
    shares : (n, s) float64
        Of each filter at each vertex.
    threads : int
        Number of threads.

    Returns
    -------
    (n, c) float64
    """
    result = np.zeros_like(signals)

    def add(values: FloatArray, coefficients: FloatArray) -> None:
        result[:] += values * (shares @ coefficients)[:, np.newaxis]

    run_series(laplacian, signals, series(strengths, laplacian.bound), add, threads=threads)
    return result


def filtered_evenly(laplacian: Laplacian, signals: FloatArray, strength: float, *, threads: int = 1) -> FloatArray:
    """Signals (n, c) after one filter for all vertices."""
    everywhere = np.ones((len(signals), 1))
    return filtered(laplacian, signals, np.array([strength]), everywhere, threads=threads)


def _advance_all(
    laplacian: Laplacian,
    bound: float,
    factor: float,
    before: FloatArray,
    current: FloatArray,
    following: FloatArray,
    threads: int,
) -> None:
    def make_task() -> RangeTask:
        return lambda start, stop: _advance(
            laplacian.indptr,
            laplacian.indices,
            laplacian.weights,
            laplacian.rates,
            2.0 / bound,
            factor,
            before,
            current,
            start,
            stop,
            following,
        )

    run_in_chunks(make_task, len(current), threads=threads)


@lean_njit()
def _advance(
    ptr: IntArray,
    indices: IntArray,
    weights: FloatArray,
    rates: FloatArray,
    scale: float,
    factor: float,
    before: FloatArray,
    current: FloatArray,
    start: int,
    stop: int,
    following: FloatArray,
) -> None:
    """The recurrence T_k+1 = 2 A T_k - T_k-1 with A = scale L - 1; factor 1 makes the first step."""
    columns = current.shape[1]
    for i in range(start, stop):
        own = factor * (scale * rates[i] - 1.0)
        for c in range(columns):
            following[i, c] = own * current[i, c] - (before[i, c] if factor > 1.0 else 0.0)
        for q in range(ptr[i], ptr[i + 1]):
            j, weight = indices[q], factor * scale * rates[i] * weights[q]
            for c in range(columns):
                following[i, c] -= weight * current[j, c]
