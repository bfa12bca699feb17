"""Triangulation of a plane polygon with islands by ear clipping (Meisters 1975; islands as in Eberly 2002).

Each island is connected by the shortest segment that crosses nothing, traversed in both directions, so that one polygon
remains. Its ears are clipped, the one with the shortest chord first. Unlike `loops.triangulate_loop`, which does not
know the plane, this tests whether other vertices lie in an ear, so the triangles never overlap.
"""

from collections.abc import Sequence

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.refinement import is_listed, sort_pairs
from bezier_filters.runtime.jit import inner_jit, jit, short_jit

MAX_BRIDGES = 1_000_000  # segments to an island that are sorted by length, at most; the shortest of them are tested
# Rounding error of an area, over the product of two lengths: sums of products of coordinates of the size of the polygon
AREA_ROUNDING = 1e-13


def triangulate_polygon(points: FloatArray, loops: Sequence[IntArray], existing: IntArray) -> IntArray | None:
    """Triangles (m, 3) of a polygon, or None if there are none.

    `points` (n, 2) are in the plane. Of the loops, rows of points, the first goes around the polygon counter-clockwise,
    the others around its islands clockwise. Chords are no existing edges, pairs of rows (p, 2).

    >>> square = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0]])
    >>> island = np.array([[1.0, 1.0], [1.0, 2.0], [2.0, 2.0], [2.0, 1.0]])
    >>> faces = triangulate_polygon(np.vstack([square, island]), [np.arange(4), np.arange(4, 8)], np.empty((0, 2), int))
    >>> len(faces)
    8
    """
    edges = np.concatenate([np.column_stack([loop, np.roll(loop, -1)]) for loop in loops]).astype(np.int32)
    polygon = np.asarray(loops[0], dtype=np.int32)
    islands = {k: np.asarray(loop, dtype=np.int32) for k, loop in enumerate(loops[1:])}
    distances = {k: _distance_square(points[polygon], points[island]) for k, island in islands.items()}
    while islands:
        nearest = min(distances, key=lambda k: distances[k])
        island = islands.pop(nearest)
        joined = _join_island(points, edges, polygon, island)
        if joined is None:
            return None
        edges = np.concatenate([edges, joined[1][np.newaxis]])
        polygon = joined[0]
        del distances[nearest]
        for k, other in islands.items():
            distances[k] = min(distances[k], _distance_square(points[island], points[other]))
    faces = np.empty((len(polygon) - 2, 3), dtype=np.int32)
    scale = float(np.abs(points - points.mean(axis=0)).max(initial=0.0))
    work = np.empty((3, len(polygon)), dtype=np.int32)
    existing = sort_pairs(existing.astype(np.int32))
    is_done = _clip_ears(points, polygon, existing, AREA_ROUNDING * scale * scale, work, np.empty(len(polygon)), faces)
    return faces if is_done else None


def _distance_square(first: FloatArray, second: FloatArray) -> float:
    """Square of the least distance between two sets of points (n, 2)."""
    return float(np.square(first[:, np.newaxis] - second).sum(axis=2).min())


def _join_island(
    points: FloatArray, edges: IntArray, polygon: IntArray, island: IntArray
) -> tuple[IntArray, IntArray] | None:
    """The polygon joined to an island, and the edge (2,) that joins them; None if every one crosses an edge."""
    squares = np.square(points[polygon][:, np.newaxis] - points[island]).sum(axis=2).ravel()
    count = min(len(squares), MAX_BRIDGES)
    shortest = np.argpartition(squares, count - 1)[:count]
    for pair in shortest[np.argsort(squares[shortest], kind="stable")]:
        i, j = divmod(int(pair), len(island))
        before, after = polygon[i - 1], polygon[(i + 1) % len(polygon)]
        is_inside = _is_inside(points, before, polygon[i], after, island[j])
        if is_inside and not _crosses(points, edges, polygon[i], island[j]):
            around = np.roll(island, -j)
            joined = np.concatenate([polygon[: i + 1], around, around[:1], polygon[i:]])
            return joined, np.array([polygon[i], island[j]], dtype=np.int32)
    return None


