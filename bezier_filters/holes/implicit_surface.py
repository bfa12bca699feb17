"""The surface that continues points and normals: the zero set of a polyharmonic spline in space.

f(x) = sum_j c_j |x - x_j|^p + q(x), with a quadratic q, is 0 at points of the surface and +-e at a distance e
along their normals; planes, spheres, cylinders and all other quadrics are reproduced. It is the best linear prediction
of an intrinsic random field of points with independent errors. The power p, 3 or 5, and the ratio of the errors
to the variation of the field have the largest restricted likelihood (REML), so that noise is
fitted and not followed.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, block_diag, cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dgeqrf
from scipy.spatial.distance import cdist

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.runtime.lean import lean_njit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks

POWERS = (3, 5)
TERMS = 10
"""Of a quadratic."""
CLEAN = 1e-13
"""Errors over variation where there is no noise: as little as the arithmetic can take."""
NOISE_RATIOS = 10.0 ** np.arange(-8.0, 1.0)
"""The same for noisy points, of which one is chosen."""
SMALLEST_SLOPE = 0.3
"""Of f, which changes by one per unit of length at the points: with less slope there is no surface."""
STEPS = 8
SIDE_ERRORS = 1.0
"""Variance of the errors of the single values, in which the normals have a part, over that of the points."""


@dataclass(frozen=True)
class ImplicitSurface:
    """A function whose zeros are the surface, positive outside, in units of length.

    Attributes
    ----------
    origin, scale : (3,) float64, float
        Centre and size of the coordinates (x - origin) / scale in which it is computed.
    centers : (n, 3) float64
        x_j, scaled.
    weights : (n,) float64
        c_j.
    quadratic : (10,) float64
        Coefficients of 1, x, y, z, xx, xy, xz, yy, yz, zz.
    power : int
        p.
    noise_ratio : float
        Errors over variation, `CLEAN` where the points are interpolated.
    """

    origin: FloatArray
    scale: float
    centers: FloatArray
    weights: FloatArray
    quadratic: FloatArray
    power: int
    noise_ratio: float

    def values_and_gradients(self, points: FloatArray, *, threads: int = 1) -> tuple[FloatArray, FloatArray]:
        """Values, lengths (n,), and gradients (n, 3) at points (n, 3)."""
        scaled = (points - self.origin) / self.scale
        values, gradients = np.zeros(len(points)), np.zeros((len(points), 3))

        def make_task() -> RangeTask:
            return lambda start, stop: _evaluate(
                scaled, self.centers, self.weights, self.quadratic, self.power, start, stop, values, gradients
            )

        run_in_chunks(make_task, len(points), threads=threads)
        return self.scale * values, gradients

    def project(self, points: FloatArray, *, threads: int = 1) -> tuple[FloatArray, BoolArray]:
        """Move points along the gradient to the surface.

        Returns
        -------
        (n, 3) float64, (n,) bool
            Where they end, and which of them are on the surface.
        """
        points, found = points.copy(), np.zeros(len(points), dtype=np.bool_)
        active = np.arange(len(points))
        for _ in range(STEPS):
            values, gradients = self.values_and_gradients(points[active], threads=threads)
            slopes = np.linalg.norm(gradients, axis=1)
            steps = values / np.maximum(slopes, SMALLEST_SLOPE)
            points[active] -= (steps / np.maximum(slopes, SMALLEST_SLOPE))[:, np.newaxis] * gradients
            # Newton's steps shrink quadratically: after a short one the rest is shorter still.
            found[active] = (np.abs(steps) < 1e-4 * self.scale) & (slopes > SMALLEST_SLOPE)
            active = active[~found[active]]
            if len(active) == 0:
                break
        return points, found


def fit_implicit_surface(
    points: FloatArray, normals: FloatArray, offset: float, *, noisy: bool, others: FloatArray | None = None
) -> ImplicitSurface | None:
    """Fit a surface to points (n, 3) and unit normals (n, 3).

    Parameters
    ----------
    points, normals : (n, 3) float64
        Where the surface is, and where its outside.
    offset : float
        Length e at which the function is told its values off the surface: about that of an edge.
    noisy : bool
        Whether the points have errors; otherwise they are interpolated.
    others : (k, 3) float64, optional
        Further points of the surface, with unknown normals.

    Returns
    -------
    ImplicitSurface or None
        None if there are too few points, or they do not determine the function.

    Examples
    --------
    >>> points = np.random.default_rng(0).normal(size=(30, 3))
    >>> points /= np.linalg.norm(points, axis=1, keepdims=True)
    >>> ball = fit_implicit_surface(points, points, 0.1, noisy=False)
    >>> on_it, found = ball.project(np.array([[0.9, 0.3, 0.2]]))
    >>> bool(found.all()), float(np.linalg.norm(on_it).round(3))
    (True, 1.0)
    """
    if 3 * len(points) < 20:
        return None
    origin = points.mean(axis=0)
    scale = float(np.sqrt(np.square(points - origin).sum(axis=1).max()))
    if not scale > 0.0:
        return None
    step = offset / scale
    surface = (points - origin) / scale
    further = np.empty((0, 3)) if others is None else (others - origin) / scale
    centers = np.vstack([surface, surface + step * normals, surface - step * normals, further])
    values = np.concatenate([np.repeat([0.0, step, -step], len(points)), np.zeros(len(further))])
    polynomials = _quadratics(centers)
    vectors, factors, triangle = _householder(polynomials)
    if np.abs(np.diag(triangle)).min() < 1e-12:
        return None
    target = _reflected(vectors, factors, values)
    errors = _turned(vectors, factors, _error_covariance(len(points), len(further))) if noisy else None
    best: tuple[float, ImplicitSurface] | None = None
    squares = cdist(centers, centers, "sqeuclidean")
    cubes = squares * np.sqrt(squares)
    for power in POWERS:
        sign = 1.0 if power == 3 else -1.0  # conditionally positive definite
        kernel = sign * cubes if power == 3 else sign * cubes * squares
        turned = _turned(vectors, factors, kernel)
        projected = turned[TERMS:, TERMS:]
        size = float(np.linalg.norm(projected))
        for ratio in NOISE_RATIOS if noisy else (CLEAN,):
            own_errors = None if errors is None else errors[TERMS:, TERMS:]
            solved = _restricted_likelihood(projected, target[TERMS:], own_errors, ratio * size)
            if solved is None or (best is not None and solved[0] >= best[0]):
                continue
            across = turned[:TERMS, TERMS:]
            if errors is not None:
                across = across + ratio * size * errors[:TERMS, TERMS:]
            rest = target[:TERMS] - across @ solved[1]
            quadratic = solve_triangular(triangle, rest)
            weights = _reflected(vectors, factors.T, np.concatenate([np.zeros(TERMS), solved[1]]))
            found = ImplicitSurface(origin, scale, centers, sign * weights, quadratic, power, float(ratio))
            best = solved[0], found
    return best[1] if best else None


def _householder(columns: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Reflections that turn k columns (n, k) into a triangle: V (n, k) and T (k, k) of I - V T V^T, and the triangle.

    In the directions that the first k axes do not take, polynomials vanish: the contrasts of REML.
    """
    factored, scales, _, _ = dgeqrf(columns)
    vectors = np.tril(factored, -1)
    np.fill_diagonal(vectors, 1.0)
    # T is the inverse of the upper triangle of V^T V with the diagonal 1 / tau (Puglisi 1992).
    inverse = np.triu(vectors.T @ vectors, 1)
    np.fill_diagonal(inverse, 1.0 / np.maximum(scales, 1e-300))
    count = columns.shape[1]
    return vectors, solve_triangular(inverse, np.eye(count)).T, np.triu(factored[:count])


