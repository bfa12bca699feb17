"""Mesh files whose header promises more than they hold, found before a reader allocates memory for it."""

import os
import re
from pathlib import Path

from bezier_filters.errors import FieldFileError
from bezier_filters.files.ply_header import HEADER_LIMIT, check_size, parse_header

_STL_HEADER, _STL_TRIANGLE = 84, 50
_STL_LOOK = 1000  # bytes that tell text from numbers
_OFF_VERTEX, _OFF_FACE = 6, 2  # least bytes of a line of three coordinates, and of the number of corners


def check_header(path: str | os.PathLike[str]) -> None:
    """Refuse a PLY, binary STL or ASCII OFF file that is too short for what its header announces.

    What is not understood passes: its own reader has to judge.

    Raises
    ------
    FieldFileError
        The message names what is announced and what there is.
    """
    path = Path(path)
    with path.open("rb") as stream:
        head = stream.read(HEADER_LIMIT)
    check = {".ply": _check_ply, ".stl": _check_stl, ".off": _check_off}.get(path.suffix.lower())
    if check is not None:
        check(path, head)


def _check_ply(path: Path, head: bytes) -> None:
    try:
        header = parse_header(path, head)
    except FieldFileError:
        return
    check_size(path, header)


def _check_stl(path: Path, head: bytes) -> None:
    if len(head) < _STL_HEADER or not _is_binary_stl(head):
        return
    announced = int.from_bytes(head[_STL_HEADER - 4 : _STL_HEADER], "little")
    held = (path.stat().st_size - _STL_HEADER) // _STL_TRIANGLE
    if announced > held:
        raise FieldFileError(
            f"{path} is cut short or damaged: its header announces {announced} triangles, but it holds {held}"
        )


def _is_binary_stl(head: bytes) -> bool:
    """Some binary files begin with ``solid``, too; but only text has neither zeros nor high bytes."""
    sample = head[_STL_HEADER : _STL_HEADER + _STL_LOOK]
    return not head.lstrip().startswith(b"solid") or any(byte == 0 or byte > 127 for byte in sample)


def _check_off(path: Path, head: bytes) -> None:
    text = re.sub(rb"#[^\n]*", b"", head[:4096])
    counts = re.match(rb"\s*[A-Z0-9]*OFF\s+(\d{1,18})\s+(\d{1,18})\s", text)
    if counts is None:
        return
    vertices, faces = map(int, counts.groups())
    size = path.stat().st_size
    if _OFF_VERTEX * vertices + _OFF_FACE * faces > size:
        raise FieldFileError(
            f"{path} is cut short or damaged: it announces {vertices} vertices and {faces} faces in {size} bytes"
        )
