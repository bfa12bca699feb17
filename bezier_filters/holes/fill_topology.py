"""Splitting and flipping in the triangulation of a hole.

Triangles are refined until their edges are as long as those of the surroundings, with edges flipped until all of them
are locally Delaunay (P. Liepa, "Filling holes in meshes", SGP 2003). The edges at the rim stay as they are.
"""

from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.half_edges import faces_at_edges
from bezier_filters.meshes.triangles import angle_parts, area_vector, has_corner
from bezier_filters.runtime.lean import inner_njit, lean_njit

DENSITY = float(np.sqrt(2.0))
"""Triangles are split while their centroid is farther from their corners than the wanted edge length over this."""
FEW_FACES = 2_000
"""Of a fill, and twice the square of its rim's number of edges, some twelve times as many as a round hole needs:
where a rim has edges of very different lengths, triangles stay larger than they would be."""
MOST_PASSES = 60
GROWTH = 9
"""Rows that there is room for, in faces of a fill, before its arrays are made longer."""
MOST_FLIPS = 30
"""Passes over all edges."""


@dataclass(frozen=True)
class Fill:
    """The triangulation of a hole.

    Attributes
    ----------
    points : (n, 3) float64
        Vertices, those of the rim first.
    sizes : (n,) float64
        Edge length that is wanted around each of them.
    faces : (m, 3) int32
        Triangles.
    fixed : frozenset of (int, int)
        Edges within the fill that must stay: creases. Pairs of vertices, the smaller first.
    rim_count : int
        Number of vertices of the rim.
    """

    points: FloatArray
    sizes: FloatArray
    faces: IntArray
    rim_count: int
    fixed: AbstractSet[tuple[int, int]] = frozenset()


def refined(fill: Fill, existing: AbstractSet[tuple[int, int]]) -> Fill:
    """Split triangles that are too large, and flip edges.

    Parameters
    ----------
    fill : Fill
    existing : set of (int, int)
        Pairs of rim vertices that must not be joined, the smaller first.
    """
    keys = _keys(existing | fill.fixed)
    arrays: tuple[NDArray[Any], ...] = (
        fill.points,
        fill.sizes,
        fill.faces,
        face_neighbours(fill.faces),
        _fixed_edges(fill.faces, fill.fixed),
    )
    n, m = len(fill.points), len(fill.faces)
    most = FEW_FACES + 2 * fill.rim_count**2
    for _ in range(MOST_PASSES):
        if m > most:
            break
        if len(arrays[2]) < 3 * m:  # each face may become three
            arrays = tuple(_with_room(part, GROWTH * m) for part in arrays)
        points, sizes, faces, neighbours, fixed = arrays
        added = _split(points, sizes, faces, neighbours, fixed, n, m)
        n, m = n + added, m + 2 * added
        flips = _flip(points, faces[:m], neighbours, fixed, keys, fill.rim_count, MOST_FLIPS)
        if added == 0 and flips == 0:
            break
    points, sizes, faces = arrays[:3]
    return Fill(points[:n].copy(), sizes[:n].copy(), faces[:m].copy(), fill.rim_count, fill.fixed)


def _with_room(part: NDArray[Any], count: int) -> NDArray[Any]:
    """An array with as many further rows as are needed for so many in all."""
    return np.concatenate([part, np.zeros((count - len(part), *part.shape[1:]), dtype=part.dtype)])


def flipped(fill: Fill, existing: AbstractSet[tuple[int, int]]) -> Fill:
    """Flip edges until all are locally Delaunay."""
    faces = fill.faces.copy()
    neighbours = face_neighbours(faces)
    fixed = _fixed_edges(faces, fill.fixed)
    _flip(fill.points, faces, neighbours, fixed, _keys(existing | fill.fixed), fill.rim_count, MOST_FLIPS)
    return Fill(fill.points, fill.sizes, faces, fill.rim_count, fill.fixed)


def face_neighbours(faces: IntArray) -> IntArray:
    """Face beyond the edge from corner k to the next, -1 at the border, (m, 3), of manifold, oriented faces."""
    return faces_at_edges(faces, faces[:, [1, 2, 0]].ravel(), faces.ravel()).reshape(-1, 3)


def _keys(pairs: AbstractSet[tuple[int, int]]) -> IntArray:
    """Sorted pairs, (p, 2)."""
    return np.array(sorted(pairs), dtype=np.int32).reshape(-1, 2)


def _fixed_edges(faces: IntArray, fixed: AbstractSet[tuple[int, int]]) -> BoolArray:
    """Which edges of faces, from corner k to the next, must not be flipped, (m, 3)."""
    result = np.zeros(faces.shape, dtype=np.bool_)
    if fixed:
        low, high = (function(faces, np.roll(faces, -1, axis=1)) for function in (np.minimum, np.maximum))
        for a, b in fixed:
            result |= (low == a) & (high == b)
    return result


