"""Tables in files, of which some rows at a time are read or written.

Memory maps would be shorter, but the pages that they touch count as memory of the process, and
workers are ended when they use more than they were given.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from bezier_filters.errors import FieldFileError

Values: TypeAlias = NDArray[Any]  # rows of a table: (k,) if there is one column, else (k, columns)
DType: TypeAlias = np.dtype[Any]
_one_at_a_time = Lock()


@dataclass(frozen=True)
class ArrayFile:
    """A table in a file."""

    path: Path
    dtype: DType  # of an entry, or of a whole row
    columns: int  # entries per row
    rows: int
    offset: int = 0  # bytes before the first row

    @property
    def row_size(self) -> int:
        """Bytes of a row."""
        return self.dtype.itemsize * self.columns

    def read(self, start: int, stop: int) -> Values:
        """Rows start .. stop-1; FieldFileError if the file ends before."""
        count = (stop - start) * self.columns
        found = np.fromfile(self.path, self.dtype, count, offset=self.offset + start * self.row_size)
        if len(found) < count:
            raise FieldFileError(f"{self.path} is cut short: row {stop - 1} is not there")
        return found if self.columns == 1 else found.reshape(-1, self.columns)

    def mapped(self, mode: Literal["r", "r+"] = "r") -> Values:
        """The whole table as a memory map, to be dropped soon."""
        shape = (self.rows,) if self.columns == 1 else (self.rows, self.columns)
        return np.memmap(self.path, self.dtype, mode, self.offset, shape)


def load_array(path: Path, mode: Literal["r"] | None = None) -> Values:
    """What `np.save` wrote, or a memory map of it.

    Its header is Python, and CPython 3.11 now and then fails to parse two texts at once.
    """
    with _one_at_a_time:
        found: Values = np.load(path, mmap_mode=mode)
    return found


def saved_array(path: Path, values: Values) -> ArrayFile:
    """Write a table (k, columns) or (k,) to a file."""
    values.tofile(path)
    return ArrayFile(path, values.dtype, 1 if values.ndim == 1 else values.shape[1], len(values))


def new_array_file(path: Path, dtype: DTypeLike, columns: int, rows: int) -> ArrayFile:
    """A file for a table, filled with zeros that take no room on the disk yet."""
    table = ArrayFile(path, np.dtype(dtype), columns, rows)
    with open(path, "wb") as stream:
        os.truncate(stream.fileno(), rows * table.row_size)
    return table
