"""Results of single tiles: rows in an NPY file, and a JSON file with a checksum, which says that they are whole."""

import json
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from bezier_filters.errors import FieldFileError
from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.scale.array_file import Values, load_array

ROWS = 1 << 16  # that checksums are computed of at a time


class DamagedTileError(FieldFileError):
    """A file with the results of a tile is not what was written; the message names both."""


@dataclass(frozen=True)
class TileReport:
    """What a task has to say of its tile.

    How many vertices it read, numbers that are added up over all tiles, what it took, and the most memory that its
    process has had so far.
    """

    tile: int
    read: int
    sums: dict[str, list[float]]
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_bytes: int = 0
    process: int = 0


@dataclass(frozen=True)
class Tile:
    """The results of a tile: a file of rows, and the report."""

    path: Path
    report: TileReport

    def rows(self) -> Values:
        """The rows as a memory map, to be dropped soon."""
        return load_array(self.path, "r")


def tile_path(folder: Path, tile: int) -> Path:
    """Where the rows of a tile are; the report is next to them."""
    return folder / f"tile-{tile:06d}.npy"


def report_path(folder: Path, tile: int) -> Path:
    """Where the report of a tile is, which is there only if the rows are."""
    return tile_path(folder, tile).with_suffix(".json")


def write_tile(folder: Path, report: TileReport, rows: Values) -> None:
    """Write the results of a tile, whole or not at all: the report comes last."""
    content: dict[str, object] = {"report": asdict(report), "rows": str(rows.dtype.descr)}
    text = json.dumps(content | {"checksum": _checksum(content, rows)})
    with atomic_write(tile_path(folder, report.tile)) as temporary:
        np.save(temporary, rows)
    with atomic_write(report_path(folder, report.tile)) as temporary:
        temporary.write_text(text, encoding="utf-8")


def open_tile(folder: Path, tile: int) -> Tile:
    """Results of a tile; FileNotFoundError if there are none, `DamagedTileError` if they are not what was written."""
    path = tile_path(folder, tile)
    data = report_path(folder, tile).read_bytes()
    try:
        content = json.loads(data)
        checksum, result = content.pop("checksum"), Tile(path, TileReport(**content["report"]))
        rows = result.rows()
        whole = checksum == _checksum(content, rows) and content["rows"] == str(rows.dtype.descr)
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        whole = False
    if not whole:
        raise DamagedTileError(f"tile {tile} is damaged: {path} is not what was written; resume to compute it again")
    return result


def remove_tile(folder: Path, tile: int) -> None:
    """Remove the results of a tile."""
    report_path(folder, tile).unlink(missing_ok=True)
    tile_path(folder, tile).unlink(missing_ok=True)


def _checksum(content: Mapping[str, object], rows: Values) -> int:
    """Of the report and all rows."""
    result = zlib.crc32(json.dumps(content).encode())
    for start in range(0, len(rows), ROWS):
        result = zlib.crc32(np.ascontiguousarray(rows[start : start + ROWS]).view(np.uint8).data, result)
    return result
