"""Implicit surface through points with normals: the zero set of a polyharmonic spline in space.

    f(x) = sum_j c_j |x - x_j|^p + q(x),   p = 3 or 5,   q a quadratic polynomial

is 0 at the points and +-e at distance e along their normals. All quadrics are reproduced. f is the best linear unbiased
prediction (kriging) of an intrinsic random field with the generalised covariance +-|x - x'|^p from observations with
independent errors. The power p and the noise ratio (error variance over field variance) maximise the restricted
likelihood (REML), so that noisy points are smoothed, not interpolated. Points are projected to the zero set by Newton's
method along the gradient.
"""

from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.holes.dense_rows import FASTMATH
from bezier_filters.holes.restricted_likelihood import (
    QUADRATIC_TERMS,
    apply_on_both_sides,
    householder_reflectors,
    reml_criterion,
    solve_trend,
)
from bezier_filters.runtime.jit import inner_jit, jit, short_jit

KERNEL_POWERS = (3, 5)
# Every third point decides on the noise ratio, and on the power, if it raises the likelihood of each value there by a
# factor of e^(1/2). The ratio is a multiple of the norm of the kernel matrix, which grows with the number of points:
# all points, whose patches overlap and have common errors, count as much as a third of them. With all points in the
# search, it takes 1.8 times as long, and fills of noisy tori and ellipsoids are 5 to 18 % farther from the truth.
PILOT_STRIDE = 3
INTERPOLATION_RATIO = 1e-13  # noise ratio without noise: the smallest for which the matrix is numerically definite
NOISE_RATIOS = tuple(10.0**power for power in range(-8, 1))  # candidates for noisy points
MIN_SLOPE = 0.3  # |grad f| at which a projection may end; it is 1 at the points
MAX_PROJECTION_STEPS = 8  # of Newton's method
PROJECTION_TOLERANCE = 1e-4  # length of the last step, in scaled coordinates
OFFSET_ERROR_RATIO = 1.0  # variance of the independent error of each value over that shared by the values of a point


