"""A mesh in spatial order in a folder, cut into blocks that can be read one by one.

Blocks are runs of vertices in spatial order; every face is kept with each block that has one of its corners, so
that the faces at a vertex are all in one place. Tiles are runs of blocks.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import FieldFileError
from bezier_filters.meshes.spatial_order import Grid
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.scale.array_file import ArrayFile, load_array
from bezier_filters.scale.source import Fingerprint

FORMAT = 1
MANIFEST = "store.json"
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

    def faces(self, start: int, stop: int) -> IntArray:
        """Number in the source and corners of the faces in some rows, (k, 4)."""
        return ArrayFile(self.folder / FACES, np.dtype(np.int32), 4, stop).read(start, stop)

    def coordinates(self, start: int, stop: int) -> FloatArray:
        """Coordinates of vertices start .. stop-1, (k, 3)."""
        return self.vertices.read(start, stop).astype(np.float64, copy=False)

    def coordinates_of(self, ids: IntArray) -> FloatArray:
        """Coordinates of some vertices, (k, 3)."""
        return self.vertices.mapped()[ids].astype(np.float64)

    def sources(self, ids: IntArray) -> IntArray:
        """Which vertices of the source some are."""
        return np.array(self.order.mapped()[ids], dtype=np.int32)

    def with_vertices(self, path: Path) -> "Store":
        """The same mesh with other coordinates, float64, in spatial order of the old ones."""
        vertices = ArrayFile(path, np.dtype(np.float64), 3, self.layout.vertex_count)
        return replace(self, vertices=vertices)


def write_manifest(folder: Path, layout: Layout, fingerprint: Fingerprint) -> None:
    """Declare a store to be complete."""
    with atomic_write(folder / MANIFEST) as temporary:
        text = json.dumps({"format": FORMAT, "source": fingerprint, **layout.__dict__}, indent=1)
        temporary.write_text(text, encoding="utf-8")


def is_store(folder: Path) -> bool:
    """Whether there is a store that is complete."""
    return (folder / MANIFEST).is_file()


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
