"""Smoothness rows S that regularise the least-squares fit.

The fit solves [alpha A; (1 - alpha) S] b = [alpha z; 0] by least squares. S b is penalised; polynomials in the null
space of S are fitted without bias.
"""

from collections.abc import Callable
from math import factorial
from typing import Literal, get_args

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.patches.polynomials import monomials_from_bernstein

Smoothness = Literal["third_order", "paper"]
Penalty = Smoothness | Literal["flattest"]  # for points that do not determine a quadratic
# Weight of second-order coefficients relative to those of third order and more: points that extend over 1/300 of the
# neighbourhood in some direction still determine the curvature along it. With ten times the weight it is 1/100; a tenth
# is lost to rounding.
FLATTEST_WEIGHT = 1e-7


def smoothness_matrix(smoothness: Penalty, degree: int) -> FloatArray:
    """Rows S for a patch of the given bi-degree, shape (r, (degree + 1)**2).

    Parameters
    ----------
    smoothness : {"third_order", "paper", "flattest"}
        ``"paper"``: the second differences of the four boundary polygons of the control net
        (Li, Barsky, Jin 2009). It penalises quadratics, so curvature is biased at every
        resolution. ``"third_order"``: the patch's monomial coefficients of total degree >= 3;
        all quadratics are free, so the fit is consistent for every alpha. ``"flattest"``, not
        public: as ``"third_order"``, with the least second-order coefficients among all fits to
        the points.
    degree : int
        2, 3 or 4.

    Raises
    ------
    InvalidParameterError
        If the name is unknown.
    """
    rows: dict[str, Callable[[int], FloatArray]] = {
        "third_order": third_order_coefficients,
        "flattest": flattest_rows,
        "paper": boundary_second_differences,
    }
    if smoothness not in rows:
        raise InvalidParameterError(f"smoothness: got {smoothness!r}, expected one of {get_args(Smoothness)}")
    return rows[smoothness](degree)


def boundary_second_differences(degree: int) -> FloatArray:
    """Second differences (1, -2, 1) along the four boundary polygons, shape (4 (d-1), (d+1)^2).

    For degree 3 these are the eight rows of the paper's S (its printed matrix lost a column).
    """
    size = degree + 1
    index = np.arange(size * size).reshape(size, size)
    polygons = np.vstack([index[0], index[-1], index[:, 0], index[:, -1]])
    rows = np.zeros((4, degree - 1, size * size))
    for side, polygon in enumerate(polygons):
        for k in range(degree - 1):
            rows[side, k, polygon[k : k + 3]] = 1.0, -2.0, 1.0
    return rows.reshape(-1, size * size)


def third_order_coefficients(degree: int) -> FloatArray:
    """Coefficients of the monomials s^a t^b with a + b >= 3 on the square [-1, 1]^2.

    Each row carries the weight sqrt(a! b! / (a+b)!): the sum of squares over one total degree
    is then Bombieri's norm, which does not change when the axes turn.
    """
    size = degree + 1
    a, b = np.divmod(np.arange(size * size), size)
    weight = np.sqrt([factorial(i) * factorial(j) / factorial(i + j) for i, j in zip(a, b, strict=True)])
    return (weight[:, np.newaxis] * monomials_from_bernstein(degree))[a + b >= 3]


def flattest_rows(degree: int) -> FloatArray:
    """Third-order rows, and rows of small weight for the monomials with a + b = 2."""
    second = [[2, 0], [1, 1], [0, 2]]
    rows = monomials_from_bernstein(degree)[[(degree + 1) * a + b for a, b in second]]
    return np.vstack([third_order_coefficients(degree), FLATTEST_WEIGHT * np.sqrt([[1.0], [0.5], [1.0]]) * rows])
