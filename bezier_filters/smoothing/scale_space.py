"""Low-pass filters of many strengths at once: the scale space of a mesh.

The filter of order r and strength s is 1 / (1 + (s L^4)^(r / 4)) of a Laplacian L: for a symmetric L and r = 4, x
minimises |x - p|^2 + s |L^2 x|^2. Filters of one strength end their pass band at the same place, the steeper the
higher the order. As a Chebyshev series in L a filter takes some dozen steps, each a mean over neighbours, and the
steps are the same for all strengths.
"""

from typing import TypeVar

import numpy as np

from bezier_filters.arrays import FloatArray, RealArray, SingleArray
from bezier_filters.smoothing.chebyshev import add_mixtures, coefficients, differences, groups_of_signals
from bezier_filters.smoothing.laplacian import Laplacian

STRENGTHS: FloatArray = np.concatenate([[0.0], 10.0 ** np.arange(-1.0, 6.1, 0.5)])
"""Of the filters; 0 leaves everything as it is."""
ORDER = 4
"""Of the filters, where nothing else is said."""
TERMS = 4.6
"""Of a series, times the square root of half the range of the eigenvalues over the end of the pass band, over the
sine of half the angle at which the poles of the filter lie: series converge the slower, the nearer these are."""

Signals = TypeVar("Signals", FloatArray, SingleArray)


def series(strengths: FloatArray, bound: float, order: int = ORDER) -> FloatArray:
    """Chebyshev coefficients, (terms, strengths), of (1 - f(x)) / x on [0, bound] for the filters f.

    Examples
    --------
    >>> rows = series(np.array([0.0, 10.0]), 2.0)  # at x = 2, where all polynomials are 1
    >>> bool(np.allclose(rows.sum(axis=0), [0.0, 0.5 * (1.0 - 1.0 / 161.0)], atol=1e-3))
    True
    """
    edge = max(float(strengths.max()), 1.0) ** -0.25
    terms = max(8, int(np.ceil(TERMS / np.sin(0.5 * np.pi / order) * np.sqrt(bound / (2.0 * edge)))))
    scales = strengths**0.25

    def taken(x: FloatArray) -> FloatArray:
        """The part that a filter takes off, over x."""
        powers = np.outer(x, scales) ** order
        result: FloatArray = powers / ((1.0 + powers) * x[:, np.newaxis])
        return result

    return coefficients(taken, bound, terms)


def heat_terms(time: float, bound: float) -> int:
    """Number of terms, and of rings that `diffused` looks around."""
    return 8 + int(np.ceil(2.0 * np.sqrt(time * bound)))


def diffused(laplacian: Laplacian, signals: FloatArray, time: float, *, threads: int = 1) -> FloatArray:
    """Signals (n, c) after heat flow, exp(-time L): means over the surroundings, some `time` edges squared wide."""
    bound = laplacian.bound
    terms = heat_terms(time, bound)
    rows = coefficients(lambda x: -np.expm1(-time * x[:, np.newaxis]) / x[:, np.newaxis], bound, terms)
    return _filtered(laplacian, signals, rows, _everywhere(signals), threads)


def filtered(
    laplacian: Laplacian,
    signals: Signals,
    strengths: FloatArray,
    shares: SingleArray,
    order: int = ORDER,
    *,
    threads: int = 1,
) -> Signals:
    """Signals (n, c) filtered by mixtures of filters that differ from vertex to vertex.

    Parameters
    ----------
    laplacian : Laplacian
    signals : (n, c) float64 or float32
    strengths : (s,) float64
        Of the filters.
    shares : (n, s) float32
        Of each filter at each vertex.
    order : int
        Of the filters.
    threads : int
        Number of threads.

    Returns
    -------
    (n, c), as the signals
    """
    return _filtered(laplacian, signals, series(strengths, laplacian.bound, order), shares, threads)


def filtered_evenly(laplacian: Laplacian, signals: Signals, strength: float, *, threads: int = 1) -> Signals:
    """Signals (n, c) after one filter for all vertices."""
    return filtered(laplacian, signals, np.array([strength]), _everywhere(signals), threads=threads)


def _everywhere(signals: RealArray) -> SingleArray:
    return np.ones((len(signals), 1), dtype=np.float32)


def _filtered(laplacian: Laplacian, signals: Signals, rows: FloatArray, shares: SingleArray, threads: int) -> Signals:
    result = signals.copy()
    for columns, group in groups_of_signals(signals):
        state = differences(laplacian, group, threads=threads)
        taken = np.zeros_like(state.current)
        add_mixtures(laplacian, state, rows, shares, taken, threads=threads)
        result[:, columns] -= taken[:, : columns.stop - columns.start]
    return result
