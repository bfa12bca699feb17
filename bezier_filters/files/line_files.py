"""Files of lines: pymeshlab saves no edges, so PLY and OBJ files of them are written here."""

import os
from pathlib import Path

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.runtime.atomic import atomic_write

SUFFIXES = (".ply", ".obj")


def check_line_file(path: str | os.PathLike[str]) -> None:
    """Refuse a file name whose suffix stands for no format of lines.

    Raises
    ------
    InvalidParameterError
        The message lists those that can be used.
    """
    if Path(path).suffix.lower() not in SUFFIXES:
        raise InvalidParameterError(f"{path}: lines can be saved as {' and '.join(SUFFIXES)} files only")


def save_lines(
    path: str | os.PathLike[str], points: FloatArray, edges: IntArray, values: FloatArray, colors: FloatArray
) -> None:
    """Write points and the edges between them, whole or not at all.

    PLY files are text with an element ``edge``, which MeshLab, pymeshlab and Blender read, with the quality and the
    colours of the points; OBJ files have ``l`` lines, which ParaView reads, too, and no quality. Coordinates come back
    exactly.

    Parameters
    ----------
    path : path
        Ends in .ply or .obj.
    points : (k, 3) float64
    edges : (e, 2) int32
        Rows of `points`.
    values : (k,) float64
        Quality.
    colors : (k, 3) float64
        Red, green, blue from 0 to 1.

    Raises
    ------
    InvalidParameterError
        Another suffix.
    OSError
        The file cannot be written.
    """
    check_line_file(path)
    text = _ply if Path(path).suffix.lower() == ".ply" else _obj
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join(text(points, edges, values, colors)) + "\n", encoding="ascii")


def _ply(points: FloatArray, edges: IntArray, values: FloatArray, colors: FloatArray) -> list[str]:
    header = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
    header += [f"property double {name}" for name in "xyz"]
    header += [f"property uchar {name}" for name in ("red", "green", "blue", "alpha")]
    header += ["property double quality", f"element edge {len(edges)}"]
    header += ["property int vertex1", "property int vertex2", "end_header"]
    bytes_ = np.rint(255.0 * colors).astype(int)
    rows = zip(points.tolist(), bytes_.tolist(), values.tolist(), strict=True)
    lines = [f"{x!r} {y!r} {z!r} {r} {g} {b} 255 {value!r}" for (x, y, z), (r, g, b), value in rows]
    return [*header, *lines, *(f"{a} {b}" for a, b in edges.tolist())]


def _obj(points: FloatArray, edges: IntArray, values: FloatArray, colors: FloatArray) -> list[str]:
    rows = zip(points.tolist(), colors.tolist(), strict=True)
    lines = [f"v {x!r} {y!r} {z!r} {r:.4g} {g:.4g} {b:.4g}" for (x, y, z), (r, g, b) in rows]
    return [*lines, *(f"l {a} {b}" for a, b in (edges + 1).tolist())]
