"""Tables in files that are read and written in ranges of rows.

Memory maps would be simpler, but the pages that they touch count as memory of the process, and
workers are terminated when they exceed their limit.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bezier_filters.errors import FieldFileError

Values: TypeAlias = NDArray[Any]  # rows of a table: (k,) for one column, else (k, columns)
DType: TypeAlias = np.dtype[Any]
_one_at_a_time = Lock()


@dataclass(frozen=True)
class ArrayFile:
    """A table in a file."""

    path: Path
    dtype: DType  # of a row; with a shape for several numbers of one type
    rows: int
    offset: int = 0  # bytes before the first row

    def read(self, start: int, stop: int) -> Values:
        """Rows start .. stop-1; FieldFileError if the file is shorter."""
        offset = self.offset + start * self.dtype.itemsize
        found: Values = np.fromfile(self.path, self.dtype, stop - start, offset=offset)
        if len(found) < stop - start:
            raise FieldFileError(f"{self.path} is cut short: row {stop - 1} is missing")
        return found

    def memory_map(self, mode: Literal["r", "r+"] = "r") -> Values:
        """The whole table as a memory map, which should be released soon."""
        return np.memmap(self.path, self.dtype, mode, self.offset, (self.rows,))

    def allocate(self) -> "ArrayFile":
        """Create the file as a sparse file of zeros; returns the table."""
        with open(self.path, "wb") as stream:
            os.truncate(stream.fileno(), self.rows * self.dtype.itemsize)
        return self


def load_array(path: Path, mode: Literal["r"] | None = None) -> Values:
    """Load an array written by `np.save`, or a memory map of it.

    The header is parsed as Python, one at a time: CPython 3.11 sometimes fails to parse in two threads.
    """
    with _one_at_a_time:
        found: Values = np.load(path, mmap_mode=mode)
    return found


def save_array(path: Path, values: Values) -> ArrayFile:
    """Write a table (k, columns) or (k,) to a file."""
    values.tofile(path)
    return ArrayFile(path, np.dtype((values.dtype, values.shape[1:])), len(values))
