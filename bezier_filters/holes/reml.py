"""Restricted likelihood (REML) of splines: covariances in the directions that quadratics do not take."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgeqrf, dpotrf

from bezier_filters.arrays import FloatArray
from bezier_filters.runtime.jit import jit

TERMS = 10  # of a quadratic
FAST = {"contract", "reassoc", "nsz", "arcp"}


@dataclass(frozen=True)
class Reflections:
    """Q = I - V T V^T, reflections that turn k columns (n, k) into a triangle.

    In the directions that the first k axes do not take, polynomials vanish: the contrasts of REML.
    """

    vectors: FloatArray  # (n, k): V
    weights: FloatArray  # (k, k): T
    triangle: FloatArray  # (k, k): the first k rows that result

    def applied(self, column: FloatArray) -> FloatArray:
        """Q a of a column (n,)."""
        return column - self.vectors @ (self.weights @ (column @ self.vectors))

    def undone(self, column: FloatArray) -> FloatArray:
        """Q^T a of a column (n,)."""
        return column - self.vectors @ ((column @ self.vectors) @ self.weights)


def reflections_of(columns: FloatArray) -> Reflections:
    """The reflections of some columns (n, k)."""
    factored, scales, _, _ = dgeqrf(columns)
    vectors = np.tril(factored, -1)
    np.fill_diagonal(vectors, 1.0)
    # T is the inverse of the upper triangle of V^T V with the diagonal 1 / tau (Puglisi 1992).
    inverse = np.triu(vectors.T @ vectors, 1)
    np.fill_diagonal(inverse, 1.0 / np.maximum(scales, 1e-300))
    count = columns.shape[1]
    return Reflections(vectors, np.linalg.inv(inverse).T, np.triu(factored[:count]))


def turn(matrix: FloatArray, reflections: Reflections) -> float:
    """Replace the lower triangle of a symmetric matrix K (n, n) by that of Q K Q^T; return the norm of the contrasts.

    Q K Q^T is K - V B^T - B V^T for B = A - V (T V^T A) / 2, where A = K V T^T.
    """
    vectors, weights = reflections.vectors, reflections.weights
    half, columns = np.zeros((TERMS, len(matrix))), np.ascontiguousarray((vectors @ weights.T).T)
    _multiply(matrix, columns, half)
    half -= 0.5 * ((half @ vectors) @ weights.T) @ vectors.T
    return float(np.sqrt(_subtract_products(np.ascontiguousarray(vectors.T), half, matrix)))


def restricted_likelihood(
    turned: FloatArray, target: FloatArray, errors: FloatArray, variance: float, factor: FloatArray
) -> tuple[float, FloatArray] | None:
    """-2 log of the restricted likelihood, up to a constant, and the weights.

    Errors, independent ones if no covariance is given, are added with their variance, and with up to a thousand times
    as much if the matrix is not positive definite otherwise; None if it still is not. `factor` is overwritten.
    """
    for _ in range(4):
        _add_errors(turned, errors, variance, factor)
        # LAPACK's rows are columns here: its upper triangle is the lower one, and nothing is copied.
        if dpotrf(factor.T, lower=0, clean=0, overwrite_a=1)[1] == 0:
            weights = target.copy()
            log_determinant, energy = _solve_factored(factor, weights)
            return log_determinant + len(target) * float(np.log(energy)), weights
        variance *= 10.0
    return None


@jit(fastmath=FAST)
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


@jit(fastmath=FAST)
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


@jit()
def _add_errors(turned: FloatArray, errors: FloatArray, variance: float, total: FloatArray) -> None:
    """Write the lower triangle of the contrasts with errors, independent ones if no covariance is given."""
    for i in range(total.shape[0]):
        row = total[i]
        for j in range(i + 1):
            row[j] = turned[TERMS + i, TERMS + j]
        if errors.shape[0] == 0:
            row[i] += variance
        else:
            for j in range(i + 1):
                row[j] += variance * errors[TERMS + i, TERMS + j]


@jit(fastmath=FAST)
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
