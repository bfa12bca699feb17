"""The texels of an image that the faces of a mesh cover in texture space.

A texel belongs to the face that contains its centre. Spans end where the row of centres crosses an edge, and both faces
of an edge compute the same crossing, so that no texel between them is left out or covered twice.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.errors import InvalidParameterError

CHUNK_TEXELS = 1 << 20  # texels of the bounding boxes of the faces that are covered at a time
# Largest area of all faces in texture space, in images: many times what charts that overlap on purpose need.
MAX_COVERINGS = 64.0


@dataclass(frozen=True)
class Texels:
    """The covered texels of a square image, each with the first of the faces that contain its centre."""

    size: int  # of the image: rows, and columns
    places: NDArray[np.int64]  # (k,): row * size + column
    faces: IntArray  # (k,)
    weights: FloatArray  # (k, 3): barycentric coordinates of the centre in its face
    overlapping: int  # number of texels whose centres several faces contain

    def mask(self) -> BoolArray:
        """Mask of the image, (size, size)."""
        mask = np.zeros(self.size * self.size, dtype=np.bool_)
        mask[self.places] = True
        return mask.reshape(self.size, self.size)


def cover_texels(coordinates: FloatArray, size: int) -> Texels:
    """Find the texels that faces cover, given the texture coordinates (m, 3, 2) of their corners.

    The first row of the image is the top of the texture, v = 1. Beyond 0 to 1 the texture repeats.

    >>> square = np.array([[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], [[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]]])
    >>> texels = cover_texels(square, 2)
    >>> texels.faces[np.argsort(texels.places)].tolist(), texels.overlapping
    ([1, 0, 0, 0], 0)
    """
    corners = coordinates * size
    corners[..., 1] = size - corners[..., 1]
    coverings = float(np.abs(area_determinants(corners)).sum()) / (2.0 * size * size)
    if coverings > MAX_COVERINGS:
        raise InvalidParameterError(
            f"texture_coordinates: the faces cover the image {coverings:.3g} times, expected {MAX_COVERINGS:g} times "
            "or less; a map needs a place of its own for every face"
        )
    first_face = np.full(size * size, -1, dtype=np.int32)
    overlaps = np.zeros(size * size, dtype=np.bool_)
    places, faces, weights = list[NDArray[np.int64]](), list[IntArray](), list[FloatArray]()
    for chunk in _chunks(corners):
        face, column, row = _texels_of(corners[chunk])
        place = (row % size) * size + column % size
        number = chunk[face].astype(np.int32)
        is_free = first_face[place] < 0
        first_face[place[is_free][::-1]] = number[is_free][::-1]  # of repeated places the last one counts
        is_first = is_free & (first_face[place] == number)
        overlaps[place[~is_first]] = True
        places.append(place[is_first])
        faces.append(number[is_first])
        centres = np.column_stack([column[is_first], row[is_first]]) + 0.5
        weights.append(_barycentric(corners[number[is_first]], centres))
    if not places:
        return Texels(size, np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, 3)), 0)
    return Texels(size, np.concatenate(places), np.concatenate(faces), np.concatenate(weights), int(overlaps.sum()))


def area_determinants(corners: FloatArray) -> FloatArray:
    """Twice the signed areas of triangles (m, 3, 2) in a plane, (m,): positive where counter-clockwise."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _chunks(corners: FloatArray) -> list[NDArray[np.int64]]:
    """Faces with an area, in their order, in groups whose bounding boxes have some `CHUNK_TEXELS`."""
    faces = np.flatnonzero(area_determinants(corners))
    boxes = np.ceil(np.ptp(corners[faces], axis=1)).prod(axis=1)
    group = (np.cumsum(boxes) // CHUNK_TEXELS).astype(np.int64)
    return np.split(faces, np.flatnonzero(np.diff(group)) + 1) if len(faces) else []


def _texels_of(corners: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Triangle (k,), column (k,) and row (k,) of all texels with their centre in one of the triangles (t, 3, 2)."""
    triangle, row = _expand(*_centres_between(corners[..., 1].min(axis=1), corners[..., 1].max(axis=1)))
    centre = row + 0.5
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        x, y, end_y, slope = _edge_lines(corners[:, a], corners[:, b])
        crosses = (y[triangle] <= centre) & (centre < end_y[triangle])
        at = triangle[crosses]
        crossing = x[at] + (centre[crosses] - y[at]) * slope[at]
        left[crosses] = np.minimum(left[crosses], crossing)
        right[crosses] = np.maximum(right[crosses], crossing)
    span, column = _expand(*_centres_between(left, right))
    return triangle[span], column, row[span]


def _edge_lines(starts: FloatArray, ends: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Start x and y, end y and slope dx / dy of edges, each (t,): the same for both faces of an edge."""
    swap = (starts[:, 1] > ends[:, 1]) | ((starts[:, 1] == ends[:, 1]) & (starts[:, 0] > ends[:, 0]))
    p, q = np.where(swap[:, np.newaxis], ends, starts), np.where(swap[:, np.newaxis], starts, ends)
    height = q[:, 1] - p[:, 1]
    slope = np.divide(q[:, 0] - p[:, 0], height, out=np.zeros(len(p)), where=height > 0.0)
    return p[:, 0], p[:, 1], q[:, 1], slope


def _centres_between(low: FloatArray, high: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First number k with ``low <= k + 1/2``, and how many of them are below ``high - 1/2``."""
    first, stop = (np.ceil(bound - 0.5).astype(np.int64) for bound in (low, high))
    return first, np.maximum(stop - first, 0)


def _expand(first: NDArray[np.int64], count: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and number of the ``count`` numbers from ``first`` on, of each row."""
    row = np.repeat(np.arange(len(first)), count)
    within = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    return row, first[row] + within


def _barycentric(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Barycentric coordinates (k, 3) of points (k, 2) in triangles (k, 3, 2); rounding leaves none below 0."""
    a, b, c = (corners[:, k] - points for k in range(3))
    areas = np.column_stack([p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((b, c), (c, a), (a, b))])
    shares = np.maximum(areas / area_determinants(corners)[:, np.newaxis], 0.0)
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def dilate(image: SingleArray, covered: BoolArray, padding: int) -> None:
    """Copy the nearest covered texel to those within `padding` texels of one, in place.

    Filters and mip-maps mix the texels at the rim of a chart with those outside of it.
    """
    if not padding or covered.all() or not covered.any():
        return
    distances, nearest = distance_transform_edt(~covered, return_indices=True)
    near = ~covered & (distances <= padding)
    image[near] = image[tuple(axis[near] for axis in nearest)]
