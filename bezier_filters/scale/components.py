"""Closed components of a mesh on disk: components of tiles, merged by a union over their common vertices."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from bezier_filters.arrays import IntArray
from bezier_filters.meshes.adjacency import Adjacency
from bezier_filters.scale.array_file import ArrayFile, Values, save_array
from bezier_filters.scale.halo import TilePart
from bezier_filters.scale.remote import write_file
from bezier_filters.scale.store import Store
from bezier_filters.scale.tiles import Tile
from bezier_filters.smoothing.volume import ClosedComponents

LABEL = np.dtype([("vertex", "<i4"), ("label", "<i4"), ("open", "?")])


@dataclass(frozen=True)
class StoredComponents:
    """Closed components of a mesh on disk: the number of each vertex's, -1 for none, and a point of each, (c, 3)."""

    of_vertex: ArrayFile
    origins: ArrayFile

    @property
    def count(self) -> int:
        """Number of components."""
        return self.origins.rows

    def select(self, ids: IntArray) -> tuple[ClosedComponents, IntArray]:
        """Components of some vertices, and their numbers in the whole mesh."""
        numbers = self.of_vertex.take(ids)
        there = np.unique(numbers[numbers >= 0])
        local = np.where(numbers >= 0, np.searchsorted(there, numbers), -1).astype(np.int32)
        return ClosedComponents(local, self.origins.take(there)), there


def label_vertices(part: TilePart, adjacency: Adjacency) -> Values:
    """Labels of the vertices of a tile and then of their neighbours: their components within this part."""
    rows = adjacency.vertices
    graph = csr_array((np.ones(len(rows.indices), np.int8), rows.indices, rows.indptr), shape=(len(rows), len(rows)))
    found = np.empty(len(rows), dtype=LABEL)
    found["vertex"], found["label"] = part.ids, connected_components(graph, directed=False)[1]
    found["open"] = adjacency.on_boundary | (rows.lengths == 0)
    around = rows.indices[rows.indptr[part.own.start] : rows.indptr[part.own.stop]]
    around = np.unique(around[(around < part.own.start) | (around >= part.own.stop)])
    return np.concatenate([found[part.own], found[around]])


def merge_components(store: Store, tiles: Sequence[Tile]) -> StoredComponents | None:
    """Closed components of a mesh, from `label_vertices` of all tiles in order; None if there are none."""
    n = store.layout.vertex_count
    path, ranges = store.folder / "components.bin", [store.layout.tile(tile) for tile in range(len(tiles))]
    with write_file(path) as temporary:
        nodes = ArrayFile(temporary, np.dtype(np.int32), n).allocate().memory_map("r+")
        open_nodes, links, count = [], [], 0
        for (start, stop), tile in zip(ranges, tiles, strict=True):
            rows = np.array(tile.rows())
            rows["label"] += count
            own, around = rows[: stop - start], rows[stop - start :]
            nodes[start:stop] = own["label"]
            open_nodes.append(np.unique(own["label"][own["open"]]))
            links.append(around[["vertex", "label"]])
            count = int(rows["label"].max(initial=count - 1)) + 1
        there, here = (np.concatenate([link[name] for link in links]) for name in ("vertex", "label"))
        graph = csr_array((np.ones(len(here), np.int8), (here, nodes[there])), shape=(count, count))
        total, component = connected_components(graph, directed=False)
        is_closed = np.ones(total, dtype=np.bool_)
        is_closed[component[np.concatenate(open_nodes)]] = False
        number = np.where(is_closed, np.cumsum(is_closed) - 1, -1).astype(np.int32)[component]
        firsts = np.empty(int(is_closed.sum()), dtype=np.int32)
        for start, stop in reversed(ranges):
            numbers = number[nodes[start:stop]]
            nodes[start:stop] = numbers
            closed = np.flatnonzero(numbers >= 0)[::-1]
            firsts[numbers[closed]] = start + closed
        del nodes  # before the file is renamed
    if not len(firsts):
        return None
    origins = store.vertices.take(firsts).astype(np.float64)
    return StoredComponents(ArrayFile(path, np.dtype(np.int32), n), save_array(store.folder / "origins.bin", origins))
