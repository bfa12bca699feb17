"""Triangles that cut each other."""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.triangles import area_vector, cosine_between, has_corner
from bezier_filters.runtime.jit import inner_jit, jit

FEWEST_CELLS, MOST_CELLS = 4, 128  # per axis, in which boxes are looked up
FOLDED = -0.9999  # cosine of the angle between two faces on one edge from which down they lie on each other


def faces_in_boxes(vertices: FloatArray, faces: IntArray, low: FloatArray, high: FloatArray) -> Rows:
    """Faces whose bounding box meets each of some boxes between corners (b, 3): rows of ascending indices."""
    count, found = len(low), np.empty(0, dtype=np.int32)
    if count == 0 or len(faces) == 0:
        return Rows(np.zeros(count + 1, dtype=np.int32), found)
    grid = _grid_of(low, high)
    # Twice: first the faces of each box are counted, then those that were met, few of many, are written.
    counts, is_met = np.zeros(count, dtype=np.int32), np.zeros(len(faces), dtype=np.bool_)
    _collect(vertices, faces, grid, np.full(count, -1, dtype=np.int32), is_met, counts, found, found)
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    indices = np.empty(indptr[-1], dtype=np.int32)
    found = np.flatnonzero(is_met).astype(np.int32)
    counts[:] = 0
    _collect(vertices, faces[found], grid, np.full(count, -1, dtype=np.int32), is_met, counts, indptr, indices)
    return Rows(indptr, found[indices])


class _Grid(NamedTuple):
    """Cells along each axis between the boxes' outermost corners, and the boxes that reach each cell as rows."""

    low: FloatArray
    high: FloatArray
    origin: FloatArray
    extent: FloatArray
    cells: int
    starts: IntArray
    boxes: IntArray


def _grid_of(low: FloatArray, high: FloatArray) -> _Grid:
    origin, extent = low.min(axis=0), np.maximum(np.ptp(np.vstack([low, high]), axis=0), 1e-300)
    cells = int(np.clip(round(len(low) ** 0.5), FEWEST_CELLS, MOST_CELLS))
    starts = np.zeros(cells**3 + 1, dtype=np.int32)
    grid = _Grid(low, high, origin, extent, cells, starts, np.empty(0, dtype=np.int32))
    _list_boxes(grid, starts[1:])
    np.cumsum(starts, out=starts)
    grid = grid._replace(boxes=np.empty(starts[-1], dtype=np.int32))
    _list_boxes(grid, starts[:-1].copy())
    return grid


@jit()
def _list_boxes(grid: _Grid, fill: IntArray) -> None:
    """List the boxes that reach each cell, from where `fill` says; without room for them, count them only."""
    for box in range(grid.low.shape[0]):
        x, end_x = _cells(grid, 0, grid.low[box, 0], grid.high[box, 0])
        y, end_y = _cells(grid, 1, grid.low[box, 1], grid.high[box, 1])
        z, end_z = _cells(grid, 2, grid.low[box, 2], grid.high[box, 2])
        for i in range(x, end_x):
            for j in range(y, end_y):
                for k in range(z, end_z):
                    cell = (i * grid.cells + j) * grid.cells + k
                    if grid.boxes.shape[0] > 0:
                        grid.boxes[fill[cell]] = box
                    fill[cell] += 1


@jit()
def _collect(
    vertices: FloatArray,
    faces: IntArray,
    grid: _Grid,
    met: IntArray,
    is_met: BoolArray,
    counts: IntArray,
    indptr: IntArray,
    indices: IntArray,
) -> None:
    """Count the faces in every box, mark them, and list them if there is room; `met` is -1 at first."""
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x, end_x = _cells_of_face(grid, 0, vertices, a, b, c)
        y, end_y = _cells_of_face(grid, 1, vertices, a, b, c)
        z, end_z = _cells_of_face(grid, 2, vertices, a, b, c)
        for i in range(x, end_x):
            for j in range(y, end_y):
                for k in range(z, end_z):
                    cell = (i * grid.cells + j) * grid.cells + k
                    for q in range(grid.starts[cell], grid.starts[cell + 1]):
                        box = grid.boxes[q]
                        if met[box] == f or not _in_box(vertices, a, b, c, grid.low[box], grid.high[box]):
                            continue
                        met[box] = f
                        is_met[f] = True
                        if indices.shape[0] > 0:
                            indices[indptr[box] + counts[box]] = f
                        counts[box] += 1


@inner_jit()
def _cells_of_face(grid: _Grid, axis: int, vertices: FloatArray, a: int, b: int, c: int) -> tuple[int, int]:
    """Range of cells along an axis that a triangle reaches."""
    x, y, z = vertices[a, axis], vertices[b, axis], vertices[c, axis]
    return _cells(grid, axis, min(x, y, z), max(x, y, z))


@inner_jit()
def _cells(grid: _Grid, axis: int, least: float, most: float) -> tuple[int, int]:
    """Range of cells along an axis that an interval reaches, empty if it is outside."""
    origin, extent = grid.origin[axis], grid.extent[axis]
    if most < origin or least > origin + extent:
        return 0, 0
    first = (least - origin) / extent * grid.cells
    last = (most - origin) / extent * grid.cells
    return int(min(max(first, 0.0), grid.cells - 1.0)), int(min(max(last, 0.0), grid.cells - 1.0)) + 1


def meeting_box(vertices: FloatArray, faces: IntArray, low: FloatArray, high: FloatArray) -> BoolArray:
    """Whether the bounding boxes of faces meet the box between two corners, each (3,), (m,)."""
    corners = vertices[faces]
    return np.asarray(((corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)).all(axis=1), dtype=np.bool_)


@inner_jit()
def _in_box(vertices: FloatArray, a: int, b: int, c: int, low: FloatArray, high: FloatArray) -> bool:
    for axis in range(3):
        x, y, z = vertices[a, axis], vertices[b, axis], vertices[c, axis]
        if min(x, y, z) > high[axis] or max(x, y, z) < low[axis]:
            return False
    return True


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
