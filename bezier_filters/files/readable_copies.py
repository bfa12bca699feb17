"""Copies of valid files that pymeshlab refuses or misreads: PLY in other number types, OBJ with lines put together."""

from pathlib import Path
from typing import BinaryIO

import numpy as np

from bezier_filters.errors import FieldFileError
from bezier_filters.files.mesh_headers import BYTE_ORDER, HEADER_LIMIT, PlyHeader, parse_header

_BLOCK = 1 << 24
_CONTINUED = b"\\\r\n"
_AXES = ("x", "y", "z")
_REAL = ("f4", "f8")
_BIG = "binary_big_endian"
_LONGEST = 255  # entries of a list whose length is one byte
# types of the lengths and entries of lists of corners that are read, in text and in both byte orders, by their name
_ALWAYS = {("u1", "i4"), ("i1", "i4"), ("i4", "i4")}
_LISTS = {
    "vertex_index": _ALWAYS,
    "vertex_indices": _ALWAYS | {(length, entry) for length in ("u1", "i1") for entry in ("i2", "u4")},
}


def is_misread(path: Path) -> bool:
    """Whether pymeshlab refuses or misreads a valid file.

    In PLY files it takes coordinates only as floating-point numbers, corners only in some types of lists, and does not
    turn the bytes of big-endian doubles; in OBJ files it loses lines that go on in the next one where these end with
    carriage returns, too.
    """
    suffix = path.suffix.lower()
    if suffix == ".obj":
        with path.open("rb") as stream:
            return any(_CONTINUED in block for block in iter(lambda: _whole_lines(stream), b""))
    if suffix != ".ply":
        return False
    with path.open("rb") as stream:
        head = stream.read(HEADER_LIMIT)
    try:
        return _is_misread(parse_header(path, head))
    except FieldFileError:  # not understood: its reader has to judge
        return False


def write_copy(path: Path, target: Path) -> None:
    """Write a file that is misread once more, so that it is not; `FieldFileError` if it is damaged."""
    if path.suffix.lower() == ".ply":
        _convert_ply(path, target)
        return
    with path.open("rb") as source, target.open("wb") as copy:
        while block := _whole_lines(source):
            copy.write(block.replace(_CONTINUED, b"   "))


def _whole_lines(stream: BinaryIO) -> bytes:
    return stream.read(_BLOCK) + stream.readline()


def _is_misread(header: PlyHeader) -> bool:
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
    """Write a file once more, little-endian, in types that pymeshlab reads."""
    import plyfile

    try:
        data = plyfile.PlyData.read(str(path), mmap=False)
        for element in data.elements:
            for item in element.properties:
                if isinstance(item, plyfile.PlyListProperty):
                    longest = max(map(len, element.data[item.name]), default=0)
                    item.len_dtype = "u1" if longest <= _LONGEST else "i4"
                    if item.name in _LISTS:
                        item.val_dtype = "i4"
                elif element.name == "vertex" and item.name in _AXES and item.val_dtype not in _REAL:
                    item.val_dtype = "f8"
        data.text, data.byte_order = False, BYTE_ORDER["binary_little_endian"]
        with np.errstate(all="ignore"):
            data.write(str(target))
    except (plyfile.PlyParseError, ValueError, OverflowError, KeyError) as error:
        raise FieldFileError(f"{path} is damaged or cut short: {error}") from error
