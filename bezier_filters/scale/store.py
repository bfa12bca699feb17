"""A mesh in spatial order in a folder, cut into blocks that can be read one by one.

Blocks are runs of vertices in spatial order; every face is kept with each block that has one of its corners, so
that the faces at a vertex are all in one place. Tiles are runs of blocks. A mesh is sorted without ever being held in
memory. The order is that of `spatial_order`, which meshes in memory are sorted by, too: each tile then sees its
vertices and faces in the same order as there, and its sums are the same to the last digit.
"""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import FieldFileError, InvalidMeshError
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.spatial_order import Grid, grid_around, widen_bounds
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import Progress, report
from bezier_filters.scale.array_file import ArrayFile, load_array, new_array_file
from bezier_filters.scale.source import Fingerprint, MeshSource

ROWS = 1 << 20  # vertices or faces that are held at a time
LARGEST_BLOCK_BITS = 10  # of the number of vertices in a block: sampled neighbourhoods and halos read whole blocks
FORMAT = 1
MANIFEST = "store.json"  # which is there only if all the others are
VERTICES, ORDER, RANK, FACES, FACE_PTR = "vertices.bin", "order.bin", "rank.bin", "faces.bin", "face_ptr.npy"


@dataclass(frozen=True)
class Layout:
    """The numbers that say how a store is laid out."""

    vertex_count: int
    face_count: int
    dtype: str  # of the coordinates
    block_bits: int  # blocks have 2^block_bits vertices,
    tile_vertices: int  # and tiles a multiple of that
    low: tuple[float, float, float]  # this and the next two are those of the `Grid`
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
        return ArrayFile(self.folder / ORDER, np.dtype(np.int32), 1, self.layout.vertex_count)

    @property
    def rank(self) -> ArrayFile:
        """Where each vertex of the source is, (n,) int32."""
        return ArrayFile(self.folder / RANK, np.dtype(np.int32), 1, self.layout.vertex_count)

    def face_ptr(self) -> NDArray[np.int64]:
        """Where the faces of every block begin and end, (blocks + 1,)."""
        return load_array(self.folder / FACE_PTR)

    def faces_of(self, blocks: IntArray, ptr: NDArray[np.int64]) -> list[IntArray]:
        """Number in the source and corners of the faces of some blocks, ascending, (k, 4) for each run of them."""
        rows = ArrayFile(self.folder / FACES, np.dtype(np.int32), 4, int(ptr[-1]))
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


def open_store(folder: Path, fingerprint: Fingerprint | None = None) -> Store:
    """Open a store; FieldFileError if there is none, or it is damaged, or made from another source than this one."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        version, found = manifest.pop("format"), manifest.pop("source")
        layout = Layout(**manifest | {"low": tuple(manifest["low"])})
    except FileNotFoundError:
        raise FieldFileError(f"{folder} holds no complete store") from None
    except (ValueError, TypeError, KeyError) as error:
        raise FieldFileError(f"{folder / MANIFEST} is damaged: {error}; remove the folder") from error
    if version != FORMAT:
        raise FieldFileError(f"{folder} was made by another version (format {version}, expected {FORMAT}); remove it")
    if fingerprint is not None and found != fingerprint:
        raise FieldFileError(
            f"{folder} was made from another file, or the file has changed since: {found}, now {fingerprint}; "
            "remove it to start anew"
        )
    n = layout.vertex_count
    store = Store(folder, layout, ArrayFile(folder / VERTICES, np.dtype(layout.dtype), 3, n))
    sizes = {VERTICES: n * store.vertices.row_size, ORDER: 4 * n, RANK: 4 * n, FACES: 16 * _face_rows(store)}
    for name, size in sizes.items():
        if not (folder / name).is_file() or (folder / name).stat().st_size != size:
            raise _damaged(folder / name)
    return store


def _face_rows(store: Store) -> int:
    """How many rows the file of the faces should have."""
    try:
        ptr = store.face_ptr()
    except (OSError, ValueError, EOFError) as error:
        raise _damaged(store.folder / FACE_PTR) from error
    if ptr.shape != (store.layout.block_count + 1,):
        raise _damaged(store.folder / FACE_PTR)
    return int(ptr[-1])


def _damaged(path: Path) -> FieldFileError:
    return FieldFileError(f"{path} is damaged or missing; remove the folder")


def build_store(
    source: MeshSource, folder: Path, tile_vertices: int, *, threads: int = 1, progress: Progress | None = None
) -> Store:
    """Make a mesh ready for tiles, in an empty folder; refused if a coordinate is not finite, or a face no triangle."""
    n, m = source.vertex_count, source.face_count
    passes = _Passes(2 * n + m, progress)
    bits = min(LARGEST_BLOCK_BITS, int(math.log2(tile_vertices)))
    grid = _grid(source, passes)
    x, y, z = grid.low.tolist()
    layout = Layout(n, m, source.dtype.str, bits, 0, (x, y, z), grid.scale, grid.bits)
    layout = replace(layout, tile_vertices=layout.in_whole_blocks(tile_vertices))
    store = Store(folder, layout, new_array_file(folder / VERTICES, source.dtype, 3, n))
    _sort_vertices(source, store, threads, passes)
    _sort_faces(source, store, passes)
    with atomic_write(folder / MANIFEST) as temporary:  # which declares it to be complete
        text = json.dumps({"format": FORMAT, "source": source.fingerprint(), **vars(layout)}, indent=1)
        temporary.write_text(text, encoding="utf-8")
    return open_store(folder)


class _Passes:
    """Rows done over several passes."""

    def __init__(self, total: int, progress: Progress | None) -> None:
        self.done, self.total, self.progress = 0, total, progress

    def add(self, rows: int) -> None:
        self.done += rows
        report(self.progress, self.done, self.total)


def _chunks(total: int) -> list[tuple[int, int]]:
    return [(start, min(start + ROWS, total)) for start in range(0, total, ROWS)]


def _grid(source: MeshSource, passes: _Passes) -> Grid:
    """The grid around all vertices, which are checked."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for start, stop in _chunks(source.vertex_count):
        vertices = source.vertices(start, stop).astype(np.float64)
        widen_bounds(vertices, low, high)
        if not np.isfinite(vertices).all():
            bad = start + int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
            raise InvalidMeshError(
                f"{source.paths[0]}: vertex {bad} has a coordinate that is NaN or infinite; remove such vertices first"
            )
        passes.add(stop - start)
    triangle_mesh([low, high], [])  # sizes that cannot be computed with
    return grid_around(low, high, source.vertex_count)


