"""Creases that end at the rim of a hole, and the sub-holes that continued creases cut it into.

An edge is sharp if its dihedral angle is large and stands out among its neighbours (`meshes.sharp_edges`). Sharp edges
form a graph. A crease is a chain of this graph that runs into the rim; its tangent there is that of a parabola fitted
to the chain by arc length. Crease ends divide the rim into sectors. A flood fill that stops at sharp edges assigns the
faces around the hole to these sectors.
"""

from dataclasses import dataclass
from math import cos, radians

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.influence_region import InfluenceRegion
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import unit_face_normal
from bezier_filters.meshes.half_edges import cycles, ends_of_half_edges, half_edge_twins, mesh_edges
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.sharp_edges import sharp_edges
from bezier_filters.runtime.jit import short_jit

# smallest dihedral angle of a sharp edge: smaller than for crease lines, so that slightly rounded edges are continued
MIN_CREASE_ANGLE = radians(35.0)
MIN_FADING_ANGLE = radians(20.0)  # the same for the counterpart of the only crease that enters a hole
# edges of a crease that are followed from the rim; a single edge counts only if it is sharper than the next constant
# and ends at another crease
MIN_CREASE_EDGES, MAX_CREASE_EDGES = 2, 6
MIN_SINGLE_EDGE_ANGLE = radians(60.0)
MIN_RIM_COSINE = cos(radians(10.0))  # between a crease and a rim edge that continues it
MIN_PLANE_SINE = 1e-3  # of the angle between two faces whose planes intersect in a well-defined line
MIN_CHAIN_COSINE = 0.5  # between consecutive edges of a crease


@dataclass(frozen=True)
class CreaseEnd:
    """Point where a crease meets the rim."""

    position: int  # index of the vertex in the rim loop
    tangent: FloatArray  # (3,): unit vector along the crease into the hole
    is_convex: bool  # True for a ridge, False for a valley, seen from outside


def may_have_creases(region: InfluenceRegion) -> bool:
    """Quick necessary condition: two face normals can differ by the crease angle only if one deviates by half of it.

    The deviation is that from the mean normal.
    """
    return bool(_min_normal_cosine(region.crease_vertices, region.faces) < cos(0.5 * MIN_CREASE_ANGLE))


@short_jit()
def _min_normal_cosine(points: FloatArray, faces: IntArray) -> float:
    """Smallest cosine of the angles between the face normals and their mean; 1 without faces."""
    u, v, w, least = 0.0, 0.0, 0.0, 1.0
    for f in range(faces.shape[0]):
        x, y, z = unit_face_normal(points, faces, f)
        u, v, w = u + x, v + y, w + z
    length = np.sqrt(u * u + v * v + w * w)
    for f in range(faces.shape[0]):
        x, y, z = unit_face_normal(points, faces, f)
        if x != 0.0 or y != 0.0 or z != 0.0:
            least = min(least, (x * u + y * v + z * w) / max(length, 1e-300))
    return float(least)


@dataclass(frozen=True)
class SharpEdgeGraph:
    """Graph of the sharp edges around a hole."""

    neighbours: dict[int, list[int]]  # adjacency lists: vertices joined to each vertex by a sharp edge
    angles: dict[tuple[int, int], float]  # signed dihedral angles, in both directions, in radians; valleys are negative
    twins: IntArray  # (3 m,): opposite half-edge of each half-edge, or -1


def sharp_edge_graph(region: InfluenceRegion, angle: float = MIN_CREASE_ANGLE) -> SharpEdgeGraph:
    """Collect the edges around a hole whose dihedral angle exceeds an angle in radians and stands out."""
    mesh = TriangleMesh(region.crease_vertices, region.faces)
    edges = mesh_edges(mesh)
    is_sharp = sharp_edges(mesh, edges, vertex_adjacency(mesh), angle)
    signed = np.where(edges.is_convex, edges.angles, -edges.angles)
    edge_of_half_edge = edges.of_faces.ravel()  # no face of a region repeats a vertex, so each half-edge has an edge
    graph = SharpEdgeGraph({}, {}, half_edge_twins(region.faces, len(region.ids)))
    start, end = ends_of_half_edges(region.faces)
    for half_edge in np.flatnonzero(is_sharp[edge_of_half_edge]).tolist():
        a, b = int(start[half_edge]), int(end[half_edge])
        graph.neighbours.setdefault(a, []).append(b)
        graph.angles[a, b] = float(signed[edge_of_half_edge[half_edge]])
    return graph


