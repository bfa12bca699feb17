"""Vertices and triangles in the chunks of 3DS files."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import FieldFileError

_CHUNK_HEADER_BYTES = 6  # bytes: two for the kind of a chunk, four for its total size
_MAIN, _EDITOR, _OBJECT, _MESH = 0x4D4D, 0x3D3D, 0x4000, 0x4100
_POINT_CHUNK, _FACE_CHUNK = 0x4110, 0x4120
_POINT_BYTES, _FACE_BYTES = 12, 8  # bytes: three floats; three corners and flags
_MESH_CHUNK_FAMILY = 0x41  # first byte of the kinds of chunks that follow the triangles, inside of their chunk


def count_3ds(path: Path) -> tuple[int, int]:
    """Numbers of vertices and triangles; `FieldFileError` if the file is truncated or inconsistent."""
    meshes = list(read_3ds(path))
    return sum(len(vertices) for vertices, _ in meshes), sum(len(faces) for _, faces in meshes)


def read_3ds(path: Path) -> Iterator[tuple[FloatArray, IntArray]]:
    """Vertices (n, 3) and faces (m, 3) of each mesh."""
    data = path.read_bytes()
    for kind, mesh in _chunks(data, 0, len(data), (_MAIN, _EDITOR, _OBJECT)):
        if kind != _MESH:
            continue
        tables: dict[int, NDArray[Any]] = {_POINT_CHUNK: np.empty((0, 3)), _FACE_CHUNK: np.empty((0, 3), np.int32)}
        for inner, (start, end) in _chunks(data, *mesh, ()):
            if inner not in tables or end - start < 2:
                continue
            (count,) = struct.unpack_from("<H", data, start)
            size, code, name = (
                (_POINT_BYTES, "f4", "vertices") if inner == _POINT_CHUNK else (_FACE_BYTES, "u2", "triangles")
            )
            held = (end - start - 2) // size
            if count > held:
                raise FieldFileError(
                    f"{path} is cut short or damaged: a mesh in it announces {count} {name}, but holds {held}"
                )
            numbers = np.frombuffer(data, f"<{code}", count * size // int(code[1]), start + 2)
            after = start + 2 + count * size
            if count < held and not (inner == _FACE_CHUNK and data[after + 1] == _MESH_CHUNK_FAMILY):
                raise FieldFileError(f"{path} is damaged: a mesh in it announces {count} {name}, but holds {held}")
            tables[inner] = numbers.reshape(count, -1)[:, :3]
        if tables[_FACE_CHUNK].size and tables[_FACE_CHUNK].max() >= len(tables[_POINT_CHUNK]):
            raise FieldFileError(f"{path} has faces on vertices that are not in it")  # they crash its reader
        yield tables[_POINT_CHUNK].astype(np.float64), tables[_FACE_CHUNK].astype(np.int32)


def _chunks(data: bytes, start: int, end: int, opened: tuple[int, ...]) -> Iterator[tuple[int, tuple[int, int]]]:
    """Kind and range of the content of chunks, including chunks inside those of the `opened` kinds."""
    while start + _CHUNK_HEADER_BYTES <= end:
        kind, size = struct.unpack_from("<HI", data, start)
        inside, stop = start + _CHUNK_HEADER_BYTES, min(start + size, end)
        if size < _CHUNK_HEADER_BYTES:
            return
        if kind in opened:
            if kind == _OBJECT:  # after its name
                inside = data.find(b"\0", inside, stop) + 1 or stop
            yield from _chunks(data, inside, stop, opened)
        else:
            yield kind, (inside, stop)
        start = stop
