"""Vertices, faces, normals, colours and fields of a mesh, as files hold them, and binary PLY files of them."""

import shutil
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import IntArray
from bezier_filters.field_arrays import shrink, split_vectors
from bezier_filters.fields import AXES, NORMAL_COLUMNS
from bezier_filters.files.mesh_headers import BYTE_ORDER, HEADER_LIMIT, TRIPLE, parse_header

COLOR_COLUMNS = ("red", "green", "blue", "alpha")
_NAMES = {
    "f8": "double",
    "f4": "float",
    "u1": "uchar",
    "i1": "char",
    "u2": "ushort",
    "i2": "short",
    "u4": "uint",
    "i4": "int",
}


@dataclass(frozen=True)
class MeshData:
    """A mesh, or a point cloud without faces.

    Attributes
    ----------
    vertices : (n, 3) float64 or float32
        Coordinates, possibly not finite.
    faces : (m, 3) int32
        Triangles.
    normals : (n, 3) float64 or None
        Normals of the vertices.
    colors : (n, 4) uint8 or None
        Red, green, blue and alpha of the vertices.
    fields : dict of (n,) and (n, 3) arrays
        Quality and fields, by name.
    notes : tuple of str
        What of a file was not read.
    """

    vertices: NDArray[Any]
    faces: IntArray
    normals: NDArray[Any] | None = None
    colors: NDArray[np.uint8] | None = None
    fields: dict[str, NDArray[Any]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def vertex_table(data: MeshData) -> dict[str, NDArray[Any]]:
    """Columns of the vertices, all but the fields."""
    table: dict[str, NDArray[Any]] = dict(zip(AXES, data.vertices.T, strict=True))
    if data.normals is not None:
        table |= dict(zip(NORMAL_COLUMNS, data.normals.T, strict=True))
    if data.colors is not None:
        table |= dict(zip(COLOR_COLUMNS, data.colors.T, strict=True))
    return table


def shrink_data(data: MeshData) -> MeshData:
    """The same mesh with numbers in the smallest types that hold them: see `shrink`."""
    columns = split_vectors(data.fields)
    normals = data.normals
    return replace(
        data,
        vertices=shrink(AXES, data.vertices, {}),
        normals=None if normals is None else shrink(NORMAL_COLUMNS[0], normals, {}),
        fields={name: shrink(name, values, columns) for name, values in data.fields.items()},
    )


def shrink_ply(path: Path) -> None:
    """Rewrite the vertices of a binary PLY file of pymeshlab in the smallest types that hold them: see `shrink`."""
    with path.open("rb") as stream:
        header = parse_header(path, stream.read(HEADER_LIMIT))
        vertex = header.elements[0]
        if vertex.name != "vertex" or any(item.length_type for item in vertex.properties):  # a list
            return
        stream.seek(0)
        lines = stream.read(header.size).decode("latin-1").split("\n")
        kinds = [(item.name, BYTE_ORDER[header.format] + item.type) for item in vertex.properties]
        rows = np.fromfile(stream, kinds, vertex.count)
        columns = {name: rows[name].astype(kind[1:]) for name, kind in kinds}
        small = {name: shrink(name, values, columns) for name, values in columns.items()}
        axes = [small[axis] for axis in AXES if axis in small]
        if any(values.dtype == np.float64 for values in axes):  # all three alike, as readers expect
            small |= {axis: columns[axis] for axis in AXES}
        first = next(k for k, line in enumerate(lines) if line.startswith("element vertex ")) + 1
        lines[first : first + len(small)] = _declare(small)
        copy = path.with_name(uuid.uuid4().hex)
        with copy.open("wb") as target:
            target.write("\n".join(lines).encode("latin-1"))
            _table_of(small).tofile(target)
            shutil.copyfileobj(stream, target)
    copy.replace(path)


def _declare(columns: Mapping[str, NDArray[Any]]) -> list[str]:
    """Lines of a header that declare columns."""
    return [f"property {_NAMES[_code(values)]} {name}" for name, values in columns.items()]


def _table_of(columns: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    """Rows of columns, in little-endian numbers."""
    count = len(next(iter(columns.values())))
    rows = np.empty(count, [(name, "<" + _code(values)) for name, values in columns.items()])
    for name, values in columns.items():
        rows[name] = values
    return rows


def write_ply(path: Path, data: MeshData) -> None:
    """Write a binary PLY file of a mesh whose fields are columns (n,), in double precision."""
    numbers = {name: np.asarray(values, np.float64) for name, values in data.fields.items()}
    table = vertex_table(data) | numbers
    faces = np.empty(len(data.faces), [("count", "u1"), ("corners", "<i4", TRIPLE)])
    faces["count"], faces["corners"] = TRIPLE, data.faces
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(data.vertices)}"]
    lines += _declare(table)
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header\n"]
    path.write_bytes("\n".join(lines).encode("ascii") + _table_of(table).tobytes() + faces.tobytes())


def _code(values: NDArray[Any]) -> str:
    return f"{values.dtype.kind}{values.dtype.itemsize}"
