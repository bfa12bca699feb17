"""A mesh in spatial order in a folder, in blocks that can be read separately.

Blocks are ranges of vertices in spatial order. Every face is stored with each block that has one of its corners, so
that all faces at a vertex are in one block. Tiles are ranges of blocks. Sorting does not load the whole mesh. The
order is that of `spatial_order`, as in memory: each tile sees its vertices and faces in the same order, and its sums
agree to the last digit.
"""

import hashlib
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import FieldFileError, InvalidMeshError
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.spatial_order import Grid, grid_around, widen_bounds
from bezier_filters.meshes.unit_size import MAX_UNSCALED_EXPONENT, size_exponent
from bezier_filters.runtime.checksums import stream_checksum
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import Progress, report
from bezier_filters.scale.array_file import ArrayFile, load_array
from bezier_filters.scale.remote import Location, write_file, write_folder
from bezier_filters.scale.source import Fingerprint, MeshSource

ROWS_PER_PASS = 1 << 20  # vertices or faces in memory at a time
MAX_BLOCK_BITS = 10  # log2 of the vertices of a block; samples and halos read whole blocks
STORE_FORMAT = 3
LAYOUT = "layout"  # entry of the manifest, with a checksum like those of the files
MANIFEST = "store.json"  # written last, when all other files exist
FILES = VERTICES, ORDER, RANK, FACES, FACE_PTR = "vertices.bin", "order.bin", "rank.bin", "faces.bin", "face_ptr.npy"


