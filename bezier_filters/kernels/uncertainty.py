"""Standard errors of the geometry, from the factorisation that gave the fit.

Given the noise sigma, the coefficients have the posterior covariance sigma^2 G^-1, G being the
matrix of the normal equations with its prior. For a quantity whose derivatives by the
coefficients are g, the variance is sigma^2 |L^-1 g|^2 with the Cholesky factor L of G.
"""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.runtime.dense import dot
from bezier_filters.runtime.lean import inner_njit

SEEN = 5
"""Coefficients of which the geometry is a function: those of x, y, x^2, x y and y^2, eliminated last."""


class StandardErrors(NamedTuple):
    """Output arrays, one row per vertex; see `VertexGeometry`."""

    normal: FloatArray
    mean_curvature: FloatArray
    gaussian_curvature: FloatArray


@inner_njit()
def last_corner(factor: FloatArray, order: int, corner: FloatArray) -> None:
    """Copy the last `SEEN` rows and columns of a packed Cholesky factor, (order (order + 1) / 2,).

    With these coefficients eliminated last, they are the factor of their own inverse covariance.
    """
    first = order - SEEN
    for a in range(SEEN):
        for b in range(a + 1):
            corner[a * (a + 1) // 2 + b] = factor[(first + a) * (first + a + 1) // 2 + first + b]


@inner_njit()
def write_standard_errors(
    factor: FloatArray,
    noise: tuple[float, float],
    scale: float,
    derivatives: tuple[float, float, float, float, float],
    work: FloatArray,
    i: int,
    result: StandardErrors,
) -> None:
    """Write the standard errors of vertex i, by the derivatives of the graph formulas.

    Parameters
    ----------
    factor : (15,) float64
        Cholesky factor of the inverse covariance of the coefficients of x, y, x^2, x y and y^2 under
        unit noise, with reciprocal diagonal, from `last_corner`; the vertex is the origin.
    noise : (2,) tuple of float
        Standard deviation of the heights, a length, as far as it concerns the normal, or the curvatures.
    scale : float
        Parameters per length.
    derivatives : (5,) tuple of float
        z_x, z_y, z_xx, z_xy, z_yy at the vertex.
    work : (4, SEEN) float64
        Work space.
    i : int
        Row of the result.
    """
    p, q, r, s, t = derivatives
    w2 = 1.0 + p * p + q * q
    w3 = w2 * np.sqrt(w2)
    numerator = (1.0 + q * q) * r - 2.0 * p * q * s + (1.0 + p * p) * t
    gaussian = (r * t - s * s) / (w2 * w2)
    work[:] = 0.0
    # Times the noise at once, which is small where the derivatives are large: squares must not overflow.
    noise1 = noise[1] * scale
    noise2 = noise1 * scale
    # Rows: slope along x, slope along y, mean curvature, Gaussian curvature.
    work[0, 0] = scale
    work[1, 1] = scale
    work[2, 0] = noise1 * (2.0 * (p * t - q * s) / (2.0 * w3) - 3.0 * p * numerator / (2.0 * w3 * w2))
    work[2, 1] = noise1 * (2.0 * (q * r - p * s) / (2.0 * w3) - 3.0 * q * numerator / (2.0 * w3 * w2))
    work[2, 2] = 2.0 * noise2 * (1.0 + q * q) / (2.0 * w3)
    work[2, 3] = -noise2 * p * q / w3
    work[2, 4] = 2.0 * noise2 * (1.0 + p * p) / (2.0 * w3)
    work[3, 0] = -4.0 * noise1 * gaussian * p / w2
    work[3, 1] = -4.0 * noise1 * gaussian * q / w2
    work[3, 2] = 2.0 * noise2 * t / (w2 * w2)
    work[3, 3] = -2.0 * noise2 * s / (w2 * w2)
    work[3, 4] = 2.0 * noise2 * r / (w2 * w2)
    for k in range(4):
        row = work[k]
        for a in range(SEEN):
            below = factor[a * (a + 1) // 2 :]
            row[a] = (row[a] - dot(below, row, a)) * below[a]
    pp, pq, qq = dot(work[0], work[0], SEEN), dot(work[0], work[1], SEEN), dot(work[1], work[1], SEEN)
    # |dn|^2 = ((1 + q^2) dp^2 - 2 p q dp dq + (1 + p^2) dq^2) / w^4
    turned = ((1.0 + q * q) * pp - 2.0 * p * q * pq + (1.0 + p * p) * qq) / (w2 * w2)
    result.normal[i] = noise[0] * np.sqrt(turned)
    result.mean_curvature[i] = np.sqrt(dot(work[2], work[2], SEEN))
    result.gaussian_curvature[i] = np.sqrt(dot(work[3], work[3], SEEN))
