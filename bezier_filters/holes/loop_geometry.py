"""Closed polygons in space, and which points of a plane they enclose."""

import numpy as np
from scipy.spatial.distance import cdist

from bezier_filters.arrays import BoolArray, FloatArray

CHUNK = 512


def area_vector(loop: FloatArray) -> FloatArray:
    """Vector area of a closed polygon (k, 3): the normal by the right-hand rule, as long as the area, shape (3,)."""
    centred = loop - loop.mean(axis=0)
    result: FloatArray = 0.5 * np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    return result


def edge_lengths(loop: FloatArray) -> FloatArray:
    """Lengths of the edges of a closed polygon (k, 3); edge i begins at point i, shape (k,)."""
    result: FloatArray = np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1)
    return result


def diameter(points: FloatArray) -> float:
    """Largest distance between two of the points (k, 3)."""
    parts = (points[k : k + CHUNK] for k in range(0, len(points), CHUNK))
    return max((float(cdist(part, points).max()) for part in parts), default=0.0)


def plane_axes(normal: FloatArray) -> FloatArray:
    """Right-handed orthonormal frame whose third row points along a vector that is not zero, shape (3, 3).

    Examples
    --------
    >>> bool(np.allclose(plane_axes(np.array([0.0, 0.0, 2.0]))[2], [0, 0, 1]))
    True
    """
    z = normal / np.linalg.norm(normal)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def enclosed(points: FloatArray, polygon: FloatArray) -> BoolArray:
    """Whether points (n, 2) lie inside a closed polygon (k, 2), by the parity of crossings.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> enclosed(np.array([[0.5, 0.5], [1.5, 0.5]]), square).tolist()
    [True, False]
    """
    x, y = points[:, :1], points[:, 1:]
    following = np.roll(polygon, -1, axis=0)
    rise = following[:, 1] - polygon[:, 1]
    spans = (polygon[:, 1] <= y) != (following[:, 1] <= y)
    along = np.divide(y - polygon[:, 1], rise, out=np.zeros(spans.shape), where=rise != 0.0)
    crossing = polygon[:, 0] + along * (following[:, 0] - polygon[:, 0])
    result: BoolArray = np.count_nonzero(spans & (x < crossing), axis=1) % 2 == 1
    return result


def is_simple(polygon: FloatArray) -> bool:
    """Whether no two edges of a closed polygon (k, 2) cross or overlap, and none has length zero.

    Examples
    --------
    >>> is_simple(np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]))
    False
    """
    count = len(polygon)
    following = np.roll(polygon, -1, axis=0)
    for i in range(count):
        a, b = polygon[i], following[i]
        if not (a != b).any():
            return False
        # The edges that do not share a vertex with this one.
        stop = count if i > 0 else count - 1
        c, d = polygon[i + 2 : stop], following[i + 2 : stop]
        sides_of_others = _side(a, b, c) * _side(a, b, d)
        sides_of_own = _side(c, d, a) * _side(c, d, b)
        boxes_meet = (np.minimum(c, d) <= np.maximum(a, b)) & (np.maximum(c, d) >= np.minimum(a, b))
        if ((sides_of_others <= 0.0) & (sides_of_own <= 0.0) & boxes_meet.all(axis=1)).any():
            return False
    return True


def _side(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Positive where c lies to the left of the line from a to b."""
    ab, ac = b - a, c - a
    result: FloatArray = np.sign(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])
    return result
