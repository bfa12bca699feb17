"""The triangulation of a hole, refined: triangles are split, edges flipped, vertices moved to where they are more even.

Triangles are split until their edges are as long as those of the surroundings, with edges flipped until all of them
are locally Delaunay (P. Liepa, "Filling holes in meshes", SGP 2003). The edges at the rim stay as they are. Far from
the rim of a large hole edges grow, so that the number of faces is n log n for a rim of n edges, and not n^2.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.spatial import cKDTree

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.half_edges import HalfEdgeLists, face_neighbours, find_neighbours, room_for_half_edges
from bezier_filters.meshes.triangles import angle_parts, area_vector, cosine_between, has_corner
from bezier_filters.runtime.jit import inner_jit, jit, short_jit

# triangles are split while their centroid is farther from their corners than the wanted edge length over this
DENSITY = float(np.sqrt(2.0))
# edges from the rim up to which wanted lengths are those at the rim, and over which their square doubles from there on:
# a round hole of 200 edges is nowhere deeper
UNIFORM_DEPTH, GROWTH_DEPTH = 32.0, 4.0
# limit on the faces of a fill: this plus the square of the number of rim vertices, some six times as many as a round
# hole needs, and for each rim vertex of a large hole some three times as many; beyond it triangles stay too large
FEW_FACES, FACES_PER_RIM_VERTEX = 1_000, 250
MOST_PASSES = 60
# rows that there is room for, in faces of a fill or in so many, if it has fewer, before its arrays are made longer
GROWTH, FEWEST_ROWS = 9, 200
MOST_FLIPS = 30  # passes over all edges
FINISHED, NO_ROOM, PAUSED, LIMITED = 0, 1, 2, 3  # outcomes of passes

Values = TypeVar("Values", FloatArray, IntArray)


@dataclass(frozen=True)
class Fill:
    """The triangulation of a hole."""

    points: FloatArray  # (n, 3): vertices, those of the rim first
    sizes: FloatArray  # (n,): edge length that is wanted around each of them, before it grows away from the rim
    faces: IntArray  # (m, 3): triangles
    rim_count: int  # number of vertices of the rim
    is_limited: bool = False  # whether triangles stayed too large, as there would be too many faces


def refine(fill: Fill, existing: IntArray) -> Fill:
    """Split triangles that are too large, and flip edges; pairs (p, 2) of rim vertices are not joined again."""
    points, sizes, faces = fill.points, fill.sizes, fill.faces
    neighbours, existing = face_neighbours(faces), sorted_pairs(existing)
    rim = cKDTree(points[: fill.rim_count]) if _is_wide(fill) else None
    growth = np.ones(len(points)) if rim is None else _growth(points, sizes, rim, fill.rim_count)
    borders = np.empty(fill.rim_count, dtype=np.int32)
    counts, most = np.array([len(points), len(faces), 0]), face_limit(fill.rim_count)
    while True:
        passes = MOST_PASSES if rim is None else int(counts[2]) + 1
        done = int(counts[0])
        state = _refine(
            points, sizes, growth, faces, neighbours, existing, fill.rim_count, borders, most, passes, counts
        )
        n, m = int(counts[0]), int(counts[1])
        if state == NO_ROOM:
            room = GROWTH * max(m, FEWEST_ROWS)
            points, sizes, growth = _with_room(points, room), _with_room(sizes, room), _with_room(growth, room)
            faces, neighbours = _with_room(faces, room), _with_room(neighbours, room)
        elif state == PAUSED and rim is not None and counts[2] < MOST_PASSES:
            growth[done:n] = _growth(points[done:n], sizes[done:n], rim, 0)
        else:
            return Fill(points[:n].copy(), sizes[:n].copy(), faces[:m].copy(), fill.rim_count, state == LIMITED)


def face_limit(rim_count: int) -> int:
    """Number of faces from which on no more triangles of a fill are split, for a number of rim vertices."""
    return FEW_FACES + rim_count * min(rim_count, FACES_PER_RIM_VERTEX)


def _is_wide(fill: Fill) -> bool:
    """Whether a hole may be so wide that the edges of its fill grow."""
    rim = fill.points[: fill.rim_count]
    return float(np.linalg.norm(np.ptp(rim, axis=0))) > UNIFORM_DEPTH * float(fill.sizes[: fill.rim_count].min())


def _growth(points: FloatArray, sizes: FloatArray, rim: cKDTree, rim_count: int) -> FloatArray:
    """Factors of wanted lengths at points, (n,), by their distance to the rim; 1 at the first points.

    At a depth of d edges of a large hole of n edges, faces fill n / d per edge of depth where factors grow like the
    root of d: all in all n log n. The angles between faces on a smooth surface, by which it differs from its facets,
    still fall with n.
    """
    depths = rim.query(points)[0] / np.maximum(sizes, 1e-300) - UNIFORM_DEPTH
    factors = np.sqrt(1.0 + np.maximum(depths, 0.0) / GROWTH_DEPTH)
    factors[:rim_count] = 1.0
    return np.asarray(factors, dtype=np.float64)


def sorted_pairs(pairs: IntArray) -> IntArray:
    """Pairs (p, 2), the smaller one first, in ascending order."""
    result = np.sort(pairs, axis=1)
    return result[np.lexsort((result[:, 1], result[:, 0]))]


def _with_room(part: Values, count: int) -> Values:
    """An array with as many further rows as are needed for so many in all."""
    result = np.empty((count, *part.shape[1:]), dtype=part.dtype)
    result[: len(part)] = part
    return result


def flip_edges(fill: Fill, existing: IntArray) -> Fill:
    """Flip edges until all are locally Delaunay, without joining pairs (p, 2) of rim vertices again."""
    faces = fill.faces.copy()
    _flip_all(fill.points, faces, work_space(fill), sorted_pairs(existing), fill.rim_count)
    return replace(fill, faces=faces)


class WorkSpace(NamedTuple):
    """What is needed to even out a fill of n points and m faces."""

    lists: HalfEdgeLists
    neighbours: IntArray  # (m, 3)
    before: FloatArray  # (n, 3)
    goals: FloatArray  # (n, 3)
    counts: FloatArray  # (n,)
    moving: BoolArray  # (n,)
    borders: IntArray  # (r,): room for each vertex of the rim


def work_space(fill: Fill) -> WorkSpace:
    """Room for a fill."""
    n, m = len(fill.points), len(fill.faces)
    before, goals = np.empty((2, n, 3))
    neighbours, lists = np.empty((m, 3), dtype=np.int32), room_for_half_edges(3 * m, n)
    borders = np.empty(fill.rim_count, dtype=np.int32)
    return WorkSpace(lists, neighbours, before, goals, np.empty(n), np.empty(n, dtype=np.bool_), borders)


@inner_jit()
def even_out(points: FloatArray, faces: IntArray, room: WorkSpace, existing: IntArray, rim_count: int) -> None:
    """Flip edges as `flip_edges`, given sorted pairs, and then move every new vertex to the mean of its neighbours.

    On a fill that is projected to its surface again this moves vertices along the surface only.
    """
    _flip_all(points, faces, room, existing, rim_count)
    _move_to_means(points, faces, room, rim_count)


@short_jit()
def _flip_all(points: FloatArray, faces: IntArray, room: WorkSpace, existing: IntArray, rim_count: int) -> None:
    find_neighbours(faces, room.lists, room.neighbours)
    _flip(points, faces, room.neighbours, existing, rim_count, room.borders)


@jit()
def _refine(
    points: FloatArray,
    sizes: FloatArray,
    growth: FloatArray,
    faces: IntArray,
    neighbours: IntArray,
    existing: IntArray,
    rim_count: int,
    borders: IntArray,
    most: int,
    passes: int,
    counts: IntArray,
) -> int:
    """Split and flip in passes, up to a number of them; return how that ended.

    `counts` are those of vertices, faces and passes.
    """
    while counts[2] < passes:
        n, m = counts[0], counts[1]
        if m > most:
            return LIMITED
        if faces.shape[0] < 3 * m:  # each face may become three
            return NO_ROOM
        added = _split(points, sizes, growth, faces, neighbours, n, m)
        counts[0], counts[1], counts[2] = n + added, m + 2 * added, counts[2] + 1
        flips = _flip(points, faces[: m + 2 * added], neighbours, existing, rim_count, borders)
        if flips == 0 and added == 0:
            return FINISHED
    return PAUSED


@inner_jit()
def _split(
    points: FloatArray, sizes: FloatArray, growth: FloatArray, faces: IntArray, neighbours: IntArray, n: int, m: int
) -> int:
    """Split those of the first m faces that are too large at their centroids; return how many."""
    added = 0
    for f in range(m):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        size, factor = (sizes[a] + sizes[b] + sizes[c]) / 3.0, (growth[a] + growth[b] + growth[c]) / 3.0
        x = (points[a, 0] + points[b, 0] + points[c, 0]) / 3.0
        y = (points[a, 1] + points[b, 1] + points[c, 1]) / 3.0
        z = (points[a, 2] + points[b, 2] + points[c, 2]) / 3.0
        large = True
        for k in range(3):
            i = faces[f, k]
            dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
            distance = DENSITY * np.sqrt(dx * dx + dy * dy + dz * dz)
            large = large and distance > factor * size and distance > growth[i] * sizes[i]
        if not large:
            continue
        tip, g, h = n + added, m + 2 * added, m + 2 * added + 1
        points[tip, 0], points[tip, 1], points[tip, 2], sizes[tip], growth[tip] = x, y, z, size, factor
        beyond_bc, beyond_ca = neighbours[f, 1], neighbours[f, 2]
        faces[g, 0], faces[g, 1], faces[g, 2] = b, c, tip
        faces[h, 0], faces[h, 1], faces[h, 2] = c, a, tip
        faces[f, 2] = tip
        neighbours[g, 0], neighbours[g, 1], neighbours[g, 2] = beyond_bc, h, f
        neighbours[h, 0], neighbours[h, 1], neighbours[h, 2] = beyond_ca, f, g
        neighbours[f, 1], neighbours[f, 2] = g, h
        _relink(faces, neighbours, beyond_bc, c, g)
        _relink(faces, neighbours, beyond_ca, a, h)
        added += 1
    return added


@inner_jit()
def _relink(faces: IntArray, neighbours: IntArray, f: int, start: int, new: int) -> None:
    """Tell face f, if there is one, which face lies beyond its edge that begins at a vertex."""
    if f >= 0:
        k = 0 if faces[f, 0] == start else 1 if faces[f, 1] == start else 2
        neighbours[f, k] = new


@inner_jit()
def _flip(
    points: FloatArray, faces: IntArray, neighbours: IntArray, existing: IntArray, rim_count: int, borders: IntArray
) -> int:
    """Flip edges that are not locally Delaunay, in passes over all faces; return how many.

    `borders` (r,) receives how many edges of the border begin at each vertex of the rim.
    """
    flips = 0
    for i in range(rim_count):
        borders[i] = 0
    for f in range(faces.shape[0]):
        for k in range(3):
            if neighbours[f, k] < 0 and faces[f, k] < rim_count:
                borders[faces[f, k]] += 1
    for _ in range(MOST_FLIPS):
        before = flips
        for f in range(faces.shape[0]):
            for k in range(3):
                g = neighbours[f, k]
                if g < 0:
                    continue
                a, b, c = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
                q = 0 if faces[g, 0] == b else 1 if faces[g, 1] == b else 2
                d = faces[g, (q + 2) % 3]
                if (
                    c == d
                    or not _is_better_flipped(points, a, b, c, d)
                    or (c < rim_count and d < rim_count and _is_listed(existing, c, d))
                    or _are_joined(faces, neighbours, f, g, c, d, rim_count, borders)
                ):
                    continue
                # Faces (a, b, c) and (b, a, d) become (d, c, a) and (c, d, b).
                p1, p2 = (k + 1) % 3, (k + 2) % 3
                q1, q2 = (q + 1) % 3, (q + 2) % 3
                beyond_bc, beyond_ca = neighbours[f, p1], neighbours[f, p2]
                beyond_ad, beyond_db = neighbours[g, q1], neighbours[g, q2]
                faces[f, 0], faces[f, 1], faces[f, 2] = d, c, a
                faces[g, 0], faces[g, 1], faces[g, 2] = c, d, b
                neighbours[f, 0], neighbours[f, 1], neighbours[f, 2] = g, beyond_ca, beyond_ad
                neighbours[g, 0], neighbours[g, 1], neighbours[g, 2] = f, beyond_db, beyond_bc
                _relink(faces, neighbours, beyond_ad, d, f)
                _relink(faces, neighbours, beyond_bc, c, g)
                flips += 1
                break
        if flips == before:
            break
    return flips


@inner_jit()
def _is_better_flipped(points: FloatArray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the angles at c and d, opposite the edge (a, b), exceed pi, and (c, d) makes no sharper edge."""
    at_c, across_c = angle_parts(points, c, a, b)
    at_d, across_d = angle_parts(points, d, b, a)
    if across_c * at_d + at_c * across_d >= -1e-10 * (abs(across_c * at_d) + abs(at_c * across_d)):
        return False
    # A triangle without area is as good as folded. Ties stay as they are, lest rounding flips edges to and fro.
    now = cosine_between(points, a, b, c, b, a, d, -1.0)
    then = cosine_between(points, d, c, a, c, d, b, -1.0)
    return then >= min(now, 0.5) - 1e-9


