"""Creases that end at the rim of a hole, and the one-sided parts of its surroundings between them."""

from dataclasses import dataclass
from math import cos, radians

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.surroundings import Surroundings
from bezier_filters.meshes.half_edges import half_edge_twins
from bezier_filters.meshes.mesh import TriangleMesh

SHARP = radians(35.0)
"""Angle between two faces from which on their edge may be a crease."""
TIMES_USUAL = 4.0
"""A crease is more than this many times as sharp as most edges around the hole."""
SHORTEST, LONGEST = 2, 6
"""Edges of a crease that are followed from the rim: one alone is no crease."""
ALONG = cos(radians(10.0))
"""Least cosine of the angle between a crease and an edge of the rim that goes on as it does."""
WEAK = 0.5
"""Share of the angle of a sharp edge from which on an edge may continue one."""
STRAIGHT_ON = cos(radians(30.0))
"""Least cosine of the angle between a sharp edge and a less sharp one that continues it."""
STRAIGHT = 0.5
"""Least cosine of the angle between two edges of a crease that follow each other."""


@dataclass(frozen=True)
class CreaseEnd:
    """Where a crease meets the rim.

    Attributes
    ----------
    position : int
        Place of the vertex in the rim loop.
    tangent : (3,) float64
        Unit vector along the crease into the hole.
    is_convex : bool
        Whether the crease is a ridge, not a valley, seen from outside.
    rim_edges : frozenset of int
        Edges of the rim that are part of the crease, by the places of their first vertices.
    """

    position: int
    tangent: FloatArray
    is_convex: bool
    rim_edges: frozenset[int] = frozenset()


@dataclass(frozen=True)
class SharpEdges:
    """Edges around a hole that may be creases.

    Attributes
    ----------
    is_sharp : (3 m,) bool
        By half-edge; 3 f + k runs from corner k of face f to the next.
    is_convex : (3 m,) bool
        Whether the faces bend away from the outside.
    twins : (3 m,) int32
        Opposite half-edges, -1 at the border.
    """

    is_sharp: BoolArray
    is_convex: BoolArray
    twins: IntArray


def may_have_creases(around: Surroundings) -> bool:
    """Whether the faces differ enough for a crease, which is quickly told: no two if all are near their mean normal."""
    normals = around.face_normals[around.face_normals.any(axis=1)]
    mean = normals.sum(axis=0)
    return bool((normals @ mean < cos(0.5 * SHARP) * np.linalg.norm(mean)).any())


def sharp_edges(around: Surroundings) -> SharpEdges:
    """Find the edges that are much sharper than most."""
    faces = around.faces
    twins = half_edge_twins(TriangleMesh(around.vertices, faces))
    inner = np.flatnonzero(twins >= 0)
    normals = around.face_normals
    own, other = normals[inner // 3], normals[twins[inner] // 3]
    angles = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(own - other, axis=1), 1.0))
    limit = max(SHARP, TIMES_USUAL * float(np.median(angles))) if len(angles) else SHARP
    is_sharp, is_convex = np.zeros((2, 3 * len(faces)), dtype=np.bool_)
    known = own.any(axis=1) & other.any(axis=1)
    is_sharp[inner] = known & (angles > limit)
    weak = np.zeros(3 * len(faces))
    weak[inner] = np.where(known & (angles > WEAK * limit), angles, 0.0)
    _continue_sharp_edges(around, twins, is_sharp, weak)
    tips = np.roll(faces, -2, axis=1).ravel()
    beyond = around.vertices[tips[twins[inner]]] - around.vertices[faces.ravel()[inner]]
    is_convex[inner] = np.einsum("ij,ij->i", beyond, own) < 0.0
    return SharpEdges(is_sharp, is_convex, twins)


def _continue_sharp_edges(around: Surroundings, twins: IntArray, is_sharp: BoolArray, angles: FloatArray) -> None:
    """Let sharp edges that end go straight on along less sharp ones: those of a rounded crease differ by chance.

    `angles` are those of edges that may be added, by half-edge, and 0 for the others.
    """
    start, end = around.faces.ravel(), np.roll(around.faces, -1, axis=1).ravel()
    sharp = np.flatnonzero(is_sharp)
    count = np.bincount(start[sharp], minlength=len(around.ids))
    leaving: dict[int, list[int]] = {}
    for half_edge in np.flatnonzero(angles > 0.0).tolist():
        leaving.setdefault(int(start[half_edge]), []).append(half_edge)
    front = [(int(start[h]), int(end[h])) for h in sharp.tolist() if count[end[h]] == 1]
    while front:
        before, tip = front.pop()
        if count[tip] != 1:
            continue
        ahead = around.vertices[tip] - around.vertices[before]
        straight = [
            h
            for h in leaving.get(tip, [])
            if _cosine(ahead, around.vertices[end[h]] - around.vertices[tip]) > STRAIGHT_ON and not is_sharp[h]
        ]
        if straight:
            best = max(straight, key=lambda h: angles[h])
            is_sharp[[best, twins[best]]] = True
            count[[tip, end[best]]] += 1
            front.append((tip, int(end[best])))


