"""Collapses and flips of many edges at once: the best ones among edges without common faces."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.half_edges import half_edge_twins

MIN_FACE_COSINE = 0.5  # of the angle by which a face may turn in one operation: 60 degrees


@dataclass(frozen=True)
class Stars:
    """Faces around the ends of edges: a row for each pair."""

    edge: IntArray  # (k,)
    face: IntArray  # (k,)


def vertex_faces(faces: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """Faces at each of n vertices: begins (n + 1,) of their rows, and rows of faces."""
    order = np.argsort(faces.ravel(), kind="stable").astype(np.int32)
    return np.searchsorted(faces.ravel()[order], np.arange(n + 1)).astype(np.int32), order // 3


def stars(faces: IntArray, n: int, ends: IntArray) -> Stars:
    """Faces at one end of edges (e, 2) or both, those at both twice."""
    begin, rows = vertex_faces(faces, n)
    corner = ends.ravel()
    count = begin[corner + 1] - begin[corner]
    owner = np.repeat(np.arange(len(corner), dtype=np.int32), count)
    offset = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    return Stars(owner // 2, rows[begin[corner][owner] + offset])


def independent(around: Stars, cost: FloatArray, m: int) -> BoolArray:
    """Mask of edges (e,) whose costs are the lowest on all of their faces."""
    rank = np.empty(len(cost), dtype=np.int64)
    rank[np.argsort(cost, kind="stable")] = np.arange(len(cost))
    lowest = np.full(m, len(cost))
    np.minimum.at(lowest, around.face, rank[around.edge])
    beaten = lowest[around.face] != rank[around.edge]
    return np.asarray(np.bincount(around.edge, beaten, len(cost)) == 0)


def may_collapse(
    points: FloatArray, faces: IntArray, ends: IntArray, goal: FloatArray, longest: FloatArray, around: Stars
) -> BoolArray:
    """Mask of edges (e, 2) that may shrink to the points `goal` (e, 3).

    The surface stays a manifold (Dey et al., "Topology preserving edge contraction", 1999), edges do not get longer
    than `longest` (e,), and no face turns over.
    """
    count, n = len(ends), len(points)
    corners = faces[around.face]
    at_end = (corners == ends[around.edge, 0, np.newaxis]) | (corners == ends[around.edge, 1, np.newaxis])
    both = at_end.sum(axis=1) == 2
    # neighbours of both ends, each once: those of the first and of the second end
    keys = list[NDArray[np.int64]]()
    for k in (0, 1):
        mine = (corners == ends[around.edge, k, np.newaxis]).any(axis=1)
        rest = np.where(at_end[mine], -1, corners[mine])
        pair = (around.edge[mine, np.newaxis].astype(np.int64) * n + rest)[rest >= 0]
        keys.append(np.unique(pair))
    common = np.intersect1d(keys[0], keys[1], assume_unique=True)
    shared = np.bincount(common // n, minlength=count)
    sides = np.bincount(around.edge, both, count) / 2  # listed at both ends
    before = points[corners]
    after = np.where(at_end[..., np.newaxis], goal[around.edge, np.newaxis], before)
    reach = np.where(at_end, 0.0, np.linalg.norm(before - goal[around.edge, np.newaxis], axis=2)).max(axis=1)
    turned = ~both & ~(cosines(_normals(before), _normals(after)) > MIN_FACE_COSINE)
    bad = turned | (~both & (reach > longest[around.edge]))
    return np.asarray((np.bincount(around.edge, bad, count) == 0) & (shared == sides))


def collapse_edges(faces: IntArray, target: IntArray) -> IntArray:
    """Faces with vertex i replaced by `target[i]`, without the faces that shrink."""
    new = target[faces]
    stays = (new[:, 0] != new[:, 1]) & (new[:, 1] != new[:, 2]) & (new[:, 2] != new[:, 0])
    return np.asarray(new[stays], dtype=np.int32)


def flip_edges(points: FloatArray, faces: IntArray, kept: IntArray, valences: IntArray) -> tuple[IntArray, int]:
    """Flip edges where that brings the numbers of neighbours nearer to the ideal ones, `valences` (n,).

    The keys `kept` of edges to keep are the smaller vertex times n plus the larger. Returns the faces
    and the number of flips.
    """
    n = len(points)
    twins = half_edge_twins(faces, n)
    start, stop = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    half = np.flatnonzero((twins >= 0) & (start < stop)).astype(np.int32)
    half = half[~np.isin(start[half].astype(np.int64) * n + stop[half], kept, assume_unique=True)]
    twin = twins[half]
    a, b = start[half], stop[half]
    c, d = (np.roll(faces, -2, axis=1).ravel()[row] for row in (half, twin))
    degree = np.bincount(start, minlength=n)
    off = np.stack([degree[v] - valences[v] for v in (a, b, c, d)])
    gain = (np.square(off) - np.square(off + np.array([[-1], [-1], [1], [1]]))).sum(axis=0)
    keys = np.unique(np.minimum(start, stop).astype(np.int64) * n + np.maximum(start, stop))
    exists = np.isin(np.minimum(c, d).astype(np.int64) * n + np.maximum(c, d), keys)
    rows = np.flatnonzero((gain > 0) & ~exists & (c != d))
    half, twin, a, b, c, d = (values[rows] for values in (half, twin, a, b, c, d))
    gain = gain[rows]
    old = _normals(points[np.stack([a, b, c], axis=1)]) + _normals(points[np.stack([b, a, d], axis=1)])
    new = [_normals(points[np.stack(corners, axis=1)]) for corners in ((a, d, c), (d, b, c))]
    flat = np.minimum(cosines(old, new[0]), cosines(old, new[1])) > MIN_FACE_COSINE
    flat &= cosines(new[0], new[1]) > MIN_FACE_COSINE
    half, twin, a, b, c, d = (values[flat] for values in (half, twin, a, b, c, d))
    gain = gain[flat]
    # one flip changes the valences of four vertices, and so what is gained by others there
    quad = np.stack([a, b, c, d], axis=1)
    rank = np.empty(len(gain), dtype=np.int64)
    rank[np.argsort(-gain, kind="stable")] = np.arange(len(gain))
    lowest = np.full(n, len(gain))
    np.minimum.at(lowest, quad.ravel(), np.repeat(rank, 4))
    chosen = (lowest[quad] == rank[:, np.newaxis]).all(axis=1)
    faces = faces.copy()
    faces[half[chosen] // 3] = np.stack([a, d, c], axis=1)[chosen]
    faces[twin[chosen] // 3] = np.stack([d, b, c], axis=1)[chosen]
    return faces, int(chosen.sum())


def _normals(corners: FloatArray) -> FloatArray:
    """Area vectors (f, 3) of triangles (f, 3, 3)."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def cosines(u: FloatArray, v: FloatArray) -> FloatArray:
    """Cosines of the angles between vectors (k, 3); -1 for those without length."""
    lengths = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
    return np.where(lengths > 0.0, np.einsum("kd,kd->k", u, v) / np.maximum(lengths, 1e-300), -1.0)
