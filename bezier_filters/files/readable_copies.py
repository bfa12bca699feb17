"""Copies of valid files that pymeshlab refuses or misreads: PLY with other types, OBJ and OFF with plain lines."""

import re
from pathlib import Path
from typing import BinaryIO

import numpy as np

from bezier_filters.errors import FieldFileError
from bezier_filters.files.mesh_headers import BYTE_ORDER, HEADER_LIMIT, PlyHeader, parse_header

_COPY_BLOCK_BYTES = 1 << 24
_COMMENT, _COMMENT_BEHIND = re.compile(rb"#[^\n]*"), re.compile(rb"^[^#\n]*[^#\s][^#\n]*#", re.MULTILINE)
_CONTINUED = b"\\\r\n"
_AXES = ("x", "y", "z")
_REAL = ("f4", "f8")
_BIG = "binary_big_endian"
_MAX_BYTE_LENGTH = 255  # longest list whose length fits into a byte
# types of the lengths and entries of lists of corners that are read, in text and in both byte orders, by their name
_ALWAYS = {("u1", "i4"), ("i1", "i4"), ("i4", "i4")}
_LISTS = {
    "vertex_index": _ALWAYS,
    "vertex_indices": _ALWAYS | {(length, entry) for length in ("u1", "i1") for entry in ("i2", "u4")},
}


def is_misread(path: Path) -> bool:
    """Whether pymeshlab refuses or misreads a valid file.

    In PLY files it reads coordinates only as floating-point numbers, and corners only after the vertices and in some
    types of lists, and does not swap the bytes of big-endian doubles. In OBJ files it loses continued lines that end
    with carriage returns. In OFF files it reads comments behind rows as numbers.
    """
    suffix = path.suffix.lower()
    if suffix in (".obj", ".off"):
        with path.open("rb") as stream:
            blocks = iter(lambda: _whole_lines(stream), b"")
            if suffix == ".obj":
                return any(_CONTINUED in block for block in blocks)
            return any(b"#" in block and _COMMENT_BEHIND.search(block) for block in blocks)
    if suffix != ".ply":
        return False
    with path.open("rb") as stream:
        head = stream.read(HEADER_LIMIT)
    try:
        return _is_misread(parse_header(path, head))
    except FieldFileError:  # left to its reader
        return False


def write_copy(path: Path, target: Path) -> None:
    """Write a readable copy of a file that is misread; `FieldFileError` if it is damaged."""
    if path.suffix.lower() == ".ply":
        _convert_ply(path, target)
        return
    is_off = path.suffix.lower() == ".off"
    with path.open("rb") as source, target.open("wb") as copy:
        while block := _whole_lines(source):
            copy.write(_COMMENT.sub(b"", block) if is_off else block.replace(_CONTINUED, b"   "))


def _whole_lines(stream: BinaryIO) -> bytes:
    return stream.read(_COPY_BLOCK_BYTES) + stream.readline()


def _is_misread(header: PlyHeader) -> bool:
    names = [element.name for element in header.elements]
    if "face" in names[: max(header.vertex_index, 0)]:
        return True
    for element in header.elements:
        for item in element.properties:
            if header.format == _BIG and item.type == "f8":
                return True
            if element.name == "vertex" and item.name in _AXES and item.type not in _REAL:
                return True
            if item.length_type and item.name in _LISTS and (item.length_type, item.type) not in _LISTS[item.name]:
                return True
    return False


def _convert_ply(path: Path, target: Path) -> None:
    """Write a little-endian copy with types that pymeshlab reads."""
    import plyfile

    try:
        data = plyfile.PlyData.read(str(path), mmap=False)
        for element in data.elements:
            for item in element.properties:
                if isinstance(item, plyfile.PlyListProperty):
                    longest = max(map(len, element.data[item.name]), default=0)
                    item.len_dtype = "u1" if longest <= _MAX_BYTE_LENGTH else "i4"
                    if item.name in _LISTS:
                        item.val_dtype = "i4"
                elif element.name == "vertex" and item.name in _AXES and item.val_dtype not in _REAL:
                    item.val_dtype = "f8"
        data = plyfile.PlyData(sorted(data.elements, key=lambda element: element.name != "vertex"))
        data.text, data.byte_order = False, BYTE_ORDER["binary_little_endian"]
        with np.errstate(all="ignore"):
            data.write(str(target))
    except (plyfile.PlyParseError, ValueError, OverflowError, KeyError) as error:
        raise FieldFileError(f"{path} is damaged or cut short: {error}") from error
