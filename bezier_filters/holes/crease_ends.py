"""Creases that end at the rim of a hole, and the parts that they cut the hole and its surroundings into."""

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

# angle up to which no edge is sharp, less than for lines: edges that are rounded a little are continued, too
ROUNDED = radians(35.0)
FADING = radians(20.0)  # the same where one crease enters a hole that must go on somewhere
# edges of a crease that are followed from the rim: one alone is no crease, unless it is clear and ends at another
SHORTEST, LONGEST = 2, 6
CLEAR = radians(60.0)
ALONG = cos(radians(10.0))  # least cosine of the angle between a crease and an edge of the rim that goes on as it does
FOLDED = 1e-3  # sine of the angle between two faces up to which their planes do not meet in a line
STRAIGHT = 0.5  # least cosine of the angle between two edges of a crease that follow each other


@dataclass(frozen=True)
class CreaseEnd:
    """Where a crease meets the rim."""

    position: int  # place of the vertex in the rim loop
    tangent: FloatArray  # (3,): unit vector along the crease into the hole
    is_convex: bool  # whether the crease is a ridge, not a valley, seen from outside


def may_have_creases(region: InfluenceRegion) -> bool:
    """Whether the faces differ enough for a crease, which is quickly told: no two if all are near their mean normal."""
    return bool(_least_cosine(region.shape, region.faces) < cos(0.5 * ROUNDED))


@short_jit()
def _least_cosine(points: FloatArray, faces: IntArray) -> float:
    """Least cosine of the angles between normals of faces and their mean; 1 if there are none."""
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
class Creases:
    """Sharp edges around a hole."""

    leaving: dict[int, list[int]]  # the vertices at their other ends, by those where they begin
    angles: dict[tuple[int, int], float]  # how far they bend, both ways, in radians: negative in valleys
    twins: IntArray  # (3 m,): the half-edge opposite to each, or -1


def creases_around(region: InfluenceRegion, angle: float = ROUNDED) -> Creases:
    """Find the sharp edges of the surface around a hole, those that bend by more than an angle in radians."""
    mesh = TriangleMesh(region.shape, region.faces)
    edges = mesh_edges(mesh)
    is_sharp = sharp_edges(mesh, edges, vertex_adjacency(mesh), angle)
    signed = np.where(edges.is_convex, edges.angles, -edges.angles)
    of_half_edges = edges.of_faces.ravel()  # no face of a region names a vertex twice, so all have an edge
    creases = Creases({}, {}, half_edge_twins(region.faces, len(region.ids)))
    start, end = ends_of_half_edges(region.faces)
    for half_edge in np.flatnonzero(is_sharp[of_half_edges]).tolist():
        a, b = int(start[half_edge]), int(end[half_edge])
        creases.leaving.setdefault(a, []).append(b)
        creases.angles[a, b] = float(signed[of_half_edges[half_edge]])
    return creases


def crease_ends(region: InfluenceRegion, creases: Creases) -> tuple[list[CreaseEnd], frozenset[int]]:
    """Ends of creases at the rim, in its order, and the edges of the rim that creases run along.

    These are given by the places of their first vertices. A crease that touches the rim, or runs along it from one
    vertex to another, does not go through the hole.
    """
    after = region.normals_beyond(region.loops[0])
    before = np.roll(after, 1, axis=0)
    found = [
        end
        for position in range(len(after))
        if (end := _end_at(region, creases, position, before[position], after[position]))
    ]
    along_rim = [edges for _, edges in found]
    ends = {end.position: end for end, edges in found if along_rim.count(edges) < 2 or not edges}
    return [ends[position] for position in sorted(ends)], frozenset[int]().union(*along_rim)


