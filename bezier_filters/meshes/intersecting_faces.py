"""Finds the faces of a mesh that intersect others.

Nearly all pairs of faces that are near each other are neighbours on a surface that bends little. So faces are grouped
in connected leaves of a tree. A leaf whose normals lie in a cone, and two such leaves with a common vertex and a
common cone, are taken for parts of one graph over a plane, which does not intersect itself (Volino and
Magnenat-Thalmann 1994, without their test of the contour: it matters only for ramps that turn around within a leaf).
All other pairs are tested.
"""

from typing import NamedTuple

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.self_intersections import is_cut
from bezier_filters.meshes.spatial_order import grid_around, sort_by_cell, widen_bounds
from bezier_filters.meshes.triangles import unit_normal
from bezier_filters.runtime.jit import inner_jit, jit
from bezier_filters.runtime.parallel import run_kernel

MAX_LEAF_FACES = (
    16  # a clean torus of 800,000 faces takes .22 s, .27 with 8, .20 with 32; with noise .2, 1.2, 1.0, 1.7 s
)
# Cosine of the half angle of the cone around the sum of the normals of a graph. On a torus with noise of .2 edges in
# all directions 43 of 15,346 faces are missed; 192 with 0, a half-space, and 8 with .71 in 1.3 times the time.
MIN_CONE_COSINE = 0.5


class _Leaves(NamedTuple):
    """Connected groups of faces, and a binary tree of boxes around them."""

    ptr: IntArray  # (l + 1,): where each leaf begins in `order`
    order: IntArray  # (m,): faces by leaf
    normals: FloatArray  # (m, 3): unit normals of the faces in this order
    corners: IntArray  # (l, 3 MAX_LEAF_FACES): vertices of each leaf in ascending order, without repeats, then -1
    sums: FloatArray  # (l, 3): sums of the normals; 0 if one lies outside the cone around them
    low: FloatArray  # (2 k, 3): node j has the children 2 j and 2 j + 1; the k leaves come last
    high: FloatArray


def intersecting_faces(mesh: PreparedMesh) -> IntArray:
    """For each face another one that it intersects, or overlaps on a common edge, (m,) int32; -1 if there is none.

    Faces that only touch do not count.

    >>> from bezier_filters.meshes.mesh import triangle_mesh
    >>> from bezier_filters.meshes.prepared_mesh import prepare_mesh
    >>> points = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [2, 2, 0], [5, 5, 5]]
    >>> intersecting_faces(prepare_mesh(triangle_mesh(points, [[0, 1, 2], [3, 4, 5], [2, 5, 6]])))
    array([ 1,  0, -1], dtype=int32)
    """
    result = np.full(mesh.face_count, -1, dtype=np.int32)
    if mesh.face_count > 1:
        leaves = _group_faces(mesh)
        run_kernel(_search, len(leaves.sums), mesh.vertices, mesh.faces, leaves, result)
    return result


