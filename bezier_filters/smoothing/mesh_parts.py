"""Parts of a large mesh, from which what holds for the whole is learned."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency, Rows, vertex_adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.spatial_order import SpatialOrder
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
    core: BoolArray  # (k,): vertices that stand for the mesh as a whole: not those near where the part was cut out
    vertex_count: int  # how many vertices the whole mesh has


def whole_mesh(mesh: TriangleMesh, adjacency: Adjacency) -> MeshPart:
    """All of a mesh."""
    n = mesh.vertex_count
    cut, core = np.zeros(n, dtype=np.bool_), np.ones(n, dtype=np.bool_)
    return MeshPart(mesh, adjacency, np.arange(n, dtype=np.int32), cut, core, n)


def renumbered(part: MeshPart, ordered: SpatialOrder) -> MeshPart:
    """A part whose mesh is in another order."""
    mesh, order = ordered.mesh, ordered.order
    return MeshPart(mesh, vertex_adjacency(mesh), part.ids[order], part.cut[order], part.core[order], part.vertex_count)


def sampled_parts(mesh: TriangleMesh, adjacency: Adjacency, around: Sequence[int] = ()) -> MeshPart:
    """Connected parts from all over a mesh, or all of it if it is not large.

    Each part grows ring by ring from a vertex until it has enough, and continues with another one where there
    is nothing more to grow to. The sample also holds the vertices `around` with what is around them; these do not
    stand for the mesh as a whole.
    """
    n = mesh.vertex_count
    if n <= LARGEST_WHOLE:
        return whole_mesh(mesh, adjacency)
    samples = sampled_vertices(n, around, partial(_grown, adjacency))
    return mesh_part(mesh, adjacency, np.arange(n, dtype=np.int32), samples, n)


def sampled_vertices(n: int, around: Sequence[int], grown: Callable[[int], IntArray]) -> tuple[IntArray, IntArray]:
    """Vertices of the parts of a mesh of n, and those that stand for the whole, from what grows around one of them."""
    if n <= LARGEST_WHOLE:
        every = np.arange(n, dtype=np.int32)
        return every, every
    orders = [grown(int(seed)) for seed in (np.arange(PARTS) + 0.5) * n / PARTS]
    core = [order[: CORE if len(order) == PART else len(order)] for order in orders]
    return np.unique(np.concatenate([*orders, *map(grown, around)])), np.unique(np.concatenate(core))


def mesh_part(
    mesh: TriangleMesh, adjacency: Adjacency, ids: IntArray, samples: tuple[IntArray, IntArray], n: int
) -> MeshPart:
    """The samples among the vertices of a mesh, which have ids in one of n vertices, and the faces between them."""
    taken, core = (np.isin(ids, some) for some in samples)
    number = np.cumsum(taken, dtype=np.int32) - np.int32(1)
    part = TriangleMesh(mesh.vertices[taken], number[mesh.faces[taken[mesh.faces].all(axis=1)]])
    found = vertex_adjacency(part)
    cut = found.faces.lengths != adjacency.faces.lengths[taken]
    return MeshPart(part, found, ids[taken], cut, core[taken], n)


def _grown(adjacency: Adjacency, seed: int) -> IntArray:
    """Vertices around one, nearest first, and then around the next one that is not among them."""
    seen, following = np.zeros(len(adjacency.vertices), np.bool_), seed
    orders, room = list[IntArray](), PART
    while room and following >= 0:
        orders.append(grow(adjacency.vertices, following, seen, room)[0])
        room -= len(orders[-1])
        following = next_unseen(seen, following)
    return np.concatenate(orders)


def grow(rows: Rows, seed: int, seen: BoolArray, room: int) -> tuple[IntArray, int]:
    """What is connected to a vertex and was not seen before, nearest first, as many as there is room for.

    Also how many edges the last one whose neighbours were added is away; -1 if there is none.
    """
    order, depth = np.zeros((2, room), dtype=np.int32)
    count, done = _grow(rows.indptr, rows.indices, seed, seen, order, depth)
    return order[:count], int(depth[done - 1]) if done else -1


@jit()
def _grow(
    ptr: IntArray, indices: IntArray, seed: int, seen: BoolArray, order: IntArray, depth: IntArray
) -> tuple[int, int]:
    """Write vertices around one, nearest first; return how many there are, and how many were looked at."""
    order[0], seen[seed] = seed, True
    count, done = 1, 0
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
def next_unseen(seen: BoolArray, after: int) -> int:
    """The next vertex, beginning anew after the last one; -1 if all were seen."""
    n = len(seen)
    for k in range(1, n):
        if not seen[(after + k) % n]:
            return (after + k) % n
    return -1
