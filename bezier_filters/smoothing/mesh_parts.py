"""Parts of a large mesh, from which what holds for the whole is learned."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.meshes.adjacency import Adjacency, vertex_adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.runtime.lean import lean_njit

LARGEST_WHOLE = 60_000
"""Vertices up to which the sample is the whole mesh."""
PARTS, PART, CORE = 6, 9_000, 6_000
"""How many parts, of how many vertices, without and with those near their border that only surround the others."""


@dataclass(frozen=True)
class SampledParts:
    """A mesh made of parts of another one.

    Attributes
    ----------
    mesh : TriangleMesh
    adjacency : Adjacency
        Of that mesh.
    vertices : (k,) int32
        Which vertices of the other mesh they are, ascending.
    core : (k,) bool
        Vertices that are not near where a part was cut out.
    """

    mesh: TriangleMesh
    adjacency: Adjacency
    vertices: IntArray
    core: BoolArray


def sampled_parts(
    mesh: TriangleMesh, adjacency: Adjacency, around: Sequence[int] = (), *, threads: int = 1
) -> SampledParts:
    """Connected parts from all over a mesh, or all of it if it is not large.

    Each part grows ring by ring from a vertex until it has enough, and continues with another one where there
    is nothing more to grow to.

    Parameters
    ----------
    mesh : TriangleMesh
    adjacency : Adjacency
        Of the same mesh.
    around : sequence of int
        Vertices that the sample has to hold with what is around them.
    threads : int
        Number of threads.
    """
    n = mesh.vertex_count
    if n <= LARGEST_WHOLE:
        return SampledParts(mesh, adjacency, np.arange(n, dtype=np.int32), np.ones(n, dtype=np.bool_))
    seeds = ((np.arange(PARTS) + 0.5) * n / PARTS).astype(np.int32)
    core, taken, rows = np.zeros(n, np.bool_), np.zeros(n, np.bool_), adjacency.vertices
    for seed in (*seeds, *around):
        order = np.empty(PART, dtype=np.int32)
        count = _grow(rows.indptr, rows.indices, seed, np.zeros(n, np.bool_), order)
        taken[order[:count]] = True
        core[order[: CORE if count == PART else count]] = True
    vertices = np.flatnonzero(taken).astype(np.int32)
    number = np.full(n, -1, dtype=np.int32)
    number[vertices] = np.arange(len(vertices), dtype=np.int32)
    faces = mesh.faces[taken[mesh.faces].all(axis=1)]
    part = TriangleMesh(mesh.vertices[vertices], number[faces])
    return SampledParts(part, vertex_adjacency(part, threads=threads), vertices, core[vertices])


@lean_njit()
def _grow(ptr: IntArray, indices: IntArray, seed: int, seen: BoolArray, order: IntArray) -> int:
    """Write vertices around one, nearest first; return how many there are."""
    n, count, done, following = len(seen), 0, 0, seed
    while count < len(order):
        if done == count:  # a seed, at first or because a component is exhausted
            tried = 0
            while seen[following] and tried < n:
                following = (following + 1) % n
                tried += 1
            if tried == n:
                return count
            order[count] = following
            seen[following] = True
            count += 1
            continue
        i = order[done]
        done += 1
        for q in range(ptr[i], ptr[i + 1]):
            j = indices[q]
            if not seen[j] and count < len(order):
                seen[j] = True
                order[count] = j
                count += 1
    return count
