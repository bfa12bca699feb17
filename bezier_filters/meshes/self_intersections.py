"""Triangles that cut each other."""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.triangles import area_vector, has_corner
from bezier_filters.runtime.lean import inner_njit, lean_njit

FEWEST_CELLS, MOST_CELLS = 4, 128
"""Per axis, in which boxes are looked up."""
FEW_PAIRS = 100_000
"""Of faces, up to which the boxes of all are compared."""
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
    cells = int(np.clip(round(count**0.5), FEWEST_CELLS, MOST_CELLS))
    pointer = np.zeros(cells**3 + 1, dtype=np.int32)
    _count_cells(low, high, origin, extent, cells, pointer[1:])
    np.cumsum(pointer, out=pointer)
    boxes = np.empty(pointer[-1], dtype=np.int32)
    _fill_cells(low, high, origin, extent, cells, pointer[:-1].copy(), boxes)
    counts, met = np.zeros(count, dtype=np.int32), np.full(count, -1, dtype=np.int32)
    is_met, nowhere = np.zeros(len(faces), dtype=np.bool_), np.empty(0, dtype=np.int32)
    _collect(vertices, faces, low, high, origin, extent, cells, pointer, boxes, met, is_met, counts, nowhere, nowhere)
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    indices = np.empty(indptr[-1], dtype=np.int32)
    found = np.flatnonzero(is_met).astype(np.int32)  # few, where there are many faces
    met[:], counts[:] = -1, 0
    faces = faces[found]
    _collect(vertices, faces, low, high, origin, extent, cells, pointer, boxes, met, is_met, counts, indptr, indices)
    indices = found[indices]
    return Rows(indptr, indices)


def meeting_box(vertices: FloatArray, faces: IntArray, low: FloatArray, high: FloatArray) -> BoolArray:
    """Whether the bounding boxes of faces meet the box between two corners, each (3,), (m,)."""
    result = np.empty(len(faces), dtype=np.bool_)
    _mark_meeting(vertices, faces, low, high, result)
    return result


@lean_njit()
def _mark_meeting(vertices: FloatArray, faces: IntArray, low: FloatArray, high: FloatArray, result: BoolArray) -> None:
    for f in range(faces.shape[0]):
        result[f] = _in_box(vertices, faces[f, 0], faces[f, 1], faces[f, 2], low, high)


@lean_njit()
def _count_cells(
    low: FloatArray, high: FloatArray, origin: FloatArray, extent: FloatArray, cells: int, counts: IntArray
) -> None:
    """Count the boxes that reach each cell."""
    for box in range(low.shape[0]):
        x, end_x = _cells(low[box, 0], high[box, 0], origin[0], extent[0], cells)
        y, end_y = _cells(low[box, 1], high[box, 1], origin[1], extent[1], cells)
        z, end_z = _cells(low[box, 2], high[box, 2], origin[2], extent[2], cells)
        for i in range(x, end_x):
            for j in range(y, end_y):
                for k in range(z, end_z):
                    counts[(i * cells + j) * cells + k] += 1


@lean_njit()
def _fill_cells(
    low: FloatArray,
    high: FloatArray,
    origin: FloatArray,
    extent: FloatArray,
    cells: int,
    fill: IntArray,
    boxes: IntArray,
) -> None:
    """List the boxes that reach each cell, from where `fill` says."""
    for box in range(low.shape[0]):
        x, end_x = _cells(low[box, 0], high[box, 0], origin[0], extent[0], cells)
        y, end_y = _cells(low[box, 1], high[box, 1], origin[1], extent[1], cells)
        z, end_z = _cells(low[box, 2], high[box, 2], origin[2], extent[2], cells)
        for i in range(x, end_x):
            for j in range(y, end_y):
                for k in range(z, end_z):
                    cell = (i * cells + j) * cells + k
                    boxes[fill[cell]] = box
                    fill[cell] += 1


@lean_njit()
def _collect(
    vertices: FloatArray,
    faces: IntArray,
    low: FloatArray,
    high: FloatArray,
    origin: FloatArray,
    extent: FloatArray,
    cells: int,
    pointer: IntArray,
    boxes: IntArray,
    met: IntArray,
    is_met: BoolArray,
    counts: IntArray,
    indptr: IntArray,
    indices: IntArray,
) -> None:
    """Count the faces in every box, mark them, and list them if there is room; `met` is -1 at first."""
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        begin_x, end_x = _cells_of_face(vertices, a, b, c, 0, origin, extent, cells)
        begin_y, end_y = _cells_of_face(vertices, a, b, c, 1, origin, extent, cells)
        begin_z, end_z = _cells_of_face(vertices, a, b, c, 2, origin, extent, cells)
        for i in range(begin_x, end_x):
            for j in range(begin_y, end_y):
                for k in range(begin_z, end_z):
                    cell = (i * cells + j) * cells + k
                    for q in range(pointer[cell], pointer[cell + 1]):
                        box = boxes[q]
                        if met[box] == f or not _in_box(vertices, a, b, c, low[box], high[box]):
                            continue
                        met[box] = f
                        is_met[f] = True
                        if indices.shape[0] > 0:
                            indices[indptr[box] + counts[box]] = f
                        counts[box] += 1