def _group_faces(mesh: PreparedMesh) -> _Leaves:
    """Group the faces of a mesh in leaves, in the order of the cells of a grid."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    widen_bounds(mesh.vertices, low, high)
    grid, m = grid_around(low, high, mesh.vertex_count), mesh.face_count
    seeds, order, ptr, grouped = *np.empty((2, m), dtype=np.int32), np.zeros(m + 1, np.int32), np.zeros(m, np.bool_)
    cells = grid.cells(mesh.vertices)[mesh.faces[:, 0]]
    sort_by_cell(cells, np.zeros(grid.cell_count + 1, dtype=np.int32), seeds)
    rows = mesh.adjacency.faces
    count = _grow_leaves(mesh.faces, rows.indptr, rows.indices, seeds, grouped, order, ptr)
    nodes = 1 << (count - 1).bit_length()
    leaves = _Leaves(
        ptr[: count + 1],
        order,
        np.empty((m, 3)),
        np.empty((count, 3 * MAX_LEAF_FACES), dtype=np.int32),
        np.zeros((count, 3)),
        np.full((2 * nodes, 3), np.inf),
        np.full((2 * nodes, 3), -np.inf),
    )
    run_kernel(_write_leaves, count, mesh.vertices, mesh.faces, leaves)
    while nodes > 1:
        below, nodes = slice(nodes, 2 * nodes), nodes // 2
        leaves.low[nodes : 2 * nodes] = leaves.low[below].reshape(-1, 2, 3).min(axis=1)
        leaves.high[nodes : 2 * nodes] = leaves.high[below].reshape(-1, 2, 3).max(axis=1)
    return leaves


@jit()
def _grow_leaves(
    faces: IntArray,
    face_ptr: IntArray,
    face_indices: IntArray,
    seeds: IntArray,
    grouped: BoolArray,
    order: IntArray,
    ptr: IntArray,
) -> int:
    """Grow leaves from face to face through common vertices, from one seed after the other; return their number."""
    count, end = 0, 0
    for seed in seeds:
        if grouped[seed]:
            continue
        first, place = end, end
        order[end], grouped[seed] = seed, True
        end += 1
        while place < end:
            for k in range(3):
                i = faces[order[place], k]
                for q in range(face_ptr[i], face_ptr[i + 1]):
                    f = face_indices[q]
                    if end < first + MAX_LEAF_FACES and not grouped[f]:
                        order[end], grouped[f] = f, True
                        end += 1
            place += 1
        count += 1
        ptr[count] = end
    return count


@jit()
def _write_leaves(vertices: FloatArray, faces: IntArray, leaves: _Leaves, start: int, stop: int) -> None:
    """Write the normals, corners and boxes of leaves start .. stop-1."""
    for a in range(start, stop):
        node, count = leaves.low.shape[0] // 2 + a, 0
        for q in range(leaves.ptr[a], leaves.ptr[a + 1]):
            f = leaves.order[q]
            x, y, z, _ = unit_normal(vertices, faces[f, 0], faces[f, 1], faces[f, 2])
            leaves.normals[q, 0], leaves.normals[q, 1], leaves.normals[q, 2] = x, y, z
            leaves.sums[a, 0] += x
            leaves.sums[a, 1] += y
            leaves.sums[a, 2] += z
            for k in range(3):
                count = _insert(leaves.corners[a], count, faces[f, k])
                for axis in range(3):
                    coordinate = vertices[faces[f, k], axis]
                    leaves.low[node, axis] = min(leaves.low[node, axis], coordinate)
                    leaves.high[node, axis] = max(leaves.high[node, axis], coordinate)
        leaves.corners[a, count:] = -1
        if not _lies_in_cone(leaves, a, leaves.sums[a, 0], leaves.sums[a, 1], leaves.sums[a, 2]):
            leaves.sums[a] = 0.0


@inner_jit()
def _insert(row: IntArray, count: int, value: int) -> int:
    """Insert a value into the first `count` ascending ones unless it is there; return the new count."""
    place = count
    while place > 0 and row[place - 1] >= value:
        place -= 1
    if place < count and row[place] == value:
        return count
    for k in range(count, place, -1):
        row[k] = row[k - 1]
    row[place] = value
    return count + 1


@inner_jit()
def _lies_in_cone(leaves: _Leaves, a: int, x: float, y: float, z: float) -> bool:
    """Whether all normals of a leaf lie in the cone around (x, y, z)."""
    least = MIN_CONE_COSINE * np.sqrt(x * x + y * y + z * z)
    for q in range(leaves.ptr[a], leaves.ptr[a + 1]):
        if leaves.normals[q, 0] * x + leaves.normals[q, 1] * y + leaves.normals[q, 2] * z <= least:
            return False
    return True


@inner_jit()
def _continue_each_other(leaves: _Leaves, a: int, b: int) -> bool:
    """Whether two leaves are parts of one graph over a plane."""
    sums = leaves.sums
    x, y, z = sums[a, 0] + sums[b, 0], sums[a, 1] + sums[b, 1], sums[a, 2] + sums[b, 2]
    return bool(
        sums[a].any()
        and sums[b].any()
        and _lies_in_cone(leaves, a, x, y, z)
        and _lies_in_cone(leaves, b, x, y, z)
        and _have_common_vertex(leaves.corners[a], leaves.corners[b])
    )


@inner_jit()
def _have_common_vertex(a: IntArray, b: IntArray) -> bool:
    """Whether two ascending rows, filled up with -1, have a common value."""
    p, q = 0, 0
    while p < a.shape[0] and q < b.shape[0] and a[p] >= 0 and b[q] >= 0:
        if a[p] == b[q]:
            return True
        if a[p] < b[q]:
            p += 1
        else:
            q += 1
    return False


@jit()
def _search(vertices: FloatArray, faces: IntArray, leaves: _Leaves, result: IntArray, start: int, stop: int) -> None:
    """Write a face that each face of leaves start .. stop-1 intersects."""
    half = leaves.low.shape[0] // 2
    for a in range(start, stop):
        if not leaves.sums[a].any():
            _test(vertices, faces, leaves, a, a, result)
        node = 1
        while True:
            while node < half and _meet(leaves, node, half + a):
                node *= 2
            b = node - half
            if b >= 0 and b != a and _meet(leaves, node, half + a) and not _continue_each_other(leaves, a, b):
                _test(vertices, faces, leaves, a, b, result)
            node += 1
            if node & (node - 1) == 0:  # past the last node of the level
                break
            while node % 2 == 0:  # the largest subtree that begins here
                node //= 2


@inner_jit(inline="always")
def _meet(leaves: _Leaves, j: int, k: int) -> bool:
    """Whether the boxes of two nodes meet."""
    low, high = leaves.low, leaves.high
    return bool(
        low[j, 0] <= high[k, 0]
        and low[k, 0] <= high[j, 0]
        and low[j, 1] <= high[k, 1]
        and low[k, 1] <= high[j, 1]
        and low[j, 2] <= high[k, 2]
        and low[k, 2] <= high[j, 2]
    )


@inner_jit()
def _test(vertices: FloatArray, faces: IntArray, leaves: _Leaves, a: int, b: int, result: IntArray) -> None:
    """Write a face of leaf b that each face of leaf a intersects."""
    half = leaves.low.shape[0] // 2
    for p in range(leaves.ptr[a], leaves.ptr[a + 1]):
        f = leaves.order[p]
        if result[f] >= 0 or not _meets_box(vertices, faces, f, leaves.low, leaves.high, half + b):
            continue
        for q in range(leaves.ptr[b], leaves.ptr[b + 1]):
            g = leaves.order[q]
            if g != f and _boxes_meet(vertices, faces, f, g) and is_cut(vertices, faces, faces, f, g):
                result[f] = g
                break


@inner_jit()
def _meets_box(vertices: FloatArray, faces: IntArray, f: int, low: FloatArray, high: FloatArray, node: int) -> bool:
    """Whether the box of a face meets that of a node."""
    for axis in range(3):
        x, y, z = vertices[faces[f, 0], axis], vertices[faces[f, 1], axis], vertices[faces[f, 2], axis]
        if min(x, y, z) > high[node, axis] or max(x, y, z) < low[node, axis]:
            return False
    return True


@inner_jit()
def _boxes_meet(vertices: FloatArray, faces: IntArray, f: int, g: int) -> bool:
    """Whether the boxes of two faces meet."""
    for axis in range(3):
        x, y, z = vertices[faces[f, 0], axis], vertices[faces[f, 1], axis], vertices[faces[f, 2], axis]
        u, v, w = vertices[faces[g, 0], axis], vertices[faces[g, 1], axis], vertices[faces[g, 2], axis]
        if min(x, y, z) > max(u, v, w) or max(x, y, z) < min(u, v, w):
            return False
    return True
