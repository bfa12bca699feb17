"""Triangles that cut each other."""

import numpy as np

from bezier_filters.adjacency import Rows
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.lean import inner_njit, lean_njit

CELLS = 32
"""Per axis, in which boxes are looked up."""
FOLDED = -0.9999
"""Cosine of the angle between two faces on one edge from which down they lie on each other."""


def faces_in_boxes(vertices: FloatArray, faces: IntArray, low: FloatArray, high: FloatArray) -> Rows:
    """Faces whose bounding box meets each of some boxes: rows of ascending indices.

    Parameters
    ----------
    vertices, faces : (n, 3) float64, (m, 3) int32
    low, high : (b, 3) float64
        Corners of the boxes.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> faces_in_boxes(corners, np.array([[0, 1, 2]], dtype=np.int32), np.full((1, 3), 0.4), np.ones((1, 3))).lengths
    array([0], dtype=int32)
    """
    count = len(low)
    if count == 0 or len(faces) == 0:
        return Rows(np.zeros(count + 1, dtype=np.int32), np.empty(0, dtype=np.int32))
    origin, extent = low.min(axis=0), np.maximum(np.ptp(np.vstack([low, high]), axis=0), 1e-300)
    first, last = (np.clip((corner - origin) / extent * CELLS, 0, CELLS - 1).astype(np.int32) for corner in (low, high))
    sizes = np.prod(last - first + 1, axis=1)
    # The boxes of every cell.
    box_of = np.repeat(np.arange(count, dtype=np.int32), sizes)
    cells = np.concatenate([_cells_between(*corners) for corners in zip(first, last, strict=True)])
    order = np.argsort(cells, kind="stable")
    pointer = np.searchsorted(cells[order], np.arange(CELLS**3 + 1)).astype(np.int32)
    counts, met = np.zeros(count, dtype=np.int32), np.full(count, -1, dtype=np.int32)
    arguments = (vertices, faces, low, high, origin, extent, pointer, box_of[order])
    _collect(*arguments, met, counts, np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32))
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    indices = np.empty(indptr[-1], dtype=np.int32)
    met[:], counts[:] = -1, 0
    _collect(*arguments, met, counts, indptr, indices)
    return Rows(indptr, indices)


def _cells_between(first: IntArray, last: IntArray) -> IntArray:
    """Numbers of the cells from one corner to the opposite one."""
    i, j, k = np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(first, last, strict=True)), indexing="ij")
    result: IntArray = ((i * CELLS + j) * CELLS + k).ravel()
    return result


@lean_njit()
def _collect(
    vertices: FloatArray,
    faces: IntArray,
    low: FloatArray,
    high: FloatArray,
    origin: FloatArray,
    extent: FloatArray,
    pointer: IntArray,
    boxes: IntArray,
    met: IntArray,
    counts: IntArray,
    indptr: IntArray,
    indices: IntArray,
) -> None:
    """Count the faces in every box, and list them if there is room; `met` is -1 at first."""
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        begin_x, end_x = _cells(vertices, a, b, c, 0, origin, extent)
        begin_y, end_y = _cells(vertices, a, b, c, 1, origin, extent)
        begin_z, end_z = _cells(vertices, a, b, c, 2, origin, extent)
        for i in range(begin_x, end_x):
            for j in range(begin_y, end_y):
                for k in range(begin_z, end_z):
                    cell = (i * CELLS + j) * CELLS + k
                    for q in range(pointer[cell], pointer[cell + 1]):
                        box = boxes[q]
                        if met[box] == f or not _in_box(vertices, a, b, c, low, high, box):
                            continue
                        met[box] = f
                        if indices.shape[0] > 0:
                            indices[indptr[box] + counts[box]] = f
                        counts[box] += 1


@inner_njit()
def _cells(
    vertices: FloatArray, a: int, b: int, c: int, axis: int, origin: FloatArray, extent: FloatArray
) -> tuple[int, int]:
    """Range of cells along an axis that a triangle reaches, empty if it is outside."""
    least = min(vertices[a, axis], vertices[b, axis], vertices[c, axis])
    most = max(vertices[a, axis], vertices[b, axis], vertices[c, axis])
    if most < origin[axis] or least > origin[axis] + extent[axis]:
        return 0, 0
    first = (least - origin[axis]) / extent[axis] * CELLS
    last = (most - origin[axis]) / extent[axis] * CELLS
    return int(min(max(first, 0.0), CELLS - 1.0)), int(min(max(last, 0.0), CELLS - 1.0)) + 1


@inner_njit()
def _in_box(vertices: FloatArray, a: int, b: int, c: int, low: FloatArray, high: FloatArray, box: int) -> bool:
    for axis in range(3):
        if min(vertices[a, axis], vertices[b, axis], vertices[c, axis]) > high[box, axis]:
            return False
        if max(vertices[a, axis], vertices[b, axis], vertices[c, axis]) < low[box, axis]:
            return False
    return True


