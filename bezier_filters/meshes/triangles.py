"""Formulas for triangles: for single ones in compiled code, and for arrays."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.runtime.jit import inner_jit


def area_vectors(points: FloatArray, faces: IntArray) -> FloatArray:
    """Normals of triangles, (m, 3), with twice their areas as lengths."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


@inner_jit()
def area_vector(points: FloatArray, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Normal of the triangle (a, b, c), with twice its area as length."""
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@inner_jit()
def unit_normal(points: FloatArray, a: int, b: int, c: int) -> tuple[float, float, float, float]:
    """Unit normal of the triangle (a, b, c), zero if its area is zero, and twice its area."""
    x, y, z = area_vector(points, a, b, c)
    twice = np.sqrt(x * x + y * y + z * z)
    if twice == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    return x / twice, y / twice, z / twice, twice


@inner_jit()
def angle_parts(points: FloatArray, tip: int, left: int, right: int) -> tuple[float, float]:
    """Dot product and length of the cross product of the sides at a corner; the latter is twice the area."""
    x, y, z = area_vector(points, tip, left, right)
    cosine = 0.0
    for axis in range(3):
        cosine += (points[left, axis] - points[tip, axis]) * (points[right, axis] - points[tip, axis])
    return cosine, np.sqrt(x * x + y * y + z * z)


@inner_jit()
def cotangent_and_area(points: FloatArray, tip: int, left: int, right: int) -> tuple[float, float]:
    """Cotangent of the angle at a corner, very large where the area is zero, and the area."""
    cosine, twice = angle_parts(points, tip, left, right)
    return cosine / max(twice, 1e-300), 0.5 * twice


@inner_jit()
def cosine_between(points: FloatArray, a: int, b: int, c: int, d: int, e: int, f: int, without_area: float) -> float:
    """Cosine of the angle between the normals of triangles (a, b, c) and (d, e, f), `without_area` if one is zero."""
    x, y, z = area_vector(points, a, b, c)
    u, v, w = area_vector(points, d, e, f)
    lengths = np.sqrt(x * x + y * y + z * z) * np.sqrt(u * u + v * v + w * w)
    return float((x * u + y * v + z * w) / lengths) if lengths > 0.0 else without_area


@inner_jit()
def has_corner(faces: IntArray, f: int, i: int) -> bool:
    """Whether vertex i is a corner of face f."""
    return bool(faces[f, 0] == i or faces[f, 1] == i or faces[f, 2] == i)


@inner_jit()
def next_corner(faces: IntArray, f: int, i: int) -> int:
    """The vertex after vertex i in face f."""
    return int(faces[f, 1] if faces[f, 0] == i else faces[f, 2] if faces[f, 1] == i else faces[f, 0])


@inner_jit()
def edge_length(points: FloatArray, a: int, b: int) -> float:
    """Distance between two points."""
    x, y, z = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    return float(np.sqrt(x * x + y * y + z * z))


@inner_jit()
def longest_squared(vertices: FloatArray, faces: IntArray, f: int) -> float:
    """Squared length of the longest edge of a face."""
    result = 0.0
    for k in range(3):
        i, j = faces[f, k], faces[f, (k + 1) % 3]
        squared = 0.0
        for axis in range(3):
            squared += (vertices[i, axis] - vertices[j, axis]) ** 2
        result = max(result, squared)
    return result
