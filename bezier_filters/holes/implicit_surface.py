"""The surface that continues points and normals: the zero set of a polyharmonic spline in space.

f(x) = sum_j c_j |x - x_j|^p + q(x), with a quadratic q, is 0 at points of the surface and +-e at a distance e
along their normals; planes, spheres, cylinders and all other quadrics are reproduced. It is the best linear prediction
of an intrinsic random field of points with independent errors. The power p, 3 or 5, and the ratio of the errors
to the variation of the field have the largest restricted likelihood (REML), so that noise is
fitted and not followed.
"""

from collections.abc import Callable
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.holes.dense_rows import FAST
from bezier_filters.holes.restricted_likelihood import (
    TERMS,
    reflections_of,
    restricted_likelihood,
    subtract_contrasts,
    turn,
)
from bezier_filters.runtime.jit import inner_jit, jit, short_jit

POWERS = (3, 5)
PILOT = 3  # one of so many points is enough to tell the power if that makes each value there more likely by e^(1/2)
CLEAN = 1e-13  # errors over variation where there is no noise: as little as the arithmetic can take
NOISE_RATIOS = tuple(10.0**power for power in range(-8, 1))  # the same for noisy points, of which one is chosen
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
        _evaluate(self, (points - self.origin) / self.scale, values, gradients)
        return self.scale * values, gradients

    def project(self, points: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Move points along the gradient to the surface: where they end, (n, 3), and which of them are on it, (n,)."""
        moved, found = points.copy(), np.zeros(len(points), dtype=np.bool_)
        _project(self, moved, found)
        return moved, found


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
    further = np.empty((0, 3)) if others is None else others
    powers: tuple[int, ...] = POWERS
    if not noisy:
        pilot = _fits(points[::PILOT], normals[::PILOT], further[:0], offset, POWERS, noisy=False)
        if len(pilot) == len(POWERS) and abs(pilot[0][0] - pilot[1][0]) > 3 * len(points[::PILOT]):
            powers = (min(pilot, key=itemgetter(0))[1].power,)
    fits = _fits(points, normals, further, offset, powers, noisy=noisy)
    return min(fits, key=itemgetter(0))[1] if fits else None


def _fits(
    points: FloatArray, normals: FloatArray, others: FloatArray, offset: float, powers: tuple[int, ...], *, noisy: bool
) -> list[tuple[float, ImplicitSurface]]:
    """Surfaces with each of some powers, as far as possible, and -2 log of their likelihoods."""
    if 3 * len(points) < 20:
        return []
    count = 3 * len(points) + len(others)
    origin, centers, values, quadratics = np.empty(3), np.empty((3, count)), np.empty(count), np.empty((TERMS, count))
    scale = _place_values(points, normals, others, offset, origin, centers, values, quadratics)
    if not scale > 0.0:
        return []
    reflections = reflections_of(quadratics)
    if np.abs(reflections.triangle.diagonal()).min() < 1e-12:
        return []
    turned = np.empty((count, count))  # of which the lower triangle is written
    factor = np.empty((count - TERMS, count - TERMS))
    errors = _error_covariance(len(points), len(others)) if noisy else np.empty((0, 0))
    if noisy:
        turn(errors, reflections)
    target = reflections.applied(values)
    ratios, start, result = NOISE_RATIOS if noisy else (CLEAN,), len(NOISE_RATIOS) // 2 if noisy else 0, []
    for power in powers:
        _write_kernel(centers, power, turned)
        size = turn(turned, reflections)

        def solved(place: int, size: float = size) -> tuple[float, FloatArray]:
            return restricted_likelihood(turned, target[TERMS:], errors, ratios[place] * size, factor)

        start, (measure, contrasts) = _least(solved, len(ratios), start)
        if not np.isfinite(measure):
            continue
        quadratic, ratio = target[:TERMS].copy(), ratios[start]
        subtract_contrasts(turned, errors, ratio * size, contrasts, reflections.triangle, quadratic)
        weights = reflections.undone(np.concatenate([np.zeros(TERMS), contrasts]))
        result.append((measure, ImplicitSurface(origin, scale, centers, weights, quadratic, power, ratio)))
    return result


def _least(
    solved: Callable[[int], tuple[float, FloatArray]], count: int, start: int
) -> tuple[int, tuple[float, FloatArray]]:
    """Of so many places the one with the least first value, to which they fall and after which they rise; and both.

    It is looked for from a start, upwards first, as too small errors leave no solution.
    """
    place, best = start, solved(start)
    for step in (1, -1):
        while 0 <= place + step < count:
            other = solved(place + step)
            if other[0] > best[0] or (other[0] == best[0] and np.isfinite(best[0])):
                break
            place, best = place + step, other
        if place != start:
            break
    return place, best


def _error_covariance(count: int, others: int) -> FloatArray:
    """Covariance of the errors of the values at some points and beside them: what moves a point moves both."""
    common = block_diag(np.tile(np.eye(count), (3, 3)), np.eye(others))
    return np.asarray(common + SIDE_ERRORS * np.eye(3 * count + others), dtype=np.float64)


@short_jit(fastmath=FAST)
def _place_values(
    points: FloatArray,
    normals: FloatArray,
    others: FloatArray,
    offset: float,
    origin: FloatArray,
    centers: FloatArray,
    values: FloatArray,
    quadratics: FloatArray,
) -> float:
    """Write where values are known, scaled, and these: on the points, outside, inside, on the others; return the scale.

    `quadratics` (10, n) receives the monomials up to degree 2 there. Nothing but the origin is written for scale 0.
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


@short_jit(fastmath=FAST)
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
def _project(surface: ImplicitSurface, points: FloatArray, found: BoolArray) -> None:
    for i in range(points.shape[0]):
        found[i] = project_point(surface, points, i)


@inner_jit(fastmath=FAST, inline="always")
def project_point(surface: ImplicitSurface, points: FloatArray, i: int) -> bool:
    """Move a point to the surface, and say whether it got there."""
    origin, scale, found = surface.origin, surface.scale, False
    x, y, z = (points[i, 0] - origin[0]) / scale, (points[i, 1] - origin[1]) / scale, (points[i, 2] - origin[2]) / scale
    for _ in range(STEPS):
        value, gx, gy, gz = _value_and_gradient(surface, x, y, z)
        slope = np.sqrt(gx * gx + gy * gy + gz * gz)
        bounded = max(slope, SMALLEST_SLOPE)
        step = value / bounded
        x, y, z = x - step / bounded * gx, y - step / bounded * gy, z - step / bounded * gz
        # Newton's steps shrink quadratically: after a short one the rest is shorter still.
        found = abs(step) < SHORT_STEP and slope > SMALLEST_SLOPE
        if found:
            break
    points[i, 0], points[i, 1], points[i, 2] = origin[0] + scale * x, origin[1] + scale * y, origin[2] + scale * z
    return found


@inner_jit(fastmath=FAST, inline="always")
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
