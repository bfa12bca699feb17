"""The field columns of PLY files, which pymeshlab writes but cannot read.

NumPy reads the block of the vertices and never touches the faces; plyfile is the fallback for
unusual layouts.
"""

import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray
from bezier_filters.errors import FieldFileError
from bezier_filters.files.fields import PREFIX
from bezier_filters.files.ply_header import (
    BYTE_ORDER,
    TRIPLE,
    PlyElement,
    PlyHeader,
    check_lines,
    check_size,
    parse_header,
)

QUALITY = "quality"

_Columns: TypeAlias = Mapping[str, NDArray[Any]]


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
    header = parse_header(path, head)
    names = _field_names(path, header)
    check_size(path, header)
    if header.is_ascii:
        check_lines(path, stream, header)
    rows = _read_regular(stream, header)
    if rows is None:
        rows = _read_irregular(path)
    return {name: rows[name].astype(np.float64) for name in names}


def _field_names(path: Path, header: PlyHeader) -> list[str]:
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


def _read_regular(stream: BinaryIO, header: PlyHeader) -> _Columns | None:
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
        columns = _binary_columns(stream, vertex, BYTE_ORDER[header.format])
    lists = [item.name for item in vertex.properties if item.length_type]
    if columns is None or any((columns[f"{name} length"] != TRIPLE).any() for name in lists):
        return None
    return columns


def _binary_columns(stream: BinaryIO, vertex: PlyElement, byte_order: str) -> _Columns | None:
    dtype = np.dtype([(name, byte_order + code) for name, code in vertex.columns])
    rows = np.fromfile(stream, dtype, vertex.count)
    return {name: rows[name] for name, _ in vertex.columns} if len(rows) == vertex.count else None


def _ascii_columns(stream: BinaryIO, vertex: PlyElement) -> _Columns | None:
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
