"""Parts of a large mesh, from which what holds for the whole is learned."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency, vertex_adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.jit import jit

LARGEST_WHOLE = 60_000  # vertices up to which the sample is the whole mesh
# how many parts, of how many vertices, and how many of these are so far inside that the strongest filters do not feel
# where the part was cut out
PARTS, PART, CORE = 6, 15_000, 6_000


@dataclass(frozen=True)
class MeshPart:
    """A mesh that is a part of another one, or all of it."""

    mesh: TriangleMesh
    adjacency: Adjacency  # of that mesh
    ids: IntArray  # (k,): which vertices of the whole mesh they are
    cut: BoolArray  # (k,): vertices some of whose faces are missing
    vertex_count: int  # how many vertices the whole mesh has


def whole_mesh(mesh: TriangleMesh, adjacency: Adjacency) -> MeshPart:
    """All of a mesh."""
    n = mesh.vertex_count
    return MeshPart(mesh, adjacency, np.arange(n, dtype=np.int32), np.zeros(n, dtype=np.bool_), n)


@dataclass(frozen=True)
class SampledParts:
    """Connected parts from all over a mesh."""

    part: MeshPart  # all of them together
    core: BoolArray  # (k,): vertices that stand for the mesh as a whole: not those near where a part was cut out


def sampled_parts(
    mesh: TriangleMesh, adjacency: Adjacency, around: Sequence[int] = (), *, threads: int = 1
) -> SampledParts:
    """Connected parts from all over a mesh, or all of it if it is not large.

    Each part grows ring by ring from a vertex until it has enough, and continues with another one where there
    is nothing more to grow to. The sample also holds the vertices `around` with what is around them; these do not
    stand for the mesh as a whole.
    """
    n = mesh.vertex_count
    if n <= LARGEST_WHOLE:
        return SampledParts(whole_mesh(mesh, adjacency), np.ones(n, dtype=np.bool_))
    core, taken = np.zeros((2, n), np.bool_)
    for seed in part_seeds(n):
        order = _grown(adjacency, seed)
        taken[order] = True
        core[core_of(order)] = True
    for seed in around:
        taken[_grown(adjacency, seed)] = True
    vertices = np.flatnonzero(taken).astype(np.int32)
    number = np.full(n, -1, dtype=np.int32)
    number[vertices] = np.arange(len(vertices), dtype=np.int32)
    faces = mesh.faces[taken[mesh.faces].all(axis=1)]
    part = TriangleMesh(mesh.vertices[vertices], number[faces])
    found = vertex_adjacency(part, threads=threads)
    cut = found.faces.lengths != adjacency.faces.lengths_of(vertices)
    return SampledParts(MeshPart(part, found, vertices, cut, n), core[vertices])


def part_seeds(n: int) -> list[int]:
    """Vertices that parts of a mesh of n vertices grow from."""
    return [int(seed) for seed in (np.arange(PARTS) + 0.5) * n / PARTS]


def core_of(order: IntArray) -> IntArray:
    """Vertices of a part, nearest first, that are not near where it was cut out."""
    return order[: CORE if len(order) == PART else len(order)]


def _grown(adjacency: Adjacency, seed: int) -> IntArray:
    """Vertices around one, nearest first, and then around the next one that is not among them."""
    rows, n = adjacency.vertices, len(adjacency.vertices)
    growth, seen, following = Growth.of(PART), np.zeros(n, np.bool_), seed
    while not growth.is_full and following >= 0:
        growth = growth.around(rows.indptr, rows.indices, following, seen)
        following = _next_unseen(seen, following)
    return growth.order[: growth.count]


@dataclass(frozen=True)
class Growth:
    """Vertices that a part has got, nearest first."""

    # order, depth: (size,): the vertices and how many edges each is away from where it began
    order: IntArray
    depth: IntArray
    count: int = 0  # how many there are
    looked_at: int = -1  # the depth of the last one whose neighbours were added; -1 if there is none

    @staticmethod
    def of(size: int) -> "Growth":
        """An empty part that has room for some vertices."""
        return Growth(*np.zeros((2, size), dtype=np.int32))

    @property
    def is_full(self) -> bool:
        """Whether there is no more room."""
        return self.count == len(self.order)

    def around(self, ptr: IntArray, indices: IntArray, seed: int, seen: BoolArray) -> "Growth":
        """Add what is connected to a vertex and was not seen before, as long as there is room."""
        count, done = _grow(ptr, indices, seed, seen, self.order, self.depth, self.count)
        return Growth(self.order, self.depth, count, int(self.depth[done - 1]) if done > self.count else -1)


@jit()
def _grow(
    ptr: IntArray, indices: IntArray, seed: int, seen: BoolArray, order: IntArray, depth: IntArray, count: int
) -> tuple[int, int]:
    """Write vertices around one, nearest first; return how many there are, and how many were looked at."""
    done = count
    order[count], depth[count] = seed, 0
    seen[seed] = True
    count += 1
    while done < count and count < len(order):
        i, next_depth = order[done], depth[done] + 1
        done += 1
        for q in range(ptr[i], ptr[i + 1]):
            j = indices[q]
            if not seen[j] and count < len(order):
                seen[j] = True
                order[count], depth[count] = j, next_depth
                count += 1
    return count, done


@jit()
def _next_unseen(seen: BoolArray, after: int) -> int:
    """The next vertex, beginning anew after the last one; -1 if all were seen."""
    n = len(seen)
    for k in range(1, n):
        if not seen[(after + k) % n]:
            return (after + k) % n
    return -1
