"""Joins the results of all tiles to one PLY file, in the order of the source, some rows at a time."""

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from bezier_filters._version import __version__
from bezier_filters.arrays import IntArray
from bezier_filters.files.mesh_headers import TRIPLE
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.runtime.parallel import Progress, report
from bezier_filters.scale.array_file import DType, Values
from bezier_filters.scale.source import MeshSource
from bezier_filters.scale.store import Store
from bezier_filters.scale.tiles import Tile

ROWS = 1 << 17  # rows that are held at a time
FACE = np.dtype([("corners", "u1"), ("vertex_indices", "<i4", (TRIPLE,))])
_NAMES = {"<f4": "float", "<f8": "double"}


def write_joined(
    path: str | os.PathLike[str],
    source: MeshSource,
    store: Store,
    tiles: Sequence[Tile],
    *,
    threads: int = 1,
    progress: Progress | None = None,
) -> None:
    """Write a binary PLY file with the rows of all tiles, in order, as vertices, and the faces of the source."""
    n, m = source.vertex_count, source.face_count
    dtype = tiles[0].rows().dtype
    with atomic_write(Path(path)) as temporary, open(temporary, "wb") as stream:
        stream.write(ply_head(dtype, n, m))
        done = 0
        for write, total in ((partial(gathered, store, tiles), n), (partial(_faces, source), m)):
            for rows in _in_order(write, total, threads):
                rows.tofile(stream)
                done += len(rows)
                report(progress, done, n + m)


def _in_order(rows: Callable[[int, int], Values], total: int, threads: int) -> Iterator[Values]:
    """All rows, some at a time: as many as there are threads are being collected ahead."""
    ahead: deque[Future[Values]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        for start in range(0, total, ROWS):
            ahead.append(pool.submit(rows, start, min(start + ROWS, total)))
            if len(ahead) > threads:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()


def _faces(source: MeshSource, start: int, stop: int) -> Values:
    """Faces start .. stop-1 of the source as rows of a PLY file."""
    rows = np.empty(stop - start, dtype=FACE)
    rows["corners"], rows["vertex_indices"] = TRIPLE, source.faces(start, stop)
    return rows


def gathered(store: Store, tiles: Sequence[Tile], start: int, stop: int) -> Values:
    """Rows of vertices start .. stop-1 of the source."""
    ranks = store.rank.read(start, stop)
    of_tile = ranks // np.int32(store.layout.tile_vertices)
    rows = np.empty(len(ranks), dtype=tiles[0].rows().dtype)
    order: IntArray = np.argsort(of_tile, kind="stable").astype(np.int32)
    ends = np.searchsorted(of_tile[order], np.arange(len(tiles) + 1))
    for tile in np.flatnonzero(np.diff(ends)).tolist():
        these = order[ends[tile] : ends[tile + 1]]
        table = tiles[tile].rows()
        rows[these] = table[ranks[these] - tile * store.layout.tile_vertices]
    return rows


def ply_head(dtype: DType, n: int, m: int) -> bytes:
    """Header of a binary PLY file with n vertices of a type and m triangles of type `FACE`."""
    lines = ["ply", "format binary_little_endian 1.0", f"comment bezier_filters {__version__}", f"element vertex {n}"]
    lines += [f"property {_NAMES[dtype[name].str]} {name}" for name in dtype.names or ()]
    lines += [f"element face {m}", "property list uchar int vertex_indices", "end_header"]
    return ("\n".join(lines) + "\n").encode("ascii")
