"""Closed polygons in space: their measures, and their triangulations without further vertices.

Small loops take the triangulation with the flattest worst edge and, among those, the least area that dynamic
programming finds (G. Barequet, M. Sharir, 1995; P. Liepa, "Filling holes in meshes", SGP 2003). Of larger ones,
ears are cut off first, the shortest chords before the others, until they are small.
"""

import heapq
from math import pi

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import cdist

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.triangles import unit_normal
from bezier_filters.runtime.jit import inner_jit, jit, short_jit

DISTANCES_AT_ONCE = 512  # points up to which all distances are computed
SWEEPS = 6  # times that the farthest point from the last one is looked for, for a long distance to begin with
LARGEST_EXACT = 160  # most vertices of a loop that is triangulated in cubic time
WIDEST_EAR = 1.1 * pi  # angle of the hole at a vertex from which on the vertex is no ear
STEPS = 1e6  # in which 1 - cos of an angle is counted


def vector_area(loop: FloatArray) -> FloatArray:
    """Vector area of a closed polygon (k, 3): the normal by the right-hand rule, as long as the area, shape (3,)."""
    centred = loop - loop.mean(axis=0)
    return np.asarray(0.5 * np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0))


def diameter(points: FloatArray) -> float:
    """Largest distance between two of the points (k, 3).

    Of many points only the corners of their convex hull are compared, from the outside in. Two points are no farther
    from each other than from the middle of all points, in sum: most pairs need no look.
    """
    if len(points) <= DISTANCES_AT_ONCE:
        return float(cdist(points, points).max(initial=0.0))
    points = points[_hull_corners(points)]
    reach = np.linalg.norm(points - 0.5 * (points.min(axis=0) + points.max(axis=0)), axis=1)
    order = reach.argsort(kind="stable")[::-1]
    points, reach = points[order], reach[order]
    ends, longest = 0, 0.0
    for _ in range(SWEEPS):
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
        except QhullError:  # they lie in a space of fewer dimensions
            continue
    along = centred @ axes[0]
    return np.array([along.argmin(), along.argmax()], dtype=np.int32)


@jit()
def _longest_distance(points: FloatArray, reach: FloatArray, longest: float) -> tuple[float, int]:
    """Largest distance, given one, and how many were measured; points are sorted by their reach from the middle."""
    measured = 0
    for i in range(points.shape[0]):
        for j in range(i):
            # the sum may be as long by rounding alone
            if reach[i] + reach[j] <= longest * (1.0 + 1e-14):
                break
            x, y, z = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
            longest = max(longest, np.sqrt(x * x + y * y + z * z))
            measured += 1
    return longest, measured


def plane_axes(normal: FloatArray) -> FloatArray:
    """Right-handed orthonormal frame whose third row points along a vector that is not zero, shape (3, 3).

    >>> bool(np.allclose(plane_axes(np.array([0.0, 0.0, 2.0]))[2], [0, 0, 1]))
    True
    """
    z = normal / np.linalg.norm(normal)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def corner_angles(tips: FloatArray, lefts: FloatArray, rights: FloatArray) -> FloatArray:
    """Angles at the tips (n, 3) of triangles, in radians, (n,)."""
    u, v = lefts - tips, rights - tips
    angles = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v))
    return np.asarray(angles, dtype=np.float64)


def angle_sums(points: FloatArray, faces: IntArray, count: int) -> FloatArray:
    """Sum of the angles of faces (m, 3) at each of the first points, in radians, (count,)."""
    here, after, before = (faces[:, k].ravel() for k in ([0, 1, 2], [1, 2, 0], [2, 0, 1]))
    angles = corner_angles(points[here], points[after], points[before])
    return np.bincount(here, weights=angles, minlength=count)[:count].astype(np.float64)