def _sort_vertices(source: MeshSource, store: Store, threads: int, passes: _Passes) -> None:
    """Write coordinates and numbers of the vertices in their new order, and their new places."""
    n, grid = source.vertex_count, store.layout.grid
    ends = np.zeros(grid.cell_count + 1, dtype=np.int32)
    for start, stop in _chunks(n):
        cells = grid.cells(source.vertices(start, stop).astype(np.float64), threads=threads)
        np.add.at(ends[1:], cells, np.int32(1))  # far faster than with a number of another type
    np.cumsum(ends, out=ends)
    order = new_array_file(store.order.path, np.int32, 1, n)
    with open(store.rank.path, "wb") as stream:
        for start, stop in _chunks(n):
            vertices, places = source.vertices(start, stop), np.empty(stop - start, dtype=np.int32)
            cells = grid.cells(vertices.astype(np.float64), threads=threads)
            _place(cells, ends, start, places, order.mapped("r+"))
            store.vertices.mapped("r+")[places] = vertices
            places.tofile(stream)
            passes.add(stop - start)


def _sort_faces(source: MeshSource, store: Store, passes: _Passes) -> None:
    """Write every face to each block that it touches."""
    m, bits = source.face_count, store.layout.block_bits
    ptr = np.zeros(store.layout.block_count + 1, dtype=np.int64)

    def ranked(start: int, stop: int) -> IntArray:
        return np.take(store.rank.mapped(), source.faces(start, stop))

    for start, stop in _chunks(m):
        _count_faces(ranked(start, stop), bits, ptr)
        passes.add(stop - start)
    np.cumsum(ptr, out=ptr)
    np.save(store.folder / FACE_PTR, ptr)
    rows = new_array_file(store.folder / FACES, np.int32, 4, int(ptr[-1]))
    for start, stop in _chunks(m):
        _fill_in_faces(ranked(start, stop), start, bits, ptr, rows.mapped("r+"))


@jit()
def _place(cells: IntArray, ends: IntArray, first: int, places: IntArray, order: IntArray) -> None:
    """Append each vertex to those of its cell."""
    for i in range(cells.shape[0]):
        place = ends[cells[i]]
        ends[cells[i]] += 1
        places[i] = place
        order[place] = first + i


@jit()
def _count_faces(faces: IntArray, bits: int, ptr: NDArray[np.int64]) -> None:
    """Count the faces of each block, one place later."""
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0] >> bits, faces[f, 1] >> bits, faces[f, 2] >> bits
        ptr[a + 1] += 1
        if b != a:
            ptr[b + 1] += 1
        if c not in (a, b):
            ptr[c + 1] += 1


@jit()
def _fill_in_faces(faces: IntArray, first: int, bits: int, ptr: NDArray[np.int64], rows: IntArray) -> None:
    """Append each face to those of its blocks."""
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0] >> bits, faces[f, 1] >> bits, faces[f, 2] >> bits
        for k, block in enumerate((a, b, c)):
            if (k == 1 and b == a) or (k == 2 and c in (a, b)):
                continue
            row = ptr[block]
            ptr[block] += 1
            rows[row, 0] = first + f
            rows[row, 1], rows[row, 2], rows[row, 3] = faces[f, 0], faces[f, 1], faces[f, 2]