@short_jit()
def _is_inside(points: FloatArray, before: int, corner: int, after: int, target: int) -> bool:
    """Whether a point lies in the angle to the left of two edges of a polygon, seen from their common corner."""
    left_of_first = _turn(points, before, corner, target) > 0.0
    left_of_second = _turn(points, corner, after, target) > 0.0
    if _turn(points, before, corner, after) > 0.0:
        return left_of_first and left_of_second
    return left_of_first or left_of_second


@jit()
def _crosses(points: FloatArray, edges: IntArray, a: int, b: int) -> bool:
    """Whether the segment between two points meets an edge that has no end in common with it."""
    for k in range(edges.shape[0]):
        c, d = edges[k, 0], edges[k, 1]
        if c in (a, b) or d in (a, b):
            continue
        sides = _turn(points, a, b, c) * _turn(points, a, b, d), _turn(points, c, d, a) * _turn(points, c, d, b)
        if sides[0] <= 0.0 and sides[1] <= 0.0:
            return True
    return False


@inner_jit()
def _turn(points: FloatArray, a: int, b: int, c: int) -> float:
    """Twice the area of a triangle, positive if it is counter-clockwise."""
    return float(
        (points[b, 0] - points[a, 0]) * (points[c, 1] - points[a, 1])
        - (points[b, 1] - points[a, 1]) * (points[c, 0] - points[a, 0])
    )


@jit()
def _clip_ears(
    points: FloatArray,
    polygon: IntArray,
    existing: IntArray,
    rounding: float,
    work: IntArray,
    chords: FloatArray,
    faces: IntArray,
) -> bool:
    """Clip ears until none remains; return whether that succeeds.

    `chords` (k,) receives the squared lengths of the chords, infinite where there is no ear, and the rows of `work` the
    neighbours of each vertex along the polygon and a vertex that lies in its ear.
    """
    count = polygon.shape[0]
    before, after, inside = work[0], work[1], work[2]
    for i in range(count):
        before[i], after[i] = (i - 1) % count, (i + 1) % count
    for i in range(count):
        _measure_ear(points, polygon, existing, before, after, rounding, i, inside, chords)
    for k in range(count - 2):
        best = -1
        for i in range(count):
            if after[i] >= 0 and chords[i] < np.inf and (best < 0 or chords[i] < chords[best]):
                best = i
        if best < 0:
            return False
        a, b = before[best], after[best]
        faces[k, 0], faces[k, 1], faces[k, 2] = polygon[a], polygon[best], polygon[b]
        after[a], before[b], after[best] = b, a, -1
        for i in range(count):
            if after[i] >= 0 and (i in (a, b) or inside[i] == best):
                _measure_ear(points, polygon, existing, before, after, rounding, i, inside, chords)
    return True


@inner_jit()
def _measure_ear(
    points: FloatArray,
    polygon: IntArray,
    existing: IntArray,
    before: IntArray,
    after: IntArray,
    rounding: float,
    i: int,
    inside: IntArray,
    chords: FloatArray,
) -> None:
    """Write the squared length of the chord of an ear; infinite if there is none."""
    a, b, c = polygon[before[i]], polygon[i], polygon[after[i]]
    inside[i], chords[i] = -1, np.inf
    if a == c or _turn(points, a, b, c) <= rounding:
        return
    j = after[after[i]]
    if j != before[i] and is_listed(existing, a, c):
        return
    while j != before[i]:
        p = polygon[j]
        blocks = (
            p not in (a, b, c)
            and _turn(points, a, b, p) >= -rounding
            and _turn(points, b, c, p) >= -rounding
            and _turn(points, c, a, p) >= -rounding
        )
        if p == b:  # the end of a bridge, which may cross the chord
            for q in (polygon[before[j]], polygon[after[j]]):
                blocks = blocks or (_turn(points, a, b, q) > rounding and _turn(points, b, c, q) > rounding)
        if blocks:
            inside[i] = j
            return
        j = after[j]
    x, y = points[a, 0] - points[c, 0], points[a, 1] - points[c, 1]
    chords[i] = x * x + y * y