@dataclass(frozen=True)
class Layout:
    """Layout of a store."""

    vertex_count: int
    face_count: int
    dtype: str  # of the coordinates
    block_bits: int  # blocks have 2^block_bits vertices,
    tile_vertices: int  # and tiles a multiple of that
    low: Sequence[float]  # this and the next two are attributes of the `Grid`
    scale: float
    bits: int

    @property
    def block_count(self) -> int:
        """Number of blocks."""
        return -(-self.vertex_count >> self.block_bits)

    @property
    def tile_count(self) -> int:
        """Number of tiles."""
        return -(-self.vertex_count // self.tile_vertices)

    @property
    def grid(self) -> Grid:
        """Grid whose cells give the order of the vertices."""
        return Grid(np.array(self.low), self.scale, self.bits)

    def round_to_blocks(self, tile_vertices: int) -> int:
        """Number of vertices of a tile, rounded up to whole blocks."""
        return -(-tile_vertices >> self.block_bits) << self.block_bits

    def tile(self, number: int) -> tuple[int, int]:
        """Range of the vertices of a tile: first, and one after the last."""
        start = number * self.tile_vertices
        return start, min(start + self.tile_vertices, self.vertex_count)


@dataclass(frozen=True)
class Store:
    """A mesh prepared for tiles."""

    folder: Location  # all workers must see it there
    layout: Layout
    vertices: ArrayFile  # coordinates in spatial order, (n, 3)

    @property
    def order(self) -> ArrayFile:
        """Number in the source of each vertex, (n,) int32."""
        return ArrayFile(self.folder / ORDER, np.dtype(np.int32), self.layout.vertex_count)

    @property
    def rank(self) -> ArrayFile:
        """Position in the store of each vertex of the source, (n,) int32."""
        return ArrayFile(self.folder / RANK, np.dtype(np.int32), self.layout.vertex_count)

    def face_ptr(self) -> NDArray[np.int64]:
        """First face of every block, and the end of the last, (blocks + 1,)."""
        return load_array(self.folder / FACE_PTR)

    def faces_of(self, blocks: IntArray, ptr: NDArray[np.int64]) -> list[IntArray]:
        """Number in the source and corners of the faces of ascending blocks, (k, 4) for each run of blocks."""
        rows = ArrayFile(self.folder / FACES, np.dtype(("i4", 4)), int(ptr[-1]))
        runs = np.split(blocks, np.flatnonzero(np.diff(blocks) > 1) + 1)
        return rows.read_runs([(int(ptr[run[0]]), int(ptr[run[-1] + 1])) for run in runs if len(run)])

    def coordinates(self, start: int, stop: int) -> FloatArray:
        """Coordinates of vertices start .. stop-1, (k, 3)."""
        return self.vertices.read(start, stop).astype(np.float64, copy=False)

    def coordinates_of(self, ids: IntArray) -> FloatArray:
        """Coordinates of some vertices, (k, 3)."""
        return self.vertices.take(ids).astype(np.float64, copy=False)

    def sources(self, ids: IntArray) -> IntArray:
        """Numbers in the source of some vertices."""
        return self.order.take(ids)


def open_store(folder: Location, fingerprint: Fingerprint) -> Store:
    """Open a store; FieldFileError if it is damaged, or made from another source than this one."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        version, found = manifest["format"], manifest["source"]
        if version != STORE_FORMAT:
            expected = f"(format {version}, expected {STORE_FORMAT})"
            raise FieldFileError(f"{folder} was made by another version {expected}; remove it")
        checksums, layout = dict[str, str](manifest["checksums"]), Layout(**manifest["layout"])
    except (ValueError, TypeError, KeyError) as error:
        raise FieldFileError(f"{folder / MANIFEST} is damaged: {error}; remove the folder") from error
    if found != fingerprint:
        raise FieldFileError(
            f"{folder} was made from another file, or the file has changed since: {found}, now {fingerprint}; "
            "remove it to start over"
        )
    for name in FILES:
        if not (folder / name).is_file() or _file_checksum(folder / name) != checksums.get(name):
            raise FieldFileError(f"{folder / name} is damaged or missing; remove the folder")
    if _checksum(layout) != checksums.get(LAYOUT):
        raise FieldFileError(f"{folder / MANIFEST} is damaged; remove the folder")
    return _store_in(folder, layout)


def _store_in(folder: Location, layout: Layout) -> Store:
    return Store(folder, layout, ArrayFile(folder / VERTICES, np.dtype((layout.dtype, 3)), layout.vertex_count))


def _file_checksum(path: Location) -> str:
    with path.open("rb") as stream:
        return stream_checksum(stream)


def build_store(source: MeshSource, folder: Location, tile_vertices: int, *, progress: Progress | None = None) -> Store:
    """Prepare a mesh for tiles in an empty folder; coordinates must be finite and faces triangles."""
    n, m = source.vertex_count, source.face_count
    passes = _Passes(3 * n + 2 * m, progress)
    bits = min(MAX_BLOCK_BITS, int(math.log2(tile_vertices)))
    grid = _grid(source, passes)
    layout = Layout(n, m, source.dtype.str, bits, 0, grid.low.tolist(), grid.scale, grid.bits)
    layout = replace(layout, tile_vertices=layout.round_to_blocks(tile_vertices))
    with write_folder(folder) as local:
        store = _store_in(local, layout)
        store.vertices.allocate()
        _sort_vertices(source, store, passes)
        _sort_faces(source, local, store, passes)
        checksums = {name: _file_checksum(local / name) for name in FILES}
    checksums[LAYOUT] = _checksum(layout)
    manifest = {"format": STORE_FORMAT, "source": source.fingerprint(), "checksums": checksums, "layout": vars(layout)}
    with write_file(folder / MANIFEST) as temporary:  # marks the store as complete
        temporary.write_text(json.dumps(manifest, indent=1), encoding="utf-8")
    return _store_in(folder, layout)


def _checksum(layout: Layout) -> str:
    return hashlib.blake2b(json.dumps(vars(layout), sort_keys=True).encode(), digest_size=16).hexdigest()


@dataclass
class _Passes:
    """Passes over the rows of a mesh, and the progress of all together."""

    total: int
    progress: Progress | None
    done: int = 0

    def chunks(self, rows: int) -> Iterator[tuple[int, int]]:
        """Ranges of rows: first, and one after the last."""
        for start in range(0, rows, ROWS_PER_PASS):
            stop = min(start + ROWS_PER_PASS, rows)
            yield start, stop
            self.done += stop - start
            report(self.progress, self.done, self.total)


def _grid(source: MeshSource, passes: _Passes) -> Grid:
    """Grid around all vertices, which are validated."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for start, stop in passes.chunks(source.vertex_count):
        vertices = source.vertices(start, stop).astype(np.float64)
        widen_bounds(vertices, low, high)
        if not np.isfinite(vertices).all():
            bad = start + int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
            raise InvalidMeshError(
                f"{source.paths[0]}: vertex {bad} has a coordinate that is NaN or infinite; remove such vertices first"
            )
    triangle_mesh([low, high], [])  # refuses extreme sizes
    if size_exponent([low, high]):
        limit = 2.0**MAX_UNSCALED_EXPONENT
        raise InvalidMeshError(
            f"{source.paths[0]}: the largest coordinate is {max(abs(low).max(), abs(high).max()):.3g}; in tiles it "
            f"must be between {1.0 / limit:.2g} and {limit:.2g}: scale the mesh, or compute it in memory"
        )
    return grid_around(low, high, source.vertex_count)


def _sort_vertices(source: MeshSource, store: Store, passes: _Passes) -> None:
    """Write coordinates and source numbers of the vertices in the new order, and their ranks."""
    n, grid = source.vertex_count, store.layout.grid
    ends = np.zeros(grid.cell_count + 1, dtype=np.int32)
    for start, stop in passes.chunks(n):
        cells = grid.cells(source.vertices(start, stop).astype(np.float64))
        np.add.at(ends[1:], cells, np.int32(1))  # much faster than with another integer type
    np.cumsum(ends, out=ends)
    order = store.order.allocate()
    with store.rank.path.open("wb") as stream:
        for start, stop in passes.chunks(n):
            vertices, places = source.vertices(start, stop), np.empty(stop - start, dtype=np.int32)
            cells = grid.cells(vertices.astype(np.float64))
            _place(cells, ends, start, places, order.memory_map("r+"))
            store.vertices.memory_map("r+")[places] = vertices
            places.tofile(stream)


def _sort_faces(source: MeshSource, folder: Path, store: Store, passes: _Passes) -> None:
    """Write every face to each block that it touches."""
    m, bits = source.face_count, store.layout.block_bits
    ptr = np.zeros(store.layout.block_count + 1, dtype=np.int64)

    def corner_ranks(start: int, stop: int) -> IntArray:
        return np.take(store.rank.memory_map(), source.faces(start, stop))

    for start, stop in passes.chunks(m):
        _append_faces(corner_ranks(start, stop), start, bits, ptr[1:], np.empty((0, 4), dtype=np.int32))
    np.cumsum(ptr, out=ptr)
    np.save(folder / FACE_PTR, ptr)
    rows = ArrayFile(folder / FACES, np.dtype(("i4", 4)), int(ptr[-1])).allocate()
    for start, stop in passes.chunks(m):
        _append_faces(corner_ranks(start, stop), start, bits, ptr, rows.memory_map("r+"))


@jit()
def _place(cells: IntArray, ends: IntArray, first: int, places: IntArray, order: IntArray) -> None:
    """Append each vertex to its cell."""
    for i in range(cells.shape[0]):
        place = ends[cells[i]]
        ends[cells[i]] += 1
        places[i] = place
        order[place] = first + i


@jit()
def _append_faces(faces: IntArray, first: int, bits: int, ends: NDArray[np.int64], rows: IntArray) -> None:
    """Append each face to its blocks, or only count it if there are no rows to write."""
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0] >> bits, faces[f, 1] >> bits, faces[f, 2] >> bits
        for k, block in enumerate((a, b, c)):
            if (k == 1 and b == a) or (k == 2 and c in (a, b)):
                continue
            row = ends[block]
            ends[block] += 1
            if len(rows):
                rows[row, 0] = first + f
                rows[row, 1], rows[row, 2], rows[row, 3] = faces[f, 0], faces[f, 1], faces[f, 2]
