"""Parts of a mesh on disk, from which what holds for the whole is learned: the same as in memory."""

import numpy as np

from bezier_filters.arrays import IntArray
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.scale.halo import in_source_order, part_around
from bezier_filters.scale.store import Store
from bezier_filters.scale.tile_values import rows_at
from bezier_filters.smoothing.mesh_parts import LARGEST_WHOLE, PART, Growth, SampledParts, core_of, part_seeds

FIRST_RINGS, NEXT_RINGS = 64, 4
"""That are read around a vertex, and around those where there was nothing more to grow to; more if that is too few."""
NEXT = 2048
"""Vertices whose surroundings are read together then."""


def sampled_parts_of(store: Store, around: tuple[int, ...] = (), *, threads: int = 1) -> SampledParts:
    """See `mesh_parts.sampled_parts`; vertices are those of the source."""
    n = store.layout.vertex_count
    if n <= LARGEST_WHOLE:
        taken = core = np.arange(n, dtype=np.int32)
    else:
        orders = [_grown(store, seed) for seed in (*part_seeds(n), *around)]
        taken, core = np.unique(np.concatenate(orders)), np.unique(np.concatenate([core_of(o) for o in orders]))
    ids, mesh = in_source_order(store, part_around(store, np.sort(_ranks(store, taken)), 1))
    numbers = _sources(store, ids)
    is_taken = np.isin(numbers, taken)
    number = np.cumsum(is_taken, dtype=np.int32) - np.int32(1)
    faces = number[mesh.faces[is_taken[mesh.faces].all(axis=1)]]
    part = TriangleMesh(mesh.vertices[is_taken], faces)
    return SampledParts(part, vertex_adjacency(part, threads=threads), taken, np.isin(taken, core))


def _grown(store: Store, seed: int) -> IntArray:
    """Vertices of the source around one, nearest first, and then around the next one that is not among them."""
    n = store.layout.vertex_count
    found, following = np.zeros(0, dtype=np.int32), seed
    seeds, rings = np.array([seed], dtype=np.int32), FIRST_RINGS
    while len(found) < PART:
        part = _Surroundings(store, seeds, rings, found)
        for k in seeds:
            if part.has_seen(k):
                continue
            more = part.around(k, PART - len(found))
            if more is None:  # they go on further than was read
                seeds, rings = np.array([k], dtype=np.int32), 2 * rings
                break
            found = np.concatenate([found, more])
            if len(found) == PART:
                return found
        else:
            following = _next_unseen(found, int(seeds[-1]), n)
            if following < 0:
                return found
            seeds, rings = np.arange(following, min(following + NEXT, n), dtype=np.int32), NEXT_RINGS
    return found


class _Surroundings:
    """Some rings around some vertices of the source, and which of them were met before."""

    def __init__(self, store: Store, seeds: IntArray, rings: int, found: IntArray) -> None:
        self.rings = rings
        ids, mesh = in_source_order(store, part_around(store, np.sort(_ranks(store, seeds)), rings))
        self.numbers = _sources(store, ids)
        self.rows = vertex_adjacency(mesh).vertices
        self.seen = np.isin(self.numbers, found)

    def has_seen(self, number: int) -> bool:
        """Whether a vertex was met."""
        return bool(self.seen[np.searchsorted(self.numbers, number)])

    def around(self, number: int, most: int) -> IntArray | None:
        """What is connected to a vertex and was not met before; None if that goes on further than is known."""
        before = self.seen.copy()
        seed = int(np.searchsorted(self.numbers, number))
        growth = Growth.of(most).around(self.rows.indptr, self.rows.indices, seed, self.seen)
        if growth.looked_at >= self.rings:
            self.seen = before
            return None
        result: IntArray = self.numbers[growth.order[: growth.count]]
        return result


def _next_unseen(found: IntArray, after: int, n: int) -> int:
    """The next vertex, beginning anew after the last one; -1 if all were found."""
    met = set(found.tolist())
    return next((k for k in (*range(after + 1, n), *range(after)) if k not in met), -1) if len(met) < n else -1


def _ranks(store: Store, numbers: IntArray) -> IntArray:
    """Where some vertices of the source, ascending, are in the store."""
    return rows_at(store.rank, numbers)


def _sources(store: Store, ids: IntArray) -> IntArray:
    """Which vertices of the source some of the store are."""
    result: IntArray = np.array(store.order.mapped()[ids], dtype=np.int32)
    return result
