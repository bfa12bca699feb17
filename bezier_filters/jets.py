"""Derivatives of fitted patches, and the geometry of the graph that they describe."""

from typing import NamedTuple

import numpy as np
from numba import njit

from bezier_filters.arrays import FloatArray
from bezier_filters.lanes import LANES, power_products


class GraphGeometry(NamedTuple):
    """Output arrays, one row per vertex; see `VertexGeometry`."""

    normals: FloatArray
    k_min: FloatArray
    k_max: FloatArray
    direction_min: FloatArray
    direction_max: FloatArray


@njit(cache=True, nogil=True, error_model="numpy")
def basis_derivatives(
    t: FloatArray, degree: int, factor: FloatArray, powers: FloatArray, lowered: FloatArray, out: FloatArray
) -> None:
    """Bernstein polynomials and their first two derivatives: out[r, i] for order r.

    The r-th derivative is the r-th difference of the basis of degree - r; `factor[r, k]` is
    its binomial coefficient times degree! / (degree - r)!.
    """
    out[:] = 0.0
    for r in range(3):
        power_products(t, degree - r, powers, lowered)
        for k in range(degree - r + 1):
            for e in range(r + 1):
                sign = 1.0 if (r - e) % 2 == 0 else -1.0
                times = 2.0 if r == 2 and e == 1 else 1.0
                for lane in range(LANES):
                    out[r, k + e, lane] += sign * times * factor[r, k] * lowered[k, lane]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def height_derivatives(heights: FloatArray, derivatives: FloatArray, size: int, jet: FloatArray) -> None:
    """Partial derivatives jet[r, s] of the height, r times by u and s times by v, r + s <= 2."""
    jet[:] = 0.0
    for i in range(size):
        for s in range(3):
            for lane in range(LANES):
                along_v = 0.0
                for j in range(size):
                    along_v += heights[i * size + j, lane] * derivatives[1, s, j, lane]
                for r in range(3 - s):
                    jet[r, s, lane] += derivatives[0, r, i, lane] * along_v


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def add_squared_residuals(
    heights: FloatArray,
    basis_u: FloatArray,
    basis_v: FloatArray,
    size: int,
    target: FloatArray,
    weight: FloatArray,
    residual: FloatArray,
) -> None:
    """Add the weighted squared distances of one point of each lane from its patch."""
    for lane in range(LANES):
        difference = -target[lane]
        for i in range(size):
            along_v = 0.0
            for j in range(size):
                along_v += heights[i * size + j, lane] * basis_v[j, lane]
            difference += basis_u[i, lane] * along_v
        residual[lane] += weight[lane] * difference * difference


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
