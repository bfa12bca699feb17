"""The chunks of 3DS files: vertices and triangles, as far as the file holds them."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import FieldFileError

_HEADER = 6  # bytes of a chunk: two for its kind, four for its size with all that is in it
_MAIN, _EDITOR, _OBJECT, _MESH = 0x4D4D, 0x3D3D, 0x4000, 0x4100
_POINTS, _TRIANGLES = 0x4110, 0x4120
_POINT, _TRIANGLE = 12, 8  # bytes: three floats; three corners and flags
_OF_MESHES = 0x41  # first byte of the kinds of chunks that follow the triangles, inside of their chunk


def count_3ds(path: Path) -> tuple[int, int]:
    """Numbers of vertices and triangles; `FieldFileError` if the file does not hold these, or they do not fit."""
    meshes = list(read_3ds(path))
    return sum(len(vertices) for vertices, _ in meshes), sum(len(faces) for _, faces in meshes)


def read_3ds(path: Path) -> Iterator[tuple[FloatArray, IntArray]]:
    """Vertices (n, 3) and faces (m, 3) of each mesh."""
    data = path.read_bytes()
    for kind, mesh in _chunks(data, 0, len(data), (_MAIN, _EDITOR, _OBJECT)):
        if kind != _MESH:
            continue
        tables: dict[int, NDArray[Any]] = {_POINTS: np.empty((0, 3)), _TRIANGLES: np.empty((0, 3), np.int32)}
        for inner, (start, end) in _chunks(data, *mesh, ()):
            if inner not in tables or end - start < 2:
                continue
            (count,) = struct.unpack_from("<H", data, start)
            size, code, name = (_POINT, "f4", "vertices") if inner == _POINTS else (_TRIANGLE, "u2", "triangles")
            held = (end - start - 2) // size
            if count > held:
                raise FieldFileError(
                    f"{path} is cut short or damaged: a mesh in it announces {count} {name}, but holds {held}"
                )
            numbers = np.frombuffer(data, f"<{code}", count * size // int(code[1]), start + 2)
            after = start + 2 + count * size
            if count < held and not (inner == _TRIANGLES and data[after + 1] == _OF_MESHES):
                raise FieldFileError(f"{path} is damaged: a mesh in it announces {count} {name}, but holds {held}")
            tables[inner] = numbers.reshape(count, -1)[:, :3]
        if tables[_TRIANGLES].size and tables[_TRIANGLES].max() >= len(tables[_POINTS]):
            raise FieldFileError(f"{path} has faces on vertices that are not in it")  # which end its reader
        yield tables[_POINTS].astype(np.float64), tables[_TRIANGLES].astype(np.int32)


def _chunks(data: bytes, start: int, end: int, opened: tuple[int, ...]) -> Iterator[tuple[int, tuple[int, int]]]:
    """Kind and place of the content of the chunks, also of those inside chunks of the kinds to be opened."""
    while start + _HEADER <= end:
        kind, size = struct.unpack_from("<HI", data, start)
        inside, stop = start + _HEADER, min(start + size, end)
        if size < _HEADER:
            return
        if kind in opened:
            if kind == _OBJECT:  # after its name
                inside = data.find(b"\0", inside, stop) + 1 or stop
            yield from _chunks(data, inside, stop, opened)
        else:
            yield kind, (inside, stop)
        start = stop
