"""A mesh in spatial order in a folder, cut into blocks that can be read one by one.

Blocks are runs of vertices in spatial order; every face is kept with each block that has one of its corners, so
that the faces at a vertex are all in one place. Tiles are runs of blocks. A mesh is sorted without ever being held in
memory. The order is that of `spatial_order`, which meshes in memory are sorted by, too: each tile then sees its
vertices and faces in the same order as there, and its sums are the same to the last digit.
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
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.runtime.checksums import file_checksum
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import Progress, report
from bezier_filters.scale.array_file import ArrayFile, load_array
from bezier_filters.scale.source import Fingerprint, MeshSource

ROWS = 1 << 20  # vertices or faces that are held at a time
LARGEST_BLOCK_BITS = 10  # of the number of vertices in a block: sampled neighbourhoods and halos read whole blocks
FORMAT = 3
LAYOUT = "layout"  # of the manifest, which has a checksum among those of the files
MANIFEST = "store.json"  # which is there only if all the others are
FILES = VERTICES, ORDER, RANK, FACES, FACE_PTR = "vertices.bin", "order.bin", "rank.bin", "faces.bin", "face_ptr.npy"


@dataclass(frozen=True)
class Layout:
    """The numbers that say how a store is laid out."""

    vertex_count: int
    face_count: int
    dtype: str  # of the coordinates
    block_bits: int  # blocks have 2^block_bits vertices,
    tile_vertices: int  # and tiles a multiple of that
    low: Sequence[float]  # this and the next two are those of the `Grid`
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
        """The grid whose cells the vertices are sorted by."""
        return Grid(np.array(self.low), self.scale, self.bits)

    def in_whole_blocks(self, tile_vertices: int) -> int:
        """Vertices of a tile, rounded up to whole blocks."""
        return -(-tile_vertices >> self.block_bits) << self.block_bits

    def tile(self, number: int) -> tuple[int, int]:
        """First vertex of a tile, and the one after the last."""
        start = number * self.tile_vertices
        return start, min(start + self.tile_vertices, self.vertex_count)


@dataclass(frozen=True)
class Store:
    """A mesh that was made ready for tiles."""

    folder: Path  # all workers must see it there
    layout: Layout
    vertices: ArrayFile  # coordinates in spatial order, (n, 3)

    @property
    def order(self) -> ArrayFile:
        """Which vertex of the source each one is, (n,) int32."""
        return ArrayFile(self.folder / ORDER, np.dtype(np.int32), self.layout.vertex_count)

    @property
    def rank(self) -> ArrayFile:
        """Where each vertex of the source is, (n,) int32."""
        return ArrayFile(self.folder / RANK, np.dtype(np.int32), self.layout.vertex_count)

    def face_ptr(self) -> NDArray[np.int64]:
        """Where the faces of every block begin and end, (blocks + 1,)."""
        return load_array(self.folder / FACE_PTR)

    def faces_of(self, blocks: IntArray, ptr: NDArray[np.int64]) -> list[IntArray]:
        """Number in the source and corners of the faces of some blocks, ascending, (k, 4) for each run of them."""
        rows = ArrayFile(self.folder / FACES, np.dtype(("i4", 4)), int(ptr[-1]))
        runs = np.split(blocks, np.flatnonzero(np.diff(blocks) > 1) + 1)
        return [rows.read(int(ptr[run[0]]), int(ptr[run[-1] + 1])) for run in runs if len(run)]

    def coordinates(self, start: int, stop: int) -> FloatArray:
        """Coordinates of vertices start .. stop-1, (k, 3)."""
        return self.vertices.read(start, stop).astype(np.float64, copy=False)

    def coordinates_of(self, ids: IntArray) -> FloatArray:
        """Coordinates of some vertices, (k, 3)."""
        return self.vertices.mapped()[ids].astype(np.float64)

    def sources(self, ids: IntArray) -> IntArray:
        """Which vertices of the source some are."""
        return np.array(self.order.mapped()[ids], dtype=np.int32)


def open_store(folder: Path, fingerprint: Fingerprint) -> Store:
    """Open a store; FieldFileError if it is damaged, or made from another source than this one."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        version, found = manifest["format"], manifest["source"]
        if version != FORMAT:
            expected = f"(format {version}, expected {FORMAT})"
            raise FieldFileError(f"{folder} was made by another version {expected}; remove it")
        checksums, layout = dict[str, str](manifest["checksums"]), Layout(**manifest["layout"])
    except (ValueError, TypeError, KeyError) as error:
        raise FieldFileError(f"{folder / MANIFEST} is damaged: {error}; remove the folder") from error
    if found != fingerprint:
        raise FieldFileError(
            f"{folder} was made from another file, or the file has changed since: {found}, now {fingerprint}; "
            "remove it to start anew"
        )
    for name in FILES:
        if not (folder / name).is_file() or file_checksum(folder / name) != checksums.get(name):
            raise FieldFileError(f"{folder / name} is damaged or missing; remove the folder")
    if _checksum(layout) != checksums.get(LAYOUT):
        raise FieldFileError(f"{folder / MANIFEST} is damaged; remove the folder")
    return Store(folder, layout, ArrayFile(folder / VERTICES, np.dtype((layout.dtype, 3)), layout.vertex_count))


