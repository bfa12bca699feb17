"""Refinement of the triangulation of a hole: centroid splits, Delaunay edge flips and tangential relaxation.

Triangles are split until their edges have the target length, that of the edges around the hole, and edges are flipped
until all are locally Delaunay (P. Liepa, "Filling holes in meshes", SGP 2003). Rim edges do not change. Far from the
rim of a large hole the target length grows, so that a rim of n edges gets O(n log n) faces instead of O(n^2).
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.spatial import cKDTree

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.half_edges import HalfEdgeLists, allocate_half_edges, face_neighbours, find_neighbours
from bezier_filters.meshes.triangles import angle_parts, area_vector, cosine_between, has_corner
from bezier_filters.runtime.jit import inner_jit, jit, short_jit

# A triangle is split if its centroid is farther from its corners than their target lengths over this ratio.
SPLIT_RATIO = float(np.sqrt(2.0))
# Depth from the rim, in edges, up to which the target length is that at the rim, and depth over which its square then
# grows by one unit: a round hole of 200 edges is nowhere deeper than the first.
UNIFORM_DEPTH, GROWTH_DEPTH = 32.0, 4.0
# Limit on the faces of a fill: the constant plus the number of rim vertices times the smaller of that number and the
# factor. It is some six times the number of faces that a round hole needs, some three times for a large one.
MIN_FACE_LIMIT, MAX_FACES_PER_RIM_VERTEX = 1_000, 250
MAX_PASSES = 60  # of splits and flips
CAPACITY_FACTOR, MIN_CAPACITY = 9, 200  # rows of enlarged arrays: the factor times the number of faces, or a minimum
MAX_FLIP_PASSES = 30  # over all edges
FINISHED, OUT_OF_CAPACITY, PAUSED, LIMITED = 0, 1, 2, 3  # outcomes of passes

Values = TypeVar("Values", FloatArray, IntArray)


@dataclass(frozen=True)
class Fill:
    """The triangulation of a hole."""

    points: FloatArray  # (n, 3): vertices, those of the rim first
    sizes: FloatArray  # (n,): target edge lengths, without the growth away from the rim
    faces: IntArray  # (m, 3): triangles
    rim_count: int  # number of vertices of the rim
    is_limited: bool = False  # whether triangles stay too large because of the limit on faces


def refine(fill: Fill, existing: IntArray) -> Fill:
    """Split large triangles and flip edges; existing edges (p, 2) between rim vertices are not repeated."""
    points, sizes, faces = fill.points, fill.sizes, fill.faces
    neighbours, existing = face_neighbours(faces), sort_pairs(existing)
    rim = cKDTree(points[: fill.rim_count]) if _is_wide(fill) else None
    growth = np.ones(len(points)) if rim is None else _length_growth(points, sizes, rim, fill.rim_count)
    borders = np.empty(fill.rim_count, dtype=np.int32)
    counts, most = np.array([len(points), len(faces), 0]), face_limit(fill.rim_count)
    while True:
        passes = MAX_PASSES if rim is None else int(counts[2]) + 1
        done = int(counts[0])
        state = _refine(
            points, sizes, growth, faces, neighbours, existing, fill.rim_count, borders, most, passes, counts
        )
        n, m = int(counts[0]), int(counts[1])
        if state == OUT_OF_CAPACITY:
            rows = CAPACITY_FACTOR * max(m, MIN_CAPACITY)
            points, sizes, growth = _enlarge(points, rows), _enlarge(sizes, rows), _enlarge(growth, rows)
            faces, neighbours = _enlarge(faces, rows), _enlarge(neighbours, rows)
        elif state == PAUSED and rim is not None and counts[2] < MAX_PASSES:
            growth[done:n] = _length_growth(points[done:n], sizes[done:n], rim, 0)
        else:
            return Fill(points[:n].copy(), sizes[:n].copy(), faces[:m].copy(), fill.rim_count, state == LIMITED)


def face_limit(rim_count: int) -> int:
    """Number of faces of a fill beyond which triangles are not split any more, for a number of rim vertices."""
    return MIN_FACE_LIMIT + rim_count * min(rim_count, MAX_FACES_PER_RIM_VERTEX)


def _is_wide(fill: Fill) -> bool:
    """Whether the hole may be so wide that target lengths grow inside it."""
    rim = fill.points[: fill.rim_count]
    return float(np.linalg.norm(np.ptp(rim, axis=0))) > UNIFORM_DEPTH * float(fill.sizes[: fill.rim_count].min())


def _length_growth(points: FloatArray, sizes: FloatArray, rim: cKDTree, rim_count: int) -> FloatArray:
    """Growth factors of the target lengths at points, (n,), by their distance to the rim; 1 at the first points.

    At depth d (in edges) the factor is sqrt(1 + (d - d0) / d1). A large hole of n edges then has O(n / d) faces per
    edge of depth, O(n log n) in all. The dihedral angles on a smooth surface still decrease with n.
    """
    depths = rim.query(points)[0] / np.maximum(sizes, 1e-300) - UNIFORM_DEPTH
    factors = np.sqrt(1.0 + np.maximum(depths, 0.0) / GROWTH_DEPTH)
    factors[:rim_count] = 1.0
    return np.asarray(factors, dtype=np.float64)


def sort_pairs(pairs: IntArray) -> IntArray:
    """Sort the two entries of each pair (p, 2), then the pairs, in ascending order."""
    result = np.sort(pairs, axis=1)
    return result[np.lexsort((result[:, 1], result[:, 0]))]


def _enlarge(array: Values, count: int) -> Values:
    """Copy an array into one with `count` rows; the further rows hold anything."""
    result = np.empty((count, *array.shape[1:]), dtype=array.dtype)
    result[: len(array)] = array
    return result


def flip_edges(fill: Fill, existing: IntArray) -> Fill:
    """Flip edges until all are locally Delaunay, without repeating existing edges (p, 2) between rim vertices."""
    faces = fill.faces.copy()
    _flip_all(fill.points, faces, relaxation_workspace(fill), sort_pairs(existing), fill.rim_count)
    return replace(fill, faces=faces)


class RelaxationWorkspace(NamedTuple):
    """Scratch arrays for the relaxation of a fill of n points and m faces."""

    lists: HalfEdgeLists
    neighbours: IntArray  # (m, 3)
    before: FloatArray  # (n, 3)
    goals: FloatArray  # (n, 3)
    counts: FloatArray  # (n,)
    moving: BoolArray  # (n,)
    borders: IntArray  # (r,): one entry for each vertex of the rim


def relaxation_workspace(fill: Fill) -> RelaxationWorkspace:
    """Scratch arrays for a fill."""
    n, m = len(fill.points), len(fill.faces)
    before, goals = np.empty((2, n, 3))
    neighbours, lists = np.empty((m, 3), dtype=np.int32), allocate_half_edges(3 * m, n)
    borders = np.empty(fill.rim_count, dtype=np.int32)
    return RelaxationWorkspace(lists, neighbours, before, goals, np.empty(n), np.empty(n, dtype=np.bool_), borders)


@inner_jit()
def relax_tangentially(
    points: FloatArray, faces: IntArray, work: RelaxationWorkspace, existing: IntArray, rim_count: int
) -> None:
    """Flip edges as `flip_edges`, given sorted pairs, and then move each new vertex to the mean of its neighbours.

    Followed by a projection to the surface, the motion is tangential.
    """
    _flip_all(points, faces, work, existing, rim_count)
    _move_to_centroids(points, faces, work, rim_count)


@short_jit()
def _flip_all(
    points: FloatArray, faces: IntArray, work: RelaxationWorkspace, existing: IntArray, rim_count: int
) -> None:
    find_neighbours(faces, work.lists, work.neighbours)
    _flip(points, faces, work.neighbours, existing, rim_count, work.borders)


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
    """Split and flip in passes, up to a number of them; return the outcome.

    `counts` holds the numbers of vertices, faces and passes.
    """
    while counts[2] < passes:
        n, m = counts[0], counts[1]
        if m > most:
            return LIMITED
        if faces.shape[0] < 3 * m:  # each face may become three
            return OUT_OF_CAPACITY
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
    """Split the large ones of the first m faces at their centroids; return the number of splits."""
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
            distance = SPLIT_RATIO * np.sqrt(dx * dx + dy * dy + dz * dz)
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
    """Set the neighbour of face f, if there is one, at its edge that begins at a vertex."""
    if f >= 0:
        k = 0 if faces[f, 0] == start else 1 if faces[f, 1] == start else 2
        neighbours[f, k] = new


@inner_jit()
def _flip(
    points: FloatArray, faces: IntArray, neighbours: IntArray, existing: IntArray, rim_count: int, borders: IntArray
) -> int:
    """Flip edges that are not locally Delaunay, in passes over all faces; return the number of flips.

    `borders` (r,) receives the number of border edges that begin at each rim vertex.
    """
    flips = 0
    for i in range(rim_count):
        borders[i] = 0
    for f in range(faces.shape[0]):
        for k in range(3):
            if neighbours[f, k] < 0 and faces[f, k] < rim_count:
                borders[faces[f, k]] += 1
    for _ in range(MAX_FLIP_PASSES):
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
                    or (c < rim_count and d < rim_count and is_listed(existing, c, d))
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
    """Whether the angles at c and d, opposite the edge (a, b), sum to more than pi and (c, d) is not a sharper edge."""
    at_c, across_c = angle_parts(points, c, a, b)
    at_d, across_d = angle_parts(points, d, b, a)
    if across_c * at_d + at_c * across_d >= -1e-10 * (abs(across_c * at_d) + abs(at_c * across_d)):
        return False
    # A degenerate triangle counts as folded. Ties are not flipped, so that rounding does not cause endless flips.
    now = cosine_between(points, a, b, c, b, a, d, -1.0)
    then = cosine_between(points, d, c, a, c, d, b, -1.0)
    return then >= min(now, 0.5) - 1e-9


@inner_jit()
def is_listed(pairs: IntArray, a: int, b: int) -> bool:
    """Whether (a, b) or (b, a) is among sorted pairs: a binary search."""
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

    The faces around an interior vertex form one closed fan; around a rim vertex an open one, or several if the rim
    touches itself there and several border edges begin there. If no traversal of a fan terminates, the result is True.
    """
    start, tip, other = f, c, d
    if c < rim_count and (d >= rim_count or borders[c] > 1):
        start, tip, other = g, d, c
    if tip < rim_count and borders[tip] > 1:
        joined = False
        for face in range(faces.shape[0]):
            joined = joined or (has_corner(faces, face, c) and has_corner(faces, face, d))
        return joined
    for turn in range(2):  # an open fan is traversed in both directions
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
def _move_to_centroids(points: FloatArray, faces: IntArray, work: RelaxationWorkspace, rim_count: int) -> None:
    """Move new points to the mean of their neighbours, except where a triangle would turn by more than 90 degrees.

    Corners of such triangles do not move, and neither do those of triangles that turn in consequence.
    """
    before, goals, counts, moving = work.before, work.goals, work.counts, work.moving
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
    any_turned = True
    while any_turned:
        any_turned = False
        # All triangles are tested before any vertex is reset, so that the order of the faces does not matter.
        for f in range(faces.shape[0]):
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            if (moving[a] or moving[b] or moving[c]) and _are_opposite(before, points, a, b, c):
                moving[a] = moving[b] = moving[c] = False
                any_turned = True
        for i in range(before.shape[0]):
            if not moving[i]:
                for axis in range(3):
                    points[i, axis] = before[i, axis]


@inner_jit()
def _are_opposite(before: FloatArray, after: FloatArray, a: int, b: int, c: int) -> bool:
    """Whether the normal of a triangle turns by more than a right angle."""
    ux, uy, uz = area_vector(before, a, b, c)
    vx, vy, vz = area_vector(after, a, b, c)
    return ux * vx + uy * vy + uz * vz < 0.0
