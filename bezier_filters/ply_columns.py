"""The field columns of PLY files, which pymeshlab writes but cannot read.

NumPy reads the block of the vertices and never touches the faces; plyfile is the fallback for
unusual layouts. A header is believed only as far as the size of the file bears it out.
"""

import os
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray
from bezier_filters.errors import FieldFileError
from bezier_filters.fields import PREFIX

QUALITY = "quality"

_BLOCK = 1 << 20
_CORNERS = ("vertex_indices", "vertex_index")
_TRIPLE = 3  # entries of the lists that meshes have: corners of a triangle, a point attribute
_BYTE_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    name: code
    for code, names in {
        "i1": ("char", "int8"),
        "u1": ("uchar", "uint8"),
        "i2": ("short", "int16"),
        "u2": ("ushort", "uint16"),
        "i4": ("int", "int32"),
        "u4": ("uint", "uint32"),
        "f4": ("float", "float32"),
        "f8": ("double", "float64"),
    }.items()
    for name in names
}
_Columns: TypeAlias = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class _Property:
    name: str
    type: str  # NumPy code without byte order
    length_type: str = ""  # of lists only

    def columns(self) -> list[tuple[str, str]]:
        """Names and types of the numbers of this property in a row, a list being taken for a triple."""
        if not self.length_type:
            return [(self.name, self.type)]
        # Names in PLY files have no spaces, so these cannot clash with one.
        return [(f"{self.name} length", self.length_type)] + [(f"{self.name} {k}", self.type) for k in range(_TRIPLE)]


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]

    @property
    def columns(self) -> list[tuple[str, str]]:
        return [column for item in self.properties for column in item.columns()]

    @property
    def has_lists(self) -> bool:
        return any(item.length_type for item in self.properties)

    def least_row_size(self, is_ascii: bool) -> int:
        """Bytes that a row has at least; faces have three corners, other lists may be empty."""
        parts = [item.columns()[: None if item.name in _CORNERS else 1] for item in self.properties]
        # In ASCII a number takes a digit and a separator.
        return sum(2 if is_ascii else int(code[1]) for part in parts for _, code in part)


@dataclass(frozen=True)
class _Header:
    format: str
    elements: list[_Element]
    size: int  # bytes up to the data

    @property
    def is_ascii(self) -> bool:
        return self.format == "ascii"

    @property
    def vertex_index(self) -> int:
        """Place of the vertices among the elements; -1 if there are none."""
        return next((k for k, element in enumerate(self.elements) if element.name == "vertex"), -1)


def read_ply_columns(path: Path, stream: BinaryIO, head: bytes) -> dict[str, FloatArray]:
    """Read the scalar columns ``bz_*`` and ``quality`` of a PLY file's vertices, each (n,).

    Parameters
    ----------
    path : Path
        The file, for messages and for layouts that only plyfile can read.
    stream : binary file
        The file, open for reading.
    head : bytes
        Its beginning, long enough to hold the header.

    Raises
    ------
    FieldFileError
        If the file is not PLY, is damaged or too short, or has none of these columns.
    """
    header = _parse_header(path, head)
    names = _field_names(path, header)
    _check_size(path, stream, header)
    rows = _read_regular(stream, header)
    if rows is None:
        rows = _read_irregular(path)
    return {name: rows[name].astype(np.float64) for name in names}


def _parse_header(path: Path, head: bytes) -> _Header:
    if not head.startswith((b"ply\n", b"ply\r\n")):
        raise FieldFileError(f"{path} is neither a PLY nor an NPZ file: it starts with {head[:12]!r}")
    text = re.match(rb".*?^end_header[ \t]*\r?\n", head, re.DOTALL | re.MULTILINE)
    if text is None:
        raise FieldFileError(f"{path} is cut short or damaged: its PLY header has no end")
    format_name, elements = "", list[_Element]()
    for number, line in enumerate(text.group().splitlines()[1:-1], start=2):
        # Comments, which may name files, are the only place for other than ASCII characters.
        words = line.decode("ascii", "replace").split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in _BYTE_ORDER:
                format_name = name
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append(_Element(name, int(count), []))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= _TYPES.keys():
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[length]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind]))
            case _:
                raise FieldFileError(
                    f"{path}: line {number} of the PLY header is not understood: {' '.join(words)[:80]!r}"
                )
    if not format_name:
        raise FieldFileError(f"{path}: the PLY header names no format")
    for element in elements:
        names = [item.name for item in element.properties]
        if not names or len(set(names)) < len(names):
            raise FieldFileError(f"{path}: the element {element.name} has no properties, or two of the same name")
    return _Header(format_name, elements, text.end())