def crease_ends(region: InfluenceRegion, graph: SharpEdgeGraph) -> tuple[list[CreaseEnd], frozenset[int]]:
    """Crease ends in the order of the rim, and the rim edges that lie on creases.

    Rim edges are given by the index of their first vertex in the loop. A crease that only touches the rim, or that runs
    along it from one vertex to another, does not enter the hole and gives no end.
    """
    after = region.rim_face_normals(region.loops[0])
    before = np.roll(after, 1, axis=0)
    found = [
        end
        for position in range(len(after))
        if (end := _end_at(region, graph, position, before[position], after[position]))
    ]
    along_rim = [edges for _, edges in found]
    ends = {end.position: end for end, edges in found if along_rim.count(edges) < 2 or not edges}
    return [ends[position] for position in sorted(ends)], frozenset[int]().union(*along_rim)


def _end_at(
    region: InfluenceRegion, graph: SharpEdgeGraph, position: int, before: FloatArray, after: FloatArray
) -> tuple[CreaseEnd, frozenset[int]] | None:
    """End of the crease that reaches a rim vertex, and the rim edges that continue it; None without a crease.

    `before` and `after` are the normals of the faces at the two rim edges of the vertex.
    """
    vertex = int(region.loops[0][position])
    others = graph.neighbours.get(vertex, [])
    if len(others) > 1 and before @ after > cos(MIN_CREASE_ANGLE):
        return None
    chains = [_follow_crease(region.crease_vertices, graph.neighbours, [vertex, other]) for other in others]
    chain = max(chains, key=len, default=[])  # ties: the first half-edge
    # A single edge is continued if other sharp edges meet it at its end: around a corner, or at a junction.
    has_successor = len(chain) > 1 and len(graph.neighbours.get(chain[1], [])) > 1
    is_clear = has_successor and abs(graph.angles[chain[0], chain[1]]) > MIN_SINGLE_EDGE_ANGLE
    if not (len(chain) > MIN_CREASE_EDGES or is_clear):
        return None
    followed = [(_follow_rim(region, position, chain), chain) for chain in chains]
    (place, tangent, edges), chain = max(followed, key=lambda end: (len(end[0][2]), len(end[1])))
    # Planes of degenerate faces, or of faces that are folded onto each other, have no well-defined intersection.
    if len(others) > 1 and not edges and np.linalg.norm(np.cross(before, after)) > MIN_PLANE_SINE:
        return _end_at_corner(region, position, before, after), edges
    return CreaseEnd(place, tangent, graph.angles[chain[0], chain[1]] > 0.0), edges


def _end_at_corner(region: InfluenceRegion, position: int, before: FloatArray, after: FloatArray) -> CreaseEnd:
    """Crease end at a rim corner: its tangent is the intersection of the planes of the faces before and after it."""
    rim = region.crease_vertices[region.loops[0]]
    ahead, behind = rim[(position + 1) % len(rim)] - rim[position], rim[position - 1] - rim[position]
    normal = before + after
    axes = np.array([ahead, np.cross(normal, ahead) / max(float(np.linalg.norm(normal)), 1e-300)])
    half = 0.5 * (np.arctan2(axes[1] @ behind, axes[0] @ behind) % (2.0 * np.pi))
    across = np.cross(before, after)
    is_convex = bool(across @ (np.array([np.cos(half), np.sin(half)]) @ axes) > 0.0)
    return CreaseEnd(position, (across if is_convex else -across) / np.linalg.norm(across), is_convex)