@inner_jit()
def _is_listed(pairs: IntArray, a: int, b: int) -> bool:
    """Whether (a, b) or (b, a) is among sorted pairs."""
    low, high = min(a, b), max(a, b)
    first, last = 0, pairs.shape[0]
    while first < last:
        middle = (first + last) // 2
        i, j = pairs[middle, 0], pairs[middle, 1]
        if i < low or (i == low and j < high):
            first = middle + 1
        else:
            last = middle
    return bool(first < pairs.shape[0] and pairs[first, 0] == low and pairs[first, 1] == high)


@inner_jit()
def _are_joined(
    faces: IntArray, neighbours: IntArray, f: int, g: int, c: int, d: int, rim_count: int, borders: IntArray
) -> bool:
    """Whether an edge joins c, a corner of face f, and d, a corner of face g.

    Around a vertex inside the fill its faces form one closed fan, around one on the rim an open one, or several where a
    rim meets itself and several edges of the border begin there. Where no turn around a vertex ends, the answer is yes.
    """
    start, tip, other = f, c, d
    if c < rim_count and (d >= rim_count or borders[c] > 1):
        start, tip, other = g, d, c
    if tip < rim_count and borders[tip] > 1:
        joined = False
        for face in range(faces.shape[0]):
            joined = joined or (has_corner(faces, face, c) and has_corner(faces, face, d))
        return joined
    for turn in range(2):  # the other way around, too, from where an open fan does not go on
        face = start
        for _ in range(faces.shape[0]):
            if has_corner(faces, face, other):
                return True
            k = 0 if faces[face, 0] == tip else 1 if faces[face, 1] == tip else 2
            face = neighbours[face, k if turn == 0 else (k + 2) % 3]
            if face == start:
                return False
            if face < 0:
                break
        if face >= 0 or tip >= rim_count:
            return True
    return False


