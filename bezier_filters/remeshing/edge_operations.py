"""Collapses and flips of many edges at once: the best ones first, among edges without common faces or vertices."""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.half_edges import HalfEdgeLists, face_at_edge, half_edge_lists
from bezier_filters.runtime.jit import inner_jit, jit

# Of the angle by which a face may turn in one operation, and of that between its normal and those of the surface at its
# corners: 60 degrees. An octahedron in a sphere has 55.
MIN_FACE_COSINE = 0.5


def choose_collapses(
    points: FloatArray, normals: FloatArray, faces: IntArray, ends: IntArray, goal: FloatArray, longest: FloatArray
) -> BoolArray:
    """Mask of edges (e, 2) that may shrink to the points `goal` (e, 3) at the same time, the shortest ones first.

    The surface stays a manifold (Dey et al., "Topology preserving edge contraction", 1999), edges do not get longer
    than `longest` (e,), no face turns over or away from the `normals` (n, 3) of the surface (0 where there are none),
    and no face at an end of one edge is at an end of another.
    """
    n, chosen = len(points), np.zeros(len(ends), dtype=np.bool_)
    lengths = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    order = np.argsort(lengths, kind="stable").astype(np.int32)
    taken, seen = np.zeros(len(faces), dtype=np.bool_), np.full(n, -1, dtype=np.int32)
    _choose_collapses(
        points, normals, faces, half_edge_lists(faces, n), ends, goal, longest, order, taken, seen, chosen
    )
    return chosen