@inner_njit()
def _cells_of_face(
    vertices: FloatArray, a: int, b: int, c: int, axis: int, origin: FloatArray, extent: FloatArray, cells: int
) -> tuple[int, int]:
    """Range of cells along an axis that a triangle reaches."""
    least = min(vertices[a, axis], vertices[b, axis], vertices[c, axis])
    most = max(vertices[a, axis], vertices[b, axis], vertices[c, axis])
    return _cells(least, most, origin[axis], extent[axis], cells)


@inner_njit()
def _cells(least: float, most: float, origin: float, extent: float, cells: int) -> tuple[int, int]:
    """Range of cells along an axis that an interval reaches, empty if it is outside."""
    if most < origin or least > origin + extent:
        return 0, 0
    first = (least - origin) / extent * cells
    last = (most - origin) / extent * cells
    return int(min(max(first, 0.0), cells - 1.0)), int(min(max(last, 0.0), cells - 1.0)) + 1


@inner_njit()
def _in_box(vertices: FloatArray, a: int, b: int, c: int, low: FloatArray, high: FloatArray) -> bool:
    for axis in range(3):
        if min(vertices[a, axis], vertices[b, axis], vertices[c, axis]) > high[axis]:
            return False
        if max(vertices[a, axis], vertices[b, axis], vertices[c, axis]) < low[axis]:
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
    first = len(faces) - new
    result = np.zeros(new, dtype=np.bool_)
    if new * len(faces) <= FEW_PAIRS:
        _find_cuts_of_few(vertices, faces, np.empty((len(faces), 2, 3)), result)
        return result
    corners = vertices[faces[first:]]
    near = faces_in_boxes(vertices, faces, corners.min(axis=1), corners.max(axis=1))
    _find_cuts(vertices, faces, near.indptr, near.indices, first, result)
    return result


@lean_njit()
def _find_cuts(
    vertices: FloatArray, faces: IntArray, near_ptr: IntArray, near: IntArray, first: int, result: BoolArray
) -> None:
    """Mark the faces from the first on that cut another one among those near them."""
    for q in range(result.shape[0]):
        for p in range(near_ptr[q], near_ptr[q + 1]):
            if near[p] != first + q and _cut(vertices, faces, first + q, near[p]):
                result[q] = True
                break


@lean_njit()
def _find_cuts_of_few(vertices: FloatArray, faces: IntArray, boxes: FloatArray, result: BoolArray) -> None:
    """Mark those of the last faces that cut another one; `boxes` (m, 2, 3) is room for their boxes."""
    for f in range(faces.shape[0]):
        for axis in range(3):
            a, b, c = vertices[faces[f, 0], axis], vertices[faces[f, 1], axis], vertices[faces[f, 2], axis]
            boxes[f, 0, axis], boxes[f, 1, axis] = min(a, b, c), max(a, b, c)
    first = faces.shape[0] - result.shape[0]
    for q in range(result.shape[0]):
        f = first + q
        for g in range(faces.shape[0]):
            if (
                g != f
                and boxes[g, 0, 0] <= boxes[f, 1, 0]
                and boxes[g, 1, 0] >= boxes[f, 0, 0]
                and boxes[g, 0, 1] <= boxes[f, 1, 1]
                and boxes[g, 1, 1] >= boxes[f, 0, 1]
                and boxes[g, 0, 2] <= boxes[f, 1, 2]
                and boxes[g, 1, 2] >= boxes[f, 0, 2]
                and _cut(vertices, faces, f, g)
            ):
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
        if has_corner(faces, g, a) or has_corner(faces, g, b):
            continue
        if _pierces(vertices, a, b, faces[g, 0], faces[g, 1], faces[g, 2]):
            return True
    for k in range(3):
        a, b = faces[g, k], faces[g, (k + 1) % 3]
        if has_corner(faces, f, a) or has_corner(faces, f, b):
            continue
        if _pierces(vertices, a, b, faces[f, 0], faces[f, 1], faces[f, 2]):
            return True
    return False


@inner_njit()
def _lie_on_each_other(vertices: FloatArray, faces: IntArray, f: int, g: int) -> bool:
    """Whether two faces on one edge are folded on each other."""
    a, b, c = 0, 0, 0
    for k in range(3):
        if not has_corner(faces, g, faces[f, k]):
            c = faces[f, k]
            a, b = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
    d = 0
    for k in range(3):
        if not has_corner(faces, f, faces[g, k]):
            d = faces[g, k]
    x, y, z = area_vector(vertices, a, b, c)
    u, v, w = area_vector(vertices, b, a, d)
    lengths = np.sqrt((x * x + y * y + z * z) * (u * u + v * v + w * w))
    return bool(lengths > 0.0 and (x * u + y * v + z * w) < FOLDED * lengths)


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
    x, y, z = area_vector(vertices, a, b, c)
    dx, dy, dz = vertices[d, 0] - vertices[a, 0], vertices[d, 1] - vertices[a, 1], vertices[d, 2] - vertices[a, 2]
    volume = x * dx + y * dy + z * dz
    scale = abs(x * dx) + abs(y * dy) + abs(z * dz)
    return volume if abs(volume) > 1e-12 * scale else 0.0
