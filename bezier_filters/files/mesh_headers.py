"""The headers of mesh files, believed only as far as the size of the file bears them out.

A damaged header must not make a reader allocate memory for what is not there; plyfile, which has no such check, and
pymeshlab read a file after it has passed. Of glTF files, pymeshlab's reader takes even more on trust, and then reads or
writes beyond its memory: lines and strips for triangles, indices wherever they point, and nodes in circles.
"""

import base64
import json
import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from bezier_filters.errors import FieldFileError

HEADER_LIMIT = 1 << 20  # bytes at the beginning of a file that hold its header; real ones have a few hundred
BYTE_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TRIPLE = 3  # entries of the lists that meshes have: corners of a triangle, a point attribute

_BLOCK = 1 << 20
_STL_HEADER, _STL_TRIANGLE = 84, 50
_STL_LOOK = 1000  # bytes that tell text from numbers
_OFF_VERTEX, _OFF_FACE = 6, 2  # least bytes of a line of three coordinates, and of the number of corners
CORNERS = ("vertex_indices", "vertex_index")
_CODES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
_NAMES = ("char uchar short ushort int uint float double", "int8 uint8 int16 uint16 int32 uint32 float32 float64")
_TYPES = {name: code for names in _NAMES for name, code in zip(names.split(), _CODES, strict=True)}
_POINTS, _TRIANGLES = 0, 4  # of the modes of glTF
_MODES = ("points", "lines", "a loop of lines", "a strip of lines", "triangles", "a strip of triangles", "a fan")
_INDEX_TYPES = {5121: "u1", 5123: "u2", 5125: "u4"}
_GLB, _GLB_HEADER, _CHUNK_HEADER = b"glTF", 12, 8
_DATA_URI = "data:"


@dataclass(frozen=True)
class PlyProperty:
    """A number, or list of numbers, in each row; types are NumPy codes without byte order."""

    name: str
    type: str
    length_type: str = ""  # for lists only

    def columns(self) -> list[tuple[str, str]]:
        """Names and types of the numbers of this property in a row, a list being taken for a triple."""
        if not self.length_type:
            return [(self.name, self.type)]
        # Names in PLY files have no spaces, so these cannot clash with one.
        return [(f"{self.name} length", self.length_type)] + [(f"{self.name} {k}", self.type) for k in range(TRIPLE)]


@dataclass(frozen=True)
class PlyElement:
    """A table of the file: its name, its number of rows and what each of them holds."""

    name: str
    count: int
    properties: list[PlyProperty]

    @property
    def columns(self) -> list[tuple[str, str]]:
        """Names and types of the numbers in a row, lists being taken for triples."""
        return [column for item in self.properties for column in item.columns()]

    def least_row_size(self, is_ascii: bool) -> int:
        """Bytes that a row has at least; faces have three corners, other lists may be empty."""
        parts = [item.columns()[: None if item.name in CORNERS else 1] for item in self.properties]
        # In ASCII a number takes a digit and a separator.
        return sum(2 if is_ascii else int(code[1]) for part in parts for _, code in part)


@dataclass(frozen=True)
class PlyHeader:
    """Format of a file, its tables in their order, and how many bytes come before the data."""

    format: str
    elements: list[PlyElement]
    size: int

    @property
    def is_ascii(self) -> bool:
        """Whether numbers are written as text."""
        return self.format == "ascii"

    @property
    def vertex_index(self) -> int:
        """Place of the vertices among the elements; -1 if there are none."""
        return next((k for k, element in enumerate(self.elements) if element.name == "vertex"), -1)


