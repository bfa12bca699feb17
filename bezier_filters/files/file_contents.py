"""Mesh files read in plain Python to report which row is wrong; slow, so only for faulty files."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.errors import FieldFileError
from bezier_filters.files.mesh_headers import (
    CORNERS,
    HEADER_LIMIT,
    STL_HEADER_BYTES,
    STL_TRIANGLE_BYTES,
    is_binary_stl,
    off_counts,
    stl_count,
)
from bezier_filters.files.three_ds import read_3ds

_MAX_QUOTED_CHARACTERS = 60  # characters of a row in a message
_FLOAT_TRIPLE = 3
_TRIANGLE_CORNERS = 3


@dataclass
class FileContents:
    """Rows of a mesh file in order, with their line numbers for messages."""

    vertices: FloatArray  # (n, 3), possibly not finite
    faces: list[list[int]]  # corners of polygons
    vertex_places: list[int] = field(default_factory=list)  # line numbers of a text file, else empty
    face_places: list[int] = field(default_factory=list)
    welds: bool = False  # whether the reader merges coincident vertices

    @property
    def is_finite(self) -> BoolArray:
        """Whether a vertex has three finite coordinates; (n,)."""
        return np.asarray(np.isfinite(self.vertices).all(axis=1))

    def vertex_name(self, index: int) -> str:
        """Name of a vertex in messages."""
        line = f" (line {self.vertex_places[index]})" if self.vertex_places else ""
        return f"vertex {index}{line}"

    def face_name(self, index: int) -> str:
        """Name of a face in messages."""
        line = f" (line {self.face_places[index]})" if self.face_places else ""
        return f"face {index}{line}"


def read_contents(path: Path) -> FileContents | None:
    """Read a mesh file, None if the format is not supported here.

    `FieldFileError` names the first row that cannot be parsed or refers to a missing vertex.
    """
    with path.open("rb") as stream:
        head = stream.read(HEADER_LIMIT)
    suffix = path.suffix.lower()
    if suffix == ".obj":
        found = _read_obj(path)
    elif suffix == ".off" and (counts := off_counts(head)) is not None:
        found = _read_off(path, *counts[:2], head[: counts[2]].count(b"\n"))
    elif suffix in (".xyz", ".asc", ".pts"):
        found = _read_points(path, suffix)
    elif suffix == ".stl":
        found = _read_binary_stl(path, stl_count(head)) if is_binary_stl(head) else _read_text_stl(path)
    elif suffix == ".3ds":
        meshes = list(read_3ds(path))
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
        faces = [face for start, (_, table) in zip(starts, meshes, strict=False) for face in (table + start).tolist()]
        found = FileContents(np.concatenate([np.empty((0, 3)), *(vertices for vertices, _ in meshes)]), faces)
    elif suffix == ".ply":
        found = _read_ply(path)
    else:
        return None
    n = len(found.vertices)
    for index, face in enumerate(found.faces):
        if face and not 0 <= min(face) <= max(face) < n:
            wrong = next(corner for corner in face if not 0 <= corner < n)
            name = wrong + (suffix == ".obj")  # where the first vertex is 1
            raise FieldFileError(
                f"{path} has no vertex {name}, which its {found.face_name(index)} names: it has {n} vertices"
            )
    return found


def _lines(path: Path, *, comments: bool = True) -> Iterator[tuple[int, list[bytes]]]:
    """Number and words of non-empty lines."""
    with path.open("rb") as stream:
        for number, line in enumerate(stream, 1):
            if b"\r" in line.rstrip(b"\r\n"):
                raise FieldFileError(f"{path} ends lines with carriage returns alone (line {number}); convert it first")
            if words := (line.partition(b"#")[0] if comments else line).split():
                yield number, words


def _numbers(path: Path, line: int, words: list[bytes]) -> list[float]:
    """The three coordinates at the beginning of a row."""
    try:
        if any(b"_" in word for word in words[:_FLOAT_TRIPLE]):
            raise ValueError
        numbers = [float(word) for word in words[:_FLOAT_TRIPLE]]
    except ValueError:
        numbers = []
    if len(numbers) < _FLOAT_TRIPLE:
        raise _misread(path, line, words, "three coordinates")
    return numbers


def _integer(word: bytes) -> int:
    if b"_" in word:  # a digit separator in Python
        raise ValueError(word)
    return int(word)


def _misread(path: Path, line: int, words: list[bytes], expected: str) -> FieldFileError:
    got = b" ".join(words)[:_MAX_QUOTED_CHARACTERS].decode("ascii", "replace")
    return FieldFileError(f"{path} cannot be relied on: line {line} has {got!r}, expected {expected}")


def _read_obj(path: Path) -> FileContents:
    vertices, found = list[list[float]](), FileContents(np.empty((0, 3)), [])
    joined: list[bytes] = []
    for number, line_words in _lines(path, comments=False):
        if line_words[-1].endswith(b"\\"):
            joined += [*line_words[:-1], *filter(None, [line_words[-1][:-1]])]
            continue
        words, joined = joined + line_words, []
        if words[0] == b"v":
            vertices.append(_numbers(path, number, words[1:]))
            found.vertex_places.append(number)
        elif words[0] == b"f":
            try:
                corners = [_integer(word.partition(b"/")[0]) for word in words[1:]]
            except ValueError:
                raise _misread(path, number, words, "vertex indices only") from None
            if len(corners) < _TRIANGLE_CORNERS:
                raise _misread(path, number, words, "three corners or more")
            # Negative indices count back from here; 0 is invalid.
            face = [k - 1 if k > 0 else len(vertices) + k if k else -1 for k in corners]
            if min(face, default=0) < 0:
                raise _misread(path, number, words, f"vertices from -{len(vertices)} to -1, or from 1 on")
            found.faces.append(face)
            found.face_places.append(number)
    if vertices:
        found.vertices = np.array(vertices)
    return found


def _read_off(path: Path, vertex_count: int, face_count: int, header_lines: int) -> FileContents:
    vertices, found = list[list[float]](), FileContents(np.empty((0, 3)), [])
    number = 0
    for number, words in _lines(path):
        if number <= header_lines:
            continue
        if len(vertices) < vertex_count:
            vertices.append(_numbers(path, number, words))
            found.vertex_places.append(number)
        elif len(found.faces) < face_count:
            try:
                size, *corners = (_integer(word) for word in words[: _integer(words[0]) + 1])
            except ValueError:
                raise _misread(path, number, words, "a number of corners and the corners") from None
            if size > len(corners):
                raise FieldFileError(
                    f"{path} is cut short or has faces over several lines: line {number} announces {size} corners, but "
                    f"holds {len(corners)}"
                )
            found.faces.append(corners)
            found.face_places.append(number)
    if len(vertices) < vertex_count or len(found.faces) < face_count:
        raise FieldFileError(
            f"{path} is cut short or damaged: it announces {vertex_count} vertices and {face_count} faces, but it has "
            f"lines for {len(vertices)} and {len(found.faces)}"
        )
    if vertices:
        found.vertices = np.array(vertices)
    return found


def _read_points(path: Path, suffix: str) -> FileContents:
    vertices, found, announced = list[list[float]](), FileContents(np.empty((0, 3)), []), None
    for number, words in _lines(path):
        if suffix == ".pts" and len(words) == 1 and words[0].isdigit() and not vertices:
            announced = int(words[0])
            continue
        if suffix == ".asc":
            words = b" ".join(words).replace(b",", b" ").split()
            if not vertices and not words[0].lstrip(b"+-.")[:1].isdigit():
                continue  # names of columns
        vertices.append(_numbers(path, number, words))
        found.vertex_places.append(number)
    if announced is not None and announced != len(vertices):
        raise FieldFileError(
            f"{path} is cut short or damaged: it announces {announced} points, but holds {len(vertices)}"
        )
    if vertices:
        found.vertices = np.array(vertices)
    return found


def _read_binary_stl(path: Path, count: int) -> FileContents:
    with path.open("rb") as stream:
        stream.seek(STL_HEADER_BYTES)
        rows = np.fromfile(stream, [("numbers", "<f4", 12), ("attribute", "<u2")], count)
    assert rows.dtype.itemsize == STL_TRIANGLE_BYTES
    return _soup(rows["numbers"][:, 3:].reshape(-1, 3).astype(np.float64), [])


def _read_text_stl(path: Path) -> FileContents:
    corners, places, open_since = [], list[int](), 0
    for number, words in _lines(path, comments=False):
        name = words[0].lower()
        if name == b"vertex":
            # Readers use single precision.
            corners.append([float(np.float32(value)) for value in _numbers(path, number, words[1:])])
        elif name == b"facet":
            open_since = number
        elif name == b"endfacet":
            if len(corners) != 3 * (len(places) + 1):
                raise FieldFileError(
                    f"{path} cannot be relied on: the facet in lines {open_since} to {number} has "
                    f"{len(corners) - 3 * len(places)} vertices, expected 3"
                )
            places.append(open_since)
            open_since = 0
    if open_since or len(corners) != 3 * len(places):
        raise FieldFileError(f"{path} is cut short or damaged: the facet of line {open_since} has no end")
    return _soup(np.array(corners).reshape(-1, 3), places)


def _soup(corners: FloatArray, places: list[int]) -> FileContents:
    """Triangles of a file without indices: corners (3 m, 3), with coincident ones merged."""
    unique, index = np.unique(corners + 0.0, axis=0, return_inverse=True, equal_nan=True)
    return FileContents(unique, index.reshape(-1, 3).tolist(), [], places, welds=True)


def _read_ply(path: Path) -> FileContents:
    import plyfile

    content = path.read_bytes()
    start = content.find(b"\nend_header")
    if b"format ascii" in content[:start] and b"_" in content[start + len(b"\nend_header") :]:
        line = content[: content.index(b"_", start + len(b"\nend_header"))].count(b"\n")
        row = content.splitlines()[line]
        raise _misread(path, line + 1, row.split(), "numbers")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of empty lists
            data = plyfile.PlyData.read(str(path), mmap=False)
        vertex = data["vertex"].data
        names = [element.name for element in data.elements]
        faces = data["face"].data if "face" in names else None
        corners = next((name for name in CORNERS if faces is not None and name in faces.dtype.names), None)
        return FileContents(
            np.stack([vertex[axis] for axis in "xyz"], axis=1).astype(np.float64),
            [] if faces is None or corners is None else [face.tolist() for face in faces[corners]],
        )
    except (plyfile.PlyParseError, ValueError, OverflowError, KeyError) as error:
        raise FieldFileError(f"{path} is damaged or cut short: {error}") from error