def build_store(source: MeshSource, folder: Path, tile_vertices: int, *, progress: Progress | None = None) -> Store:
    """Make a mesh ready for tiles, in an empty folder; refused if a coordinate is not finite, or a face no triangle."""
    n, m = source.vertex_count, source.face_count
    passes = _Passes(3 * n + 2 * m, progress)
    bits = min(LARGEST_BLOCK_BITS, int(math.log2(tile_vertices)))
    grid = _grid(source, passes)
    layout = Layout(n, m, source.dtype.str, bits, 0, grid.low.tolist(), grid.scale, grid.bits)
    layout = replace(layout, tile_vertices=layout.in_whole_blocks(tile_vertices))
    store = Store(folder, layout, ArrayFile(folder / VERTICES, np.dtype((source.dtype, 3)), n).allocated())
    _sort_vertices(source, store, passes)
    _sort_faces(source, store, passes)
    checksums = {name: file_checksum(folder / name) for name in FILES}
    checksums[LAYOUT] = _checksum(layout)
    manifest = {"format": FORMAT, "source": source.fingerprint(), "checksums": checksums, "layout": vars(layout)}
    with atomic_write(folder / MANIFEST) as temporary:  # which declares it to be complete
        temporary.write_text(json.dumps(manifest, indent=1), encoding="utf-8")
    return store


def _checksum(layout: Layout) -> str:
    return hashlib.blake2b(json.dumps(vars(layout), sort_keys=True).encode(), digest_size=16).hexdigest()


@dataclass
class _Passes:
    """Passes over the rows of a mesh, and the progress of all together."""

    total: int
    progress: Progress | None
    done: int = 0

    def chunks(self, rows: int) -> Iterator[tuple[int, int]]:
        """First row, and the one after the last, of some at a time."""
        for start in range(0, rows, ROWS):
            stop = min(start + ROWS, rows)
            yield start, stop
            self.done += stop - start
            report(self.progress, self.done, self.total)


def _grid(source: MeshSource, passes: _Passes) -> Grid:
    """The grid around all vertices, which are checked."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for start, stop in passes.chunks(source.vertex_count):
        vertices = source.vertices(start, stop).astype(np.float64)
        widen_bounds(vertices, low, high)
        if not np.isfinite(vertices).all():
            bad = start + int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
            raise InvalidMeshError(
                f"{source.paths[0]}: vertex {bad} has a coordinate that is NaN or infinite; remove such vertices first"
            )
    triangle_mesh([low, high], [])  # sizes that cannot be computed with
    if size_exponent([low, high]):
        limit = 2.0**MAX_UNSCALED_EXPONENT
        raise InvalidMeshError(
            f"{source.paths[0]}: the largest coordinate is {max(abs(low).max(), abs(high).max()):.3g}; in tiles it "
            f"must be between {1.0 / limit:.2g} and {limit:.2g}: scale the mesh, or compute it in memory"
        )
    return grid_around(low, high, source.vertex_count)


def _sort_vertices(source: MeshSource, store: Store, passes: _Passes) -> None:
    """Write coordinates and numbers of the vertices in their new order, and their new places."""
    n, grid = source.vertex_count, store.layout.grid
    ends = np.zeros(grid.cell_count + 1, dtype=np.int32)
    for start, stop in passes.chunks(n):
        cells = grid.cells(source.vertices(start, stop).astype(np.float64))
        np.add.at(ends[1:], cells, np.int32(1))  # far faster than with a number of another type
    np.cumsum(ends, out=ends)
    order = store.order.allocated()
    with open(store.rank.path, "wb") as stream:
        for start, stop in passes.chunks(n):
            vertices, places = source.vertices(start, stop), np.empty(stop - start, dtype=np.int32)
            cells = grid.cells(vertices.astype(np.float64))
            _place(cells, ends, start, places, order.mapped("r+"))
            store.vertices.mapped("r+")[places] = vertices
            places.tofile(stream)


def _sort_faces(source: MeshSource, store: Store, passes: _Passes) -> None:
    """Write every face to each block that it touches."""
    m, bits = source.face_count, store.layout.block_bits
    ptr = np.zeros(store.layout.block_count + 1, dtype=np.int64)

    def ranked(start: int, stop: int) -> IntArray:
        return np.take(store.rank.mapped(), source.faces(start, stop))

    for start, stop in passes.chunks(m):
        _append_faces(ranked(start, stop), start, bits, ptr[1:], np.empty((0, 4), dtype=np.int32))
    np.cumsum(ptr, out=ptr)
    np.save(store.folder / FACE_PTR, ptr)
    rows = ArrayFile(store.folder / FACES, np.dtype(("i4", 4)), int(ptr[-1])).allocated()
    for start, stop in passes.chunks(m):
        _append_faces(ranked(start, stop), start, bits, ptr, rows.mapped("r+"))


@jit()
def _place(cells: IntArray, ends: IntArray, first: int, places: IntArray, order: IntArray) -> None:
    """Append each vertex to those of its cell."""
    for i in range(cells.shape[0]):
        place = ends[cells[i]]
        ends[cells[i]] += 1
        places[i] = place
        order[place] = first + i


@jit()
def _append_faces(faces: IntArray, first: int, bits: int, ends: NDArray[np.int64], rows: IntArray) -> None:
    """Append each face to those of its blocks, or only count it, if there are no rows to write to."""
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
