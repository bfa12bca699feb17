"""Meshes on disk of any size: binary PLY files, or pairs of NPY files."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from bezier_filters.arrays import IntArray
from bezier_filters.errors import FieldFileError, InvalidMeshError
from bezier_filters.files.mesh_headers import (
    BYTE_ORDER,
    CORNERS,
    HEADER_LIMIT,
    TRIPLE,
    PlyElement,
    PlyHeader,
    parse_header,
)
from bezier_filters.runtime.checksums import stream_checksum
from bezier_filters.scale.array_file import ArrayFile, DType, Values, array_layout
from bezier_filters.scale.remote import Location, RemotePath, locate

# a PLY file, or a pair of NPY files with vertices (n, 3) and faces (m, 3)
SourcePath: TypeAlias = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]

# name, size, modification time and checksum of each file
Fingerprint: TypeAlias = list[list[str | int]]
MAX_ELEMENTS = np.iinfo(np.int32).max  # largest number of vertices or faces


@dataclass(frozen=True)
class MeshSource:
    """A mesh in one or two files, with rows at known offsets."""

    paths: tuple[Location, ...]
    vertex_rows: ArrayFile  # with the columns x, y and z among others, or nothing but the coordinates
    face_rows: ArrayFile
    corners: str = ""  # name of the list of corners; empty if a row consists of corners alone

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""
        return self.vertex_rows.rows

    @property
    def face_count(self) -> int:
        """Number of triangles."""
        return self.face_rows.rows

    @property
    def dtype(self) -> DType:
        """Of the coordinates: float32 or float64."""
        rows = self.vertex_rows.dtype
        return np.result_type(*(rows[axis] for axis in "xyz")) if rows.names else rows.base.newbyteorder("=")

    def vertices(self, start: int, stop: int) -> Values:
        """Coordinates of vertices start .. stop-1, (k, 3)."""
        rows = self.vertex_rows.read(start, stop)
        if rows.dtype.names:
            rows = np.column_stack([rows[axis] for axis in "xyz"])
        return np.ascontiguousarray(rows, dtype=self.dtype)

    def faces(self, start: int, stop: int) -> IntArray:
        """Corners of faces start .. stop-1, (k, 3); InvalidMeshError if one is no triangle of vertices that exist."""
        rows = self.face_rows.read(start, stop)
        if self.corners:
            sizes = rows[f"{self.corners} length"]
            if (sizes != TRIPLE).any():
                face = start + int(np.flatnonzero(sizes != TRIPLE)[0])
                raise InvalidMeshError(
                    f"{self.paths[-1]}: face {face} has {sizes[face - start]} corners, expected triangles only; "
                    "triangulate polygons first"
                )
            rows = np.column_stack([rows[f"{self.corners} {k}"] for k in range(TRIPLE)])
        if rows.size and (rows.min() < 0 or rows.max() >= self.vertex_count):
            raise InvalidMeshError(
                f"{self.paths[-1]}: corners of faces {start} to {stop - 1} run from {rows.min()} to {rows.max()}, "
                f"expected 0 to {self.vertex_count - 1}"
            )
        return np.ascontiguousarray(rows, dtype=np.int32)

    def fingerprint(self) -> Fingerprint:
        """Fingerprint by which changes of the files are detected."""
        return [_fingerprint(path) for path in self.paths]


def open_source(source: SourcePath) -> MeshSource:
    """Read the layout of a mesh file, without the data.

    FieldFileError if a file is damaged, truncated or of another kind; InvalidMeshError if it has no faces or too many.
    """
    if isinstance(source, str | os.PathLike):
        result = _open_ply(locate(source, "source"))
    else:
        paths = [locate(path, "source") for path in source]
        if len(paths) != 2:
            raise FieldFileError(f"source: got {len(paths)} files, expected a PLY file, or NPY files of both arrays")
        result = MeshSource(tuple(paths), _open_npy(paths[0], "f"), _open_npy(paths[1], "iu"))
    if not result.face_count:
        raise InvalidMeshError(
            f"{result.paths[0]} has no faces; point clouds are estimated in memory only: bezier-filters curvature"
        )
    n, m = result.vertex_count, result.face_count
    if max(n, m) > MAX_ELEMENTS:
        raise InvalidMeshError(
            f"{result.paths[0]} has {n} vertices and {m} faces, expected {MAX_ELEMENTS} of each at most"
        )
    return result


def _open_ply(path: Location) -> MeshSource:
    with path.open("rb") as stream:
        header = parse_header(path, stream.read(HEADER_LIMIT))
    if header.is_ascii:
        raise FieldFileError(f"{path} is an ASCII file, whose rows have no known place; save it as binary PLY")
    names = [element.name for element in header.elements]
    if "vertex" not in names or "face" not in names:
        raise FieldFileError(f"{path} holds {', '.join(names) or 'nothing'}; expected vertices and faces")
    vertex, face = (header.elements[names.index(name)] for name in ("vertex", "face"))
    kinds = {item.name: item.type for item in vertex.properties if not item.length_type}
    if not all(kinds.get(axis) in ("f4", "f8") for axis in "xyz"):
        raise FieldFileError(f"{path}: its vertices have {', '.join(kinds)}; expected x, y and z as float or double")
    corners = [item for item in face.properties if item.name in CORNERS and item.length_type]
    if len(corners) != 1 or corners[0].type not in ("i4", "u4"):
        raise FieldFileError(f"{path}: its faces have no list vertex_indices of int or uint")
    offset, places = header.size, dict[str, ArrayFile]()
    for element in header.elements:
        places[element.name] = rows = _rows_of(path, header, element, offset)
        offset += rows.rows * rows.dtype.itemsize
        if "vertex" in places and "face" in places:
            break
    if _size(path) < offset:
        raise FieldFileError(
            f"{path} is cut short or damaged, or has faces other than triangles: triangles would take {offset} bytes, "
            f"it has {_size(path)}"
        )
    return MeshSource((path,), places["vertex"], places["face"], corners[0].name)


def _rows_of(path: Location, header: PlyHeader, element: PlyElement, offset: int) -> ArrayFile:
    """Table of an element with rows of equal length; the only list may be that of triangles."""
    lists = [item.name for item in element.properties if item.length_type]
    if lists and (element.name != "face" or lists[0] not in CORNERS or len(lists) > 1):
        raise FieldFileError(
            f"{path}: the element {element.name} has lists of any length ({', '.join(lists)}), so that rows have no "
            "fixed offsets; save it without them"
        )
    order = BYTE_ORDER[header.format]
    dtype = np.dtype([(name, order + code) for name, code in element.columns])
    return ArrayFile(path, dtype, element.count, offset)


def _open_npy(path: Location, kinds: str) -> ArrayFile:
    """The table (n, 3) of an NPY file."""
    try:
        dtype, shape, fortran, offset = array_layout(path)
        if _size(path) < offset + dtype.itemsize * math.prod(shape):
            raise ValueError(f"{_size(path)} bytes are too few for {dtype} of shape {shape}")
    except (ValueError, EOFError) as error:
        raise FieldFileError(f"{path} is no NPY file, or cut short: {error}") from error
    expected = dtype.kind in kinds and dtype.itemsize in (4, 8)
    if len(shape) != 2 or shape[1] != 3 or fortran or not expected:
        wanted = "float32 or float64" if kinds == "f" else "integers of 4 or 8 bytes"
        raise FieldFileError(
            f"{path}: got {dtype} of shape {shape}{' in Fortran order' * fortran}, expected {wanted} of shape (n, 3), "
            "row after row (numpy.ascontiguousarray)"
        )
    return ArrayFile(path, np.dtype((dtype, 3)), shape[0], offset)


def _size(path: Location) -> int:
    return path.size() if isinstance(path, RemotePath) else path.stat().st_size


def _fingerprint(path: Location) -> list[str | int]:
    with path.open("rb") as stream:
        checksum = stream_checksum(stream)
    changed = 0 if isinstance(path, RemotePath) else path.stat().st_mtime_ns  # file systems name it differently
    return [path.name, _size(path), changed, checksum]
