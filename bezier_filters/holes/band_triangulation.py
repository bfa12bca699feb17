"""Triangulation of a band between two loops, without new vertices.

Each triangle has an edge of one loop and its third corner on the other. The second loop is moved onto the first: to the
same centre, and by the smallest rotation to the same plane. Among all bands with the connection that is shortest then,
the one with the least sum of squared lengths of its connections is found by dynamic programming in O(k l). In place,
the shortest connections, or the least area (Fuchs, Kedem, Uselton, "Optimal surface reconstruction from planar
contours", CACM 1977), may give two fans where the loops are far apart or tilted.
"""

import numpy as np
from scipy.spatial.distance import cdist

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.loops import plane_axes, vector_area
from bezier_filters.holes.refinement import is_listed, sort_pairs
from bezier_filters.runtime.jit import jit, short_jit

MIN_TURN_COSINE = -0.999  # cosine of an angle between planes up to which the smallest rotation has a certain axis


def triangulate_band(points: FloatArray, first: IntArray, second: IntArray, existing: IntArray) -> IntArray | None:
    """Triangles (k + l, 3) between two loops, rows of points, or None if there are none.

    Both loops run in the direction of the triangles, so they have opposite directions seen along the band. No
    connection is an existing edge, pairs of rows (p, 2).

    >>> around = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    >>> points = np.vstack([np.column_stack([around, np.full(4, height)]) for height in (0.0, 1.0)])
    >>> none = np.empty((0, 2), dtype=np.int32)
    >>> triangulate_band(points, np.arange(4), np.arange(7, 3, -1), none).shape
    (8, 3)
    """
    second = second[::-1]
    one, other = points[first], points[second]
    costs = cdist(one, _move_onto(one, other), "sqeuclidean")
    _forbid(first, second, sort_pairs(existing.astype(np.int32)), costs)
    i, j = np.unravel_index(int(np.argmin(costs)), costs.shape)
    # both loops begin and end at the shortest connection
    path, opposite = (np.append(np.roll(loop, -k), loop[k]).astype(np.int32) for loop, k in ((first, i), (second, j)))
    steps = np.zeros((len(path), len(opposite)), dtype=np.bool_)
    costs = np.roll(costs, (-int(i), -int(j)), axis=(0, 1))
    if not np.isfinite(_find_cheapest(costs, np.empty((2, len(opposite))), steps)):
        return None
    faces = np.empty((len(path) + len(opposite) - 2, 3), dtype=np.int32)
    _collect_band(path, opposite, steps, faces)
    return faces


def _move_onto(loop: FloatArray, other: FloatArray) -> FloatArray:
    """Move another loop to the centre and, by the smallest rotation, to the plane of a loop; both run alike."""
    center, place = loop.mean(axis=0), other.mean(axis=0)
    areas = np.array([vector_area(loop), vector_area(other)])
    lengths = np.linalg.norm(areas, axis=1)
    if not lengths.all():
        return np.asarray(other - place + center)
    normal, own = areas / lengths[:, np.newaxis]
    cosine = float(normal @ own)
    if cosine > MIN_TURN_COSINE:
        x, y, z = np.cross(own, normal)
        turn = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rotation = np.eye(3) + turn + turn @ turn / (1.0 + cosine)
    else:  # half a turn, as of a handle between two holes of a plane: about the axis across the handle
        axis = np.cross(normal, center - place)
        length = np.linalg.norm(axis)
        axis = axis / length if length > 0.0 else plane_axes(normal)[0]
        rotation = 2.0 * np.outer(axis, axis) - np.eye(3)
    return np.asarray((other - place) @ rotation.T + center)


@short_jit()
def _forbid(first: IntArray, second: IntArray, existing: IntArray, costs: FloatArray) -> None:
    """Make connections infinitely expensive that are existing edges, or join a vertex to itself."""
    for i in range(first.shape[0]):
        for j in range(second.shape[0]):
            if first[i] == second[j] or is_listed(existing, first[i], second[j]):
                costs[i, j] = np.inf


@jit()
def _find_cheapest(costs: FloatArray, least: FloatArray, steps: BoolArray) -> float:
    """Cost of the cheapest band, and whether the triangle before each connection has its edge on the first loop.

    `costs` (k, l) are those of connections, `steps` has the shape (k + 1, l + 1). `least` (2, l + 1) is scratch.
    """
    k, m = costs.shape
    for i in range(k + 1):
        for j in range(m + 1):
            before = 0.0 if i == 0 and j == 0 else np.inf
            if i > 0:
                before, steps[i, j] = least[(i - 1) % 2, j], True
            if j > 0 and least[i % 2, j - 1] < before:
                before, steps[i, j] = least[i % 2, j - 1], False
            least[i % 2, j] = before + costs[i % k, j % m]
    return float(least[k % 2, m])


@short_jit()
def _collect_band(one: IntArray, other: IntArray, steps: BoolArray, faces: IntArray) -> None:
    """Write the triangles of the cheapest band, from its end."""
    i, j = one.shape[0] - 1, other.shape[0] - 1
    for f in range(faces.shape[0]):
        faces[f, 2] = other[j] if steps[i, j] else one[i]
        if steps[i, j]:
            faces[f, 0], faces[f, 1] = one[i - 1], one[i]
            i -= 1
        else:
            faces[f, 0], faces[f, 1] = other[j], other[j - 1]
            j -= 1