def _end_at(
    region: InfluenceRegion, creases: Creases, position: int, before: FloatArray, after: FloatArray
) -> tuple[CreaseEnd, frozenset[int]] | None:
    """The end of the crease that reaches the rim at a place, and edges of the rim along which it runs on; maybe none.

    `before` and `after` are the normals of the faces at the edges of the rim that meet there.
    """
    vertex = int(region.loops[0][position])
    others = creases.leaving.get(vertex, [])
    if len(others) > 1 and before @ after > cos(ROUNDED):
        return None
    chains = [_chain(region.shape, creases.leaving, [vertex, other]) for other in others]
    chain = max(chains, key=len, default=[])  # of equally long ones the one that leaves by the first half-edge
    # round a corner, or to one where creases meet
    goes_on = len(chain) > 1 and len(creases.leaving.get(chain[1], [])) > 1
    if not (len(chain) > SHORTEST or (goes_on and abs(creases.angles[chain[0], chain[1]]) > CLEAR)):
        return None
    followed = [(_followed(region, position, chain), chain) for chain in chains]
    (place, tangent, edges), chain = max(followed, key=lambda end: (len(end[0][2]), len(end[1])))
    # Faces without an area, or folded onto each other, do not tell where their planes meet.
    if len(others) > 1 and not edges and np.linalg.norm(np.cross(before, after)) > FOLDED:
        return _end_at_corner(region, position, before, after), edges
    return CreaseEnd(place, tangent, creases.angles[chain[0], chain[1]] > 0.0), edges


def _end_at_corner(region: InfluenceRegion, position: int, before: FloatArray, after: FloatArray) -> CreaseEnd:
    """The crease that leaves a corner at the rim, between the planes of the faces before and after it."""
    rim = region.shape[region.loops[0]]
    ahead, behind = rim[(position + 1) % len(rim)] - rim[position], rim[position - 1] - rim[position]
    normal = before + after
    axes = np.array([ahead, np.cross(normal, ahead) / max(float(np.linalg.norm(normal)), 1e-300)])
    half = 0.5 * (np.arctan2(axes[1] @ behind, axes[0] @ behind) % (2.0 * np.pi))
    across = np.cross(before, after)
    is_convex = bool(across @ (np.array([np.cos(half), np.sin(half)]) @ axes) > 0.0)
    return CreaseEnd(position, (across if is_convex else -across) / np.linalg.norm(across), is_convex)


def _followed(region: InfluenceRegion, position: int, chain: list[int]) -> tuple[int, FloatArray, frozenset[int]]:
    """Place and tangent of a crease's end, followed along the rim where edges of the rim go on as it does; these."""
    rim = region.loops[0]
    edges: set[int] = set()
    while True:
        tangent = _tangent(region.shape[chain])
        steps = {step: int(rim[(position + step) % len(rim)]) for step in (1, -1)}
        cosines = {step: _cosine(tangent, region.shape[v] - region.shape[chain[0]]) for step, v in steps.items()}
        step = max(cosines, key=lambda step: cosines[step])
        if cosines[step] < ALONG or steps[step] in chain:
            return position, tangent, frozenset(edges)
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


