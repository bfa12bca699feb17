"""The nearest place on the faces of a mesh."""

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.meshes.box_tree import BOXES_PER_LEAF, BoxTree, box_tree, morton_order
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import RangeTask, run_in_chunks

STACK_SIZE = 64  # nodes that wait; a tree over 2^31 boxes has 28 levels, each with one node that waits
# columns of the scratch array of a search: coordinates of the nearest place, and its barycentric coordinates 1 and 2
PLACE, COORDINATE_1, COORDINATE_2, PLACE_SIZE = 0, 3, 4, 5


def face_tree(vertices: FloatArray, faces: IntArray) -> BoxTree:
    """Tree of the bounding boxes of faces."""
    corners = vertices[faces]
    return box_tree(corners.min(axis=1), corners.max(axis=1))


def find_squared_distances(vertices: FloatArray, faces: IntArray, points: FloatArray) -> FloatArray:
    """Squared distances (q,) of points (q, 3) from faces (m, 3), infinite from none."""
    tree, order, found = face_tree(vertices, faces), morton_order(points), np.empty(len(points))

    def task() -> RangeTask:
        stack, place = np.empty(STACK_SIZE, np.int32), np.empty(2 * PLACE_SIZE)

        def run(start: int, stop: int) -> None:
            _measure_points(vertices, faces, tree, points, order, start, stop, stack, place, found)

        return run

    run_in_chunks(task, len(points))
    return found


@jit()
def _measure_points(
    vertices: FloatArray,
    faces: IntArray,
    tree: BoxTree,
    points: FloatArray,
    order: IntArray,
    start: int,
    stop: int,
    stack: IntArray,
    place: FloatArray,
    found: FloatArray,
) -> None:
    """Write the squared distances of points[order[start:stop]] from the faces."""
    guess = -1
    for q in order[start:stop]:
        x, y, z = points[q, 0], points[q, 1], points[q, 2]
        guess = nearest_face(vertices, faces, tree, x, y, z, guess, stack, place)
        if guess < 0:
            found[q] = np.inf
            continue
        found[q] = (x - place[PLACE]) ** 2 + (y - place[PLACE + 1]) ** 2 + (z - place[PLACE + 2]) ** 2


@inner_jit()
def nearest_face(
    vertices: FloatArray,
    faces: IntArray,
    tree: BoxTree,
    x: float,
    y: float,
    z: float,
    guess: int,
    stack: IntArray,
    place: FloatArray,
) -> int:
    """Face nearest to a point, with the nearest place on it in `place`; `guess` is a face that may be near, or -1."""
    best, squared = -1, np.inf
    if guess >= 0:
        best, squared = guess, nearest_on_face(vertices, faces, guess, x, y, z, place)
    leaves, count = tree.node_low.shape[0] // 2, tree.low.shape[0]
    height, stack[0] = 1, 1
    while height > 0:
        height -= 1
        node = stack[height]
        if not _box_distance(tree.node_low, tree.node_high, node, x, y, z) < squared:
            continue
        if node < leaves:
            left, right = 2 * node, 2 * node + 1
            of_left = _box_distance(tree.node_low, tree.node_high, left, x, y, z)
            if of_left > _box_distance(tree.node_low, tree.node_high, right, x, y, z):
                left, right = right, left
            stack[height], stack[height + 1] = right, left  # the nearer one first
            height += 2
            continue
        begin = (node - leaves) * BOXES_PER_LEAF
        for k in range(begin, min(begin + BOXES_PER_LEAF, count)):
            if _box_distance(tree.low, tree.high, k, x, y, z) < squared:
                found = nearest_on_face(vertices, faces, tree.row[k], x, y, z, place[PLACE_SIZE:])
                if found < squared:
                    best, squared = tree.row[k], found
                    for axis in range(PLACE_SIZE):
                        place[axis] = place[PLACE_SIZE + axis]
    return best


@inner_jit()
def _box_distance(low: FloatArray, high: FloatArray, k: int, x: float, y: float, z: float) -> float:
    """Squared distance from a point to box k; infinite for an empty one."""
    dx = max(low[k, 0] - x, x - high[k, 0], 0.0)
    dy = max(low[k, 1] - y, y - high[k, 1], 0.0)
    dz = max(low[k, 2] - z, z - high[k, 2], 0.0)
    return float(dx * dx + dy * dy + dz * dz)


@inner_jit()
def nearest_on_face(
    vertices: FloatArray, faces: IntArray, f: int, x: float, y: float, z: float, place: FloatArray
) -> float:
    """Write the place on face f nearest to a point; return its squared distance.

    The barycentric coordinates follow from the region of the plane that the point projects to (Ericson, "Real-time
    collision detection", 2005, section 5.1.5).
    """
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for axis in range(3):
        q = x if axis == 0 else y if axis == 1 else z
        p, to_j, to_k = vertices[i, axis], vertices[j, axis] - vertices[i, axis], vertices[k, axis] - vertices[i, axis]
        d1 += to_j * (q - p)
        d2 += to_k * (q - p)
        d3 += to_j * (q - vertices[j, axis])
        d4 += to_k * (q - vertices[j, axis])
        d5 += to_j * (q - vertices[k, axis])
        d6 += to_k * (q - vertices[k, axis])
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    a, b = 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        a = 1.0
    elif d6 >= 0.0 and d5 <= d6:
        b = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        a = d1 / (d1 - d3)
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        b = d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        b = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        a = 1.0 - b
    else:
        total = va + vb + vc
        a, b = vb / total, vc / total
    squared = 0.0
    for axis in range(3):
        q = x if axis == 0 else y if axis == 1 else z
        here = (1.0 - a - b) * vertices[i, axis] + a * vertices[j, axis] + b * vertices[k, axis]
        place[PLACE + axis] = here
        squared += (q - here) ** 2
    place[COORDINATE_1], place[COORDINATE_2] = a, b
    return squared