def parse_header(path: Path, head: bytes) -> PlyHeader:
    """Header of the PLY file that begins with `head`; `FieldFileError` if it is damaged or goes beyond that."""
    if not head.startswith((b"ply\n", b"ply\r\n")):
        raise FieldFileError(f"{path} is neither a PLY nor an NPZ file: it starts with {head[:12]!r}")
    text = re.match(rb".*?^end_header[ \t]*\r?\n", head, re.DOTALL | re.MULTILINE)
    if text is None:
        raise FieldFileError(f"{path} is cut short or damaged: its PLY header has no end")
    format_name, elements = "", list[PlyElement]()
    for number, line in enumerate(text.group().splitlines()[1:-1], start=2):
        # Comments, which may name files, are the only place for other than ASCII characters.
        words = line.decode("ascii", "replace").split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in BYTE_ORDER:
                format_name = name
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append(PlyElement(name, int(count), []))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= _TYPES.keys():
                elements[-1].properties.append(PlyProperty(name, _TYPES[kind], _TYPES[length]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(PlyProperty(name, _TYPES[kind]))
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
    return PlyHeader(format_name, elements, text.end())


def check_size(path: Path, header: PlyHeader) -> None:
    """Refuse a header that promises more than the file holds, before anything is allocated for it."""
    needed = sum(element.count * element.least_row_size(header.is_ascii) for element in header.elements)
    size = path.stat().st_size - header.size
    # The last number of an ASCII file needs no separator.
    if needed > size + header.is_ascii:
        raise FieldFileError(
            f"{path} is cut short or damaged: its header announces {needed} bytes of data or more, but {size} follow"
        )


def check_lines(path: Path, stream: BinaryIO, header: PlyHeader) -> None:
    """Refuse an ASCII file with fewer lines than its header announces rows."""
    stream.seek(header.size)
    lines = sum(block.count(b"\n") for block in iter(lambda: stream.read(_BLOCK), b""))
    rows = sum(element.count for element in header.elements)
    if lines + 1 < rows:
        raise FieldFileError(
            f"{path} is cut short or damaged: its header announces {rows} lines of data, but {lines} follow"
        )


def check_header(path: str | os.PathLike[str]) -> None:
    """Refuse a PLY, binary STL or ASCII OFF file that is too short for what its header announces, and broken glTF.

    What is not understood passes: its own reader has to judge.
    """
    path = Path(path)
    with path.open("rb") as stream:
        head = stream.read(HEADER_LIMIT)
    checks = {".ply": _check_ply, ".stl": _check_stl, ".off": _check_off, ".gltf": _check_gltf, ".glb": _check_gltf}
    check = checks.get(path.suffix.lower())
    if check is not None:
        check(path, head)


def _check_ply(path: Path, head: bytes) -> None:
    if not head.startswith(b"ply"):
        raise FieldFileError(f"{path} is no PLY file: it starts with {head[:12].decode('ascii', 'replace')!r}")
    try:
        header = parse_header(path, head)
    except FieldFileError:
        return
    check_size(path, header)


def _check_stl(path: Path, head: bytes) -> None:
    # Some binary files begin with ``solid``, too; but only text has neither zeros nor high bytes.
    sample = head[_STL_HEADER : _STL_HEADER + _STL_LOOK]
    is_text = head.lstrip().startswith(b"solid") and all(0 < byte < 128 for byte in sample)
    if len(head) < _STL_HEADER or is_text:
        return
    announced = int.from_bytes(head[_STL_HEADER - 4 : _STL_HEADER], "little")
    held = (path.stat().st_size - _STL_HEADER) // _STL_TRIANGLE
    if announced > held:
        raise FieldFileError(
            f"{path} is cut short or damaged: its header announces {announced} triangles, but it holds {held}"
        )


def _check_off(path: Path, head: bytes) -> None:
    """Refuse faces that go on over several lines, too: pymeshlab's reader runs out of the line."""
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

    def rows() -> Iterator[tuple[int, list[bytes]]]:
        with path.open("rb") as stream:
            for number, line in enumerate(stream, 1):
                if cells := line.partition(b"#")[0].split():
                    yield number, cells

    count = sum(1 for _ in rows())
    for number, cells in islice(rows(), max(count - faces, 0), None):
        if cells[0].isdigit() and len(cells) <= int(cells[0]):
            raise FieldFileError(
                f"{path} is cut short or has faces over several lines: line {number} announces {int(cells[0])} "
                f"corners, but holds {len(cells) - 1}"
            )


def _check_gltf(path: Path, head: bytes) -> None:
    """Refuse a glTF file, as text or binary, whose primitives are not whole triangles of its vertices."""
    content, chunk = path.read_bytes(), b""
    try:
        if head.startswith(_GLB):
            start = _GLB_HEADER + _CHUNK_HEADER
            (size,) = struct.unpack_from("<I", content, _GLB_HEADER)
            content, chunk = content[start : start + size], content[start + size + _CHUNK_HEADER :]
        scene = json.loads(content)
        TopologicalSorter({k: node.get("children", []) for k, node in enumerate(scene.get("nodes", []))}).prepare()
        for mesh in scene.get("meshes", []):
            for primitive in mesh["primitives"]:
                _check_primitive(path, scene, chunk, primitive)
    except FieldFileError:
        raise
    except CycleError as error:
        raise FieldFileError(f"{path} has nodes that are inside themselves") from error
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, struct.error, OSError):
        pass


def _check_primitive(path: Path, scene: dict[str, Any], chunk: bytes, primitive: dict[str, Any]) -> None:
    mode = primitive.get("mode", _TRIANGLES)
    if mode not in (_POINTS, _TRIANGLES):
        raise FieldFileError(f"{path} holds {_MODES[mode]}; only points and separate triangles can be read")
    vertices = scene["accessors"][primitive["attributes"]["POSITION"]]["count"]
    corners = vertices
    if "indices" in primitive:
        indices = _indices(path, scene, chunk, scene["accessors"][primitive["indices"]])
        corners = len(indices)
        if corners and indices.max() >= vertices:
            raise FieldFileError(f"{path} has faces on vertices that are not in it")
    if mode == _TRIANGLES and corners % 3:
        raise FieldFileError(f"{path} has {corners} corners of triangles, which is not a multiple of 3")


def _indices(path: Path, scene: dict[str, Any], chunk: bytes, accessor: dict[str, Any]) -> NDArray[np.unsignedinteger]:
    """The numbers of vertices that an accessor stands for."""
    view = scene["bufferViews"][accessor["bufferView"]]
    uri = scene["buffers"][view["buffer"]].get("uri")
    if uri is None:
        data = chunk
    elif uri.startswith(_DATA_URI):
        data = base64.b64decode(uri.partition(",")[2])
    else:
        data = (path.parent / unquote(uri)).read_bytes()
    kind: np.dtype[np.unsignedinteger] = np.dtype(_INDEX_TYPES[accessor["componentType"]])
    offset = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    if offset + accessor["count"] * kind.itemsize > len(data):
        raise FieldFileError(f"{path} is cut short or damaged: its buffer ends before its indices")
    return np.frombuffer(data, kind, accessor["count"], offset)
