"""Derivatives of fitted polynomials, and the geometry of the graph that they describe."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.runtime.lean import inner_njit, lean_njit


class GraphGeometry(NamedTuple):
    """Output arrays, one row per vertex; see `VertexGeometry`."""

    normals: FloatArray
    k_min: FloatArray
    k_max: FloatArray
    direction_min: FloatArray
    direction_max: FloatArray
    extremality_min: FloatArray
    extremality_max: FloatArray
    displacements: FloatArray


@lean_njit()
def polynomial_derivatives(
    coefficients: FloatArray, exponents: IntArray, powers_s: FloatArray, powers_t: FloatArray, jet: FloatArray
) -> None:
    """Partial derivatives jet[r, q] of a polynomial, r times by s and q times by t, r + q <= 3.

    Parameters
    ----------
    coefficients : (m,) float64
        Coefficients of the monomials s^a t^b.
    exponents : (m, 2) int32
        The pairs (a, b).
    powers_s, powers_t : float64
        1, s, s^2, ... and 1, t, t^2, ... for the (s, t) where the derivatives are wanted.
    jet : (4, 4) float64
        Receives them; zero beyond third derivatives.
    """
    jet[:] = 0.0
    for k in range(exponents.shape[0]):
        a, b = exponents[k, 0], exponents[k, 1]
        factor_s = coefficients[k]
        for r in range(min(a, 3) + 1):
            factor = factor_s
            for q in range(min(b, 3 - r) + 1):
                jet[r, q] += factor * powers_s[a - r] * powers_t[b - q]
                factor *= b - q
            factor_s *= a - r


@lean_njit()
def rescale_jet(jet: FloatArray, scale_s: float, scale_t: float) -> None:
    """Turn derivatives by s and t into those by x = s / scale_s and y = t / scale_t, in place."""
    power_s = 1.0
    for r in range(4):
        power = power_s
        for q in range(4 - r):
            jet[r, q] *= power
            power *= scale_t
        power_s *= scale_s


@lean_njit()
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


@lean_njit()
def write_displacement(z: float, frame: FloatArray, i: int, result: GraphGeometry) -> None:
    """Write the vector from vertex i, the origin of the frame, to the graph."""
    for k in range(3):
        result.displacements[i, k] = z * frame[6 + k]


@lean_njit()
def write_extremalities(jet: FloatArray, frame: FloatArray, i: int, result: GraphGeometry) -> None:
    """Write the derivatives of the principal curvatures of vertex i along their own directions.

    The derivative of a principal curvature along its unit direction d is the covariant derivative
    of the second fundamental form, (D_d II)(d, d), because turning d changes II(d, d) only to
    second order. For a graph, whose Christoffel symbols are z_k z_ij / w^2 with
    w^2 = 1 + z_x^2 + z_y^2 (do Carmo, "Differential geometry of curves and surfaces", 4-3),

        (D_d II)(d, d) = (z_ddd - 3 z_dd (grad z . grad z_d) / w^2) / w.

    Parameters
    ----------
    jet : (4, 4) float64
        Derivatives of z by x and y at the vertex.
    frame : (9,) float64
        The x, y and z axes of the local frame in world coordinates.
    i : int
        Row of the result, whose curvatures and directions have been written.
    """
    result.extremality_min[i] = _extremality(jet, frame, result.direction_min[i])
    result.extremality_max[i] = _extremality(jet, frame, result.direction_max[i])


@inner_njit()
def _extremality(jet: FloatArray, frame: FloatArray, direction: FloatArray) -> float:
    """-(D_d II)(d, d) for one unit tangent, with MeshLab's sign of curvature."""
    dx = direction[0] * frame[0] + direction[1] * frame[1] + direction[2] * frame[2]
    dy = direction[0] * frame[3] + direction[1] * frame[4] + direction[2] * frame[5]
    slope_x = jet[2, 0] * dx + jet[1, 1] * dy
    slope_y = jet[1, 1] * dx + jet[0, 2] * dy
    second = slope_x * dx + slope_y * dy
    third = dx * dx * (jet[3, 0] * dx + 3.0 * jet[2, 1] * dy) + dy * dy * (3.0 * jet[1, 2] * dx + jet[0, 3] * dy)
    w2 = 1.0 + jet[1, 0] * jet[1, 0] + jet[0, 1] * jet[0, 1]
    return float(-(third - 3.0 * second * (jet[1, 0] * slope_x + jet[0, 1] * slope_y) / w2) / np.sqrt(w2))