def _reflected(vectors: FloatArray, weights: FloatArray, columns: FloatArray) -> FloatArray:
    """Columns (n, c), or one column (n,), after the reflections; after those in the reverse order with weights.T."""
    return columns - vectors @ (weights @ (vectors.T @ columns))


def _turned(vectors: FloatArray, weights: FloatArray, matrix: FloatArray) -> FloatArray:
    """A symmetric matrix K (n, n) in the reflected axes.

    With Q = I - V T V^T, Q K Q^T is K - V B^T - B V^T for B = A - V (T V^T A) / 2, where A = K V T^T.
    """
    half = matrix @ (vectors @ weights.T)
    half -= 0.5 * vectors @ (weights @ (vectors.T @ half))
    return np.asarray(matrix - np.hstack([vectors, half]) @ np.hstack([half, vectors]).T, dtype=np.float64)


def _error_covariance(count: int, others: int) -> FloatArray:
    """Covariance of the errors of the values at some points and beside them: what moves a point moves both."""
    common = block_diag(np.tile(np.eye(count), (3, 3)), np.eye(others))
    return np.asarray(common + SIDE_ERRORS * np.eye(3 * count + others), dtype=np.float64)


def _restricted_likelihood(
    covariance: FloatArray, target: FloatArray, errors: FloatArray | None, variance: float
) -> tuple[float, FloatArray] | None:
    """-2 log of the restricted likelihood, up to a constant, and the weights.

    Errors, independent ones if no covariance is given, are added with their variance, and with up to a thousand times
    as much if the matrix is not positive definite otherwise; None if it still is not.
    """
    for _ in range(4):
        try:
            matrix = np.array(covariance, order="F")
            if errors is None:
                np.fill_diagonal(matrix, matrix.diagonal() + variance)
            else:
                matrix += variance * errors
            factor = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
            break
        except LinAlgError:
            variance *= 10.0
    else:
        return None
    weights = cho_solve((factor, True), target, check_finite=False)
    energy = float(target @ weights)
    if not energy > 0.0:
        energy = np.finfo(np.float64).tiny
    return 2.0 * float(np.log(np.diag(factor)).sum()) + len(target) * float(np.log(energy)), weights


