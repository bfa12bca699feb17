"""Results of tiles: rows in NPY files with checksums, and a PLY file that joins them."""

import json
import zlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from tokenize import TokenError

import numpy as np

from bezier_filters._version import __version__
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import FieldFileError
from bezier_filters.files.mesh_headers import TRIPLE
from bezier_filters.runtime.parallel import Progress, report, thread_count
from bezier_filters.scale.array_file import DType, Values, load_array
from bezier_filters.scale.remote import Location, local_files, write_file
from bezier_filters.scale.source import MeshSource
from bezier_filters.scale.store import Store

ROWS_PER_WRITE = 1 << 17  # rows in memory at a time
ROWS_PER_CACHE = 1 << 11  # rows that fit into the cache
FACE = np.dtype([("corners", "u1"), ("vertex_indices", "<i4", (TRIPLE,))])
_NAMES = {"<f4": "float", "<f8": "double"}


class DamagedTileError(FieldFileError):
    """The file of a tile does not match its checksum; the message names the tile and the file."""


@dataclass(frozen=True)
class TileReport:
    """Report of a task on its tile: vertices read, numbers to sum over all tiles, seconds and peak memory."""

    tile: int
    read: int
    sums: dict[str, list[float]]
    seconds: float = 0.0
    peak_bytes: int = 0
    process: int = 0


@dataclass(frozen=True)
class Tile:
    """The results of a tile: a file of rows, and the report."""

    path: Location
    report: TileReport

    def rows(self) -> Values:
        """The rows, of a local file as a memory map, which should be released soon."""
        return load_array(self.path, "r")


def tile_path(folder: Location, tile: int) -> Location:
    """Path of the rows of a tile; the report is next to it."""
    return folder / f"tile-{tile:06d}.npy"


def report_path(folder: Location, tile: int) -> Location:
    """Path of the report of a tile, which is written after the rows."""
    return folder / f"tile-{tile:06d}.json"


def write_tile(folder: Location, of_tile: TileReport, rows: Values) -> None:
    """Write the results of a tile atomically: the report comes last."""
    content: dict[str, object] = {"report": asdict(of_tile), "rows": str(rows.dtype.descr)}
    text = json.dumps(content | {"checksum": _checksum(content, rows)})
    with write_file(tile_path(folder, of_tile.tile)) as temporary:
        np.save(temporary, rows)
    with write_file(report_path(folder, of_tile.tile)) as temporary:
        temporary.write_text(text, encoding="utf-8")


def open_tile(folder: Location, tile: int) -> Tile:
    """Open the results of a tile; FileNotFoundError if there are none, `DamagedTileError` if a checksum differs."""
    path = tile_path(folder, tile)
    data = report_path(folder, tile).read_bytes()
    try:
        content = json.loads(data)
        checksum, result = content.pop("checksum"), Tile(path, TileReport(**content["report"]))
        rows = result.rows()
        whole = checksum == _checksum(content, rows) and content["rows"] == str(rows.dtype.descr)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, SyntaxError, TokenError):
        whole = False
    if not whole:
        raise DamagedTileError(
            f"tile {tile} is damaged: {path} does not match its checksum; resume to compute it again"
        )
    return result


def remove_tile(folder: Location, tile: int) -> None:
    """Remove the results of a tile."""
    report_path(folder, tile).unlink(missing_ok=True)
    tile_path(folder, tile).unlink(missing_ok=True)


def _checksum(content: Mapping[str, object], rows: Values) -> int:
    """Checksum of the report and all rows."""
    return zlib.crc32(np.ascontiguousarray(rows).view(np.uint8).data, zlib.crc32(json.dumps(content).encode()))


def table_of(vertices: FloatArray, columns: Mapping[str, FloatArray], coordinates: str = "<f8") -> Values:
    """Rows of a PLY file: coordinates of a given type, and columns."""
    every = dict(zip("xyz", vertices.T, strict=True)) | dict(columns)
    rows = np.empty(len(vertices), dtype=[(name, "<f8" if k > 2 else coordinates) for k, name in enumerate(every)])
    for start in range(0, len(rows), ROWS_PER_CACHE):  # column by column while the rows are in the cache
        stop = start + ROWS_PER_CACHE
        for name, values in every.items():
            rows[name][start:stop] = values[start:stop]
    return rows


def write_joined(
    path: Location,
    source: MeshSource,
    store: Store,
    tiles: Sequence[Tile],
    *,
    progress: Progress | None = None,
) -> None:
    """Write a binary PLY file with the rows of all tiles, in order, as vertices, and the faces of the source."""
    n, m = source.vertex_count, source.face_count
    dtype = tiles[0].rows().dtype
    threads = thread_count()
    with (
        local_files([tile.path for tile in tiles]) as paths,
        write_file(path) as temporary,
        open(temporary, "wb") as stream,
        ThreadPoolExecutor(threads) as pool,
    ):
        tiles = [replace(tile, path=path) for tile, path in zip(tiles, paths, strict=True)]
        stream.write(ply_head(dtype, n, m))
        done, together = 0, threads * ROWS_PER_WRITE
        for collect, total in ((partial(gather_rows, store, tiles), n), (partial(_faces, source), m)):
            for first in range(0, total, together):
                starts = np.arange(first, min(first + together, total), ROWS_PER_WRITE)
                for rows in pool.map(collect, starts, np.minimum(starts + ROWS_PER_WRITE, total)):
                    rows.tofile(stream)
                    done += len(rows)
                    report(progress, done, n + m)


def _faces(source: MeshSource, start: int, stop: int) -> Values:
    """Faces start .. stop-1 of the source as rows of a PLY file."""
    rows = np.empty(stop - start, dtype=FACE)
    rows["corners"], rows["vertex_indices"] = TRIPLE, source.faces(start, stop)
    return rows


def gather_rows(store: Store, tiles: Sequence[Tile], start: int, stop: int) -> Values:
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
