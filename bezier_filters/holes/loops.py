"""Closed polygons in space: vector area, diameter, angles, and triangulation without new vertices.

Small loops get the triangulation that minimises the largest dihedral angle and then the area, or only the area, by
dynamic programming in O(k^3) (G. Barequet, M. Sharir, 1995; P. Liepa, "Filling holes in meshes", SGP 2003). Larger
loops are first reduced by ear clipping, in the order of the chord lengths.
"""

import heapq
from math import pi

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import cdist

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.triangles import unit_normal
from bezier_filters.runtime.jit import inner_jit, jit, short_jit

MAX_PAIRWISE_POINTS = 512  # points of which all pairwise distances are computed
DIAMETER_SWEEPS = 6  # farthest-point steps for a lower bound on the diameter
MAX_EXACT_LOOP = 160  # vertices of a loop that is triangulated by dynamic programming
MAX_EAR_ANGLE = 1.1 * pi  # gap angle of a vertex that may be an ear
COSINE_STEPS = 1e6  # resolution of 1 - cos of a dihedral angle, in steps per unit


def vector_area(loop: FloatArray) -> FloatArray:
    """Vector area of a closed polygon (k, 3), shape (3,): half the sum of p_i x p_(i+1), by the right-hand rule."""
    centred = loop - loop.mean(axis=0)
    return np.asarray(0.5 * np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0))


def diameter(points: FloatArray) -> float:
    """Largest distance between two of the points (k, 3).

    Of many points only the corners of their convex hull are compared, sorted by their distance to the centre of the
    bounding box. The triangle inequality through this centre excludes most pairs.
    """
    if len(points) <= MAX_PAIRWISE_POINTS:
        return float(cdist(points, points).max(initial=0.0))
    points = points[_hull_corners(points)]
    reach = np.linalg.norm(points - 0.5 * (points.min(axis=0) + points.max(axis=0)), axis=1)
    order = reach.argsort(kind="stable")[::-1]
    points, reach = points[order], reach[order]
    ends, longest = 0, 0.0
    for _ in range(DIAMETER_SWEEPS):
        distances = np.linalg.norm(points - points[ends], axis=1)
        ends, longest = int(distances.argmax()), max(longest, float(distances.max()))
    return float(_longest_distance(points, reach, longest)[0])


def _hull_corners(points: FloatArray) -> IntArray:
    """Corners of the convex hull of points (k, 3), which may lie in a plane or on a line."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.svd(centred.T @ centred)[2]
    for dimension in (3, 2):
        try:
            return np.asarray(ConvexHull(centred @ axes[:dimension].T).vertices, dtype=np.int32)
        except QhullError:  # the points are coplanar or collinear
            continue
    along = centred @ axes[0]
    return np.array([along.argmin(), along.argmax()], dtype=np.int32)


@jit()
def _longest_distance(points: FloatArray, reach: FloatArray, longest: float) -> tuple[float, int]:
    """Largest distance, given a lower bound, and the number of pairs measured; `reach` (k,) is descending."""
    measured = 0
    for i in range(points.shape[0]):
        for j in range(i):
            # the tolerance covers rounding of the sum
            if reach[i] + reach[j] <= longest * (1.0 + 1e-14):
                break
            x, y, z = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
            longest = max(longest, np.sqrt(x * x + y * y + z * z))
            measured += 1
    return longest, measured


def plane_axes(normal: FloatArray) -> FloatArray:
    """Right-handed orthonormal frame whose third row is parallel to a non-zero vector, shape (3, 3).

    >>> bool(np.allclose(plane_axes(np.array([0.0, 0.0, 2.0]))[2], [0, 0, 1]))
    True
    """
    z = normal / np.linalg.norm(normal)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def corner_angles(tips: FloatArray, lefts: FloatArray, rights: FloatArray) -> FloatArray:
    """Angles of triangles at their tips (n, 3), in radians, (n,)."""
    u, v = lefts - tips, rights - tips
    angles = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v))
    return np.asarray(angles, dtype=np.float64)


def angle_sums(points: FloatArray, faces: IntArray, count: int) -> FloatArray:
    """Sum of the face angles at each of the first `count` points, in radians, (count,)."""
    here, after, before = (faces[:, k].ravel() for k in ([0, 1, 2], [1, 2, 0], [2, 0, 1]))
    angles = corner_angles(points[here], points[after], points[before])
    return np.bincount(here, weights=angles, minlength=count)[:count].astype(np.float64)


def points_in_polygon(points: FloatArray, polygon: FloatArray) -> BoolArray:
    """Whether points (n, 2) lie inside a closed polygon (k, 2), by the parity of crossings.

    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> points_in_polygon(np.array([[0.5, 0.5], [1.5, 0.5]]), square).tolist()
    [True, False]
    """
    x, y = points[:, :1], points[:, 1:]
    following = np.roll(polygon, -1, axis=0)
    rise = following[:, 1] - polygon[:, 1]
    spans = (polygon[:, 1] <= y) != (following[:, 1] <= y)
    along = np.divide(y - polygon[:, 1], rise, out=np.zeros(spans.shape), where=rise != 0.0)
    crossing = polygon[:, 0] + along * (following[:, 0] - polygon[:, 0])
    return np.asarray(np.count_nonzero(spans & (x < crossing), axis=1) % 2 == 1)


def is_simple(polygon: FloatArray) -> bool:
    """Whether no two edges of a closed polygon (k, 2) cross or overlap, and none has length zero.

    >>> is_simple(np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]))
    False
    """
    count = len(polygon)
    following = np.roll(polygon, -1, axis=0)
    for i in range(count):
        a, b = polygon[i], following[i]
        if not (a != b).any():
            return False
        # the edges that share no vertex with this one
        stop = count if i > 0 else count - 1
        c, d = polygon[i + 2 : stop], following[i + 2 : stop]
        sides_of_others = _side(a, b, c) * _side(a, b, d)
        sides_of_own = _side(c, d, a) * _side(c, d, b)
        boxes_meet = (np.minimum(c, d) <= np.maximum(a, b)) & (np.maximum(c, d) >= np.minimum(a, b))
        if ((sides_of_others <= 0.0) & (sides_of_own <= 0.0) & boxes_meet.all(axis=1)).any():
            return False
    return True


def _side(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Positive where c lies to the left of the line from a to b."""
    ab, ac = b - a, c - a
    return np.sign(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])