def _follow_rim(region: InfluenceRegion, position: int, chain: list[int]) -> tuple[int, FloatArray, frozenset[int]]:
    """Move a crease end along the rim while a rim edge continues the crease.

    Returns the index in the loop, the tangent, and the rim edges that were passed.
    """
    rim = region.loops[0]
    edges: set[int] = set()
    while True:
        tangent = _end_tangent(region.crease_vertices[chain])
        steps = {step: int(rim[(position + step) % len(rim)]) for step in (1, -1)}
        cosines = {
            step: _cosine_between(tangent, region.crease_vertices[v] - region.crease_vertices[chain[0]])
            for step, v in steps.items()
        }
        step = max(cosines, key=lambda step: cosines[step])
        if cosines[step] < MIN_RIM_COSINE or steps[step] in chain:
            return position, tangent, frozenset(edges)
        edges.add((position if step == 1 else position - 1) % len(rim))
        position = (position + step) % len(rim)
        chain = [steps[step], *chain]


def _cosine_between(a: FloatArray, b: FloatArray) -> float:
    return float(a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300))


def _follow_crease(points: FloatArray, neighbours: dict[int, list[int]], chain: list[int]) -> list[int]:
    """Extend a chain of sharp edges, each time by the straightest continuation, while there is one."""
    while len(chain) <= MAX_CREASE_EDGES:
        before, tip = chain[-2:]
        ahead = points[tip] - points[before]
        best, straightest = -1, MIN_CHAIN_COSINE
        for other in neighbours.get(tip, []):
            step = points[other] - points[tip]
            cosine = _cosine_between(ahead, step)
            if other not in chain and cosine > straightest:
                best, straightest = other, cosine
        if best < 0:
            break
        chain.append(best)
    return chain