def enclosed(points: FloatArray, polygon: FloatArray) -> BoolArray:
    """Whether points (n, 2) lie inside a closed polygon (k, 2), by the parity of crossings.

    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> enclosed(np.array([[0.5, 0.5], [1.5, 0.5]]), square).tolist()
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
        # The edges that do not share a vertex with this one.
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


def triangulate_loop(
    points: FloatArray, ids: IntArray, rim_normals: FloatArray, gaps: FloatArray, existing: IntArray
) -> IntArray | None:
    """Triangulate a closed loop.

    `points` (k, 3) run in the direction of the triangles, `rim_normals` (k, 3) are those of the faces beyond the edges
    that begin there, zero where there is none, and `gaps` (k,) are the angles of the hole, in radians. A loop that
    reaches islands over bridges names the ends of the bridges twice, by `ids` (k,). Pairs of ids that exist, (p, 2), or
    that the loop itself joins, are not joined again: None if every triangulation would, otherwise triangles of ids
    (k - 2, 3).

    >>> square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    >>> flat = np.tile([0.0, 0.0, 1.0], (4, 1))
    >>> triangulate_loop(square, np.arange(4), flat, np.full(4, pi / 2), np.array([[0, 2]])).tolist()
    [[0, 1, 3], [1, 2, 3]]
    """
    joined = np.concatenate([existing, np.stack([ids, np.concatenate([ids[1:], ids[:1]])], axis=1)])
    rest, ears = _cut_ears(points, ids, gaps, joined)
    normals = rim_normals[rest]
    if ears:
        normals[np.roll(rest, -1) != (rest + 1) % len(points)] = 0.0  # chords of ears
    count = len(rest)
    split, forbidden = np.full((count, count), -1, dtype=np.int32), np.zeros((count, count), dtype=np.bool_)
    inner = np.empty((count - 2, 3), dtype=np.int32)
    worst, area = np.zeros((2, count, count))
    _forbid(ids[rest], joined, forbidden)
    _search(points[rest], normals, forbidden, worst, area, split)
    if count > 2 and split[0, count - 1] < 0:
        return None
    _collect(split, np.empty((count, 2), dtype=np.int32), inner)
    positions = np.concatenate([np.array(ears, dtype=np.int32).reshape(-1, 3), rest[inner]])
    return np.asarray(ids[positions], dtype=np.int32)


def _cut_ears(
    points: FloatArray, ids: IntArray, gaps: FloatArray, joined: IntArray
) -> tuple[IntArray, list[tuple[int, int, int]]]:
    """Positions that are left when enough ears have been cut, and the ears."""
    count = len(points)
    if count <= LARGEST_EXACT:
        return np.arange(count, dtype=np.int32), []
    existing = {(a, b) for a, b in np.sort(joined, axis=1).tolist()}
    after, before = np.roll(np.arange(count), -1), np.roll(np.arange(count), 1)
    gaps, alive, version = gaps.copy(), np.ones(count, dtype=np.bool_), np.zeros(count, dtype=np.int32)
    ears: list[tuple[int, int, int]] = []
    queue: list[tuple[float, int, int]] = []

    def consider(k: int) -> None:
        version[k] += 1
        a, b = int(ids[before[k]]), int(ids[after[k]])
        if gaps[k] < WIDEST_EAR and a != b and (min(a, b), max(a, b)) not in existing:
            chord = float(np.linalg.norm(points[before[k]] - points[after[k]]))
            heapq.heappush(queue, (chord, k, int(version[k])))

    for k in range(count):
        consider(k)
    while queue and count - len(ears) > LARGEST_EXACT:
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
def _forbid(ids: IntArray, joined: IntArray, forbidden: BoolArray) -> None:
    """Mark which corners of a loop must not be joined by a chord, (k, k); its own edges may be."""
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
def _collect(split: IntArray, waiting: IntArray, triangles: IntArray) -> None:
    """Write the triangles of the search: below the edge from i to k lies the one with the corner split[i, k]."""
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
) -> None:
    """Find the best triangulation below every chord (i, k), the shorter chords first.

    `split` receives the third corner of the triangle at the chord, -1 where there is none; `worst` the sharpest
    edge below the chord, as 1 - cos of its angle, and `area` the area. All are (k, k), of which the upper triangle
    is used; `worst` and `area` are zero at first.
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
                for side in range(2):
                    a, b = (i, m) if side == 0 else (m, k)
                    sharpest = max(sharpest, _sharpness(points, rim_normals, split, a, b, x, y, z))
                if span == count - 1:
                    u, v, w = rim_normals[k, 0], rim_normals[k, 1], rim_normals[k, 2]
                    sharpest = max(sharpest, _rounded(x * u + y * v + z * w, u * u + v * v + w * w))
                # Of equally sharp ones the least area, of equal areas the first corner: sharpness is rounded for that.
                total = area[i, m] + area[m, k] + 0.5 * twice
                if sharpest < worst[i, k] or (sharpest == worst[i, k] and total < area[i, k]):
                    worst[i, k], area[i, k], split[i, k] = sharpest, total, m


@inner_jit()
def _sharpness(
    points: FloatArray, rim_normals: FloatArray, split: IntArray, a: int, b: int, x: float, y: float, z: float
) -> float:
    """1 - cos of the angle between a face with a unit normal and the one beyond its edge (a, b)."""
    if b == a + 1:
        u, v, w = rim_normals[a, 0], rim_normals[a, 1], rim_normals[a, 2]
        return _rounded(x * u + y * v + z * w, u * u + v * v + w * w)
    u, v, w, _ = unit_normal(points, a, split[a, b], b)
    return _rounded(x * u + y * v + z * w, u * u + v * v + w * w)


@inner_jit()
def _rounded(cosine: float, known: float) -> float:
    """1 - cos in steps, so that rounding errors do not choose between flat triangulations; 0 at unknown faces."""
    if known == 0.0:
        return 0.0
    return float(np.floor((1.0 - cosine) * STEPS + 0.5) / STEPS)
