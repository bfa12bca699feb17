"""What depends on the connections of all vertices in one order or another: clusters and closed parts.

The one process that runs the tasks does this, with a table of the neighbours of all vertices in a file, and 4 to 12
bytes of memory per vertex.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, IntArray
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.runtime.lean import inner_njit, lean_njit
from bezier_filters.runtime.parallel import Progress, report
from bezier_filters.scale.array_file import ArrayFile
from bezier_filters.scale.store import Store
from bezier_filters.scale.tile_pieces import piece_around
from bezier_filters.scale.tile_values import FileValues
from bezier_filters.smoothing.clusters import find_centers, join_centers

CENTER = np.dtype([("center", "<i4"), ("label", "<i4")])
ROWS = 1 << 20
"""That are held at a time."""


@dataclass(frozen=True)
class Neighbours:
    """Neighbours of all vertices, those of each in the order of the source.

    Attributes
    ----------
    ptr : (n + 1,) int64
        Where the rows begin and end, a memory map.
    indices : (ptr[n],) int32
        The neighbours, a memory map.
    """

    ptr: NDArray[np.int64]
    indices: IntArray


def neighbours_of(store: Store, *, threads: int = 1, progress: Progress | None = None) -> Neighbours:
    """The neighbours of all vertices, from the pieces of all tiles; they are kept in the store."""
    n, ptr_path, path = store.layout.vertex_count, store.folder / "neighbour_ptr.bin", store.folder / "neighbours.bin"
    if not path.is_file():
        with atomic_write(ptr_path) as ptr_file, atomic_write(path) as file, open(ptr_file, "wb") as of_rows:
            done = np.zeros(1, dtype=np.int64)
            done.tofile(of_rows)
            with open(file, "wb") as stream:
                for tile, (lengths, indices) in enumerate(_rows_of_tiles(store, threads)):
                    ends = done[-1] + np.cumsum(lengths, dtype=np.int64)
                    ends.tofile(of_rows)
                    indices.tofile(stream)
                    done = ends
                    report(progress, tile + 1, store.layout.tile_count)
    ptr = np.memmap(ptr_path, np.int64, "c", shape=(n + 1,))
    count = int(ptr[-1])
    return Neighbours(ptr, np.memmap(path, np.int32, "c", shape=(count,)) if count else np.zeros(0, np.int32))


def _rows_of_tiles(store: Store, threads: int) -> Iterator[tuple[IntArray, IntArray]]:
    """Lengths and entries of the rows of each tile, one after the other."""

    def rows_of(tile: int) -> tuple[IntArray, IntArray]:
        piece = piece_around(store, tile, 1)
        rows, table = piece.rows(*store.layout.tile(tile)), piece.adjacency.vertices
        lengths = table.lengths_of(rows)
        starts = np.repeat(table.indptr[rows] - np.append(0, np.cumsum(lengths)[:-1]), lengths)
        return lengths, piece.ids[piece.places][table.indices[starts + np.arange(len(starts))]]

    with ThreadPoolExecutor(threads) as pool:
        tiles = range(store.layout.tile_count)
        for first in range(0, len(tiles), threads):
            yield from pool.map(rows_of, tiles[first : first + threads])


def cluster_centers(store: Store, neighbours: Neighbours) -> FileValues:
    """The center of the cluster that each vertex belongs to: "center" in the store, "label" in the source.

    Clusters form in the order of the source, as they do in memory: 4 bytes per vertex.
    """
    n, path = store.layout.vertex_count, store.folder / "clusters.bin"
    if not path.is_file():
        center = np.full(n, -1, dtype=np.int32)
        for start in range(0, n, ROWS):
            visits = store.rank.read(start, min(start + ROWS, n))
            find_centers(neighbours.ptr, neighbours.indices, visits, center)
        join_centers(neighbours.ptr, neighbours.indices, center)
        order = store.order.mapped()
        with atomic_write(path) as temporary, open(temporary, "wb") as stream:
            for start in range(0, n, ROWS):
                rows = np.empty(min(ROWS, n - start), dtype=CENTER)
                rows["center"] = center[start : start + ROWS]
                rows["label"] = order[rows["center"]]
                rows.tofile(stream)
    return FileValues(ArrayFile(path, CENTER, 1, n), "")


def label_parts(store: Store, neighbours: Neighbours, is_open: BoolArray, path: Path) -> tuple[FileValues, IntArray]:
    """Number of the connected part that each vertex belongs to, "part", -1 for parts with open vertices.

    Parts are numbered in the order of the source, whose first vertices, in the store, come with them. It takes 12
    bytes per vertex.
    """
    n = store.layout.vertex_count
    root = np.arange(n, dtype=np.int32)
    unite(neighbours.ptr, neighbours.indices, root)
    first = np.full(n, -1, dtype=np.int32)  # vertices of the source, by the roots of their parts
    for start in range(0, n, ROWS):
        _find_first(store.rank.read(start, min(start + ROWS, n)), start, root, first)
    opened = np.zeros(n, dtype=np.bool_)
    opened[root[is_open]] = True
    roots = np.flatnonzero((first >= 0) & ~opened)
    roots = roots[np.argsort(first[roots])]
    firsts: IntArray = np.array(store.rank.mapped()[first[roots]], dtype=np.int32)
    first[:] = -1
    first[roots] = np.arange(len(roots), dtype=np.int32)
    with atomic_write(path) as temporary, open(temporary, "wb") as stream:
        for start in range(0, n, ROWS):
            first[root[start : start + ROWS]].tofile(stream)
    return FileValues(ArrayFile(path, np.dtype(np.int32), 1, n), "part"), firsts


@lean_njit()
def unite(ptr: NDArray[np.int64], indices: IntArray, root: IntArray) -> None:
    """Replace vertices, (n,), by the lowest of the part that they are connected to."""
    for i in range(len(root)):
        for q in range(ptr[i], ptr[i + 1]):
            a, b = _root(root, i), _root(root, indices[q])
            if a < b:
                root[b] = a
            else:
                root[a] = b
    for i in range(len(root)):
        root[i] = root[root[i]]  # those before are done


@inner_njit()
def _root(root: IntArray, i: int) -> int:
    """Follow a vertex to where it ends, and halve the way."""
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i


@lean_njit()
def _find_first(ranks: IntArray, start: int, root: IntArray, first: IntArray) -> None:
    """Write the first vertex of the source of each part."""
    for k in range(len(ranks)):
        if first[root[ranks[k]]] < 0:
            first[root[ranks[k]]] = start + k
