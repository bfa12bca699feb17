"""Restricted likelihood (REML) of values with a quadratic trend, and the weights of their best linear prediction.

Reflections turn the trend into its first axes; what is left, the contrasts, tell how likely a covariance is.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.holes.dense_rows import FAST, add_row, dot
from bezier_filters.runtime.cholesky import factorise
from bezier_filters.runtime.jit import inner_jit, jit, short_jit

TERMS = 10  # of a quadratic


@dataclass(frozen=True)
class Reflections:
    """Q = I - V T V^T, reflections that turn k columns (n, k) into a triangle.

    In the directions that the first k axes do not take, polynomials vanish: the contrasts of REML.
    """

    vectors: FloatArray  # (k, n): V^T
    weights: FloatArray  # (k, k): T
    triangle: FloatArray  # (k, k): the first k rows that result

    def applied(self, column: FloatArray) -> FloatArray:
        """Q a of a column (n,)."""
        return column - (self.weights @ (self.vectors @ column)) @ self.vectors

    def undone(self, column: FloatArray) -> FloatArray:
        """Q^T a of a column (n,)."""
        return column - ((self.vectors @ column) @ self.weights) @ self.vectors


def reflections_of(columns: FloatArray) -> Reflections:
    """The reflections of some columns, given as rows (k, n), in which the vectors take their place."""
    weights, triangle = np.zeros((2, len(columns), len(columns)))
    _reflect(columns, weights, triangle)
    return Reflections(columns, weights, triangle)


@short_jit(fastmath=FAST)
def _reflect(vectors: FloatArray, weights: FloatArray, triangle: FloatArray) -> None:
    """Replace columns, given as rows (k, n), by the vectors of Householder's reflections, one after the other.

    T is built up as in LAPACK's dlarft (Schreiber, Van Loan 1989), transposed, as the reflections are applied in
    their order.
    """
    count, n = vectors.shape
    for c in range(count):
        vector, norm = vectors[c], 0.0
        for j in range(c, n):
            norm += vector[j] * vector[j]
        norm = np.sqrt(norm)
        diagonal = -norm if vector[c] >= 0.0 else norm
        scale = (diagonal - vector[c]) / diagonal if norm > 0.0 else 0.0
        for j in range(c + 1, n):
            vector[j] /= vector[c] - diagonal if norm > 0.0 else 1.0
        for j in range(c):
            triangle[j, c], vector[j] = vector[j], 0.0
        triangle[c, c], vector[c] = diagonal, 1.0
        for d in range(c + 1, count):
            other = vectors[d]
            along = dot(vector, other, c)
            for j in range(c, n):
                other[j] -= scale * along * vector[j]
        weights[c, c] = scale
        for d in range(c):
            along = dot(vector, vectors[d], c)
            for e in range(d + 1):
                weights[c, e] -= scale * along * weights[d, e]


def turn(matrix: FloatArray, reflections: Reflections) -> float:
    """Replace the lower triangle of a symmetric matrix K (n, n) by that of Q K Q^T; return the norm of the contrasts.

    Q K Q^T is K - V B^T - B V^T for B = A - V (T V^T A) / 2, where A = K V T^T.
    """
    vectors = reflections.vectors
    weighted, products = np.zeros((2, *vectors.shape))
    return float(np.sqrt(_turn(matrix, vectors, reflections.weights, weighted, products, np.empty(len(vectors)))))


def restricted_likelihood(
    turned: FloatArray, target: FloatArray, errors: FloatArray, variance: float, factor: FloatArray
) -> tuple[float, FloatArray]:
    """-2 log of the restricted likelihood, up to a constant, and the weights.

    Errors, independent ones if no covariance is given, are added with their variance, and with up to a thousand times
    as much if the matrix is not positive definite otherwise; infinite if it still is not. `factor` is overwritten.
    """
    for _ in range(4):
        _add_errors(turned, errors, variance, factor)
        if factorise(factor):
            weights = target.copy()
            log_determinant, energy = _solve_factored(factor, weights)
            return log_determinant + len(target) * float(np.log(energy)), weights
        variance *= 10.0
    return np.inf, target


@short_jit(fastmath=FAST)
def _add_errors(turned: FloatArray, errors: FloatArray, variance: float, total: FloatArray) -> None:
    """Write the lower triangle of the covariance of the contrasts; errors without a covariance are independent."""
    for i in range(total.shape[0]):
        row, given = total[i], turned[TERMS + i]
        for j in range(i + 1):
            row[j] = given[TERMS + j]
        if errors.shape[0] > 0:
            added = errors[TERMS + i]
            for j in range(i + 1):
                row[j] += variance * added[TERMS + j]
        else:
            row[i] += variance


@jit(fastmath=FAST)
def _turn(
    matrix: FloatArray,
    vectors: FloatArray,
    weights: FloatArray,
    weighted: FloatArray,
    products: FloatArray,
    along: FloatArray,
) -> float:
    """Turn a matrix; return the sum of squares of its contrasts. Room (k, n), (k, n) and (k,), the first two zero."""
    for c in range(vectors.shape[0]):
        for d in range(c + 1):
            add_row(weighted[c], weights[c, d], vectors[d])
    _multiply(matrix, weighted, products)
    for c in range(vectors.shape[0]):
        for d in range(vectors.shape[0]):
            along[d] = dot(products[c], weighted[d], 0)
        for d in range(vectors.shape[0]):
            add_row(products[c], -0.5 * along[d], vectors[d])
    return _subtract_products(vectors, products, matrix)


@inner_jit(fastmath=FAST, inline="always")
def _multiply(matrix: FloatArray, columns: FloatArray, products: FloatArray) -> None:
    """Add a symmetric matrix, of which the lower triangle is read, times columns (k, n) to `products` (k, n)."""
    for i in range(matrix.shape[0]):
        row = matrix[i]
        for c in range(columns.shape[0]):
            column, product, x, total = columns[c], products[c], columns[c, i], 0.0
            for j in range(i):
                total += row[j] * column[j]
                product[j] += row[j] * x
            product[i] += total + row[i] * x


@inner_jit(fastmath=FAST, inline="always")
def _subtract_products(v: FloatArray, b: FloatArray, matrix: FloatArray) -> float:
    """Subtract V^T B + B^T V of (10, n) from the lower triangle; return the sum of squares of all from row 10 on."""
    squares = 0.0
    for i in range(matrix.shape[0]):
        row = matrix[i]
        for j in range(i + 1):
            for c in range(TERMS):
                row[j] -= v[c, i] * b[c, j] + b[c, i] * v[c, j]
        for j in range(TERMS, i + 1):
            squares += (1.0 if i == j else 2.0) * row[j] * row[j]
    return squares


@short_jit(fastmath=FAST)
def _solve_factored(factor: FloatArray, right: FloatArray) -> tuple[float, float]:
    """Solve L L^T x = b in place, lower triangular; return log det L L^T and b^T x, which is positive."""
    log_determinant, energy = 0.0, 0.0
    for i in range(right.shape[0]):
        row = factor[i]
        log_determinant += 2.0 * np.log(row[i])
        for j in range(i):
            right[i] -= row[j] * right[j]
        right[i] /= row[i]
        energy += right[i] * right[i]
    for i in range(right.shape[0] - 1, -1, -1):
        row = factor[i]
        right[i] /= row[i]
        for j in range(i):
            right[j] -= row[j] * right[i]
    return log_determinant, max(energy, np.finfo(np.float64).tiny)


@short_jit(fastmath=FAST)
def subtract_contrasts(
    turned: FloatArray,
    errors: FloatArray,
    variance: float,
    contrasts: FloatArray,
    triangle: FloatArray,
    quadratic: FloatArray,
) -> None:
    """Replace turned values (10,) by the coefficients of the quadratic: what the contrasts leave, by the triangle."""
    for i in range(contrasts.shape[0]):
        for k in range(TERMS):
            quadratic[k] -= contrasts[i] * turned[TERMS + i, k]
            if errors.shape[0] > 0:
                quadratic[k] -= contrasts[i] * variance * errors[TERMS + i, k]
    for k in range(TERMS - 1, -1, -1):
        for j in range(k + 1, TERMS):
            quadratic[k] -= triangle[k, j] * quadratic[j]
        quadratic[k] /= triangle[k, k]
