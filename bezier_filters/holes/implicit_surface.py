"""The surface that continues points and normals: the zero set of a polyharmonic spline in space.

f(x) = sum_j c_j |x - x_j|^p + q(x), with a quadratic q, is 0 at points of the surface and +-e at a distance e
along their normals; planes, spheres, cylinders and all other quadrics are reproduced. It is the best linear prediction
of an intrinsic random field of points with independent errors. The power p, 3 or 5, and the ratio of the errors
to the variation of the field have the largest restricted likelihood (REML), so that noise is
fitted and not followed.
"""

from dataclasses import dataclass
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.linalg.lapack import dgeqrf, dpotrf

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import run_kernel

TERMS = 10  # of a quadratic
FAST = {"contract", "reassoc", "nsz", "arcp"}
POWERS = (3, 5)
PILOT = 3  # one of so many points is enough to tell the power if that makes each value there more likely by e^(1/2)
CLEAN = 1e-13  # errors over variation where there is no noise: as little as the arithmetic can take
NOISE_RATIOS = 10.0 ** np.arange(-8.0, 1.0)  # the same for noisy points, of which one is chosen
SMALLEST_SLOPE = 0.3  # of f, which changes by one per unit of length at the points: with less slope there is no surface
# most steps to the surface, and the length of one, in scaled coordinates, after which it is reached
STEPS, SHORT_STEP = 8, 1e-4
# variance of the errors of the single values, in which the normals have a part, over that of the points
SIDE_ERRORS = 1.0


