"""What lies between an old patch of a mesh and the new one with the same rim: volume and largest height."""

from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from bezier_filters.arrays import FloatArray, IntArray

POINTS_PER_BATCH = 256  # points whose distances are computed at once
SHARED_FOOT_TOLERANCE = 1e-9  # relative difference of the distances of faces that share the nearest point


def cone_volume(vertices: FloatArray, faces: IntArray, origin: FloatArray) -> float:
    """Signed volume between faces (m, 3) and a point, positive where they face away from it.

    That of two patches with the same rim differs by the volume between them, whatever the point.

    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> round(6.0 * cone_volume(corners, np.array([[1, 2, 3]]), corners[0]), 12)
    1.0
    """
    a, b, c = (vertices[faces[:, k]] - origin for k in range(3))
    return float(np.einsum("ij,ij->", np.cross(a, b), c)) / 6.0


def largest_height(points: FloatArray, vertices: FloatArray, faces: IntArray) -> float:
    """Largest distance of points (k, 3) from triangles, negative if that point lies behind them; 0 without points.

    The distance to the nearest vertex is an upper bound of that to the nearest face, so points are measured in the
    order of the former, until it is below the largest of the latter.

    >>> square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> largest_height(np.array([[0.2, 0.2, 0.1], [0.2, 0.2, -0.5]]), square, np.array([[0, 1, 2]]))
    -0.5
    """
    if not len(points) or not len(faces):
        return 0.0
    corners = vertices[faces]
    centers = corners.mean(axis=1)
    reach = float(np.linalg.norm(corners - centers[:, np.newaxis], axis=2).max())
    near = cKDTree(centers)
    bounds = cKDTree(vertices[np.unique(faces)]).query(points)[0]
    order = np.argsort(-bounds, kind="stable")
    largest = 0.0
    for first, last in pairwise([*range(0, len(order), POINTS_PER_BATCH), len(order)]):
        batch = order[first:last]
        if bounds[batch[0]] <= abs(largest):
            break
        for point, found in zip(
            points[batch], near.query_ball_point(points[batch], bounds[batch] + reach), strict=True
        ):
            height = _height(point, corners[found])
            largest = height if abs(height) > abs(largest) else largest
    return largest


def _height(point: FloatArray, corners: FloatArray) -> float:
    """Signed distance of a point from the nearest of some triangles (m, 3, 3)."""
    offsets = point - _nearest_points(point, corners)
    distances = np.linalg.norm(offsets, axis=1)
    nearest = distances <= distances.min() * (1.0 + SHARED_FOOT_TOLERANCE)
    # several triangles share the nearest point if it lies on an edge: their area vectors decide together
    a, b, c = corners[nearest].swapaxes(0, 1)
    area = np.cross(b - a, c - a).sum(axis=0)
    return float(np.copysign(distances.min(), offsets[nearest].mean(axis=0) @ area))


def _nearest_points(point: FloatArray, corners: FloatArray) -> FloatArray:
    """Nearest point of each triangle (m, 3, 3) to a point, (m, 3): its foot, or the nearest point of an edge."""
    starts, sides = corners, np.roll(corners, -1, axis=1) - corners
    squares = np.maximum(np.einsum("fki,fki->fk", sides, sides), 1e-300)
    along = np.clip(np.einsum("fki,fki->fk", point - starts, sides) / squares, 0.0, 1.0)
    on_edges = starts + along[:, :, np.newaxis] * sides
    nearest = np.linalg.norm(point - on_edges, axis=2).argmin(axis=1)
    result = on_edges[np.arange(len(corners)), nearest]
    normals = np.cross(sides[:, 0], sides[:, 1])
    lengths = np.einsum("fi,fi->f", normals, normals)
    inside = (np.einsum("fki,fi->fk", np.cross(sides, point - starts), normals) >= 0.0).all(axis=1) & (lengths > 0.0)
    heights = np.einsum("fi,fi->f", point - corners[:, 0], normals) / np.maximum(lengths, 1e-300)
    return np.asarray(np.where(inside[:, np.newaxis], point - heights[:, np.newaxis] * normals, result))