def _end_tangent(points: FloatArray) -> FloatArray:
    """Unit tangent at the first point of a curve, pointing backwards: that of a least-squares parabola through it."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])[1:]
    terms = np.stack([lengths, lengths**2], axis=1)[:, : 1 + (len(lengths) > 2)]
    slope = np.linalg.lstsq(terms, points[1:] - points[0], rcond=None)[0][0]
    return np.asarray(-slope / max(float(np.linalg.norm(slope)), 1e-300), dtype=np.float64)


def face_sectors(
    region: InfluenceRegion, graph: SharpEdgeGraph, ends: list[CreaseEnd], along_rim: frozenset[int]
) -> IntArray:
    """Rim sector of each face, (m,): the number of the crease end at which the sector begins; -1 for unreached faces.

    A flood fill from the rim that does not cross sharp edges. It does not start from rim edges that are creases,
    because their faces are on the other side.
    """
    positions = [end.position for end in ends]
    faces = region.faces
    rim = region.loops[0]
    owner = np.searchsorted(positions, np.arange(len(rim)), side="right") - 1
    start, end = ends_of_half_edges(faces)
    sector_of_edge = {
        (b, a): int(owner[k]) % max(len(positions), 1)
        for k, (a, b) in enumerate(zip(rim.tolist(), np.roll(rim, -1).tolist(), strict=True))
        if k not in along_rim
    }
    result = np.full(len(faces), -1, dtype=np.int32)
    reached = []
    for half_edge in np.flatnonzero(graph.twins < 0).tolist():
        sector = sector_of_edge.get((int(start[half_edge]), int(end[half_edge])), -1)
        if sector >= 0 and result[half_edge // 3] < 0:
            result[half_edge // 3] = sector
            reached.append(half_edge // 3)
    for face in reached:  # the list grows during the loop
        for half_edge in range(3 * face, 3 * face + 3):
            other = int(graph.twins[half_edge]) // 3
            is_sharp = (int(start[half_edge]), int(end[half_edge])) in graph.angles
            if graph.twins[half_edge] >= 0 and not is_sharp and result[other] < 0:
                result[other] = result[face]
                reached.append(other)
    return result


@dataclass(frozen=True)
class CutHole:
    """A hole cut into sub-holes by creases that join groups of crease ends."""

    region: InfluenceRegion  # of the whole hole, which has one loop
    ends: list[CreaseEnd]  # in the order of the rim; sector k of the rim begins at end k
    groups: list[tuple[int, ...]]  # numbers of the ends that one curve or corner joins
    sectors: list[IntArray]  # rim sectors of each sub-hole, in the order of its border
    sub_hole_of_sector: IntArray  # (k,)
    sub_hole_of_face: IntArray  # (m,): sub-hole that each face around the hole adjoins, -1 for none


def cut_hole(
    region: InfluenceRegion,
    graph: SharpEdgeGraph,
    ends: list[CreaseEnd],
    along_rim: frozenset[int],
    groups: list[tuple[int, ...]],
) -> CutHole:
    """Find the sub-holes of a hole, and the faces that adjoin each.

    A sub-hole is a cycle of sectors. Where a sector reaches the next crease end, the border of the sub-hole follows the
    creases of that end's group back to the previous end of the group, at which another sector begins.
    """
    following = np.zeros(len(ends), dtype=np.int32)
    for group in groups:
        following[[end - 1 for end in group]] = np.roll(group, 1)
    sub_holes = cycles(following, np.arange(len(ends), dtype=np.int32))
    sub_hole_of_sector = np.zeros(len(ends), dtype=np.int32)
    for number, own in enumerate(sub_holes):
        sub_hole_of_sector[own] = number
    sub_hole_of_face = np.append(sub_hole_of_sector, np.int32(-1))[face_sectors(region, graph, ends, along_rim)]
    return CutHole(region, ends, groups, sub_holes, sub_hole_of_sector, sub_hole_of_face)


def sub_hole_border(cut: CutHole, paths: list[IntArray], number: int) -> IntArray:
    """Border loop of a sub-hole: rim sectors, and the crease paths from the end of each to the start of the next."""
    rim, positions = cut.region.loops[0], [end.position for end in cut.ends]
    path_from = {int(path[0]): path for path in paths}
    path_to = {int(path[-1]): path for path in paths}
    own = cut.sectors[number]
    pieces: list[IntArray] = []
    for sector, following in zip(own.tolist(), np.roll(own, -1).tolist(), strict=True):
        start, stop = positions[sector], positions[(sector + 1) % len(positions)]
        pieces.append(rim[np.arange(start, stop if stop > start else stop + len(rim)) % len(rim)])
        here, there = int(rim[stop]), int(rim[positions[following]])
        path = path_from[here] if here in path_from else path_to[here][::-1]
        if path[-1] != there:  # through a corner
            path = np.concatenate([path, path_from[there][::-1][1:]])
        pieces.append(path[:-1])
    return np.concatenate(pieces).astype(np.int32)


def sub_hole_region(
    cut: CutHole, number: int, points: FloatArray, sizes: FloatArray, loop: IntArray, existing: IntArray
) -> InfluenceRegion:
    """Influence region of a sub-hole: the faces that adjoin it. Its `ids` are rows of `points`, then region indices.

    `existing` (p, 2) are pairs of rows of `points` that an edge joins already.
    """
    region, mine = cut.region, cut.sub_hole_of_face == number
    # Rows of `points` and region indices agree on the rim only. The other region indices are shifted beyond all rows.
    beyond = len(points) - region.rim_count
    faces = region.faces[mine]
    names = np.where(faces < region.rim_count, faces, faces + beyond)
    ids = np.concatenate([loop, np.setdiff1d(names, loop)])
    place = np.full(len(points) + len(region.ids), -1, dtype=np.int32)
    place[ids] = np.arange(len(ids), dtype=np.int32)
    others = np.where(ids < len(points), ids, ids - beyond)[len(loop) :]
    ids = np.concatenate([loop, others]).astype(np.int32)
    rings = np.concatenate([np.zeros(len(loop)), np.maximum(region.rings[others], 1)]).astype(np.int32)
    joined = place[existing]
    joined = joined[(joined >= 0).all(axis=1)]
    vertices = np.concatenate([points[loop], region.vertices[others]])
    rim = np.arange(len(loop), dtype=np.int32)
    return InfluenceRegion(ids, rings, vertices, place[names], (rim,), joined, target_sizes=sizes[loop])