class ImplicitSurface(NamedTuple):
    """A function whose zeros are the surface, positive outside, in units of length."""

    origin: FloatArray  # (3,): of the coordinates (x - origin) / scale in which it is computed,
    scale: float  # and their unit, a length
    centers: FloatArray  # (3, n): x_j, scaled, coordinate by coordinate
    weights: FloatArray  # (n,): c_j, with the sign of the kernel: - for p = 5
    quadratic: FloatArray  # (10,): coefficients of 1, x, y, z, xx, xy, xz, yy, yz, zz
    power: int  # p
    noise_ratio: float  # errors over variation, `CLEAN` where the points are interpolated

    def values_and_gradients(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values, lengths (n,), and gradients (n, 3) at points (n, 3)."""
        values, gradients = np.zeros(len(points)), np.zeros((len(points), 3))
        _evaluate(self, self._scaled(points), values, gradients)
        return self.scale * values, gradients

    def project(self, points: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Move points along the gradient to the surface: where they end, (n, 3), and which of them are on it, (n,)."""
        scaled, found = self._scaled(points), np.zeros(len(points), dtype=np.bool_)
        run_kernel(_project, len(points), self, scaled, found)
        return self.origin + self.scale * scaled, found

    def _scaled(self, points: FloatArray) -> FloatArray:
        return (points - self.origin) / self.scale


def fit_implicit_surface(
    points: FloatArray,
    normals: FloatArray,
    offset: float,
    *,
    noisy: bool,
    others: FloatArray | None = None,
) -> ImplicitSurface | None:
    """Fit a surface to points (n, 3) and unit normals (n, 3); None if they are too few or do not determine it.

    The function is told its values at the offset, a length of about an edge, from the surface. Points that are not
    noisy are interpolated. `others` (k, 3) are further points, with unknown normals.
    """
    powers: tuple[int, ...] = POWERS
    if not noisy:
        pilot = _fits(points[::PILOT], normals[::PILOT], offset, POWERS, noisy=False, others=None)
        if len(pilot) == len(POWERS) and abs(pilot[0][0] - pilot[1][0]) > 3 * len(points[::PILOT]):
            powers = (min(pilot, key=itemgetter(0))[1].power,)
    fits = _fits(points, normals, offset, powers, noisy=noisy, others=others)
    return min(fits, key=itemgetter(0))[1] if fits else None


def _fits(
    points: FloatArray,
    normals: FloatArray,
    offset: float,
    powers: tuple[int, ...],
    *,
    noisy: bool,
    others: FloatArray | None,
) -> list[tuple[float, ImplicitSurface]]:
    """Surfaces with each of some powers, as far as possible, and -2 log of their likelihoods."""
    if 3 * len(points) < 20:
        return []
    origin = points.mean(axis=0)
    scale = float(np.sqrt(np.square(points - origin).sum(axis=1).max()))
    if not scale > 0.0:
        return []
    step = offset / scale
    surface = (points - origin) / scale
    further = np.empty((0, 3)) if others is None else (others - origin) / scale
    points = np.vstack([surface, surface + step * normals, surface - step * normals, further])
    centers = np.ascontiguousarray(points.T)
    values = np.concatenate([np.repeat([0.0, step, -step], len(surface)), np.zeros(len(further))])
    reflections = reflections_of(_quadratics(points))
    if np.abs(np.diag(reflections.triangle)).min() < 1e-12:
        return []
    turned = np.zeros((len(points), len(points)))  # of which the lower triangle is written
    factor = np.empty((len(points) - TERMS, len(points) - TERMS))
    errors = _error_covariance(len(surface), len(further)) if noisy else np.empty((0, 0))
    if noisy:
        turn(errors, reflections)
    target = reflections.applied(values)
    result = []
    for power in powers:
        _write_kernel(centers, power, turned)
        size = turn(turned, reflections)
        best: tuple[float, ImplicitSurface] | None = None
        for ratio in NOISE_RATIOS if noisy else (CLEAN,):
            solved = restricted_likelihood(turned, target[TERMS:], errors, ratio * size, factor)
            if solved is None or (best is not None and solved[0] >= best[0]):
                continue
            across = turned[TERMS:, :TERMS] + (ratio * size * errors[TERMS:, :TERMS] if noisy else 0.0)
            right = target[:TERMS] - solved[1] @ across
            quadratic = np.asarray(np.linalg.solve(reflections.triangle, right), dtype=np.float64)
            weights = reflections.undone(np.concatenate([np.zeros(TERMS), solved[1]]))
            best = solved[0], ImplicitSurface(origin, scale, centers, weights, quadratic, power, float(ratio))
        if best is not None:
            result.append(best)
    return result


def _error_covariance(count: int, others: int) -> FloatArray:
    """Covariance of the errors of the values at some points and beside them: what moves a point moves both."""
    common = block_diag(np.tile(np.eye(count), (3, 3)), np.eye(others))
    return np.asarray(common + SIDE_ERRORS * np.eye(3 * count + others), dtype=np.float64)


def _quadratics(points: FloatArray) -> FloatArray:
    """Monomials up to degree 2 at points (n, 3), shape (n, 10)."""
    x, y, z = points.T
    return np.stack([np.ones(len(points)), x, y, z, x * x, x * y, x * z, y * y, y * z, z * z], axis=1)


@jit(fastmath=FAST)
def _write_kernel(centers: FloatArray, power: int, matrix: FloatArray) -> None:
    """Write the lower triangle of |x_i - x_j|^p, with the sign that makes it conditionally positive definite."""
    xs, ys, zs = centers[0], centers[1], centers[2]
    for i in range(matrix.shape[0]):
        row, x, y, z = matrix[i], xs[i], ys[i], zs[i]
        for j in range(i + 1):
            dx, dy, dz = x - xs[j], y - ys[j], z - zs[j]
            square = dx * dx + dy * dy + dz * dz
            row[j] = square * np.sqrt(square) * (-square if power == 5 else 1.0)


@jit(fastmath=FAST)
def _evaluate(surface: ImplicitSurface, points: FloatArray, values: FloatArray, gradients: FloatArray) -> None:
    """Write scaled values and gradients at scaled points."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        values[i], gradients[i, 0], gradients[i, 1], gradients[i, 2] = _value_and_gradient(surface, x, y, z)


@jit(fastmath=FAST)
def _project(surface: ImplicitSurface, points: FloatArray, found: BoolArray, start: int, stop: int) -> None:
    """Move scaled points start .. stop-1 to the surface, and say which of them got there."""
    for i in range(start, stop):
        for _ in range(STEPS):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            value, gx, gy, gz = _value_and_gradient(surface, x, y, z)
            slope = np.sqrt(gx * gx + gy * gy + gz * gz)
            bounded = max(slope, SMALLEST_SLOPE)
            step = value / bounded
            points[i, 0], points[i, 1], points[i, 2] = (
                x - step / bounded * gx,
                y - step / bounded * gy,
                z - step / bounded * gz,
            )
            # Newton's steps shrink quadratically: after a short one the rest is shorter still.
            if abs(step) < SHORT_STEP and slope > SMALLEST_SLOPE:
                found[i] = True
                break


@inner_jit(fastmath=FAST)
def _value_and_gradient(surface: ImplicitSurface, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    q, centers, weights, power = surface.quadratic, surface.centers, surface.weights, surface.power
    value = q[0] + q[1] * x + q[2] * y + q[3] * z
    value += q[4] * x * x + q[5] * x * y + q[6] * x * z + q[7] * y * y + q[8] * y * z + q[9] * z * z
    gx = q[1] + 2.0 * q[4] * x + q[5] * y + q[6] * z
    gy = q[2] + q[5] * x + 2.0 * q[7] * y + q[8] * z
    gz = q[3] + q[6] * x + q[8] * y + 2.0 * q[9] * z
    xs, ys, zs = centers[0], centers[1], centers[2]
    for j in range(weights.shape[0]):
        dx, dy, dz = x - xs[j], y - ys[j], z - zs[j]
        square = dx * dx + dy * dy + dz * dz
        slope = weights[j] * np.sqrt(square) * (-square if power == 5 else 1.0)
        value += slope * square
        gx += power * slope * dx
        gy += power * slope * dy
        gz += power * slope * dz
    return value, gx, gy, gz


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
        np.copyto(factor, turned[TERMS:, TERMS:])
        if len(errors):
            factor += variance * errors[TERMS:, TERMS:]
        else:
            factor[np.diag_indices(len(factor))] += variance
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