@lean_njit()
def _split(
    points: FloatArray, sizes: FloatArray, faces: IntArray, neighbours: IntArray, fixed: BoolArray, n: int, m: int
) -> int:
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
        fixed[g, 0], fixed[h, 0], fixed[f, 1], fixed[f, 2] = fixed[f, 1], fixed[f, 2], False, False
        _relink(faces, neighbours, beyond_bc, c, g)
        _relink(faces, neighbours, beyond_ca, a, h)
        added += 1
    return added


@inner_njit()
def _relink(faces: IntArray, neighbours: IntArray, f: int, start: int, new: int) -> None:
    """Tell face f, if there is one, which face lies beyond its edge that begins at a vertex."""
    if f >= 0:
        k = 0 if faces[f, 0] == start else 1 if faces[f, 1] == start else 2
        neighbours[f, k] = new


@lean_njit()
def _flip(
    points: FloatArray,
    faces: IntArray,
    neighbours: IntArray,
    fixed: BoolArray,
    existing: IntArray,
    rim_count: int,
    passes: int,
) -> int:
    """Flip edges that are not locally Delaunay, in passes over all faces; return how many."""
    flips = 0
    for _ in range(passes):
        before = flips
        for f in range(faces.shape[0]):
            for k in range(3):
                g = neighbours[f, k]
                if g < 0 or fixed[f, k]:
                    continue
                a, b, c = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
                q = 0 if faces[g, 0] == b else 1 if faces[g, 1] == b else 2
                d = faces[g, (q + 2) % 3]
                if (
                    c == d
                    or not _is_better_flipped(points, a, b, c, d)
                    or (c < rim_count and d < rim_count and _is_listed(existing, min(c, d), max(c, d)))
                    or _are_joined(faces, neighbours, f, g, c, d, rim_count)
                ):
                    continue
                # Faces (a, b, c) and (b, a, d) become (d, c, a) and (c, d, b).
                p1, p2 = (k + 1) % 3, (k + 2) % 3
                q1, q2 = (q + 1) % 3, (q + 2) % 3
                beyond_bc, beyond_ca, beyond_ad, beyond_db = (
                    neighbours[f, p1],
                    neighbours[f, p2],
                    neighbours[g, q1],
                    neighbours[g, q2],
                )
                fixed_bc, fixed_ca, fixed_ad, fixed_db = fixed[f, p1], fixed[f, p2], fixed[g, q1], fixed[g, q2]
                faces[f, 0], faces[f, 1], faces[f, 2] = d, c, a
                faces[g, 0], faces[g, 1], faces[g, 2] = c, d, b
                neighbours[f, 0], neighbours[f, 1], neighbours[f, 2] = g, beyond_ca, beyond_ad
                neighbours[g, 0], neighbours[g, 1], neighbours[g, 2] = f, beyond_db, beyond_bc
                fixed[f, 0], fixed[f, 1], fixed[f, 2] = False, fixed_ca, fixed_ad
                fixed[g, 0], fixed[g, 1], fixed[g, 2] = False, fixed_db, fixed_bc
                _relink(faces, neighbours, beyond_ad, d, f)
                _relink(faces, neighbours, beyond_bc, c, g)
                flips += 1
                break
        if flips == before:
            break
    return flips


@inner_njit()
def _is_better_flipped(points: FloatArray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the angles at c and d, opposite the edge (a, b), exceed pi, and (c, d) makes no sharper edge."""
    at_c, across_c = angle_parts(points, c, a, b)
    at_d, across_d = angle_parts(points, d, b, a)
    if across_c * at_d + at_c * across_d >= -1e-10 * (abs(across_c * at_d) + abs(at_c * across_d)):
        return False
    now = _cosine(points, a, b, c, b, a, d)
    then = _cosine(points, d, c, a, c, d, b)
    return then >= min(now, 0.5) - 1e-9


@inner_njit()
def _cosine(points: FloatArray, a: int, b: int, c: int, d: int, e: int, f: int) -> float:
    """Cosine of the angle between the triangles (a, b, c) and (d, e, f); -1 if one has no area."""
    x, y, z = area_vector(points, a, b, c)
    u, v, w = area_vector(points, d, e, f)
    lengths = np.sqrt((x * x + y * y + z * z) * (u * u + v * v + w * w))
    if lengths == 0.0:
        return -1.0
    return float((x * u + y * v + z * w) / lengths)


@inner_njit()
def _is_listed(pairs: IntArray, a: int, b: int) -> bool:
    """Whether (a, b) is among sorted pairs."""
    low, high = 0, pairs.shape[0]
    while low < high:
        middle = (low + high) // 2
        if pairs[middle, 0] < a or (pairs[middle, 0] == a and pairs[middle, 1] < b):
            low = middle + 1
        else:
            high = middle
    return bool(low < pairs.shape[0] and pairs[low, 0] == a and pairs[low, 1] == b)


@inner_njit()
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
