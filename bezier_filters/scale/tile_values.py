"""Values at vertices and on clusters in the files of the tiles, read some rows at a time."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import IntArray
from bezier_filters.scale.array_file import ArrayFile
from bezier_filters.scale.tile_results import look_at_tile

GAP = 1 << 10
"""Rows between two that are wanted, up to which they are read, too."""


class RowFile(Protocol):
    """Rows of all vertices, in the order of the store."""

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Rows start .. stop-1."""


@dataclass(frozen=True)
class TileValues:
    """What a stage has left at the vertices.

    Attributes
    ----------
    folder : Path
        With a file for each tile.
    tile_vertices : int
        Vertices of a tile.
    """

    folder: Path
    tile_vertices: int

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Rows start .. stop-1."""
        rows = []
        for tile in range(start // self.tile_vertices, max(stop - 1, start) // self.tile_vertices + 1):
            first = tile * self.tile_vertices
            table = look_at_tile(self.folder, tile).rows
            rows.append(table.read(max(start - first, 0), min(stop - first, table.rows)))
        return rows[0] if len(rows) == 1 else np.concatenate(rows)


@dataclass(frozen=True)
class FileValues:
    """Values of one name in a file.

    Attributes
    ----------
    table : ArrayFile
    name : str
        Of the values; empty if the rows of the file have names.
    keep_columns : bool
        Whether one column is (n, 1) and not (n,).
    """

    table: ArrayFile
    name: str
    keep_columns: bool = False

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Rows start .. stop-1, as a table with a column of that name."""
        rows = self.table.read(start, stop)
        if not self.name:
            return rows
        shape = (self.table.columns,) if self.table.columns > 1 or self.keep_columns else ()
        return rows.view([(self.name, rows.dtype, shape)]).reshape(-1)


@dataclass(frozen=True)
class ClusterValues:
    """What a stage has left on the clusters: a row for each that has its center in a tile, in ascending order.

    Attributes
    ----------
    folder : Path
        With a file for each tile.
    centers : Path
        Folder of the centers of the clusters of each tile.
    tile_vertices : int
        Vertices of a tile.
    """

    folder: Path
    centers: Path
    tile_vertices: int

    def rows_of(self, centers: IntArray) -> NDArray[Any]:
        """Rows of the clusters with some centers, ascending."""
        found = [look_at_tile(self.folder, 0).rows.read(0, 0)]  # of the right type, if there are none
        of_tile = centers // np.int32(self.tile_vertices)
        for tile in np.unique(of_tile).tolist():
            there = np.load(self.centers / f"centers-{tile:06d}.npy")
            table = look_at_tile(self.folder, tile).rows
            found.append(table.read(0, table.rows)[np.searchsorted(there, centers[of_tile == tile])])
        return np.concatenate(found)


def rows_at(values: RowFile, ids: IntArray) -> NDArray[Any]:
    """Rows of some vertices in ascending order."""
    stretches = Stretches.with_all(ids)
    return stretches.read(values)[stretches.rows]


@dataclass(frozen=True)
class Stretches:
    """Stretches of rows, without large gaps, that hold all rows of some vertices.

    Attributes
    ----------
    ends : tuple of (int, int)
        Their first rows and those after the last ones.
    rows : (k,) int32
        Where the vertices are, the stretches being put together.
    """

    ends: tuple[tuple[int, int], ...]
    rows: IntArray

    @staticmethod
    def with_all(ids: IntArray) -> "Stretches":
        """Those of some vertices in ascending order."""
        if not len(ids):
            return Stretches(((0, 0),), ids)
        breaks = np.flatnonzero(np.diff(ids) > GAP) + 1
        first, last = ids[np.append(0, breaks)], ids[np.append(breaks, len(ids)) - 1]
        ends = tuple((int(a), int(b) + 1) for a, b in zip(first, last, strict=True))
        lengths = last - first + 1
        shifts = first - (np.cumsum(lengths) - lengths)
        counts = np.diff(np.concatenate([[0], breaks, [len(ids)]]))
        return Stretches(ends, (ids - np.repeat(shifts, counts)).astype(np.int32))

    def read(self, values: RowFile) -> NDArray[Any]:
        """All rows of the stretches."""
        rows = [values.read(start, stop) for start, stop in self.ends]
        return rows[0] if len(rows) == 1 else np.concatenate(rows)

    def ordered(self, places: IntArray) -> "Stretches":
        """The same for the vertices in another order."""
        return Stretches(self.ends, self.rows[places])


def columns_of(rows: NDArray[Any], order: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Columns of a table in another order, each of them in one piece."""
    return {name: np.ascontiguousarray(rows[name][order]) for name in rows.dtype.names or ()}


def table_of_columns(columns: dict[str, NDArray[Any]], rows: IntArray) -> NDArray[Any]:
    """Some rows of columns as a table."""
    dtype = [(name, values.dtype.str, values.shape[1:]) for name, values in columns.items()]
    table = np.empty(len(rows), dtype=dtype)
    for name, values in columns.items():
        table[name] = values[rows]
    return table
