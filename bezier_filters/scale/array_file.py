"""Tables in files that are read and written in ranges of rows.

Memory maps would be simpler, but the pages that they touch count as memory of the process, and
workers are terminated when they exceed their limit.
"""

import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import IntArray
from bezier_filters.errors import FieldFileError
from bezier_filters.scale.remote import Location, write_file

Values: TypeAlias = NDArray[Any]  # rows of a table: (k,) for one column, else (k, columns)
DType: TypeAlias = np.dtype[Any]
_one_at_a_time = Lock()
MAX_GAP_BYTES = 1 << 16  # between rows of a remote file that are read together; a request takes as long as some more


@dataclass(frozen=True)
class ArrayFile:
    """A table in a file."""

    path: Location
    dtype: DType  # of a row; with a shape for several numbers of one type
    rows: int
    offset: int = 0  # bytes before the first row

    def read(self, start: int, stop: int) -> Values:
        """Rows start .. stop-1; FieldFileError if the file is shorter."""
        return self.read_runs([(start, stop)])[0]

    def read_runs(self, runs: Sequence[tuple[int, int]]) -> list[Values]:
        """Rows start .. stop-1 of each run; FieldFileError if the file is shorter."""
        size, found = self.dtype.itemsize, list[Values]()
        if isinstance(self.path, Path):
            found = [np.fromfile(self.path, self.dtype, b - a, offset=self.offset + a * size) for a, b in runs]
        elif runs:
            parts = self.path.read_ranges([(self.offset + a * size, self.offset + b * size) for a, b in runs])
            found = [np.frombuffer(bytearray(part[: len(part) // size * size]), self.dtype) for part in parts]
        for (start, stop), rows in zip(runs, found, strict=True):
            if len(rows) < stop - start:
                raise FieldFileError(f"{self.path} is cut short: row {stop - 1} is missing")
        return found

    def take(self, ids: IntArray) -> Values:
        """Copy of some rows, in any order."""
        if isinstance(self.path, Path):
            return np.array(self.memory_map()[ids])
        rows = np.unique(ids)
        if not len(rows):
            return np.empty(0, self.dtype)
        ends = np.flatnonzero(np.diff(rows) * self.dtype.itemsize > MAX_GAP_BYTES)
        starts, stops = rows[np.append(0, ends + 1)], rows[np.append(ends, -1)] + 1
        found = np.concatenate(self.read_runs(list(zip(starts.tolist(), stops.tolist(), strict=True))))
        runs = np.searchsorted(starts, ids, side="right") - 1
        before = np.cumsum(stops - starts) - (stops - starts)  # rows of the runs before each
        return np.asarray(found[before[runs] + ids - starts[runs]])

    def memory_map(self, mode: Literal["r", "r+"] = "r") -> Values:
        """The whole table of a local file as a memory map, which should be released soon."""
        return np.memmap(self._local_path, self.dtype, mode, self.offset, (self.rows,))

    @property
    def _local_path(self) -> Path:
        if not isinstance(self.path, Path):
            raise TypeError(f"{self.path} is not local")
        return self.path

    def allocate(self) -> "ArrayFile":
        """Create the file as a sparse file of zeros; returns the table."""
        with open(self._local_path, "wb") as stream:
            os.truncate(stream.fileno(), self.rows * self.dtype.itemsize)
        return self


def load_array(path: Location, mode: Literal["r"] | None = None) -> Values:
    """Load an array written by `np.save`, or a memory map of it if the file is local.

    The header is parsed as Python, one at a time: CPython 3.11 sometimes fails to parse in two threads.
    """
    source = path if isinstance(path, Path) else io.BytesIO(path.read_bytes())
    with _one_at_a_time:
        found: Values = np.load(source, mmap_mode=mode if source is path else None)
    return found


def array_layout(path: Location) -> tuple[DType, tuple[int, ...], bool, int]:
    """Type, shape, whether in Fortran order, and offset of the array in an NPY file; ValueError if it is none."""
    with path.open("rb") as stream, _one_at_a_time:
        version = np.lib.format.read_magic(stream)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read_header(stream)
        return dtype, shape, fortran, stream.tell()


def save_array(path: Location, values: Values) -> ArrayFile:
    """Write a table (k, columns) or (k,) to a file."""
    with write_file(path) as temporary:
        values.tofile(temporary)
    return ArrayFile(path, np.dtype((values.dtype, values.shape[1:])), len(values))