@jit()
def _choose_collapses(
    points: FloatArray,
    normals: FloatArray,
    faces: IntArray,
    lists: HalfEdgeLists,
    ends: IntArray,
    goal: FloatArray,
    longest: FloatArray,
    order: IntArray,
    taken: BoolArray,
    seen: IntArray,
    chosen: BoolArray,
) -> None:
    for e in order:
        chosen[e] = _may_collapse(points, normals, faces, lists, ends[e], goal[e], longest[e], e, taken, seen)
        if not chosen[e]:
            continue
        for k in range(2):
            half = lists.first[ends[e, k]]
            while half >= 0:
                taken[half // 3] = True
                half = lists.following[half]


@inner_jit()
def _may_collapse(
    points: FloatArray,
    normals: FloatArray,
    faces: IntArray,
    lists: HalfEdgeLists,
    ends: IntArray,
    goal: FloatArray,
    longest: float,
    mark: int,
    taken: BoolArray,
    seen: IntArray,
) -> bool:
    """Whether an edge may shrink to a point; `seen` (n,) has other numbers than 2 `mark` and 2 `mark` + 1."""
    sides = shared = others = first_others = 0
    for k in range(2):
        first_others = others
        half = lists.first[ends[k]]
        while half >= 0:
            f, corner = half // 3, half % 3
            if taken[f]:
                return False
            a, b = faces[f, (corner + 1) % 3], faces[f, (corner + 2) % 3]
            other = ends[1 - k]
            if a == other or b == other:
                sides += k
            elif _stays_upright(points, normals, ends[k], a, b, goal, longest):
                others += 1
            else:
                return False
            for side in range(2):  # neighbours of both ends, each once
                v = a if side == 0 else b
                if k == 0:
                    seen[v] = 2 * mark
                elif seen[v] == 2 * mark:
                    shared += 1
                    seen[v] = 2 * mark + 1
            half = lists.following[half]
    # a tetrahedron would become two triangles on each other, and a triangle nothing
    is_tetrahedron = sides == 2 and first_others == 1 and others == 2
    return shared == sides and others > 0 and not is_tetrahedron


@inner_jit()
def _stays_upright(
    points: FloatArray, normals: FloatArray, v: int, a: int, b: int, goal: FloatArray, longest: float
) -> bool:
    """Whether face (v, a, b) turns little, and its edges do not get too long, when v moves to `goal` (3,)."""
    reach_a = reach_b = 0.0
    for axis in range(3):
        reach_a += (points[a, axis] - goal[axis]) ** 2
        reach_b += (points[b, axis] - goal[axis]) ** 2
    if max(reach_a, reach_b) > longest * longest:
        return False
    old, new = _normal(points[v], points[a], points[b]), _normal(goal, points[a], points[b])
    if not _cosine(old, new) > MIN_FACE_COSINE:
        return False
    for corner in (v, a, b):
        normal = (normals[corner, 0], normals[corner, 1], normals[corner, 2])
        lean = _cosine(new, normal)
        if -1.0 < lean < MIN_FACE_COSINE and lean < _cosine(old, normal):
            return False
    return True


def collapse_edges(faces: IntArray, target: IntArray) -> IntArray:
    """Faces with vertex i replaced by `target[i]`, without the faces that shrink."""
    new = target[faces]
    stays = (new[:, 0] != new[:, 1]) & (new[:, 1] != new[:, 2]) & (new[:, 2] != new[:, 0])
    return np.asarray(new[stays], dtype=np.int32)


def flip_edges(points: FloatArray, faces: IntArray, kept: IntArray, valences: IntArray) -> tuple[IntArray, int]:
    """Flip edges where that brings the numbers of neighbours nearer to the ideal ones, `valences` (n,).

    The edges `kept` (e, 2) stay. Returns the faces and the number of flips, which have no vertices in common, as one
    flip changes what others gain there.
    """
    n, lists = len(points), half_edge_lists(faces, len(points))
    degree = np.bincount(faces.ravel(), minlength=n)
    stays = np.zeros(faces.size, dtype=np.bool_)
    gains, faces = np.zeros(faces.size, dtype=np.int32), faces.copy()
    _mark_edges(faces, lists, kept, stays)
    _find_gains(points, faces, lists, stays, degree - valences, gains)
    order: IntArray = np.flatnonzero(gains).astype(np.int32)
    order = order[np.argsort(-gains[order], kind="stable")]
    count = _flip(faces, lists, order, np.zeros(n, dtype=np.bool_))
    return faces, int(count)


@jit()
def _mark_edges(faces: IntArray, lists: HalfEdgeLists, edges: IntArray, marks: BoolArray) -> None:
    """Mark the half-edges of edges (e, 2) in both directions."""
    for e in range(edges.shape[0]):
        for k in range(2):
            half = lists.first[edges[e, k]]
            while half >= 0:
                if faces[half // 3, (half + 1) % 3] == edges[e, 1 - k]:
                    marks[half] = True
                half = lists.following[half]


@jit()
def _find_gains(
    points: FloatArray,
    faces: IntArray,
    lists: HalfEdgeLists,
    stays: BoolArray,
    excess: IntArray,
    gains: IntArray,
) -> None:
    """Write by how much a flip of each half-edge, from its smaller end, lowers the sum of squares of `excess` (n,)."""
    for half in range(gains.shape[0]):
        f, corner = half // 3, half % 3
        a, b, c = faces[f, corner], faces[f, (corner + 1) % 3], faces[f, (corner + 2) % 3]
        if a > b or stays[half]:
            continue
        other = _only_face(faces, lists, a, b)
        if other < 0:
            continue
        d = faces[other, 0] + faces[other, 1] + faces[other, 2] - a - b
        gain = 2 * (excess[a] + excess[b] - excess[c] - excess[d]) - 4
        if gain <= 0 or c == d or face_at_edge(faces, lists, c, d) >= 0 or face_at_edge(faces, lists, d, c) >= 0:
            continue
        one, two = _normal(points[a], points[d], points[c]), _normal(points[d], points[b], points[c])
        first, second = _normal(points[a], points[b], points[c]), _normal(points[b], points[a], points[d])
        old = (first[0] + second[0], first[1] + second[1], first[2] + second[2])
        if min(_cosine(old, one), _cosine(old, two), _cosine(one, two)) > MIN_FACE_COSINE:
            gains[half] = gain


@inner_jit()
def _only_face(faces: IntArray, lists: HalfEdgeLists, a: int, b: int) -> int:
    """The face with the half-edge from b to a, -1 if there is none, or another one from a to b or from b to a."""
    found, count = -1, 0
    for k in range(2):
        start, stop = (a, b) if k == 0 else (b, a)
        half = lists.first[start]
        while half >= 0:
            if faces[half // 3, (half + 1) % 3] == stop:
                count += 1
                found = half // 3 if k == 1 else found
            half = lists.following[half]
    return found if count == 2 else -1


@jit()
def _flip(faces: IntArray, lists: HalfEdgeLists, order: IntArray, taken: BoolArray) -> int:
    """Flip half-edges in order unless a vertex there is taken; return their number."""
    count = 0
    for half in order:
        f, corner = half // 3, half % 3
        a, b, c = faces[f, corner], faces[f, (corner + 1) % 3], faces[f, (corner + 2) % 3]
        if taken[a] or taken[b] or taken[c]:  # else the faces at them are as in the lists
            continue
        other = face_at_edge(faces, lists, b, a)
        d = faces[other, 0] + faces[other, 1] + faces[other, 2] - a - b
        if taken[d]:
            continue
        taken[a] = taken[b] = taken[c] = taken[d] = True
        faces[f, 0], faces[f, 1], faces[f, 2] = a, d, c
        faces[other, 0], faces[other, 1], faces[other, 2] = d, b, c
        count += 1
    return count


@inner_jit()
def _normal(p: FloatArray, q: FloatArray, r: FloatArray) -> tuple[float, float, float]:
    """Area vector of a triangle."""
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@inner_jit()
def _cosine(u: tuple[float, float, float], v: tuple[float, float, float]) -> float:
    """Cosine of the angle between two vectors; -1 for those without length."""
    lengths = np.sqrt((u[0] ** 2 + u[1] ** 2 + u[2] ** 2) * (v[0] ** 2 + v[1] ** 2 + v[2] ** 2))
    return (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]) / lengths if lengths > 0.0 else -1.0
