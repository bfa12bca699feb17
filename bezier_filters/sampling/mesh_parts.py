"""Connected parts of a large mesh, the sample from which its global parameters are learned."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.meshes.adjacency import Rows
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.spatial_order import SpatialOrder
from bezier_filters.runtime.jit import jit

MAX_WHOLE_VERTICES = 60_000  # vertices up to which the sample is the whole mesh
# number of parts, vertices of a part, and vertices of its core, so far inside that the strongest filters do not reach
# the cut
PART_COUNT, PART_VERTICES, PART_CORE_VERTICES = 6, 15_000, 6_000


@dataclass(frozen=True)
class MeshPart:
    """A part of a mesh, or all of it."""

    mesh: PreparedMesh
    ids: IntArray  # (k,): numbers of its vertices in the whole mesh
    cut: BoolArray  # (k,): vertices some of whose faces are missing
    core: BoolArray  # (k,): vertices that represent the whole mesh, away from the cut
    vertex_count: int  # number of vertices of the whole mesh


def whole_mesh(mesh: PreparedMesh) -> MeshPart:
    """A whole mesh as a part."""
    n = mesh.vertex_count
    cut, core = np.zeros(n, dtype=np.bool_), np.ones(n, dtype=np.bool_)
    return MeshPart(mesh, np.arange(n, dtype=np.int32), cut, core, n)


def reorder_part(part: MeshPart, ordered: SpatialOrder) -> MeshPart:
    """Reorder the vertices of a part."""
    order = ordered.order
    return MeshPart(prepare_mesh(ordered.mesh), part.ids[order], part.cut[order], part.core[order], part.vertex_count)


def sample_parts(mesh: PreparedMesh, around: Sequence[int] = ()) -> MeshPart:
    """Sample connected parts from all over a mesh, or all of it if it is not large.

    Each part grows ring by ring from a vertex until it is large enough, and continues at another vertex if its
    component ends. The sample also has parts around the vertices `around`, which do not belong to the core.
    """
    n = mesh.vertex_count
    if n <= MAX_WHOLE_VERTICES:
        return whole_mesh(mesh)
    samples = sample_vertices(n, around, partial(_grow_from_seed, mesh.adjacency.vertices))
    return mesh_part(mesh, np.arange(n, dtype=np.int32), samples, n)


def sample_vertices(
    n: int, around: Sequence[int], grow_from_seed: Callable[[int], IntArray]
) -> tuple[IntArray, IntArray]:
    """Vertices of the parts of a mesh of n vertices, and of their cores; `grow_from_seed` grows a part from one."""
    if n <= MAX_WHOLE_VERTICES:
        every = np.arange(n, dtype=np.int32)
        return every, every
    orders = [grow_from_seed(int(seed)) for seed in (np.arange(PART_COUNT) + 0.5) * n / PART_COUNT]
    core = [order[: PART_CORE_VERTICES if len(order) == PART_VERTICES else len(order)] for order in orders]
    return np.unique(np.concatenate([*orders, *map(grow_from_seed, around)])), np.unique(np.concatenate(core))


def mesh_part(mesh: PreparedMesh, ids: IntArray, samples: tuple[IntArray, IntArray], n: int) -> MeshPart:
    """The samples of a mesh, whose vertices have ids in a mesh of n vertices, with the faces between them."""
    sampled, core = (np.isin(ids, some) for some in samples)
    number = np.cumsum(sampled, dtype=np.int32) - np.int32(1)
    faces = number[mesh.faces[sampled[mesh.faces].all(axis=1)]]
    part = prepare_mesh(TriangleMesh(mesh.vertices[sampled], faces))
    cut = part.adjacency.faces.lengths != mesh.adjacency.faces.lengths[sampled]
    return MeshPart(part, ids[sampled], cut, core[sampled], n)


def _grow_from_seed(rows: Rows, seed: int) -> IntArray:
    """Vertices around one, nearest first, and then around the next unseen one."""
    seen, following = np.zeros(len(rows), np.bool_), seed
    orders, room = list[IntArray](), PART_VERTICES
    while room and following >= 0:
        orders.append(grow_component(rows, following, seen, room)[0])
        room -= len(orders[-1])
        following = next_unseen(seen, following)
    return np.concatenate(orders)


def grow_component(rows: Rows, seed: int, seen: BoolArray, room: int) -> tuple[IntArray, int]:
    """Unseen vertices connected to a seed, nearest first, up to `room` of them.

    Also the distance in edges of the last vertex whose neighbours were added; -1 if there is none.
    """
    order, depth = np.zeros((2, room), dtype=np.int32)
    count, done = _grow_kernel(rows.indptr, rows.indices, seed, seen, order, depth)
    return order[:count], int(depth[done - 1]) if done else -1


@jit()
def _grow_kernel(
    ptr: IntArray, indices: IntArray, seed: int, seen: BoolArray, order: IntArray, depth: IntArray
) -> tuple[int, int]:
    """Write vertices around one, nearest first; return their number, and the number of expanded ones."""
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
    """The next unseen vertex in cyclic order; -1 if all were seen."""
    n = len(seen)
    for k in range(1, n):
        if not seen[(after + k) % n]:
            return (after + k) % n
    return -1
