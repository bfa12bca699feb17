"""Intersections of triangles."""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.box_tree import BOXES_PER_LEAF, BoxTree, box_tree
from bezier_filters.meshes.triangles import area_vector, cosine_between, has_corner
from bezier_filters.runtime.jit import inner_jit, jit, short_jit
from bezier_filters.runtime.parallel import run_kernel

PRODUCT_ROUNDING = 1e-12  # relative error of areas and volumes, which are sums of products of lengths
MAX_FOLDED_COSINE = -0.9999  # cosine of the angle between normals of faces on one edge below which they overlap


def faces_in_boxes(vertices: FloatArray, faces: IntArray, low: FloatArray, high: FloatArray) -> Rows:
    """Faces whose bounding boxes meet each box between corners (b, 3): rows of ascending indices."""
    count, nothing = len(low), np.empty(0, dtype=np.int32)
    if count == 0 or len(faces) == 0:
        return Rows(np.zeros(count + 1, dtype=np.int32), nothing)
    boxes = box_tree(low, high)
    first, counts = np.empty(len(faces), dtype=np.int32), np.zeros(count, dtype=np.int32)
    run_kernel(_meet, len(faces), vertices, faces, boxes, first)
    found = np.flatnonzero(first >= 0).astype(np.int32)  # few of many
    near, first = faces[found], first[found]
    _collect(vertices, near, first, boxes, counts, nothing)
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    indices = np.empty(indptr[-1], dtype=np.int32)
    _collect(vertices, near, first, boxes, indptr[:-1].copy(), indices)
    return Rows(indptr, found[indices])


@jit()
def _meet(vertices: FloatArray, faces: IntArray, boxes: BoxTree, first: IntArray, start: int, stop: int) -> None:
    """Write the first box that each of faces start .. stop-1 meets, -1 if there is none."""
    for f in range(start, stop):
        first[f] = _next_box(vertices, faces, f, boxes, -1)


@jit()
def _collect(
    vertices: FloatArray, faces: IntArray, first: IntArray, boxes: BoxTree, places: IntArray, indices: IntArray
) -> None:
    """Append the faces of each box from `places` on, given their first boxes; only count them if `indices` is empty."""
    for f in range(faces.shape[0]):
        box = first[f]
        while box >= 0:
            row = boxes.row[box]
            if indices.shape[0] > 0:
                indices[places[row]] = f
            places[row] += 1
            box = _next_box(vertices, faces, f, boxes, box)


@inner_jit()
def _next_box(vertices: FloatArray, faces: IntArray, f: int, boxes: BoxTree, last: int) -> int:
    """The next box after `last` that a face meets, -1 if there is none."""
    x, end_x = _bounds(vertices, faces, f, 0)
    y, end_y = _bounds(vertices, faces, f, 1)
    z, end_z = _bounds(vertices, faces, f, 2)
    count, leaves, box = boxes.low.shape[0], boxes.node_low.shape[0] // 2, last + 1
    while box % BOXES_PER_LEAF != 0 and box < count:  # the rest of the last leaf
        if _meets(boxes.low, boxes.high, box, x, end_x, y, end_y, z, end_z):
            return box
        box += 1
    if box >= count:
        return -1
    node = leaves + box // BOXES_PER_LEAF
    while True:
        while node % 2 == 0:  # the largest subtree that begins here
            node //= 2
        while node < leaves and _meets(boxes.node_low, boxes.node_high, node, x, end_x, y, end_y, z, end_z):
            node *= 2
        if node >= leaves and _meets(boxes.node_low, boxes.node_high, node, x, end_x, y, end_y, z, end_z):
            first = (node - leaves) * BOXES_PER_LEAF
            for k in range(first, min(first + BOXES_PER_LEAF, count)):
                if _meets(boxes.low, boxes.high, k, x, end_x, y, end_y, z, end_z):
                    return k
        node += 1
        if node & (node - 1) == 0:  # past the last node of the level
            return -1


@inner_jit(inline="always")
def _meets(
    low: FloatArray,
    high: FloatArray,
    k: int,
    x: float,
    end_x: float,
    y: float,
    end_y: float,
    z: float,
    end_z: float,
) -> bool:
    """Whether box k meets a box given by its bounds."""
    return bool(
        low[k, 0] <= end_x
        and x <= high[k, 0]
        and low[k, 1] <= end_y
        and y <= high[k, 1]
        and low[k, 2] <= end_z
        and z <= high[k, 2]
    )


@inner_jit()
def _bounds(vertices: FloatArray, faces: IntArray, f: int, axis: int) -> tuple[float, float]:
    """Least and largest coordinate of a face along an axis."""
    x, y, z = vertices[faces[f, 0], axis], vertices[faces[f, 1], axis], vertices[faces[f, 2], axis]
    return min(x, y, z), max(x, y, z)


def cut_faces(vertices: FloatArray, faces: IntArray, new: int, names: IntArray | None = None) -> BoolArray:
    """Which of the last `new` faces intersect another face, or overlap one on a common edge, (new,).

    Faces that only touch do not count. `names` (m, 3) identifies corners where vertices are duplicated.

    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [2, 2, 0]])
    >>> cut_faces(points, np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int32), 1)
    array([ True])
    """
    first = len(faces) - new
    result = np.zeros(new, dtype=np.bool_)
    if new:
        low, high = np.empty((2, new, 3))
        _bound(vertices, faces, low, high)
        boxes = box_tree(low, high)
        _find_cuts(vertices, faces, faces if names is None else names, boxes, first, result)
    return result


