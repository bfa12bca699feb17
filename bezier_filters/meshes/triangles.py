"""Small formulas of single triangles, for compiled code."""

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.runtime.lean import inner_njit


@inner_njit()
def area_vector(points: FloatArray, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Normal of the triangle (a, b, c), as long as twice its area."""
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@inner_njit()
def angle_parts(points: FloatArray, tip: int, left: int, right: int) -> tuple[float, float]:
    """Cosine and sine of the angle at a corner, times the lengths of its sides."""
    ux, uy, uz = (
        points[left, 0] - points[tip, 0],
        points[left, 1] - points[tip, 1],
        points[left, 2] - points[tip, 2],
    )
    vx, vy, vz = (
        points[right, 0] - points[tip, 0],
        points[right, 1] - points[tip, 1],
        points[right, 2] - points[tip, 2],
    )
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return ux * vx + uy * vy + uz * vz, np.sqrt(x * x + y * y + z * z)