def simple_loops(loop: IntArray) -> list[IntArray]:
    """Split a closed loop into simple ones, at the vertices that it passes more than once.

    >>> [simple.tolist() for simple in simple_loops(np.array([0, 1, 2, 0, 3, 4], dtype=np.int32))]
    [[0, 1, 2], [0, 3, 4]]
    """
    found: list[IntArray] = []
    path: list[int] = []
    place: dict[int, int] = {}
    for vertex in [*loop.tolist(), int(loop[0])]:
        if vertex in place:
            begin = place[vertex]
            found.append(np.array(path[begin:], dtype=np.int32))
            for passed in path[begin:]:
                del place[passed]
            del path[begin:]
        place[vertex] = len(path)
        path.append(vertex)
    return [simple for simple in found if len(simple) > 2]


def triangulate_loop(
    points: FloatArray,
    ids: IntArray,
    rim_normals: FloatArray,
    gaps: FloatArray,
    existing: IntArray,
    *,
    least_area: bool = False,
) -> IntArray | None:
    """Triangulate a closed loop with the least largest dihedral angle, or else with the least area.

    `points` (k, 3) run in the direction of the triangles. `rim_normals` (k, 3) are the normals of the adjacent faces at
    the edges that begin there, zero where there is none, and `gaps` (k,) the angles of the hole, in radians. A loop
    with bridges to islands repeats the end vertices of the bridges; `ids` (k,) identifies them. Triangles do not use
    existing edges, pairs of ids (p, 2), nor edges of the loop as chords. Returns triangles of ids, (k - 2, 3), or None
    if there is no such triangulation.

    >>> square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    >>> flat = np.tile([0.0, 0.0, 1.0], (4, 1))
    >>> triangulate_loop(square, np.arange(4), flat, np.full(4, pi / 2), np.array([[0, 2]])).tolist()
    [[0, 1, 3], [1, 2, 3]]
    """
    joined = np.concatenate([existing, np.stack([ids, np.concatenate([ids[1:], ids[:1]])], axis=1)])
    rest, ears = _cut_ears(points, ids, gaps, joined)
    normals = rim_normals[rest]
    if ears:
        normals[np.roll(rest, -1) != (rest + 1) % len(points)] = 0.0  # at the chords of ears
    count = len(rest)
    split, forbidden = np.full((count, count), -1, dtype=np.int32), np.zeros((count, count), dtype=np.bool_)
    inner = np.empty((count - 2, 3), dtype=np.int32)
    worst, area = np.zeros((2, count, count))
    _mark_forbidden_chords(ids[rest], joined, forbidden)
    _search(points[rest], normals, forbidden, worst, area, split, least_area)
    if count > 2 and split[0, count - 1] < 0:
        return None
    _collect_triangles(split, np.empty((count, 2), dtype=np.int32), inner)
    positions = np.concatenate([np.array(ears, dtype=np.int32).reshape(-1, 3), rest[inner]])
    return np.asarray(ids[positions], dtype=np.int32)


def _cut_ears(
    points: FloatArray, ids: IntArray, gaps: FloatArray, joined: IntArray
) -> tuple[IntArray, list[tuple[int, int, int]]]:
    """Clip ears until the loop is small; return the remaining positions and the ears."""
    count = len(points)
    if count <= MAX_EXACT_LOOP:
        return np.arange(count, dtype=np.int32), []
    existing = {(a, b) for a, b in np.sort(joined, axis=1).tolist()}
    after, before = np.roll(np.arange(count), -1), np.roll(np.arange(count), 1)
    gaps, alive, version = gaps.copy(), np.ones(count, dtype=np.bool_), np.zeros(count, dtype=np.int32)
    ears: list[tuple[int, int, int]] = []
    queue: list[tuple[float, int, int]] = []

    def consider(k: int) -> None:
        version[k] += 1
        a, b = int(ids[before[k]]), int(ids[after[k]])
        if gaps[k] < MAX_EAR_ANGLE and a != b and (min(a, b), max(a, b)) not in existing:
            chord = float(np.linalg.norm(points[before[k]] - points[after[k]]))
            heapq.heappush(queue, (chord, k, int(version[k])))

    for k in range(count):
        consider(k)
    while queue and count - len(ears) > MAX_EXACT_LOOP:
        _, k, stamp = heapq.heappop(queue)
        if stamp != version[k] or not alive[k]:
            continue
        a, b = before[k], after[k]
        ears.append((int(a), k, int(b)))
        alive[k] = False
        after[a], before[b] = b, a
        gaps[[a, b]] -= corner_angles(points[[a, b]], points[[k, a]], points[[b, k]])
        consider(int(a))
        consider(int(b))
    return np.flatnonzero(alive).astype(np.int32), ears