def sectors(region: InfluenceRegion, creases: Creases, ends: list[CreaseEnd], along_rim: frozenset[int]) -> IntArray:
    """Number of the crease end, before it along the rim, whose side each face is on, (m,); -1 if none reaches it.

    Faces are reached from the rim without crossing a sharp edge, but not from edges of the rim that are creases: their
    faces are on the other side.
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
    for half_edge in np.flatnonzero(creases.twins < 0).tolist():
        sector = sector_of_edge.get((int(start[half_edge]), int(end[half_edge])), -1)
        if sector >= 0 and result[half_edge // 3] < 0:
            result[half_edge // 3] = sector
            reached.append(half_edge // 3)
    for face in reached:  # which grows meanwhile
        for half_edge in range(3 * face, 3 * face + 3):
            other = int(creases.twins[half_edge]) // 3
            is_sharp = (int(start[half_edge]), int(end[half_edge])) in creases.angles
            if creases.twins[half_edge] >= 0 and not is_sharp and result[other] < 0:
                result[other] = result[face]
                reached.append(other)
    return result


@dataclass(frozen=True)
class CutHole:
    """A hole whose crease ends are joined in groups."""

    region: InfluenceRegion  # of the whole hole, which has one loop
    ends: list[CreaseEnd]  # in the order of the rim; sector k of the rim begins at end k
    groups: list[tuple[int, ...]]  # ends that belong together
    sectors: list[IntArray]  # those that each part of the hole borders on, in the order of its border
    part_of_sector: IntArray  # (k,)
    part_of_face: IntArray  # (m,): the part whose side each face around the hole is on, -1 for none


def cut_hole(
    region: InfluenceRegion,
    creases: Creases,
    ends: list[CreaseEnd],
    along_rim: frozenset[int],
    groups: list[tuple[int, ...]],
) -> CutHole:
    """Find the parts of a hole, and the faces on their sides.

    Where a sector reaches the next end, the border of its part goes back, along the creases of that end's group, to the
    end of the group before, where another sector begins.
    """
    following = np.zeros(len(ends), dtype=np.int32)
    for group in groups:
        following[[end - 1 for end in group]] = np.roll(group, 1)
    parts = cycles(following, np.arange(len(ends), dtype=np.int32))
    part_of_sector = np.zeros(len(ends), dtype=np.int32)
    for part, own in enumerate(parts):
        part_of_sector[own] = part
    part_of_face = np.append(part_of_sector, np.int32(-1))[sectors(region, creases, ends, along_rim)]
    return CutHole(region, ends, groups, parts, part_of_sector, part_of_face)


def border(cut: CutHole, paths: list[IntArray], part: int) -> IntArray:
    """Border of a part: sectors of the rim, and paths back from the end of each to the beginning of the next."""
    rim, positions = cut.region.loops[0], [end.position for end in cut.ends]
    path_from = {int(path[0]): path for path in paths}
    path_to = {int(path[-1]): path for path in paths}
    own = cut.sectors[part]
    pieces: list[IntArray] = []
    for sector, following in zip(own.tolist(), np.roll(own, -1).tolist(), strict=True):
        start, stop = positions[sector], positions[(sector + 1) % len(positions)]
        pieces.append(rim[np.arange(start, stop if stop > start else stop + len(rim)) % len(rim)])
        here, there = int(rim[stop]), int(rim[positions[following]])
        path = path_from[here] if here in path_from else path_to[here][::-1]
        if path[-1] != there:  # by way of a corner
            path = np.concatenate([path, path_from[there][::-1][1:]])
        pieces.append(path[:-1])
    return np.concatenate(pieces).astype(np.int32)


def sub_hole(
    cut: CutHole, part: int, points: FloatArray, sizes: FloatArray, loop: IntArray, taken: IntArray
) -> InfluenceRegion:
    """InfluenceRegion of a part: the faces on its side. Its `ids` are rows of `points`, then places in the region.

    Pairs (p, 2) of rows that are taken are joined already.
    """
    region, mine = cut.region, cut.part_of_face == part
    # Rows of `points` and places in the region are the same on the rim only: other places get names beyond all rows.
    beyond = len(points) - region.rim_count
    faces = region.faces[mine]
    names = np.where(faces < region.rim_count, faces, faces + beyond)
    ids = np.concatenate([loop, np.setdiff1d(names, loop)])
    place = np.full(len(points) + len(region.ids), -1, dtype=np.int32)
    place[ids] = np.arange(len(ids), dtype=np.int32)
    others = np.where(ids < len(points), ids, ids - beyond)[len(loop) :]
    ids = np.concatenate([loop, others]).astype(np.int32)
    rings = np.concatenate([np.zeros(len(loop)), np.maximum(region.rings[others], 1)]).astype(np.int32)
    joined = place[taken]
    joined = joined[(joined >= 0).all(axis=1)]
    vertices = np.concatenate([points[loop], region.vertices[others]])
    rim = np.arange(len(loop), dtype=np.int32)
    return InfluenceRegion(ids, rings, vertices, place[names], (rim,), joined, wanted_sizes=sizes[loop])