def crease_ends(around: Surroundings, sharp: SharpEdges) -> list[CreaseEnd]:
    """Ends of creases at the rim, in its order."""
    start, end = around.faces.ravel(), np.roll(around.faces, -1, axis=1).ravel()
    leaving: dict[int, list[int]] = {}
    convex: dict[tuple[int, int], bool] = {}
    for half_edge in np.flatnonzero(sharp.is_sharp).tolist():
        a, b = int(start[half_edge]), int(end[half_edge])
        leaving.setdefault(a, []).append(b)
        convex[a, b] = bool(sharp.is_convex[half_edge])
    result = []
    for position, vertex in enumerate(around.loops[0].tolist()):
        chains = [_chain(around.vertices, leaving, [vertex, other]) for other in leaving.get(vertex, [])]
        chain = max(chains, key=len, default=[])
        if len(chain) > SHORTEST:
            result.append(_end(around, position, chain, convex[chain[0], chain[1]]))
    return list({end.position: end for end in sorted(result, key=lambda end: end.position)}.values())


def _end(around: Surroundings, position: int, chain: list[int], is_convex: bool) -> CreaseEnd:
    """The end of a crease, followed along the rim where edges of the rim go on as it does."""
    rim = around.loops[0]
    edges: set[int] = set()
    while True:
        tangent = _tangent(around.vertices[chain])
        steps = {step: int(rim[(position + step) % len(rim)]) for step in (1, -1)}
        cosines = {step: _cosine(tangent, around.vertices[v] - around.vertices[chain[0]]) for step, v in steps.items()}
        step = max(cosines, key=lambda step: cosines[step])
        if cosines[step] < ALONG or steps[step] in chain:
            return CreaseEnd(position, tangent, is_convex, frozenset(edges))
        edges.add((position if step == 1 else position - 1) % len(rim))
        position = (position + step) % len(rim)
        chain = [steps[step], *chain]


def _cosine(a: FloatArray, b: FloatArray) -> float:
    return float(a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300))


def _chain(points: FloatArray, leaving: dict[int, list[int]], chain: list[int]) -> list[int]:
    """Follow a crease as long as it goes straight on."""
    while len(chain) <= LONGEST:
        before, tip = chain[-2:]
        ahead = points[tip] - points[before]
        best, straightest = -1, STRAIGHT
        for other in leaving.get(tip, []):
            step = points[other] - points[tip]
            cosine = _cosine(ahead, step)
            if other not in chain and cosine > straightest:
                best, straightest = other, cosine
        if best < 0:
            break
        chain.append(best)
    return chain


def _tangent(points: FloatArray) -> FloatArray:
    """Unit tangent, backwards, at the first of some points of a curve: that of a parabola through it."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])[1:]
    terms = np.stack([lengths, lengths**2], axis=1)[:, : 1 + (len(lengths) > 2)]
    slope = np.linalg.lstsq(terms, points[1:] - points[0], rcond=None)[0][0]
    return np.asarray(-slope / max(float(np.linalg.norm(slope)), 1e-300), dtype=np.float64)


def sectors(around: Surroundings, sharp: SharpEdges, ends: list[CreaseEnd]) -> IntArray:
    """Number of the crease end, before it along the rim, whose side each face is on, (m,); -1 if none reaches it.

    Faces are reached from the rim without crossing a sharp edge, but not from edges of the rim that are creases: their
    faces are on the other side.
    """
    positions = [end.position for end in ends]
    sharp_rim = frozenset[int]().union(*(end.rim_edges for end in ends))
    faces = around.faces
    rim = around.loops[0]
    owner = np.searchsorted(positions, np.arange(len(rim)), side="right") - 1
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    sector_of_edge = {
        (b, a): int(owner[k]) % len(positions)
        for k, (a, b) in enumerate(zip(rim.tolist(), np.roll(rim, -1).tolist(), strict=True))
        if k not in sharp_rim
    }
    result = np.full(len(faces), -1, dtype=np.int32)
    front = []
    for half_edge in np.flatnonzero(sharp.twins < 0).tolist():
        sector = sector_of_edge.get((int(start[half_edge]), int(end[half_edge])), -1)
        if sector >= 0 and result[half_edge // 3] < 0:
            result[half_edge // 3] = sector
            front.append(half_edge // 3)
    while front:
        reached = []
        for face in front:
            for half_edge in range(3 * face, 3 * face + 3):
                other = int(sharp.twins[half_edge]) // 3
                if sharp.twins[half_edge] >= 0 and not sharp.is_sharp[half_edge] and result[other] < 0:
                    result[other] = result[face]
                    reached.append(other)
        front = reached
    return result