def cut_faces(vertices: FloatArray, faces: IntArray, new: int) -> BoolArray:
    """Which of the last `new` faces cut any other face, or lie folded on one that shares an edge, (new,).

    Faces that only touch do not cut.

    Examples
    --------
    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [2, 2, 0]])
    >>> cut_faces(points, np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int32), 1)
    array([ True])
    """
    corners = vertices[faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    axis = int(np.argmax(np.ptp(low[len(faces) - new :], axis=0))) if new else 0
    order = np.argsort(low[:, axis], kind="stable").astype(np.int32)
    starts = low[order, axis]
    widest = float((high - low)[:, axis].max(initial=0.0))
    result = np.zeros(new, dtype=np.bool_)
    first = len(faces) - new
    begin = np.searchsorted(starts, low[first:, axis] - widest, side="left").astype(np.int32)
    end = np.searchsorted(starts, high[first:, axis], side="right").astype(np.int32)
    _find_cuts(vertices, faces, low, high, order, begin, end, first, result)
    return result


@lean_njit()
def _find_cuts(
    vertices: FloatArray,
    faces: IntArray,
    low: FloatArray,
    high: FloatArray,
    order: IntArray,
    begin: IntArray,
    end: IntArray,
    first: int,
    result: BoolArray,
) -> None:
    """Mark the faces from the first on that cut another one among those that begin near them along an axis."""
    for q in range(result.shape[0]):
        f = first + q
        for p in range(begin[q], end[q]):
            g = order[p]
            if (
                g == f
                or low[g, 0] > high[f, 0]
                or high[g, 0] < low[f, 0]
                or low[g, 1] > high[f, 1]
                or high[g, 1] < low[f, 1]
                or low[g, 2] > high[f, 2]
                or high[g, 2] < low[f, 2]
            ):
                continue
            if _cut(vertices, faces, f, g):
                result[q] = True
                break


@inner_njit()
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
    for k in range(3):
        a, b = faces[f, k], faces[f, (k + 1) % 3]
        if _has(faces, g, a) or _has(faces, g, b):
            continue
        if _pierces(vertices, a, b, faces[g, 0], faces[g, 1], faces[g, 2]):
            return True
    for k in range(3):
        a, b = faces[g, k], faces[g, (k + 1) % 3]
        if _has(faces, f, a) or _has(faces, f, b):
            continue
        if _pierces(vertices, a, b, faces[f, 0], faces[f, 1], faces[f, 2]):
            return True
    return False


@inner_njit()
def _has(faces: IntArray, f: int, i: int) -> bool:
    return bool(faces[f, 0] == i or faces[f, 1] == i or faces[f, 2] == i)


@inner_njit()
def _lie_on_each_other(vertices: FloatArray, faces: IntArray, f: int, g: int) -> bool:
    """Whether two faces on one edge are folded on each other."""
    a, b, c = 0, 0, 0
    for k in range(3):
        if not _has(faces, g, faces[f, k]):
            c = faces[f, k]
            a, b = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
    d = 0
    for k in range(3):
        if not _has(faces, f, faces[g, k]):
            d = faces[g, k]
    x, y, z = _normal(vertices, a, b, c)
    u, v, w = _normal(vertices, b, a, d)
    lengths = np.sqrt((x * x + y * y + z * z) * (u * u + v * v + w * w))
    return bool(lengths > 0.0 and (x * u + y * v + z * w) < FOLDED * lengths)


@inner_njit()
def _normal(vertices: FloatArray, a: int, b: int, c: int) -> tuple[float, float, float]:
    ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
    vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@inner_njit()
def _pierces(vertices: FloatArray, a: int, b: int, p: int, q: int, r: int) -> bool:
    """Whether the segment from a to b goes through the triangle (p, q, r)."""
    at_a, at_b = _volume(vertices, p, q, r, a), _volume(vertices, p, q, r, b)
    if not ((at_a > 0.0 and at_b < 0.0) or (at_a < 0.0 and at_b > 0.0)):
        return False
    first, second, third = _volume(vertices, a, b, p, q), _volume(vertices, a, b, q, r), _volume(vertices, a, b, r, p)
    return (first > 0.0 and second > 0.0 and third > 0.0) or (first < 0.0 and second < 0.0 and third < 0.0)


@inner_njit()
def _volume(vertices: FloatArray, a: int, b: int, c: int, d: int) -> float:
    """Six times the volume of a tetrahedron; 0 where rounding decides."""
    x, y, z = _normal(vertices, a, b, c)
    dx, dy, dz = vertices[d, 0] - vertices[a, 0], vertices[d, 1] - vertices[a, 1], vertices[d, 2] - vertices[a, 2]
    volume = x * dx + y * dy + z * dz
    scale = abs(x * dx) + abs(y * dy) + abs(z * dz)
    return volume if abs(volume) > 1e-12 * scale else 0.0
