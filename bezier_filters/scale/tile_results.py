"""Files with the results of single tiles, that are known to be whole."""

import json
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.errors import FieldFileError
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.scale.array_file import ArrayFile

MAGIC = b"BZTILE1\n"
_PIECE = 1 << 22


class DamagedTileError(FieldFileError):
    """A file with the results of a tile is not what was written; the message names both."""


@dataclass(frozen=True)
class TileResult:
    """What is known of a tile without reading its rows.

    Attributes
    ----------
    rows : ArrayFile
        A row for each of its vertices.
    report : dict
        What the task had to say.
    """

    rows: ArrayFile
    report: dict[str, Any]


def tile_path(folder: Path, tile: int) -> Path:
    """Where the results of a tile are."""
    return folder / f"tile-{tile:06d}.bin"


def write_tile(folder: Path, tile: int, rows: NDArray[Any], report: dict[str, Any], *, lasting: bool = True) -> None:
    """Write the results of a tile: whole or not at all.

    What is not to be lasting may be damaged after a power cut, which its checksum will tell.
    """
    data = np.ascontiguousarray(rows).reshape(-1).view(np.uint8).data
    header = {"dtype": rows.dtype.descr, "columns": 1 if rows.ndim == 1 else rows.shape[1], "rows": len(rows)}
    text = json.dumps(header | {"checksum": zlib.crc32(data), "report": report}).encode()
    with atomic_write(tile_path(folder, tile), lasting=lasting) as temporary, open(temporary, "wb") as stream:
        stream.write(MAGIC + len(text).to_bytes(4, "little") + zlib.crc32(text).to_bytes(4, "little") + text)
        stream.write(data)


def open_tile(folder: Path, tile: int) -> TileResult:
    """Look at the results of a tile, and check that they are what was written.

    Raises
    ------
    DamagedTileError
        If they are not.
    """
    return _opened(folder, tile, checked=True)


def look_at_tile(folder: Path, tile: int) -> TileResult:
    """The same without reading the rows, of a tile that was checked before."""
    return _opened(folder, tile, checked=False)


def _opened(folder: Path, tile: int, *, checked: bool) -> TileResult:
    path = tile_path(folder, tile)
    with open(path, "rb") as stream:
        head = stream.read(len(MAGIC) + 8)
        length = int.from_bytes(head[len(MAGIC) : len(MAGIC) + 4], "little")
        text = stream.read(length)
        if head[: len(MAGIC)] != MAGIC or zlib.crc32(text) != int.from_bytes(head[-4:], "little"):
            raise DamagedTileError(_damage(path, tile))
        header = json.loads(text)
        checksum, offset = 0, stream.tell()
        while checked and (piece := stream.read(_PIECE)):
            checksum = zlib.crc32(piece, checksum)
    if checked and checksum != header["checksum"]:
        raise DamagedTileError(_damage(path, tile))
    descr = [tuple(field) for field in header["dtype"]]
    dtype = np.dtype([_with_shape(*field) for field in descr]) if descr[0][0] else np.dtype(descr[0][1])
    return TileResult(ArrayFile(path, dtype, header["columns"], header["rows"], offset), header["report"])


def _with_shape(name: str, dtype: str, shape: list[int] | None = None) -> tuple[Any, ...]:
    return (name, dtype) if shape is None else (name, dtype, tuple(shape))


def _damage(path: Path, tile: int) -> str:
    return f"tile {tile} is damaged: {path} is not what was written; resume to compute it again"