@short_jit()
def _move_to_means(points: FloatArray, faces: IntArray, room: WorkSpace, rim_count: int) -> None:
    """Move new points; those of turned triangles, and of triangles that turn because they stay, keep their places."""
    before, goals, counts, moving = room.before, room.goals, room.counts, room.moving
    for i in range(points.shape[0]):
        counts[i], moving[i] = 0.0, i >= rim_count
        for axis in range(3):
            before[i, axis], goals[i, axis] = points[i, axis], 0.0
    for k in range(3):
        for f in range(faces.shape[0]):
            i, j = faces[f, k], faces[f, (k + 1) % 3]
            counts[i] += 1.0
            for axis in range(3):
                goals[i, axis] += before[j, axis]
    for i in range(before.shape[0]):
        if moving[i]:
            for axis in range(3):
                points[i, axis] = goals[i, axis] / max(counts[i], 1.0)
    turned = True
    while turned:
        turned = False
        # All triangles are judged before vertices go back, so that their order does not matter.
        for f in range(faces.shape[0]):
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            if (moving[a] or moving[b] or moving[c]) and _are_opposite(before, points, a, b, c):
                moving[a] = moving[b] = moving[c] = False
                turned = True
        for i in range(before.shape[0]):
            if not moving[i]:
                for axis in range(3):
                    points[i, axis] = before[i, axis]


@inner_jit()
def _are_opposite(before: FloatArray, after: FloatArray, a: int, b: int, c: int) -> bool:
    """Whether a triangle is turned by more than a right angle."""
    ux, uy, uz = area_vector(before, a, b, c)
    vx, vy, vz = area_vector(after, a, b, c)
    return ux * vx + uy * vy + uz * vz < 0.0
