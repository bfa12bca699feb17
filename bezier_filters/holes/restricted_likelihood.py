"""Restricted likelihood (REML) of values with a quadratic trend, and the weights of their best linear prediction.

Let A be the n x 10 matrix of the trend, with the QR factorisation Q A = [R; 0]. The last n - 10 entries of Q z are the
contrasts c: linear combinations of the values without any trend. With C their covariance, up to a scale that is
profiled out,

    -2 log L = log det C + m log(c^T C^-1 c) + const,   m = n - 10.

Q = I - V T V^T are blocked Householder reflectors.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.holes.dense_rows import FASTMATH, add_row, dot
from bezier_filters.runtime.cholesky import factorise
from bezier_filters.runtime.jit import inner_jit, jit, short_jit

QUADRATIC_TERMS = 10  # coefficients of a quadratic polynomial in three variables


@dataclass(frozen=True)
class Reflectors:
    """Blocked Householder reflectors Q = I - V T V^T, with Q A = [R; 0] for k columns A (n, k)."""

    vectors: FloatArray  # (k, n): V^T
    weights: FloatArray  # (k, k): T
    triangle: FloatArray  # (k, k): R

    def apply(self, column: FloatArray) -> FloatArray:
        """Q a of a column (n,)."""
        return column - (self.weights @ (self.vectors @ column)) @ self.vectors

    def apply_transpose(self, column: FloatArray) -> FloatArray:
        """Q^T a of a column (n,)."""
        return column - ((self.vectors @ column) @ self.weights) @ self.vectors


def householder_reflectors(columns: FloatArray) -> Reflectors:
    """Reflectors of columns, given as rows (k, n), which the Householder vectors overwrite."""
    weights, triangle = np.zeros((2, len(columns), len(columns)))
    _reflect(columns, weights, triangle)
    return Reflectors(columns, weights, triangle)


@short_jit(fastmath=FASTMATH)
def _reflect(vectors: FloatArray, weights: FloatArray, triangle: FloatArray) -> None:
    """Replace columns, given as rows (k, n), by their Householder vectors, one after the other.

    T is accumulated as in LAPACK's dlarft (Schreiber, Van Loan 1989), transposed, as the reflectors are applied in
    forward order.
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


def apply_on_both_sides(matrix: FloatArray, reflectors: Reflectors) -> float:
    """Replace the lower triangle of a symmetric matrix K (n, n) by that of Q K Q^T.

    Returns the Frobenius norm of its block of contrasts.

    Q K Q^T is K - V B^T - B V^T for B = A - V (T V^T A) / 2, where A = K V T^T.
    """
    vectors = reflectors.vectors
    weighted, products = np.zeros((2, *vectors.shape))
    return float(
        np.sqrt(_apply_on_both_sides(matrix, vectors, reflectors.weights, weighted, products, np.empty(len(vectors))))
    )


def reml_criterion(
    transformed: FloatArray, target: FloatArray, errors: FloatArray, variance: float, factor: FloatArray
) -> tuple[float, FloatArray]:
    """-2 log of the restricted likelihood, up to a constant, and the weights C^-1 c of the contrasts.

    C is the transformed kernel plus the error covariance (the identity if none is given) times its variance. If C is
    not positive definite, the variance is multiplied by ten, up to three times; the criterion is infinite if that does
    not help. `factor` is overwritten.
    """
    for _ in range(4):
        _add_errors(transformed, errors, variance, factor)
        if factorise(factor):
            weights = target.copy()
            log_determinant, energy = _solve_factored(factor, weights)
            return log_determinant + len(target) * float(np.log(energy)), weights
        variance *= 10.0
    return np.inf, target


@short_jit(fastmath=FASTMATH)
def _add_errors(transformed: FloatArray, errors: FloatArray, variance: float, total: FloatArray) -> None:
    """Write the lower triangle of the covariance of the contrasts; without an error covariance it is the identity."""
    for i in range(total.shape[0]):
        row, kernel = total[i], transformed[QUADRATIC_TERMS + i]
        for j in range(i + 1):
            row[j] = kernel[QUADRATIC_TERMS + j]
        if errors.shape[0] > 0:
            added = errors[QUADRATIC_TERMS + i]
            for j in range(i + 1):
                row[j] += variance * added[QUADRATIC_TERMS + j]
        else:
            row[i] += variance


@jit(fastmath=FASTMATH)
def _apply_on_both_sides(
    matrix: FloatArray,
    vectors: FloatArray,
    weights: FloatArray,
    weighted: FloatArray,
    products: FloatArray,
    along: FloatArray,
) -> float:
    """Apply reflectors on both sides; return the sum of squares of the contrasts.

    Scratch arrays: `weighted` (k, n) and `products` (k, n), both zero, and `along` (k,).
    """
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


@inner_jit(fastmath=FASTMATH, inline="always")
def _multiply(matrix: FloatArray, columns: FloatArray, products: FloatArray) -> None:
    """Add the product of a symmetric matrix, given by its lower triangle, and columns (k, n) to `products` (k, n)."""
    for i in range(matrix.shape[0]):
        row = matrix[i]
        for c in range(columns.shape[0]):
            column, product, x, total = columns[c], products[c], columns[c, i], 0.0
            for j in range(i):
                total += row[j] * column[j]
                product[j] += row[j] * x
            product[i] += total + row[i] * x


@inner_jit(fastmath=FASTMATH, inline="always")
def _subtract_products(v: FloatArray, b: FloatArray, matrix: FloatArray) -> float:
    """Subtract V^T B + B^T V of (10, n) from the lower triangle; return the sum of squares of the contrasts' block."""
    squares = 0.0
    for i in range(matrix.shape[0]):
        row = matrix[i]
        for j in range(i + 1):
            for c in range(QUADRATIC_TERMS):
                row[j] -= v[c, i] * b[c, j] + b[c, i] * v[c, j]
        for j in range(QUADRATIC_TERMS, i + 1):
            squares += (1.0 if i == j else 2.0) * row[j] * row[j]
    return squares


@short_jit(fastmath=FASTMATH)
def _solve_factored(factor: FloatArray, right: FloatArray) -> tuple[float, float]:
    """Solve L L^T x = b in place for a lower triangle L; return log det L L^T and b^T x, which is positive."""
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


@short_jit(fastmath=FASTMATH)
def solve_trend(
    transformed: FloatArray,
    errors: FloatArray,
    variance: float,
    contrasts: FloatArray,
    triangle: FloatArray,
    quadratic: FloatArray,
) -> None:
    """Replace the first 10 transformed values by the coefficients of the quadratic.

    Back substitution with R after the contribution of the contrasts is subtracted.
    """
    for i in range(contrasts.shape[0]):
        for k in range(QUADRATIC_TERMS):
            quadratic[k] -= contrasts[i] * transformed[QUADRATIC_TERMS + i, k]
            if errors.shape[0] > 0:
                quadratic[k] -= contrasts[i] * variance * errors[QUADRATIC_TERMS + i, k]
    for k in range(QUADRATIC_TERMS - 1, -1, -1):
        for j in range(k + 1, QUADRATIC_TERMS):
            quadratic[k] -= triangle[k, j] * quadratic[j]
        quadratic[k] /= triangle[k, k]
