"""Triangles that cut each other."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.triangles import area_vector, cosine_between, has_corner
from bezier_filters.runtime.jit import inner_jit, jit

FOLDED = -0.9999  # cosine of the angle between two faces on one edge from which down they lie on each other


def faces_in_boxes(vertices: FloatArray, faces: IntArray, low: FloatArray, high: FloatArray) -> Rows:
    """Faces whose bounding box meets each of some boxes between corners (b, 3): rows of ascending indices."""
    # Sorted by where they begin along an axis, the boxes that a face may meet there follow each other.
    axis = int(np.ptp(low, axis=0).argmax()) if len(low) else 0
    order = np.argsort(low[:, axis], kind="stable").astype(np.int32)
    begins, ends = low[order, axis], np.maximum.accumulate(high[order, axis])
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    least, most = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    first = np.searchsorted(ends, least[:, axis]).astype(np.int32)
    stop = np.searchsorted(begins, most[:, axis], side="right").astype(np.int32)
    boxes = _Boxes(low, high, order, first, stop)
    # Twice: first the faces of each box are counted, then they are listed.
    counts, indptr = np.zeros(len(low), dtype=np.int32), np.zeros(len(low) + 1, dtype=np.int32)
    _collect(least, most, boxes, counts, indptr, np.empty(0, dtype=np.int32))
    np.cumsum(counts, out=indptr[1:])
    indices = np.empty(indptr[-1], dtype=np.int32)
    _collect(least, most, boxes, np.zeros_like(counts), indptr, indices)
    return Rows(indptr, indices)


class _Boxes(NamedTuple):
    """Boxes, and which of them each face may meet: entries first .. stop-1 of their order."""

    low: FloatArray
    high: FloatArray
    order: IntArray
    first: IntArray
    stop: IntArray


@jit()
def _collect(
    least: FloatArray, most: FloatArray, boxes: _Boxes, counts: IntArray, indptr: IntArray, indices: IntArray
) -> None:
    """Count the faces in every box, by their least and most coordinates, and list them if there is room.

    `counts` is zero at first.
    """
    for f in range(least.shape[0]):
        for q in range(boxes.first[f], boxes.stop[f]):
            box = boxes.order[q]
            meets = True
            for axis in range(3):
                meets &= least[f, axis] <= boxes.high[box, axis] and most[f, axis] >= boxes.low[box, axis]
            if meets:
                if indices.shape[0] > 0:
                    indices[indptr[box] + counts[box]] = f
                counts[box] += 1


def cut_faces(vertices: FloatArray, faces: IntArray, new: int) -> BoolArray:
    """Which of the last `new` faces cut any other face, or lie folded on one that shares an edge, (new,).

    Faces that only touch do not cut.

    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [2, 2, 0]])
    >>> cut_faces(points, np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int32), 1)
    array([ True])
    """
    first = len(faces) - new
    result = np.zeros(new, dtype=np.bool_)
    corners = vertices[faces[first:]]
    near = faces_in_boxes(vertices, faces, corners.min(axis=1), corners.max(axis=1))
    _find_cuts(vertices, faces, near.indptr, near.indices, first, result)
    return result


@jit()
def _find_cuts(
    vertices: FloatArray, faces: IntArray, near_ptr: IntArray, near: IntArray, first: int, result: BoolArray
) -> None:
    """Mark the faces from the first on that cut another one among those near them."""
    for q in range(result.shape[0]):
        for p in range(near_ptr[q], near_ptr[q + 1]):
            if near[p] != first + q and _cut(vertices, faces, first + q, near[p]):
                result[q] = True
                break


@inner_jit()
def _cut(vertices: FloatArray, faces: IntArray, f: int, g: int) -> bool:
    """Whether two faces cut each other."""
    shared = 0
    for k in range(3):
        for j in range(3):
            shared += faces[f, k] == faces[g, j]
    if shared == 3:
        return True
    if shared == 2:
        return _lie_on_each_other(vertices, faces, f, g)
    return _edge_pierces(vertices, faces, f, g) or _edge_pierces(vertices, faces, g, f)


@inner_jit()
def _edge_pierces(vertices: FloatArray, faces: IntArray, f: int, g: int) -> bool:
    """Whether an edge of face f that does not touch face g goes through it."""
    for k in range(3):
        a, b = faces[f, k], faces[f, (k + 1) % 3]
        if has_corner(faces, g, a) or has_corner(faces, g, b):
            continue
        if _pierces(vertices, a, b, faces[g, 0], faces[g, 1], faces[g, 2]):
            return True
    return False


@inner_jit()
def _lie_on_each_other(vertices: FloatArray, faces: IntArray, f: int, g: int) -> bool:
    """Whether two faces on one edge are folded on each other."""
    a, b, c, d = 0, 0, 0, 0
    for k in range(3):
        if not has_corner(faces, g, faces[f, k]):
            a, b, c = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3], faces[f, k]
        if not has_corner(faces, f, faces[g, k]):
            d = faces[g, k]
    return bool(cosine_between(vertices, a, b, c, b, a, d, 1.0) < FOLDED)


@inner_jit()
def _pierces(vertices: FloatArray, a: int, b: int, p: int, q: int, r: int) -> bool:
    """Whether the segment from a to b goes through the triangle (p, q, r)."""
    at_a, at_b = _volume(vertices, p, q, r, a), _volume(vertices, p, q, r, b)
    if not ((at_a > 0.0 and at_b < 0.0) or (at_a < 0.0 and at_b > 0.0)):
        return False
    first, second, third = _volume(vertices, a, b, p, q), _volume(vertices, a, b, q, r), _volume(vertices, a, b, r, p)
    return (first > 0.0 and second > 0.0 and third > 0.0) or (first < 0.0 and second < 0.0 and third < 0.0)


@inner_jit()
def _volume(vertices: FloatArray, a: int, b: int, c: int, d: int) -> float:
    """Six times the volume of a tetrahedron; 0 where rounding decides."""
    x, y, z = area_vector(vertices, a, b, c)
    dx, dy, dz = vertices[d, 0] - vertices[a, 0], vertices[d, 1] - vertices[a, 1], vertices[d, 2] - vertices[a, 2]
    volume = x * dx + y * dy + z * dz
    scale = abs(x * dx) + abs(y * dy) + abs(z * dz)
    return volume if abs(volume) > 1e-12 * scale else 0.0
