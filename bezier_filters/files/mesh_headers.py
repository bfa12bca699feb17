"""Headers of mesh files, checked against the size of the file.

A damaged header must not make a reader allocate memory for missing data. plyfile and pymeshlab have no such check and
read a file only after it has passed.
"""

import os
import re
from codecs import BOM_UTF8
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from bezier_filters.errors import FieldFileError

HEADER_LIMIT = 1 << 20  # largest size of a header in bytes; real ones have a few hundred
BYTE_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TRIPLE = 3  # entries of the lists of meshes: corners of a triangle, a point attribute

_COUNT_BLOCK_BYTES = 1 << 20
_MARKED = (".obj", ".ply", ".stl", ".xyz", ".pts", ".asc")  # formats in which a byte order mark changes the first row
STL_HEADER_BYTES, STL_TRIANGLE_BYTES = 84, 50  # bytes
_STL_SAMPLE_BYTES = 1000  # bytes that distinguish text from numbers
_MIN_OFF_VERTEX_BYTES, _MIN_OFF_FACE_BYTES = (
    6,
    2,
)  # least bytes of a line of three coordinates, and of the number of corners
CORNERS = ("vertex_indices", "vertex_index")
_CODES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
_NAMES = ("char uchar short ushort int uint float double", "int8 uint8 int16 uint16 int32 uint32 float32 float64")
_TYPES = {name: code for names in _NAMES for name, code in zip(names.split(), _CODES, strict=True)}
_NOTHING = rb"(?:\s|#[^\n]*\n)*"  # spaces and comments
_OFF_COUNTS = re.compile(_NOTHING + rb"[A-Z0-9]*OFF\s" + _NOTHING + rb"(\d{1,18})\s+(\d{1,18})\b[^\n]*(?:\n|$)")


@dataclass(frozen=True)
class PlyProperty:
    """A number, or list of numbers, in each row; types are NumPy codes without byte order."""

    name: str
    type: str
    length_type: str = ""  # for lists only

    def columns(self) -> list[tuple[str, str]]:
        """Names and types of the numbers of this property in a row; a list counts as a triple."""
        if not self.length_type:
            return [(self.name, self.type)]
        # Names in PLY files have no spaces, so these cannot clash with one.
        return [(f"{self.name} length", self.length_type)] + [(f"{self.name} {k}", self.type) for k in range(TRIPLE)]


@dataclass(frozen=True)
class PlyElement:
    """A table of the file: name, number of rows and properties."""

    name: str
    count: int
    properties: list[PlyProperty]

    @property
    def columns(self) -> list[tuple[str, str]]:
        """Names and types of the numbers in a row; lists count as triples."""
        return [column for item in self.properties for column in item.columns()]

    def least_row_size(self, is_ascii: bool) -> int:
        """Least bytes of a row; faces have three corners, other lists may be empty."""
        parts = [item.columns()[: None if item.name in CORNERS else 1] for item in self.properties]
        # In ASCII a number takes a digit and a separator.
        return sum(2 if is_ascii else int(code[1]) for part in parts for _, code in part)


@dataclass(frozen=True)
class PlyHeader:
    """Format of a file, its tables in order, and the size of the header in bytes."""

    format: str
    elements: list[PlyElement]
    size: int

    @property
    def is_ascii(self) -> bool:
        """Whether numbers are written as text."""
        return self.format == "ascii"

    @property
    def vertex_index(self) -> int:
        """Index of the vertices among the elements; -1 if there are none."""
        return next((k for k, element in enumerate(self.elements) if element.name == "vertex"), -1)


def parse_header(path: object, head: bytes) -> PlyHeader:
    """Header of the PLY file that begins with `head`; `FieldFileError` if it is damaged or longer."""
    if not head.startswith((b"ply\n", b"ply\r\n")):
        raise FieldFileError(f"{path} is neither a PLY nor an NPZ file: it starts with {head[:12]!r}")
    text = re.match(rb".*?^end_header[ \t]*\r?\n", head, re.DOTALL | re.MULTILINE)
    if text is None:
        raise FieldFileError(f"{path} is cut short or damaged: its PLY header has no end")
    format_name, elements = "", list[PlyElement]()
    for number, line in enumerate(text.group().splitlines()[1:-1], start=2):
        # Only comments may have other than ASCII characters, for example in file names.
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
    """Refuse a header that announces more data than the file holds, before any allocation."""
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
    lines, last = 0, b"\n"
    for block in iter(lambda: stream.read(_COUNT_BLOCK_BYTES), b""):
        lines, last = lines + block.count(b"\n"), block[-1:]
    lines += last != b"\n"
    rows = sum(element.count for element in header.elements)
    if lines < rows:
        raise FieldFileError(
            f"{path} is cut short or damaged: its header announces {rows} lines of data, but {lines} follow"
        )


def check_header(path: str | os.PathLike[str]) -> None:
    """Refuse a PLY, binary STL or ASCII OFF file that is too short for what its header announces.

    Other files pass, and are left to their readers.
    """
    path = Path(path)
    with path.open("rb") as stream:
        head = stream.read(HEADER_LIMIT)
    # In an OBJ file, a mark before a comment is harmless.
    if head.startswith(BOM_UTF8) and path.suffix.lower() in _MARKED and head[len(BOM_UTF8) :][:1] not in b"#\r\n":
        raise FieldFileError(
            f"{path} begins with a byte order mark, which readers mistake for text; save it as UTF-8 without one"
        )
    checks = {".ply": _check_ply, ".stl": _check_stl, ".off": _check_off}
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


def is_binary_stl(head: bytes) -> bool:
    """Whether an STL file that begins with these bytes holds numbers, not text."""
    # Some binary files begin with ``solid``, too; but only text has neither zeros nor high bytes.
    sample = head[STL_HEADER_BYTES : STL_HEADER_BYTES + _STL_SAMPLE_BYTES]
    is_text = head.lstrip()[:5].lower() == b"solid" and all(0 < byte < 128 for byte in sample)
    return len(head) >= STL_HEADER_BYTES and not is_text


def stl_count(head: bytes) -> int:
    """Triangles that a binary STL file announces."""
    return int.from_bytes(head[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")


def _check_stl(path: Path, head: bytes) -> None:
    if not is_binary_stl(head):
        return
    announced, held = stl_count(head), (path.stat().st_size - STL_HEADER_BYTES) // STL_TRIANGLE_BYTES
    if announced > held:
        raise FieldFileError(
            f"{path} is cut short or damaged: its header announces {announced} triangles, but it holds {held}"
        )


def off_counts(head: bytes) -> tuple[int, int, int] | None:
    """Vertices and faces that an ASCII OFF file announces, and the offset of its rows; None if it cannot be parsed."""
    found = _OFF_COUNTS.match(head)
    return None if found is None else (int(found[1]), int(found[2]), found.end())


def _check_off(path: Path, head: bytes) -> None:
    counts = off_counts(head)
    if counts is None:
        return
    vertices, faces, _ = counts
    size = path.stat().st_size
    if _MIN_OFF_VERTEX_BYTES * vertices + _MIN_OFF_FACE_BYTES * faces > size:
        raise FieldFileError(
            f"{path} is cut short or damaged: it announces {vertices} vertices and {faces} faces in {size} bytes"
        )
