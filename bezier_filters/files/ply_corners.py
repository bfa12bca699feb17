"""Corners of faces in binary PLY files, row by row, as faces may have any number of corners.

pymeshlab checks the corners of triangles only; those of other faces may lead it out of bounds.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.errors import FieldFileError
from bezier_filters.files.mesh_headers import BYTE_ORDER, PlyElement, PlyHeader
from bezier_filters.runtime.jit import jit

_BIG = ">"


@dataclass(frozen=True)
class FaceRows:
    """Contents of the rows of faces."""

    triangles: int  # after triangulation
    bytes_left: int  # bytes behind the last row of the file


def read_face_rows(path: Path, header: PlyHeader) -> FaceRows:
    """Read the faces of a binary file with no list but the corners.

    `FieldFileError` if a corner is out of range.
    """
    data = np.fromfile(path, np.uint8)
    start, triangles = header.size, 0
    for element in header.elements:
        if element.name == "face":
            sizes, places, start = _walk(element, data, start, BYTE_ORDER[header.format])
            triangles = int(np.maximum(sizes - 2, 0).sum())
            item = next(item for item in element.properties if item.length_type)
            kind = np.dtype(BYTE_ORDER[header.format] + item.type)
            for size in np.unique(sizes[sizes > 0]):
                chosen = np.flatnonzero(sizes == size)
                reach = np.arange(size * kind.itemsize)
                corners = data[places[chosen, np.newaxis] + reach].view(kind)
                check_corners(path, corners, chosen, header.elements[header.vertex_index].count)
        else:
            start += element.count * element.least_row_size(is_ascii=False)
    return FaceRows(triangles, len(data) - start)


def check_corners(path: Path, corners: NDArray[Any], rows: NDArray[np.intp], vertices: int) -> None:
    """Refuse corners (k, size) of faces that are out of range; `rows` are the faces' rows in the file."""
    is_wrong = (corners < 0) | (corners >= vertices)
    if is_wrong.any():
        row, place = np.argwhere(is_wrong)[0]
        raise FieldFileError(
            f"{path} has no vertex {corners[row, place]}, which its face {rows[row]} names: it has {vertices} vertices"
        )


def _walk(
    element: PlyElement, data: NDArray[np.uint8], start: int, order: str
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Sizes of the lists of an element, offsets of their first entries, and the end of its rows."""
    index = next(k for k, item in enumerate(element.properties) if item.length_type)
    item, sizes = element.properties[index], [int(item.type[1]) for item in element.properties]
    lengths, places = np.zeros((2, element.count), np.int64)
    layout = np.array([sum(sizes[:index]), int(item.length_type[1]), sizes[index], sum(sizes[index + 1 :])])
    end = _follow(data, start, layout, order == _BIG, lengths, places)
    return lengths, places, int(end)


@jit()
def _follow(
    data: NDArray[np.uint8],
    start: int,
    layout: NDArray[np.int64],
    is_big: bool,
    lengths: NDArray[np.int64],
    places: NDArray[np.int64],
) -> int:
    """Write the lengths and offsets of lists; lists beyond the end of the data stay 0.

    The layout is the bytes before a list, of its length, of an entry, and after it.
    """
    before, width, entry, after = layout[0], layout[1], layout[2], layout[3]
    end = start
    for row in range(lengths.shape[0]):
        place = end + before
        if place + width > data.shape[0]:
            return int(data.shape[0] + 1)
        length = 0
        for k in range(width):
            length = 256 * length + data[place + (k if is_big else width - 1 - k)]
        place += width
        end = place + length * entry + after
        if end > data.shape[0]:
            return int(end)
        lengths[row], places[row] = length, place
    return int(end)
