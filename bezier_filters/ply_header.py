"""The header of a PLY file: what the file holds, and how it is laid out."""

import re
from dataclasses import dataclass
from pathlib import Path

from bezier_filters.errors import FieldFileError

CORNERS = ("vertex_indices", "vertex_index")
TRIPLE = 3  # entries of the lists that meshes have: corners of a triangle, a point attribute
BYTE_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
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


@dataclass(frozen=True)
class PlyProperty:
    """A number, or a list of numbers, that every row of an element has.

    Attributes
    ----------
    name : str
    type : str
        NumPy code without byte order.
    length_type : str
        That of the length, of lists only.
    """

    name: str
    type: str
    length_type: str = ""

    def columns(self) -> list[tuple[str, str]]:
        """Names and types of the numbers of this property in a row, a list being taken for a triple."""
        if not self.length_type:
            return [(self.name, self.type)]
        # Names in PLY files have no spaces, so these cannot clash with one.
        return [(f"{self.name} length", self.length_type)] + [(f"{self.name} {k}", self.type) for k in range(TRIPLE)]


@dataclass(frozen=True)
class PlyElement:
    """A table of a file, such as that of the vertices."""

    name: str
    count: int
    properties: list[PlyProperty]

    @property
    def columns(self) -> list[tuple[str, str]]:
        """Names and types of the numbers in a row, lists being taken for triples."""
        return [column for item in self.properties for column in item.columns()]

    @property
    def has_lists(self) -> bool:
        """Whether the size of its rows may differ."""
        return any(item.length_type for item in self.properties)

    def least_row_size(self, is_ascii: bool) -> int:
        """Bytes that a row has at least; faces have three corners, other lists may be empty."""
        parts = [item.columns()[: None if item.name in CORNERS else 1] for item in self.properties]
        # In ASCII a number takes a digit and a separator.
        return sum(2 if is_ascii else int(code[1]) for part in parts for _, code in part)


@dataclass(frozen=True)
class PlyHeader:
    """All of a header; `size` is the number of bytes up to the data."""

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
    """Understand the beginning of a file, which is not yet believed as to what follows.

    Raises
    ------
    FieldFileError
        If it is not the header of a PLY file, or a line of it is not understood; `path` is named.
    """
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
