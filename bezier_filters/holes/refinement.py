"""The triangulation of a hole, refined: triangles are split, edges flipped, vertices moved to where they are more even.

Triangles are split until their edges are as long as those of the surroundings, with edges flipped until all of them
are locally Delaunay (P. Liepa, "Filling holes in meshes", SGP 2003). The edges at the rim stay as they are.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.half_edges import HalfEdgeLists, face_neighbours, find_neighbours, room_for_half_edges
from bezier_filters.meshes.triangles import angle_parts, area_vector, cosine_between, has_corner
from bezier_filters.runtime.jit import inner_jit, jit, short_jit

# triangles are split while their centroid is farther from their corners than the wanted edge length over this
DENSITY = float(np.sqrt(2.0))
# of a fill, and the square of its rim's number of edges, some six times as many as a round hole needs: where a rim has
# edges of very different lengths, triangles stay larger than they would be
FEW_FACES = 1_000
MOST_PASSES = 60
# rows that there is room for, in faces of a fill or in so many, if it has fewer, before its arrays are made longer
GROWTH, FEWEST_ROWS = 9, 200
MOST_FLIPS = 30  # passes over all edges

Values = TypeVar("Values", FloatArray, IntArray)


@dataclass(frozen=True)
class Fill:
    """The triangulation of a hole."""

    points: FloatArray  # (n, 3): vertices, those of the rim first
    sizes: FloatArray  # (n,): edge length that is wanted around each of them
    faces: IntArray  # (m, 3): triangles
    rim_count: int  # number of vertices of the rim


def refine(fill: Fill, existing: IntArray) -> Fill:
    """Split triangles that are too large, and flip edges; pairs (p, 2) of rim vertices are not joined again."""
    points, sizes, faces = fill.points, fill.sizes, fill.faces
    neighbours = face_neighbours(faces)
    counts = np.array([len(points), len(faces), 0])
    most = FEW_FACES + fill.rim_count**2
    while not _refine(points, sizes, faces, neighbours, existing, fill.rim_count, most, counts):
        room = GROWTH * max(int(counts[1]), FEWEST_ROWS)
        points, sizes = _with_room(points, room), _with_room(sizes, room)
        faces, neighbours = _with_room(faces, room), _with_room(neighbours, room)
    n, m, _ = counts
    return Fill(points[:n].copy(), sizes[:n].copy(), faces[:m].copy(), fill.rim_count)


def _with_room(part: Values, count: int) -> Values:
    """An array with as many further rows as are needed for so many in all."""
    result = np.empty((count, *part.shape[1:]), dtype=part.dtype)
    result[: len(part)] = part
    return result


def flip_edges(fill: Fill, existing: IntArray) -> Fill:
    """Flip edges until all are locally Delaunay, without joining pairs (p, 2) of rim vertices again."""
    faces = fill.faces.copy()
    _flip_all(fill.points, faces, work_space(fill), existing, fill.rim_count)
    return replace(fill, faces=faces)


class WorkSpace(NamedTuple):
    """What is needed to even out a fill of n points and m faces."""

    lists: HalfEdgeLists
    neighbours: IntArray  # (m, 3)
    before: FloatArray  # (n, 3)
    goals: FloatArray  # (n, 3)
    counts: FloatArray  # (n,)
    moving: BoolArray  # (n,)


def work_space(fill: Fill) -> WorkSpace:
    """Room for a fill."""
    n, m = len(fill.points), len(fill.faces)
    before, goals = np.empty((2, n, 3))
    neighbours, lists = np.empty((m, 3), dtype=np.int32), room_for_half_edges(3 * m, n)
    return WorkSpace(lists, neighbours, before, goals, np.empty(n), np.empty(n, dtype=np.bool_))


@inner_jit()
def even_out(points: FloatArray, faces: IntArray, room: WorkSpace, existing: IntArray, rim_count: int) -> None:
    """Flip edges as `flip_edges`, and then move every new vertex to the mean of its neighbours.

    On a fill that is projected to its surface again this moves vertices along the surface only.
    """
    _flip_all(points, faces, room, existing, rim_count)
    _move_to_means(points, faces, room, rim_count)


@short_jit()
def _flip_all(points: FloatArray, faces: IntArray, room: WorkSpace, existing: IntArray, rim_count: int) -> None:
    find_neighbours(faces, room.lists, room.neighbours)
    _flip(points, faces, room.neighbours, existing, rim_count)


@jit()
def _refine(
    points: FloatArray,
    sizes: FloatArray,
    faces: IntArray,
    neighbours: IntArray,
    existing: IntArray,
    rim_count: int,
    most: int,
    counts: IntArray,
) -> bool:
    """Split and flip in passes; return whether that has come to an end, or else there must be more room.

    `counts` are those of vertices, faces and passes.
    """
    while counts[2] < MOST_PASSES and counts[1] <= most:
        n, m = counts[0], counts[1]
        if faces.shape[0] < 3 * m:  # each face may become three
            return False
        added = _split(points, sizes, faces, neighbours, n, m)
        counts[0], counts[1], counts[2] = n + added, m + 2 * added, counts[2] + 1
        flips = _flip(points, faces[: m + 2 * added], neighbours, existing, rim_count)
        if flips == 0 and added == 0:
            break
    return True


@inner_jit()
def _split(points: FloatArray, sizes: FloatArray, faces: IntArray, neighbours: IntArray, n: int, m: int) -> int:
    """Split those of the first m faces that are too large at their centroids; return how many."""
    added = 0
    for f in range(m):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        size = (sizes[a] + sizes[b] + sizes[c]) / 3.0
        x = (points[a, 0] + points[b, 0] + points[c, 0]) / 3.0
        y = (points[a, 1] + points[b, 1] + points[c, 1]) / 3.0
        z = (points[a, 2] + points[b, 2] + points[c, 2]) / 3.0
        large = True
        for k in range(3):
            i = faces[f, k]
            dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
            distance = DENSITY * np.sqrt(dx * dx + dy * dy + dz * dz)
            large = large and distance > size and distance > sizes[i]
        if not large:
            continue
        tip, g, h = n + added, m + 2 * added, m + 2 * added + 1
        points[tip, 0], points[tip, 1], points[tip, 2], sizes[tip] = x, y, z, size
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
def _flip(points: FloatArray, faces: IntArray, neighbours: IntArray, existing: IntArray, rim_count: int) -> int:
    """Flip edges that are not locally Delaunay, in passes over all faces; return how many."""
    flips = 0
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
                    or _are_joined(faces, neighbours, f, g, c, d, rim_count)
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
    """Whether (a, b) or (b, a) is among pairs."""
    listed = False
    for p in range(pairs.shape[0]):
        i, j = pairs[p, 0], pairs[p, 1]
        listed = listed or (i == a and j == b) or (i == b and j == a)
    return listed


@inner_jit()
def _are_joined(faces: IntArray, neighbours: IntArray, f: int, g: int, c: int, d: int, rim_count: int) -> bool:
    """Whether an edge joins c, a corner of face f, and d, a corner of face g.

    Around a vertex inside the fill its faces form one fan. Around one on the rim they may form several, where a rim
    meets itself. Where faces meet in ways that no turn ends, the answer is yes.
    """
    if c < rim_count and d < rim_count:
        joined = False
        for face in range(faces.shape[0]):
            joined = joined or (has_corner(faces, face, c) and has_corner(faces, face, d))
        return joined
    start, tip, other = (f, c, d) if c >= rim_count else (g, d, c)
    face = start
    for _ in range(faces.shape[0]):
        if has_corner(faces, face, other):
            return True
        k = 0 if faces[face, 0] == tip else 1 if faces[face, 1] == tip else 2
        face = neighbours[face, k]
        if face == start:
            return False
        if face < 0:
            break
    return True


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
