"""Positions of vertices on the surface of the patches, where each may be given by places of several faces.

At a sharp edge the sides have surfaces of their own. They meet where their tangent planes at the places do: the edge of
a cylinder lies on the plane of its lid and on the cylinder, though the lid alone would leave it on the chord.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.patch_surface.projection import ON_FACE
from bezier_filters.patch_surface.surface import Surface, SurfacePoints
from bezier_filters.runtime.parallel import Progress

# Length of the mean normal below which places are on sides of a sharp edge: that of normals 10 degrees apart. Positions
# of places that are nearly tangential are averaged.
MAX_MEAN_NORMAL = float(np.cos(np.radians(5.0)))
MIN_MEETING = 0.04  # least eigenvalue, over the largest one, of the normals' matrix: two planes that meet at 23 degrees
# Distance from a face, in its longest edges, beyond which a place of the surface is wrong, in addition to the noise. An
# arc over 90 degrees is 0.2 edges from its chord.
MAX_HEIGHT, MAX_NOISE_HEIGHT = 0.5, 4.0


@dataclass(frozen=True)
class Positions:
    """Positions of vertices on a surface."""

    points: FloatArray  # (n, 3)
    on_face: BoolArray  # (n,): whether there is no surface, and the position is on a face
    curvatures: FloatArray  # (n,): largest absolute principal ones of all places


def find_positions(
    surface: Surface,
    owner: IntArray,
    faces: IntArray,
    coordinates: FloatArray,
    n: int,
    progress: Progress | None = None,
) -> Positions:
    """Positions of n vertices, given for each of q places the vertex, the face and the coordinates (q, 2).

    Vertices without places are at the origin.
    """
    found = surface.evaluate(faces, coordinates, progress=progress)
    points, own, lost = check_places(surface, found)
    curvatures = np.zeros(n)
    np.maximum.at(curvatures, owner, own)
    return Positions(meeting_points(points, found.normals, owner, n), np.bincount(owner, lost, n) > 0, curvatures)


def check_places(surface: Surface, found: SurfacePoints) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Positions (q, 3) of places, their largest absolute curvatures (q,), and whether they are on faces (q,).

    They are where the surface is missing or far from the face. The largest curvature is that of a circle whose diameter
    is the longest edge of the face: the mesh does not show a larger one.
    """
    corners = surface.mesh.vertices[surface.mesh.faces[found.faces]]
    weights = np.column_stack([1.0 - found.coordinates.sum(axis=1), found.coordinates])
    flat = np.einsum("qk,qkd->qd", weights, corners)
    longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    limit = MAX_HEIGHT * longest + MAX_NOISE_HEIGHT * (surface.geometry.noise_sigma or 0.0)
    lost = (found.outcome == ON_FACE) | ~(np.linalg.norm(found.points - flat, axis=1) < limit)
    curvature = np.maximum(np.abs(found.k_min), np.abs(found.k_max))
    curvature = np.where(lost, 0.0, np.minimum(curvature, 2.0 / np.maximum(longest, 1e-300)))
    return np.where(lost[:, np.newaxis], flat, found.points), curvature, lost


def find_vertices(surface: Surface) -> Positions:
    """Positions of the vertices of the mesh."""
    faces, corners = surface.mesh.faces, np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    rows, coordinates = np.repeat(np.arange(len(faces), dtype=np.int32), 3), np.tile(corners, (len(faces), 1))
    return find_positions(surface, faces.ravel(), rows, coordinates, surface.mesh.vertex_count)


def meeting_points(points: FloatArray, normals: FloatArray, owner: IntArray, n: int) -> FloatArray:
    """Where the planes with given points and normals (q, 3) meet, nearest to the mean of the points, for n owners.

    >>> meeting_points(np.array([[0.0, 0, 0], [0, 0, 1]]), np.array([[1.0, 0, 0], [0, 0, 1]]), np.array([0, 0]), 1)
    array([[0., 0., 1.]])
    """
    count = np.maximum(np.bincount(owner, minlength=n), 1)[:, np.newaxis]
    means = _sums(points, owner, n) / count
    mean_normals = _sums(normals, owner, n) / count
    sharp = np.linalg.norm(mean_normals, axis=1) < MAX_MEAN_NORMAL
    rows = np.flatnonzero(sharp[owner])
    if not len(rows):
        return means
    number = np.cumsum(sharp) - 1
    k, own = int(sharp.sum()), number[owner[rows]]
    n_, heights = normals[rows], np.einsum("qd,qd->q", normals[rows], points[rows] - means[owner[rows]])
    matrix = _sums(np.einsum("qi,qj->qij", n_, n_).reshape(-1, 9), own, k).reshape(-1, 3, 3)
    right = _sums(n_ * heights[:, np.newaxis], own, k)
    means[sharp] += np.einsum("kij,kj->ki", np.linalg.pinv(matrix, rcond=MIN_MEETING, hermitian=True), right)
    return means


def _sums(values: FloatArray, owner: IntArray, n: int) -> FloatArray:
    """Sums (n, c) of the rows of values (q, c) by owner."""
    return np.stack([np.bincount(owner, values[:, c], n) for c in range(values.shape[1])], axis=1)