class ImplicitSurface(NamedTuple):
    """The function f in units of length, positive outside; its zero set is the surface."""

    origin: FloatArray  # (3,): origin of the scaled coordinates (x - origin) / scale
    scale: float  # their unit, a length
    centers: FloatArray  # (3, n): x_j in scaled coordinates, one row per coordinate
    weights: FloatArray  # (n,): c_j, with the sign of the kernel: - for p = 5
    quadratic: FloatArray  # (10,): coefficients of 1, x, y, z, xx, xy, xz, yy, yz, zz
    power: int  # p
    noise_ratio: float  # error variance over field variance; `INTERPOLATION_RATIO` if the points are interpolated

    def values_and_gradients(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values, lengths (n,), and gradients (n, 3) at points (n, 3)."""
        values, gradients = np.zeros(len(points)), np.zeros((len(points), 3))
        _evaluate(self, (points - self.origin) / self.scale, values, gradients)
        return self.scale * values, gradients

    def project(self, points: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Project points along the gradient to the surface: their feet, (n, 3), and whether each converged, (n,)."""
        feet, found = points.copy(), np.zeros(len(points), dtype=np.bool_)
        _project(self, feet, found)
        return feet, found


def fit_implicit_surface(
    points: FloatArray,
    normals: FloatArray,
    offset: float,
    *,
    noisy: bool,
    others: FloatArray | None = None,
) -> ImplicitSurface | None:
    """Fit a surface to points (n, 3) and unit normals (n, 3); None if they do not determine one.

    Each point gives three constraints: 0 there, and +-offset at this distance, a length of about an edge, along its
    normal. Points that are not noisy are interpolated. `others` (k, 3) are further points, with unknown normals.
    """
    further = np.empty((0, 3)) if others is None else others
    few = slice(None, None, PILOT_STRIDE)
    candidates = dict.fromkeys(KERNEL_POWERS, NOISE_RATIOS if noisy else (INTERPOLATION_RATIO,))
    pilot = _fit_powers(points[few], normals[few], further[:0], offset, candidates)
    if len(pilot) == len(KERNEL_POWERS):
        best = min(pilot, key=itemgetter(0))[1]
        decisive = abs(pilot[0][0] - pilot[1][0]) > 3 * len(points[few])
        candidates = {fit.power: (fit.noise_ratio,) for _, fit in pilot if fit.power == best.power or not decisive}
    fits = _fit_powers(points, normals, further, offset, candidates)
    return min(fits, key=itemgetter(0))[1] if fits else None


def _fit_powers(
    points: FloatArray,
    normals: FloatArray,
    others: FloatArray,
    offset: float,
    candidates: Mapping[int, tuple[float, ...]],
) -> list[tuple[float, ImplicitSurface]]:
    """Surfaces for each power, without the powers that have none, and the REML criterion of each.

    `candidates` has the noise ratios to choose from for each power, ascending.
    """
    if 3 * len(points) < 20:
        return []
    count = 3 * len(points) + len(others)
    origin, centers, values, quadratics = (
        np.empty(3),
        np.empty((3, count)),
        np.empty(count),
        np.empty((QUADRATIC_TERMS, count)),
    )
    scale = _write_constraints(points, normals, others, offset, origin, centers, values, quadratics)
    if not scale > 0.0:
        return []
    reflectors = householder_reflectors(quadratics)
    if np.abs(reflectors.triangle.diagonal()).min() < 1e-12:
        return []
    transformed = np.empty((count, count))  # only the lower triangle is written
    factor = np.empty((count - QUADRATIC_TERMS, count - QUADRATIC_TERMS))
    noisy = any(ratio > INTERPOLATION_RATIO for ratios in candidates.values() for ratio in ratios)
    errors = _error_covariance(len(points), len(others)) if noisy else np.empty((0, 0))
    if noisy:
        apply_on_both_sides(errors, reflectors)
    target = reflectors.apply(values)
    result = []
    for power, ratios in candidates.items():
        _write_kernel(centers, power, transformed)
        size = apply_on_both_sides(transformed, reflectors)

        def criterion(ratio: float, size: float = size) -> tuple[float, FloatArray]:
            return reml_criterion(transformed, target[QUADRATIC_TERMS:], errors, ratio * size, factor)

        found, (measure, contrasts) = _local_minimum(criterion, ratios)
        if not np.isfinite(measure):
            continue
        quadratic = target[:QUADRATIC_TERMS].copy()
        solve_trend(transformed, errors, found * size, contrasts, reflectors.triangle, quadratic)
        weights = reflectors.apply_transpose(np.concatenate([np.zeros(QUADRATIC_TERMS), contrasts]))
        result.append((measure, ImplicitSurface(origin, scale, centers, weights, quadratic, power, found)))
    return result


def _local_minimum(
    criterion: Callable[[float], tuple[float, FloatArray]], ratios: Sequence[float]
) -> tuple[float, tuple[float, FloatArray]]:
    """Ratio at a local minimum of the criterion, and its result there: a descent from the middle of the candidates.

    The minimum is that of the parabola through three candidates, in the logarithm of the ratio. The descent goes
    upwards first, as the matrix may be singular for small ratios.
    """
    place = len(ratios) // 2
    found = {place: criterion(ratios[place])}
    for step in (1, -1):
        while 0 <= place + step < len(ratios):
            found[place + step] = criterion(ratios[place + step])
            before, after = found[place][0], found[place + step][0]
            if after > before or (after == before and np.isfinite(before)):
                break
            place += step
    below, here, above = (found[k][0] if k in found else np.inf for k in (place - 1, place, place + 1))
    curvature = below - 2.0 * here + above
    if not (np.isfinite(curvature) and curvature > 0.0):
        return ratios[place], found[place]
    shift = 0.5 * (below - above) / curvature
    ratio = float(ratios[place] * (ratios[place + 1] / ratios[place]) ** shift)
    return ratio, criterion(ratio)


def _error_covariance(count: int, others: int) -> FloatArray:
    """Error covariance of the constraints: an error shared by the three values of each point, plus independent ones."""
    common = block_diag(np.tile(np.eye(count), (3, 3)), np.eye(others))
    return np.asarray(common + OFFSET_ERROR_RATIO * np.eye(3 * count + others), dtype=np.float64)


@short_jit(fastmath=FASTMATH)
def _write_constraints(
    points: FloatArray,
    normals: FloatArray,
    others: FloatArray,
    offset: float,
    origin: FloatArray,
    centers: FloatArray,
    values: FloatArray,
    quadratics: FloatArray,
) -> float:
    """Write the scaled centres and values of the constraints: on the points, outside, inside, on the others.

    `quadratics` (10, n) receives the monomials up to degree 2 at the centres. Returns the scale; if it is 0, only the
    origin is written.
    """
    count, square = points.shape[0], 0.0
    for axis in range(3):
        origin[axis] = 0.0
        for i in range(count):
            origin[axis] += points[i, axis] / count
    for i in range(count):
        x, y, z = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2]
        square = max(square, x * x + y * y + z * z)
    scale = np.sqrt(square)
    if not scale > 0.0:
        return float(scale)
    for j in range(centers.shape[1]):
        side = 0.0
        for axis in range(3):
            if j < 3 * count:
                side = 0.0 if j < count else 1.0 if j < 2 * count else -1.0
                x = points[j % count, axis] + side * offset * normals[j % count, axis]
            else:
                x = others[j - 3 * count, axis]
            centers[axis, j] = (x - origin[axis]) / scale
        values[j] = side * offset / scale
        x, y, z = centers[0, j], centers[1, j], centers[2, j]
        quadratics[0, j], quadratics[1, j], quadratics[2, j], quadratics[3, j] = 1.0, x, y, z
        quadratics[4, j], quadratics[5, j], quadratics[6, j] = x * x, x * y, x * z
        quadratics[7, j], quadratics[8, j], quadratics[9, j] = y * y, y * z, z * z
    return float(scale)