def _field_names(path: Path, header: _Header) -> list[str]:
    if header.vertex_index < 0:
        found = ", ".join(element.name for element in header.elements) or "nothing"
        raise FieldFileError(f"{path} has no vertices; its elements: {found}")
    vertex = header.elements[header.vertex_index]
    names = [
        item.name
        for item in vertex.properties
        if not item.length_type and (item.name.startswith(PREFIX) or item.name == QUALITY)
    ]
    if not names:
        found = ", ".join(item.name + " (a list)" * bool(item.length_type) for item in vertex.properties)
        raise FieldFileError(
            f"{path} has no scalar {PREFIX}* column and no {QUALITY}; its vertices have {found}. Save the fields with "
            f'ms.save_current_mesh(file, save_vertex_quality=True, **{{"__ca_vs__{PREFIX}k_min": True}})'
        )
    return names


def _check_size(path: Path, stream: BinaryIO, header: _Header) -> None:
    """Refuse a header that promises more than the file holds, before anything is allocated for it."""
    needed = sum(element.count * element.least_row_size(header.is_ascii) for element in header.elements)
    size = path.stat().st_size - header.size
    # The last number of an ASCII file needs no separator.
    if needed > size + header.is_ascii:
        raise FieldFileError(
            f"{path} is cut short or damaged: its header announces {needed} bytes of data or more, but {size} follow"
        )
    if header.is_ascii:
        stream.seek(header.size)
        lines = sum(block.count(b"\n") for block in iter(lambda: stream.read(_BLOCK), b""))
        rows = sum(element.count for element in header.elements)
        if lines + 1 < rows:
            raise FieldFileError(
                f"{path} is cut short or damaged: its header announces {rows} lines of data, but {lines} follow"
            )


def _read_regular(stream: BinaryIO, header: _Header) -> _Columns | None:
    """Vertex columns of a file laid out as meshes are; None if lists make its rows irregular.

    Reads no further than the vertices: faces, of any size, cost nothing.
    """
    before, vertex = header.elements[: header.vertex_index], header.elements[header.vertex_index]
    if any(element.has_lists for element in before):
        return None
    stream.seek(header.size)
    if header.is_ascii:
        for _ in range(sum(element.count for element in before)):
            stream.readline()
        columns = _ascii_columns(stream, vertex)
    else:
        stream.seek(sum(element.count * element.least_row_size(is_ascii=False) for element in before), os.SEEK_CUR)
        columns = _binary_columns(stream, vertex, _BYTE_ORDER[header.format])
    lists = [item.name for item in vertex.properties if item.length_type]
    if columns is None or any((columns[f"{name} length"] != _TRIPLE).any() for name in lists):
        return None
    return columns


def _binary_columns(stream: BinaryIO, vertex: _Element, byte_order: str) -> _Columns | None:
    dtype = np.dtype([(name, byte_order + code) for name, code in vertex.columns])
    rows = np.fromfile(stream, dtype, vertex.count)
    return {name: rows[name] for name, _ in vertex.columns} if len(rows) == vertex.count else None


def _ascii_columns(stream: BinaryIO, vertex: _Element) -> _Columns | None:
    names = [name for name, _ in vertex.columns]
    if vertex.count == 0:
        return dict.fromkeys(names, np.zeros(0))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy only warns of empty lines
            table = np.loadtxt(stream, comments=None, max_rows=vertex.count, ndmin=2)
    except (ValueError, UserWarning):
        return None
    return dict(zip(names, table.T, strict=True)) if table.shape == (vertex.count, len(names)) else None


def _read_irregular(path: Path) -> _Columns:
    """Vertex columns by way of plyfile: slow, but right for every layout, and it names what is wrong."""
    import plyfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # plyfile warns of empty lists
            vertex = plyfile.PlyData.read(str(path), mmap=False)["vertex"]
    except (plyfile.PlyParseError, ValueError, OverflowError) as error:
        raise FieldFileError(f"{path} is damaged or cut short: {error}") from error
    return {item.name: vertex[item.name] for item in vertex.properties}
