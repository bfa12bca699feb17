"""Derivatives of fitted polynomials, and the geometry of the graph that they describe."""

from typing import NamedTuple

import numpy as np
from numba import njit

from bezier_filters.arrays import FloatArray, IntArray


class GraphGeometry(NamedTuple):
    """Output arrays, one row per vertex; see `VertexGeometry`."""

    normals: FloatArray
    k_min: FloatArray
    k_max: FloatArray
    direction_min: FloatArray
    direction_max: FloatArray


@njit(cache=True, nogil=True, error_model="numpy")
def polynomial_derivatives(coefficients: FloatArray, exponents: IntArray, s: float, t: float, jet: FloatArray) -> None:
    """Partial derivatives jet[r, q] of a polynomial at (s, t), r times by s and q times by t, r + q <= 2.

    Parameters
    ----------
    coefficients : (m,) float64
        Coefficients of the monomials s^a t^b.
    exponents : (m, 2) int32
        The pairs (a, b).
    s, t : float
        Where the derivatives are wanted.
    jet : (3, 3) float64
        Receives them.
    """
    jet[:] = 0.0
    for k in range(exponents.shape[0]):
        a, b = exponents[k, 0], exponents[k, 1]
        factor_s = coefficients[k]
        for r in range(min(a, 2) + 1):
            factor = factor_s
            for q in range(min(b, 2 - r) + 1):
                jet[r, q] += factor * s ** (a - r) * t ** (b - q)
                factor *= b - q
            factor_s *= a - r


@njit(cache=True, nogil=True, error_model="numpy")
def write_graph_geometry(
    p: float, q: float, r: float, s: float, t: float, frame: FloatArray, i: int, result: GraphGeometry
) -> None:
    """Write normal, principal curvatures and directions of the graph z(x, y) for vertex i.

    Parameters
    ----------
    p, q, r, s, t : float
        z_x, z_y, z_xx, z_xy, z_yy at the vertex.
    frame : (9,) float64
        The x, y and z axes of the local frame in world coordinates.
    i : int
        Row of the result.
    """
    a = np.sqrt(1.0 + p * p)
    w = np.sqrt(1.0 + p * p + q * q)
    # Orthonormal tangents e1 = (1, 0, p) / a and e2 = normal x e1, then the symmetric shape
    # operator in that basis, with MeshLab's sign.
    shear = p * q / (a * a)
    c = w / a
    s11 = -r / (w * a * a)
    s12 = -(s - shear * r) / (w * w)
    s22 = -(t - 2.0 * shear * s + shear * shear * r) / (w * c * c)
    mean, difference = 0.5 * (s11 + s22), 0.5 * (s11 - s22)
    torsion = np.sqrt(difference * difference + s12 * s12)
    result.k_min[i] = mean - torsion
    result.k_max[i] = mean + torsion
    # Eigenvector of the larger curvature, by the formula that does not cancel.
    d1, d2 = (difference + torsion, s12) if difference >= 0.0 else (s12, torsion - difference)
    length = np.sqrt(d1 * d1 + d2 * d2)
    d1, d2 = (d1 / length, d2 / length) if length > 0.0 else (1.0, 0.0)
    for k in range(3):
        x, y, z = frame[k], frame[3 + k], frame[6 + k]
        e1 = (x + p * z) / a
        normal = (z - p * x - q * y) / w
        e2 = (y + q * z - shear * (x + p * z)) / c
        result.normals[i, k] = normal
        result.direction_max[i, k] = d1 * e1 + d2 * e2
        result.direction_min[i, k] = d1 * e2 - d2 * e1
