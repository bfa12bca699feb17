"""Writers that pymeshlab lacks: text PLY files with any columns, and lines as PLY, OBJ and VTP files."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fields import QUALITY
from bezier_filters.files.host_formats import vtk_text
from bezier_filters.files.mesh_data import MeshData
from bezier_filters.runtime.atomic import atomic_write

SUFFIXES = (".ply", ".obj", ".vtp")


def ply_text(elements: Mapping[str, Mapping[str, NDArray[np.generic]]], comments: Sequence[str] = ()) -> str:
    """Text of a PLY file, given the columns of its elements by declarations such as ``double x``; lists are (n, k).

    >>> print(ply_text({"face": {"list uchar int vertex_indices": np.array([[0, 1, 2]])}}).splitlines()[-1])
    3 0 1 2
    """
    head, rows = ["ply", "format ascii 1.0", *(f"comment {comment}" for comment in comments)], list[str]()
    for name, columns in elements.items():
        table = list[list[object]]()
        for values in columns.values():
            if values.ndim > 1:
                table.append([values.shape[1]] * len(values))
            table += [column.tolist() for column in np.atleast_2d(values.T)]
        head += [f"element {name} {len(table[0])}", *(f"property {declaration}" for declaration in columns)]
        rows += [" ".join(map(repr, row)) for row in zip(*table, strict=True)]
    return "\n".join([*head, "end_header", *rows]) + "\n"


def coordinate_columns(points: FloatArray) -> dict[str, FloatArray]:
    """Columns of coordinates (n, 3)."""
    return {f"double {axis}": points[:, k] for k, axis in enumerate("xyz")}


def color_columns(colors: FloatArray) -> dict[str, IntArray]:
    """Columns of colours from 0 to 1, (n, 4)."""
    bytes_ = np.rint(255.0 * colors).astype(np.int32)
    return {f"uchar {channel}": bytes_[:, k] for k, channel in enumerate(("red", "green", "blue", "alpha"))}


def check_line_file(path: str | os.PathLike[str]) -> None:
    """Refuse a file name whose suffix is not that of a format for lines."""
    if Path(path).suffix.lower() not in SUFFIXES:
        raise InvalidParameterError(f"{path}: lines can be saved as {', '.join(SUFFIXES)} files only")


def save_lines(
    path: str | os.PathLike[str],
    points: FloatArray,
    edges: IntArray,
    values: FloatArray,
    colors: FloatArray,
    columns: Mapping[str, FloatArray] = MappingProxyType({}),
) -> None:
    """Write points (k, 3) and edges (e, 2) between them, with a quality (k,) and colours (k, 3) from 0 to 1.

    Other columns (k,) have names. VTP files have all of it, for ParaView and pyvista. PLY files are text with an
    element ``edge``, which MeshLab, pymeshlab and Blender read, with the quality, the columns and the colours of the
    points; OBJ files have ``l`` lines, which ParaView reads, too, and no quality. Coordinates come back exactly.
    """
    check_line_file(path)
    rgba = np.rint(255.0 * np.insert(colors, 3, 1.0, axis=1)).astype(np.uint8)
    if Path(path).suffix.lower() == ".vtp":
        data = MeshData(points, np.empty((0, 3), np.int32), None, rgba, {QUALITY: values, **columns})
        text = vtk_text(data, is_grid=False, edges=edges)
    elif Path(path).suffix.lower() == ".ply":
        vertices: dict[str, NDArray[np.generic]] = {**coordinate_columns(points)}
        vertices |= color_columns(np.insert(colors, 3, 1.0, axis=1))
        vertices |= {"double quality": values, **{f"double {name}": column for name, column in columns.items()}}
        ends = {"int vertex1": edges[:, 0], "int vertex2": edges[:, 1]}
        text = ply_text({"vertex": vertices, "edge": ends})
    else:
        rows = zip(points.tolist(), colors.tolist(), strict=True)
        lines = [f"v {x!r} {y!r} {z!r} {r:.4g} {g:.4g} {b:.4g}" for (x, y, z), (r, g, b) in rows]
        text = "\n".join([*lines, *(f"l {a} {b}" for a, b in (edges + 1).tolist())]) + "\n"
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="ascii")
