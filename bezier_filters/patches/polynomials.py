"""Bivariate polynomials in the monomial basis, which the kernels use.

A Bezier patch is a polynomial in coordinates s, t about the centre of its parameter rectangle. In monomials s^a t^b,
A^T A is a table of moments, and derivatives at the centre are coefficients.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray, unique_rows
from bezier_filters.patches.bernstein import monomial_matrix
from bezier_filters.runtime.cached_property import cached_property


@dataclass(frozen=True)
class PolynomialSpace:
    """Polynomials spanned by monomials s^a t^b on the square [-1, 1]^2."""

    exponents: IntArray  # (m, 2): the pairs (a, b)

    @property
    def dimension(self) -> int:
        """Number of coefficients."""
        return len(self.exponents)

    @cached_property
    def total_degrees(self) -> IntArray:
        """A + b of every monomial, shape (m,)."""
        return np.asarray(self.exponents.sum(axis=1), dtype=np.int32)

    def places(self, pairs: Sequence[tuple[int, int]]) -> IntArray:
        """Indices of the monomials with the given exponents, all of which must exist."""
        return np.array([np.flatnonzero((self.exponents == pair).all(axis=1))[0] for pair in pairs], dtype=np.int32)

    @cached_property
    def moments(self) -> tuple[IntArray, IntArray]:
        """Exponents (q, 2) of all products of two monomials, and the index of each product among them.

        The second array has an entry for each entry of the lower triangle of A^T A, row by row.
        """
        row, column = np.tril_indices(self.dimension)
        products = self.exponents[row] + self.exponents[column]
        distinct, place = unique_rows(products)
        return distinct.astype(np.int32), place.ravel().astype(np.int32)


@cache
def tensor_space(degree: int) -> PolynomialSpace:
    """Polynomials of bi-degree d, those of a Bezier patch: (d + 1)^2 monomials, b running fastest."""
    a, b = np.divmod(np.arange((degree + 1) ** 2), degree + 1)
    return PolynomialSpace(np.column_stack([a, b]).astype(np.int32))


@cache
def total_degree_space(degree: int) -> PolynomialSpace:
    """Polynomials of total degree d: (d + 1)(d + 2) / 2 monomials, ordered by total degree."""
    pairs = [(total - b, b) for total in range(degree + 1) for b in range(total + 1)]
    return PolynomialSpace(np.array(pairs, dtype=np.int32))


def elimination_order(space: PolynomialSpace) -> tuple[PolynomialSpace, IntArray]:
    """The space with the monomials x, y, x^2, x y and y^2 last, and the permutation of the monomials."""
    last = space.places([(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
    order = np.concatenate([np.setdiff1d(np.arange(space.dimension), last)[::-1], last]).astype(np.int32)
    return PolynomialSpace(space.exponents[order]), order


def row_starts(exponents: IntArray) -> IntArray:
    """Index of s^a t^0 for each a among monomials s^a t^b in lexicographic order, then the number of monomials."""
    return np.concatenate([[0], np.cumsum(np.bincount(exponents[:, 0]))]).astype(np.int32)


def lexicographic_places(exponents: IntArray) -> IntArray:
    """Index of each monomial in lexicographic order."""
    return (row_starts(exponents)[exponents[:, 0]] + exponents[:, 1]).astype(np.int32)


@cache
def monomials_from_bernstein(degree: int) -> FloatArray:
    """Matrix from the control heights of a patch to the coefficients of its `tensor_space`."""
    univariate = monomial_matrix(degree)
    return np.asarray(np.kron(univariate, univariate), dtype=np.float64)