@short_jit(fastmath=FASTMATH)
def _write_kernel(centers: FloatArray, power: int, matrix: FloatArray) -> None:
    """Write the lower triangle of |x_i - x_j|^p, with the sign that makes it conditionally positive definite."""
    xs, ys, zs = centers[0], centers[1], centers[2]
    for i in range(matrix.shape[0]):
        row, x, y, z = matrix[i], xs[i], ys[i], zs[i]
        for j in range(i + 1):
            dx, dy, dz = x - xs[j], y - ys[j], z - zs[j]
            square = dx * dx + dy * dy + dz * dz
            row[j] = square * np.sqrt(square) * (-square if power == 5 else 1.0)


@jit(fastmath=FASTMATH)
def _evaluate(surface: ImplicitSurface, points: FloatArray, values: FloatArray, gradients: FloatArray) -> None:
    """Write scaled values and gradients at scaled points."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        values[i], gradients[i, 0], gradients[i, 1], gradients[i, 2] = _value_and_gradient(surface, x, y, z)


@jit(fastmath=FASTMATH)
def _project(surface: ImplicitSurface, points: FloatArray, found: BoolArray) -> None:
    for i in range(points.shape[0]):
        found[i] = project_point(surface, points, i)


@inner_jit(fastmath=FASTMATH, inline="always")
def project_point(surface: ImplicitSurface, points: FloatArray, i: int) -> bool:
    """Project a point to the surface by Newton's method along the gradient; return whether it converged."""
    origin, scale, found = surface.origin, surface.scale, False
    x, y, z = (points[i, 0] - origin[0]) / scale, (points[i, 1] - origin[1]) / scale, (points[i, 2] - origin[2]) / scale
    for _ in range(MAX_PROJECTION_STEPS):
        value, gx, gy, gz = _value_and_gradient(surface, x, y, z)
        slope = np.sqrt(gx * gx + gy * gy + gz * gz)
        bounded = max(slope, MIN_SLOPE)
        step = value / bounded
        x, y, z = x - step / bounded * gx, y - step / bounded * gy, z - step / bounded * gz
        # Newton's method converges quadratically: the error after a short step is far below the step.
        found = abs(step) < PROJECTION_TOLERANCE and slope > MIN_SLOPE
        if found:
            break
    points[i, 0], points[i, 1], points[i, 2] = origin[0] + scale * x, origin[1] + scale * y, origin[2] + scale * z
    return found


@inner_jit(fastmath=FASTMATH, inline="always")
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