def _quadratics(points: FloatArray) -> FloatArray:
    """Monomials up to degree 2 at points (n, 3), shape (n, 10)."""
    x, y, z = points.T
    return np.stack([np.ones(len(points)), x, y, z, x * x, x * y, x * z, y * y, y * z, z * z], axis=1)


@lean_njit(fastmath={"contract", "reassoc", "nsz", "arcp"})
def _evaluate(
    points: FloatArray,
    centers: FloatArray,
    weights: FloatArray,
    quadratic: FloatArray,
    power: int,
    start: int,
    stop: int,
    values: FloatArray,
    gradients: FloatArray,
) -> None:
    """Write values and gradients at points start .. stop-1."""
    q = quadratic
    for i in range(start, stop):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        value = q[0] + q[1] * x + q[2] * y + q[3] * z
        value += q[4] * x * x + q[5] * x * y + q[6] * x * z + q[7] * y * y + q[8] * y * z + q[9] * z * z
        gx = q[1] + 2.0 * q[4] * x + q[5] * y + q[6] * z
        gy = q[2] + q[5] * x + 2.0 * q[7] * y + q[8] * z
        gz = q[3] + q[6] * x + q[8] * y + 2.0 * q[9] * z
        for j in range(centers.shape[0]):
            dx, dy, dz = x - centers[j, 0], y - centers[j, 1], z - centers[j, 2]
            square = dx * dx + dy * dy + dz * dz
            slope = weights[j] * np.sqrt(square) * (square if power == 5 else 1.0)
            value += slope * square
            gx += power * slope * dx
            gy += power * slope * dy
            gz += power * slope * dz
        values[i] = value
        gradients[i, 0], gradients[i, 1], gradients[i, 2] = gx, gy, gz
