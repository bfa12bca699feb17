"""The fit of one vertex to 150 digits, from its definition: what the kernels compute up to rounding.

It shares no code with the package. Third-order smoothness: the coefficient of s^a t^b, on the square around the
neighbourhood that is [-1, 1]^2 in s and t, weighs ((1 - alpha) / alpha)^2 / C(a + b, a) where a + b >= 3.
"""

from math import comb

import mpmath
import numpy as np
from mpmath import mpf

mpmath.mp.dps = 150
DEGREE = 3
EXPONENTS = [(a, b) for a in range(DEGREE + 1) for b in range(DEGREE + 1)]


def vector(values):
    return [mpf(float(value)) for value in values]


def minus(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def dot(a, b):
    return mpmath.fsum(x * y for x, y in zip(a, b, strict=True))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def unit(a):
    length = mpmath.sqrt(dot(a, a))
    return [x / length for x in a]


def vertex_normal(vertices, faces, vertex):
    """Normalised sum of the unit normals of the faces at a vertex."""
    total = [mpf(0)] * 3
    for face in faces[(faces == vertex).any(axis=1)]:
        a, b, c = (vector(vertices[i]) for i in face)
        normal = cross(minus(b, a), minus(c, a))
        if any(normal):
            total = [x + y for x, y in zip(total, unit(normal), strict=True)]
    return unit(total)


def neighbourhood(faces, vertex, rings):
    """A vertex and all within so many edges; faces that name a vertex twice have none."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    found = np.array([vertex])
    for _ in range(rings):
        found = np.union1d(found, faces[np.isin(faces, found).any(axis=1)])
    return [int(vertex), *found[found != vertex].tolist()]


def farthest_direction(edges, normal):
    """Direction of the edge that projects farthest; ValueError where others are as long, and a rule decides."""
    projected = [[x - dot(edge, normal) * n for x, n in zip(edge, normal, strict=True)] for edge in edges]
    projected.sort(key=lambda edge: dot(edge, edge))
    if len(projected) > 1 and dot(projected[-2], projected[-2]) > (1 - mpf("1e-5")) * dot(projected[-1], projected[-1]):
        raise ValueError("several neighbours are equally far")
    return unit(projected[-1])


def exact_fit(vertices, faces, vertex, rings, alpha):
    """Unit normal, k_min and k_max of the patch, its condition number, and what rounding is in proportion to."""
    z_axis = vertex_normal(vertices, faces, vertex)
    origin = vector(vertices[vertex])
    edges = [minus(vector(vertices[i]), origin) for i in neighbourhood(faces, vertex, rings)]
    x_axis = farthest_direction(
        [minus(vector(vertices[i]), origin) for i in neighbourhood(faces, vertex, 1)[1:]], z_axis
    )
    y_axis = cross(z_axis, x_axis)
    local = [(dot(edge, x_axis), dot(edge, y_axis), dot(edge, z_axis)) for edge in edges]
    radius = mpmath.sqrt(max(x * x + y * y for x, y, _ in local))
    rows = [[(x / radius) ** a * (y / radius) ** b for a, b in EXPONENTS] for x, y, _ in local]
    order = len(EXPONENTS)
    matrix = mpmath.matrix(order, order)
    right = mpmath.matrix(order, 1)
    weight = ((1 - mpf(float(alpha))) / mpf(float(alpha))) ** 2
    for i in range(order):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = mpmath.fsum(row[i] * row[j] for row in rows)
        a, b = EXPONENTS[i]
        if a + b >= 3:
            matrix[i, i] += weight / comb(a + b, a)
        right[i] = mpmath.fsum(row[i] * point[2] for row, point in zip(rows, local, strict=True))
    solution = mpmath.lu_solve(matrix, right)
    coefficient = dict(zip(EXPONENTS, solution, strict=True))
    p, q = coefficient[1, 0] / radius, coefficient[0, 1] / radius
    r, s, t = (
        2 * coefficient[2, 0] / radius**2,
        coefficient[1, 1] / radius**2,
        2 * coefficient[0, 2] / radius**2,
    )
    w = mpmath.sqrt(1 + p * p + q * q)
    normal = [(z - p * x - q * y) / w for x, y, z in zip(x_axis, y_axis, z_axis, strict=True)]
    mean = -((1 + q * q) * r - 2 * p * q * s + (1 + p * p) * t) / (2 * w**3)
    gaussian = (r * t - s * s) / w**4
    torsion = mpmath.sqrt(abs(mean**2 - gaussian))
    return normal, mean - torsion, mean + torsion, condition_number(matrix), shape(vertices, faces, vertex, local)


def shape(vertices, faces, vertex, local):
    """Largest distance of a neighbour, width of the neighbourhood, and 1 / sin of the sharpest angle at the vertex.

    The distance is measured in all directions of space, the width as the root mean square in the plane where that is
    least. Rounding turns the normals of faces with a sharp angle by the unit roundoff divided by its sine.
    """
    far = mpmath.sqrt(max(dot(point, point) for point in local))
    xx, xy, yy = (mpmath.fsum(p[i] * p[j] for p in local) / len(local) for i, j in ((0, 0), (0, 1), (1, 1)))
    width = mpmath.sqrt(max((xx * yy - xy * xy) / ((xx + yy) / 2 + mpmath.sqrt(((xx - yy) / 2) ** 2 + xy * xy)), 0))
    sharpest = mpf(1)
    for face in faces[(faces == vertex).any(axis=1)]:
        a, b, c = (vector(vertices[i]) for i in face)
        normal = cross(minus(b, a), minus(c, a))
        area = mpmath.sqrt(dot(normal, normal))
        if area:
            sharpest = max(sharpest, mpmath.sqrt(dot(minus(b, a), minus(b, a)) * dot(minus(c, a), minus(c, a))) / area)
    return far, width, sharpest


def condition_number(matrix):
    """sqrt(m sum_ij (L^-1)_ij^2 G_jj), where L is the lower triangle with L L^T = G."""
    order, lower, total = matrix.rows, mpmath.cholesky(matrix).tolist(), mpf(0)
    for j in range(order):
        column = [mpf(0)] * order  # of the inverse of L
        for i in range(j, order):
            column[i] = (int(i == j) - mpmath.fdot(lower[i][j:i], column[j:i])) / lower[i][i]
        total += matrix[j, j] * dot(column, column)
    return mpmath.sqrt(order * total)