@short_jit()
def _bound(vertices: FloatArray, faces: IntArray, low: FloatArray, high: FloatArray) -> None:
    """Write the boxes (k, 3) of the last k faces."""
    first = faces.shape[0] - low.shape[0]
    for q in range(low.shape[0]):
        for axis in range(3):
            low[q, axis], high[q, axis] = _bounds(vertices, faces, first + q, axis)


@jit()
def _find_cuts(
    vertices: FloatArray,
    faces: IntArray,
    names: IntArray,
    boxes: BoxTree,
    first: int,
    result: BoolArray,
) -> None:
    """Mark the faces from `first` on that intersect another one; `boxes` are their bounding boxes."""
    for f in range(faces.shape[0]):
        box = _next_box(vertices, faces, f, boxes, -1)
        while box >= 0:
            q = boxes.row[box]
            result[q] = result[q] or (f != first + q and is_cut(vertices, faces, names, first + q, f))
            box = _next_box(vertices, faces, f, boxes, box)


@inner_jit()
def is_cut(vertices: FloatArray, faces: IntArray, names: IntArray, f: int, g: int) -> bool:
    """Whether two faces intersect."""
    shared = 0
    for k in range(3):
        for j in range(3):
            shared += names[f, k] == names[g, j]
    if shared == 3:
        return True
    if shared == 2:
        return _lie_on_each_other(vertices, faces, names, f, g)
    return (
        _edge_pierces(vertices, faces, names, f, g)
        or _edge_pierces(vertices, faces, names, g, f)
        or _overlap_in_plane(vertices, faces, f, g)
    )


@inner_jit()
def _edge_pierces(vertices: FloatArray, faces: IntArray, names: IntArray, f: int, g: int) -> bool:
    """Whether an edge of face f without a corner of face g passes through g."""
    for k in range(3):
        if has_corner(names, g, names[f, k]) or has_corner(names, g, names[f, (k + 1) % 3]):
            continue
        if _pierces(vertices, faces[f, k], faces[f, (k + 1) % 3], faces[g, 0], faces[g, 1], faces[g, 2]):
            return True
    return False


@inner_jit()
def _lie_on_each_other(vertices: FloatArray, faces: IntArray, names: IntArray, f: int, g: int) -> bool:
    """Whether two faces on one edge overlap."""
    a, b, c, d = 0, 0, 0, 0
    for k in range(3):
        if not has_corner(names, g, names[f, k]):
            a, b, c = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3], faces[f, k]
        if not has_corner(names, f, names[g, k]):
            d = faces[g, k]
    return bool(cosine_between(vertices, a, b, c, b, a, d, 1.0) < MAX_FOLDED_COSINE)


@inner_jit()
def _overlap_in_plane(vertices: FloatArray, faces: IntArray, f: int, g: int) -> bool:
    """Whether two faces lie in one plane and have a common part with an area: no side of either separates them."""
    p, q, r = faces[g, 0], faces[g, 1], faces[g, 2]
    for k in range(3):
        if _volume(vertices, p, q, r, faces[f, k]) != 0.0:
            return False
    x, y, z = area_vector(vertices, p, q, r)
    axis = 0 if abs(x) >= max(abs(y), abs(z)) else 1 if abs(y) >= abs(z) else 2
    if x == 0.0 and y == 0.0 and z == 0.0:
        return False
    for side in range(2):
        own, other = (f, g) if side == 0 else (g, f)
        turn = _area_along(vertices, axis, faces[own, 0], faces[own, 1], faces[own, 2])
        if turn == 0.0:
            return False
        for k in range(3):
            a, b, separates = faces[own, k], faces[own, (k + 1) % 3], True
            for j in range(3):
                separates &= turn * _area_along(vertices, axis, a, b, faces[other, j]) <= 0.0
            if separates:
                return False
    return True


@inner_jit()
def _area_along(vertices: FloatArray, axis: int, a: int, b: int, c: int) -> float:
    """Twice the signed area of a triangle seen along an axis; 0 within rounding error."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    first = (vertices[b, i] - vertices[a, i]) * (vertices[c, j] - vertices[a, j])
    second = (vertices[b, j] - vertices[a, j]) * (vertices[c, i] - vertices[a, i])
    area = first - second
    return float(area if abs(area) > PRODUCT_ROUNDING * (abs(first) + abs(second)) else 0.0)


@inner_jit()
def _pierces(vertices: FloatArray, a: int, b: int, p: int, q: int, r: int) -> bool:
    """Whether the segment from a to b passes through the triangle (p, q, r) or one of its sides, not its corners."""
    at_a, at_b = _volume(vertices, p, q, r, a), _volume(vertices, p, q, r, b)
    if not ((at_a > 0.0 and at_b < 0.0) or (at_a < 0.0 and at_b > 0.0)):
        return False
    first, second, third = _volume(vertices, a, b, p, q), _volume(vertices, a, b, q, r), _volume(vertices, a, b, r, p)
    least, most = min(first, second, third), max(first, second, third)
    on_sides = (first == 0.0) + (second == 0.0) + (third == 0.0)
    return bool(on_sides < 2 and (least >= 0.0 or most <= 0.0))


@inner_jit()
def _volume(vertices: FloatArray, a: int, b: int, c: int, d: int) -> float:
    """Six times the signed volume of a tetrahedron; 0 within rounding error."""
    x, y, z = area_vector(vertices, a, b, c)
    dx, dy, dz = vertices[d, 0] - vertices[a, 0], vertices[d, 1] - vertices[a, 1], vertices[d, 2] - vertices[a, 2]
    volume = x * dx + y * dy + z * dz
    scale = abs(x * dx) + abs(y * dy) + abs(z * dz)
    return volume if abs(volume) > PRODUCT_ROUNDING * scale else 0.0