@short_jit()
def _mark_forbidden_chords(ids: IntArray, joined: IntArray, forbidden: BoolArray) -> None:
    """Mark pairs of corners that no chord may join, (k, k); edges of the loop stay unmarked."""
    count = ids.shape[0]
    for i in range(count):
        for j in range(count):
            forbidden[i, j] = ids[i] == ids[j]
    for p in range(joined.shape[0]):
        for i in range(count):
            if ids[i] == joined[p, 0]:
                for j in range(count):
                    if ids[j] == joined[p, 1]:
                        forbidden[i, j] = forbidden[j, i] = True
    for i in range(count):
        j = (i + 1) % count
        forbidden[i, j] = forbidden[j, i] = False


@short_jit()
def _collect_triangles(split: IntArray, waiting: IntArray, triangles: IntArray) -> None:
    """Write the triangles of the optimum: the triangle at the chord (i, k) has its third corner at split[i, k]."""
    count, depth = 0, 1
    waiting[0, 0], waiting[0, 1] = 0, split.shape[0] - 1
    while depth > 0:
        depth -= 1
        i, k = waiting[depth, 0], waiting[depth, 1]
        if k - i > 1:
            m = split[i, k]
            triangles[count, 0], triangles[count, 1], triangles[count, 2] = i, m, k
            count += 1
            waiting[depth, 0], waiting[depth, 1] = m, k
            waiting[depth + 1, 0], waiting[depth + 1, 1] = i, m
            depth += 2


@jit()
def _search(
    points: FloatArray,
    rim_normals: FloatArray,
    forbidden: BoolArray,
    worst: FloatArray,
    area: FloatArray,
    split: IntArray,
    least_area: bool,  # whether angles do not matter
) -> None:
    """Dynamic program over chords (i, k), in the order of their span: the best triangulation of the corners i .. k.

    `split` receives the third corner of the triangle at the chord, -1 if there is none; `worst` the largest dihedral
    angle, as 1 - cos, and `area` the area. All are (k, k) with the upper triangle in use; `worst` and `area` are zero
    at first.
    """
    count = points.shape[0]
    for span in range(2, count):
        for i in range(count - span):
            k = i + span
            worst[i, k] = np.inf
            if forbidden[i, k]:
                continue
            for m in range(i + 1, k):
                sharpest = max(worst[i, m], worst[m, k])
                if sharpest > worst[i, k]:
                    continue
                x, y, z, twice = unit_normal(points, i, m, k)
                for side in range(0 if least_area else 2):
                    a, b = (i, m) if side == 0 else (m, k)
                    sharpest = max(sharpest, _sharpness(points, rim_normals, split, a, b, x, y, z))
                if span == count - 1 and not least_area:
                    u, v, w = rim_normals[k, 0], rim_normals[k, 1], rim_normals[k, 2]
                    sharpest = max(sharpest, _round_sharpness(x * u + y * v + z * w, u * u + v * v + w * w))
                # Ties in sharpness, which is rounded, are broken by area, ties in area by the first corner.
                total = area[i, m] + area[m, k] + 0.5 * twice
                if sharpest < worst[i, k] or (sharpest == worst[i, k] and total < area[i, k]):
                    worst[i, k], area[i, k], split[i, k] = sharpest, total, m


@inner_jit()
def _sharpness(
    points: FloatArray, rim_normals: FloatArray, split: IntArray, a: int, b: int, x: float, y: float, z: float
) -> float:
    """1 - cos of the dihedral angle between a face with a unit normal and its neighbour at the edge (a, b)."""
    if b == a + 1:
        u, v, w = rim_normals[a, 0], rim_normals[a, 1], rim_normals[a, 2]
        return _round_sharpness(x * u + y * v + z * w, u * u + v * v + w * w)
    u, v, w, _ = unit_normal(points, a, split[a, b], b)
    return _round_sharpness(x * u + y * v + z * w, u * u + v * v + w * w)


@inner_jit()
def _round_sharpness(cosine: float, known: float) -> float:
    """1 - cos rounded to steps, so that flat triangulations tie in spite of rounding errors; 0 without a neighbour."""
    if known == 0.0:
        return 0.0
    return float(np.floor((1.0 - cosine) * COSINE_STEPS + 0.5) / COSINE_STEPS)
