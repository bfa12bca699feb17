"""Numbers of vertices and triangles that a mesh file announces, to be compared with the numbers that were read.

Counting is fast compared to reading. Where the numbers differ, or a row is malformed, `file_contents` reads the file
in plain Python and finds the row.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bezier_filters.errors import FieldFileError
from bezier_filters.files.mesh_headers import (
    CORNERS,
    HEADER_LIMIT,
    STL_HEADER_BYTES,
    STL_TRIANGLE_BYTES,
    PlyElement,
    PlyHeader,
    is_binary_stl,
    off_counts,
    parse_header,
    stl_count,
)
from bezier_filters.files.number_rows import TextBlock, sections, text_blocks
from bezier_filters.files.ply_corners import read_face_rows
from bezier_filters.files.three_ds import count_3ds

_TRIANGLE_CORNERS = 3
_GRID_WORDS = (b"ncols", b"nrows")  # first words of rasters, whose rows are heights in lines of the grid


@dataclass(frozen=True)
class MeshCounts:
    """Counts that a file announces; None where they cannot be counted."""

    vertices: int | None = None
    faces: int | None = None  # triangles, after triangulation of polygons
    is_odd: bool = False  # whether a row is malformed, or has to be checked
    surplus: str = ""  # a remark on rows beyond the announced ones, or on a missing end


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
            header = parse_header(path, head)
        except FieldFileError:  # left to its reader
            return MeshCounts()
        return _count_ply(path, header)
    return MeshCounts()


def _count_obj(path: Path) -> MeshCounts:
    vertices = faces = highest = 0
    is_odd = False
    for block in text_blocks(path, continued=True):
        first, second = block.heads.T
        is_record = (second == ord(" ")) | (second == ord("\t"))
        is_vertex, is_face = is_record & (first == ord("v")), is_record & (first == ord("f"))
        # Bare carriage returns were line ends on old systems.
        is_odd |= bool(((first == ord("f")) & np.isin(second, (ord("\r"), ord("\n")))).any())  # a face without corners
        is_odd |= b"\r" in block.text and block.text.count(b"\r") > block.text.count(b"\r\n")
        vertices += int(np.count_nonzero(is_vertex))
        if is_vertex.any():
            is_odd |= block.has_odd(is_vertex, heads=2)
        if is_face.any():
            lines = block.chosen(is_face)
            words = lines.words_per_line()
            faces += int(words.sum()) - _TRIANGLE_CORNERS * len(lines)  # an f, and two corners more than triangles
            is_odd = is_odd or lines.has_odd(integers=True, heads=2) or bool((words <= _TRIANGLE_CORNERS).any())
            if not is_odd and (words != _TRIANGLE_CORNERS + 1).any():  # its reader looks at triangles
                corners = lines.integers()
                highest = max(highest, int(corners.max(initial=0)))
                # Negative indices count back from about here.
                is_odd = bool((corners == 0).any()) or int(corners.min(initial=0)) < -vertices
    return MeshCounts(vertices, faces, is_odd or highest > vertices)


def _count_points(path: Path, suffix: str) -> MeshCounts:
    count, is_odd, announced = 0, False, None
    for block in text_blocks(path, commas=suffix == ".asc"):
        rows = block.rows()
        if not count and len(rows):
            start, first = 0, rows.lines(0, 1).text.split()
            if suffix == ".pts" and len(first) == 1 and first[0].isdigit():
                start, announced = 1, int(first[0])
            elif suffix == ".asc" and first[:1] and first[0].lower() in _GRID_WORDS:
                raise FieldFileError(f"{path} is a grid of heights; convert it to a mesh or to rows of points first")
            elif suffix == ".asc":  # names of columns
                start = int(np.argmax(np.isin(rows.heads[:, 0], np.frombuffer(b"0123456789+-.", np.uint8))))
            rows = rows.lines(start, len(rows))
        count += len(rows)
        is_odd |= rows.has_odd() or rows.word_count() < _TRIANGLE_CORNERS * len(rows)
    is_odd |= announced not in (None, count)
    return MeshCounts(count, 0, is_odd)


def _count_off(path: Path, head: bytes) -> MeshCounts:
    counts = off_counts(head)
    if counts is None:
        return MeshCounts()
    *announced, offset = counts
    is_plain = head.lstrip().startswith(b"OFF")
    rows, triangles, is_odd = [0, 0, 0], 0, False
    for section, block in sections(text_blocks(path, offset), announced):
        rows[section] += len(block)
        if section == 0:
            is_odd |= block.has_odd() or block.word_count() < _TRIANGLE_CORNERS * len(block)
            if is_plain and not is_odd and block.word_count() != _TRIANGLE_CORNERS * len(block):
                raise FieldFileError(
                    f"{path} has vertices of more than three numbers; where these are colours, its first line is COFF"
                )
        elif section == 1:
            first, second = block.heads.T
            corners = first.astype(np.int64) - ord("0")
            triangles += int(np.maximum(corners - 2, 0).sum())
            is_odd |= block.has_odd() or block.has_long_number() or bool((second != ord(" ")).any())
            is_odd |= bool((corners < _TRIANGLE_CORNERS).any())  # lines
            is_odd = is_odd or not _are_lists_below(block, announced[0], more=True)
            if not is_odd and (block.words_per_line() == corners + 2).any():
                raise FieldFileError(
                    f"{path} has faces with a number of a colour map, which end its reader; remove them"
                )
    return MeshCounts(announced[0], triangles, is_odd or rows[:2] != announced, _rows_left(path, rows[2]))


def _count_stl(path: Path, head: bytes) -> MeshCounts:
    """Count triangles; the number of vertices depends on coincident corners."""
    if is_binary_stl(head):
        announced, held = stl_count(head), (path.stat().st_size - STL_HEADER_BYTES) // STL_TRIANGLE_BYTES
        surplus = f"{path} holds {held} triangles, but its header announces {announced}" if held > announced else ""
        return MeshCounts(None, announced, surplus=surplus)
    facets = corners = ends = solids = 0
    is_odd = False
    for block in text_blocks(path):
        text = block.text.lower()
        facets += text.count(b"facet normal")
        corners += text.count(b"vertex ")
        ends += text.count(b"endfacet")
        solids += text.count(b"endsolid")
        first, second = block.heads.T
        is_vertex = np.isin(first, (ord("v"), ord("V"))) & np.isin(second, (ord("e"), ord("E")))
        is_odd |= block.has_odd(is_vertex, heads=len("vertex"))
    surplus = "" if solids else f"{path} has no endsolid after its last facet: it may have been cut short"
    return MeshCounts(None, facets, is_odd or not facets == ends == corners / _TRIANGLE_CORNERS, surplus)


def _count_ply(path: Path, header: PlyHeader) -> MeshCounts:
    """Count rows and corners; of elements with one list, only the corners have no known size."""
    counts = {element.name: element.count for element in header.elements}
    vertices, faces = counts.get("vertex", 0), counts.get("face", 0)
    lists = [item for element in header.elements for item in element.properties if item.length_type]
    of_faces = [element for element in header.elements if element.name == "face"]
    if any(item.name not in CORNERS or item not in of_faces[0].properties for item in lists if of_faces):
        return MeshCounts(vertices)
    if len(lists) > 1 or (lists and not of_faces):
        return MeshCounts(vertices)
    if header.is_ascii:
        return _count_text_ply(path, header, vertices)
    if faces and lists:
        rows = read_face_rows(path, header)
        if rows.bytes_left < 0:
            return MeshCounts(vertices, rows.triangles, True)
        surplus = _surplus(path, rows.bytes_left, header.elements[-1])
        return MeshCounts(vertices, rows.triangles, surplus=surplus)
    known = sum(element.count * element.least_row_size(is_ascii=False) for element in header.elements)
    surplus = _surplus(path, path.stat().st_size - header.size - known, header.elements[-1]) if counts else ""
    return MeshCounts(vertices, 0 if counts.keys() == {"vertex"} else None, surplus=surplus)


def _surplus(path: Path, bytes_left: int, last: PlyElement) -> str:
    least = last.least_row_size(is_ascii=False)
    return f"{path} has {bytes_left} bytes after the last row that its header announces" if bytes_left >= least else ""


def _count_text_ply(path: Path, header: PlyHeader, vertices: int) -> MeshCounts:
    triangles, rows, is_odd = 0, 0, False
    elements = {element.name: element for element in header.elements}
    names, surplus = [*elements, ""], 0
    for section, block in sections(text_blocks(path, header.size), [element.count for element in elements.values()]):
        if not names[section]:
            surplus += len(block)
            continue
        element = elements[names[section]]
        rows += len(block)
        is_odd |= block.has_odd()
        if not any(item.length_type for item in element.properties):
            is_odd |= block.word_count() != len(element.properties) * len(block)
        elif element.name == "face":
            triangles += block.word_count() - (len(element.properties) + 2) * len(block)
            if len(element.properties) == 1 and not is_odd:
                is_odd = block.has_long_number() or not _are_lists_below(block, vertices)
    is_odd |= rows < sum(element.count for element in header.elements)
    if elements.keys() != {"vertex"} and "face" not in elements:
        return MeshCounts(vertices, None, is_odd, _rows_left(path, surplus))
    return MeshCounts(vertices, triangles, is_odd, _rows_left(path, surplus))


def _rows_left(path: Path, rows: int) -> str:
    return f"{path} has {rows} rows after the last one that its header announces" if rows else ""


def _are_lists_below(block: TextBlock, limit: int, *, more: bool = False) -> bool:
    """Whether each row is a length and that many integers in [0, limit), followed by nothing unless `more`."""
    words = block.words_per_line()
    has_reals = any(sign in block.text for sign in (b".", b"e", b"E"))  # colours
    numbers = np.fromstring(block.text, sep=" ") if has_reals else block.integers()
    if len(numbers) != words.sum():
        return False
    ends = np.cumsum(words)
    starts = ends - words
    lengths = numbers[starts].astype(np.int64)
    if (lengths < 0).any() or (lengths >= words if more else lengths != words - 1).any():
        return False
    steps = np.zeros(len(numbers) + 1, np.int8)  # +1 where a list begins, -1 behind it
    steps[starts + 1] += 1
    steps[starts + 1 + lengths] -= 1
    corners = numbers[np.cumsum(steps[:-1], dtype=np.int8).astype(np.bool_)]
    return bool(((corners >= 0) & (corners < limit) & (corners == np.floor(corners))).all())
