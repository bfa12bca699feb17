"""The parts that creases cut a hole into: their borders and their surroundings."""

from dataclasses import dataclass, replace

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.holes.rim_creases import CreaseEnd, SharpEdges, sectors
from bezier_filters.holes.surroundings import Surroundings


@dataclass(frozen=True)
class CutHole:
    """A hole whose crease ends are joined in groups.

    Attributes
    ----------
    around : Surroundings
        Of the whole hole, which has one loop.
    ends : list of CreaseEnd
        In the order of the rim; sector k of the rim begins at end k.
    groups : list of tuple of int
        Ends that belong together.
    part_of_sector : list of int
        The part of the hole that each sector of the rim borders on.
    part_of_face : (m,) int32
        The part whose side each face around the hole is on, -1 for none.
    """

    around: Surroundings
    ends: list[CreaseEnd]
    groups: list[tuple[int, ...]]
    part_of_sector: list[int]
    part_of_face: IntArray

    @property
    def part_count(self) -> int:
        """Number of parts."""
        return max(self.part_of_sector) + 1


def cut_hole(around: Surroundings, sharp: SharpEdges, ends: list[CreaseEnd], groups: list[tuple[int, ...]]) -> CutHole:
    """Find the parts of a hole and the faces on their sides."""
    sector_of_face = sectors(around, sharp, ends)
    part_of_sector = _parts(groups, len(ends))
    part_of_face = np.append(np.array(part_of_sector, dtype=np.int32), np.int32(-1))[sector_of_face]
    return CutHole(around, ends, groups, part_of_sector, part_of_face)


def _parts(groups: list[tuple[int, ...]], count: int) -> list[int]:
    """Number of the sub-hole that each sector of the rim belongs to.

    Sector k begins at end k. Where it reaches the next end, the border of its sub-hole goes back, along the
    creases of that end's group, to the end of the group before, where another sector begins.
    """
    before = {group[k]: group[k - 1] for group in groups for k in range(len(group))}
    result = [-1] * count
    parts = 0
    for first in range(count):
        sector = first
        while result[sector] < 0:
            result[sector] = parts
            sector = before[(sector + 1) % count]
        parts = max(result) + 1
    return result


def border(cut: CutHole, paths: list[IntArray], part: int) -> IntArray:
    """Border of a part: sectors of the rim, and paths back from the end of each to the beginning of the next."""
    rim, ends, groups = cut.around.loops[0], cut.ends, cut.groups
    before = {group[k]: group[k - 1] for group in groups for k in range(len(group))}
    path_from = {int(path[0]): path for path in paths}
    path_to = {int(path[-1]): path for path in paths}
    first = cut.part_of_sector.index(part)
    pieces: list[IntArray] = []
    sector = first
    while True:
        arriving = (sector + 1) % len(ends)
        start, stop = ends[sector].position, ends[arriving].position
        stop = stop if stop > start else stop + len(rim)
        pieces.append(rim[np.arange(start, stop) % len(rim)])
        here, sector = int(rim[ends[arriving].position]), before[arriving]
        there = int(rim[ends[sector].position])
        path = path_from[here] if here in path_from else path_to[here][::-1]
        if path[-1] != there:  # by way of a corner
            path = np.concatenate([path, path_from[there][::-1][1:]])
        pieces.append(path[:-1])
        if sector == first:
            return np.concatenate(pieces).astype(np.int32)


def sub_hole(
    cut: CutHole, part: int, points: FloatArray, sizes: FloatArray, loop: IntArray, taken: set[tuple[int, int]]
) -> Surroundings:
    """Surroundings of a part: the faces on its side. Its `ids` are rows of `points`, then places in `around`."""
    around, mine = cut.around, cut.part_of_face == part
    others = np.setdiff1d(around.faces[mine], loop)
    ids = np.concatenate([loop, others]).astype(np.int32)
    rings = np.concatenate([np.zeros(len(loop)), np.maximum(around.rings[others], 1)]).astype(np.int32)
    place = {vertex: k for k, vertex in enumerate(ids.tolist())}
    faces = np.array([place[v] for v in around.faces[mine].ravel().tolist()], dtype=np.int32).reshape(-1, 3)
    joined = frozenset(
        (min(place[a], place[b]), max(place[a], place[b])) for a, b in taken if a in place and b in place
    )
    vertices = np.vstack([points[loop], around.vertices[others]])
    return replace(
        Surroundings(ids, rings, vertices, faces, (np.arange(len(loop), dtype=np.int32),), joined),
        wanted_sizes=sizes[loop],
    )
