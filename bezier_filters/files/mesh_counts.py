"""How many vertices and triangles a mesh file promises, which is compared with what a reader makes of it.

Counting is quick next to reading. Where the numbers differ, or a character is where no number can have it,
`file_contents` reads the file in plain Python and finds the row.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bezier_filters.errors import FieldFileError
from bezier_filters.files.mesh_headers import (
    CORNERS,
    HEADER_LIMIT,
    PlyHeader,
    is_binary_stl,
    off_counts,
    parse_header,
    stl_count,
)
from bezier_filters.files.number_rows import sections, text_blocks
from bezier_filters.files.three_ds import count_3ds

_TRIANGLE = 3


@dataclass(frozen=True)
class MeshCounts:
    """What a file promises; None where that cannot be counted."""

    vertices: int | None = None
    faces: int | None = None  # triangles, polygons being cut
    is_odd: bool = False  # whether a row cannot be what it should be, or has to be looked at


def count_mesh(path: Path) -> MeshCounts:
    """Count the vertices and triangles that a file promises."""
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return _count_obj(path)
    if suffix in (".xyz", ".asc", ".pts"):
        return _count_points(path, suffix)
    if suffix == ".3ds":
        return MeshCounts(*count_3ds(path))
    with path.open("rb") as stream:
        head = stream.read(HEADER_LIMIT)
    if suffix == ".off":
        return _count_off(path, head)
    if suffix == ".stl":
        return _count_stl(path, head)
    if suffix == ".ply":
        try:
            return _count_ply(path, parse_header(path, head))
        except FieldFileError:  # not understood: its reader has to judge
            return MeshCounts()
    return MeshCounts()


def _count_obj(path: Path) -> MeshCounts:
    vertices = faces = 0
    is_odd = False
    for block in text_blocks(path, continued=True):
        first, second = block.heads.T
        is_record = (second == ord(" ")) | (second == ord("\t"))
        is_vertex, is_face = is_record & (first == ord("v")), is_record & (first == ord("f"))
        # Long ago it was the only end of a line.
        is_odd |= b"\r" in block.text and block.text.count(b"\r") > block.text.count(b"\r\n")
        vertices += int(np.count_nonzero(is_vertex))
        if is_vertex.any():
            is_odd |= block.has_odd(is_vertex, heads=2)
        if is_face.any():
            lines = block.chosen(is_face)
            faces += lines.word_count() - _TRIANGLE * len(lines)  # the f, and two corners more than triangles
            is_odd |= lines.has_odd(integers=True, heads=2)
    return MeshCounts(vertices, faces, is_odd)


def _count_points(path: Path, suffix: str) -> MeshCounts:
    count, is_odd, announced = 0, False, None
    for block in text_blocks(path):
        rows = block.rows()
        if not count and len(rows):
            start, first = 0, rows.lines(0, 1).text.split()
            if suffix == ".pts" and len(first) == 1 and first[0].isdigit():
                start, announced = 1, int(first[0])
            elif suffix == ".asc":  # names of columns
                start = int(np.argmax(np.isin(rows.heads[:, 0], np.frombuffer(b"0123456789+-.", np.uint8))))
            rows = rows.lines(start, len(rows))
        count += len(rows)
        if suffix != ".asc":  # where commas may be between the numbers
            is_odd |= rows.has_odd() or rows.word_count() < _TRIANGLE * len(rows)
    is_odd |= announced not in (None, count)
    return MeshCounts(count, 0 if suffix == ".xyz" else None, is_odd)


def _count_off(path: Path, head: bytes) -> MeshCounts:
    counts = off_counts(head)
    if counts is None:
        return MeshCounts()
    *announced, offset = counts
    rows, triangles, is_odd = [0, 0, 0], 0, False
    for section, block in sections(text_blocks(path, offset), announced):
        rows[section] += len(block)
        if section == 0:
            is_odd |= block.has_odd() or block.word_count() < _TRIANGLE * len(block)
        elif section == 1:
            first, second = block.heads.T
            corners = first.astype(np.int64) - ord("0")
            triangles += int(np.maximum(corners - 2, 0).sum())
            is_odd |= block.has_odd() or block.has_long_number() or bool((second != ord(" ")).any())
            is_odd |= bool((block.words_per_line() <= corners).any())
    return MeshCounts(announced[0], triangles, is_odd or rows[:2] != announced)


def _count_stl(path: Path, head: bytes) -> MeshCounts:
    """The triangles; vertices are where corners of triangles are the same."""
    if is_binary_stl(head):
        return MeshCounts(None, stl_count(head))
    facets = corners = ends = 0
    for block in text_blocks(path):
        text = block.text.lower()
        facets += text.count(b"facet normal")
        corners += text.count(b"vertex ")
        ends += text.count(b"endfacet")
    return MeshCounts(None, facets, not facets == ends == corners / _TRIANGLE)


def _count_ply(path: Path, header: PlyHeader) -> MeshCounts:
    """Of elements with one list, the corners are all that has no known size."""
    counts = {element.name: element.count for element in header.elements}
    vertices, faces = counts.get("vertex", 0), counts.get("face", 0)
    if not faces:
        return MeshCounts(vertices, 0 if counts.keys() == {"vertex"} else None)
    lists = [item for element in header.elements for item in element.properties if item.length_type]
    if len(lists) != 1 or lists[0].name not in CORNERS:
        return MeshCounts(vertices)
    if not header.is_ascii:
        known = sum(element.count * element.least_row_size(is_ascii=False) for element in header.elements)
        more, rest = divmod(path.stat().st_size - header.size - known, int(lists[0].type[1]))
        return MeshCounts(vertices, faces + more, rest != 0)
    triangles, rows, is_odd, names = 0, 0, False, [*counts, ""]
    for section, block in sections(text_blocks(path, header.size), list(counts.values())):
        rows += len(block) if names[section] else 0
        if names[section] == "face":
            columns = next(len(element.properties) for element in header.elements if element.name == "face")
            triangles += block.word_count() - (columns + 2) * len(block)
            is_odd |= columns == 1 and block.has_long_number()
    return MeshCounts(vertices, triangles, is_odd or rows < sum(counts.values()))
