"""Meshes and point clouds as tables: CSV, NPZ and LAS files.

CSV and LAS files have no faces. A CSV file without a header has coordinates first.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.errors import FieldFileError
from bezier_filters.field_arrays import split_vectors
from bezier_filters.fields import AXES, NORMAL_COLUMNS, PREFIX, QUALITY
from bezier_filters.files.field_files import read_fields
from bezier_filters.files.mesh_data import COLOR_COLUMNS, MeshData, vertex_table
from bezier_filters.runtime.extras import import_extra

_DELIMITERS = (";", "\t", ",")  # a comma may be part of a number only where another one is there, which is refused
_CHANNEL_MAX = 255
_CSV_BLOCK_ROWS = 4096
_LAS_CHANNEL_STEP = 257  # 16 bits of LAS for each of 8
INTENSITY = PREFIX + "intensity"  # column of the strength of the returned light, in the unit of the file
# names of columns in other programs
_NAMES = {"r": "red", "g": "green", "b": "blue", "a": "alpha"}
_NAMES |= {"i": INTENSITY, "intensity": INTENSITY, "reflectance": INTENSITY, "scalar_intensity": INTENSITY}
_NAMES |= {f"normal_{axis}": name for axis, name in zip(AXES, NORMAL_COLUMNS, strict=True)}


def write_csv(path: Path, data: MeshData) -> None:
    """Write a row for each vertex, with a header, without faces; a number has the fewest digits that give it back."""
    columns = vertex_table(data) | split_vectors(data.fields)
    with path.open("w", encoding="ascii", newline="\n") as stream:
        stream.write(",".join(columns) + "\n")
        for start in range(0, len(data.vertices), _CSV_BLOCK_ROWS):
            block = [values[start : start + _CSV_BLOCK_ROWS].astype(str).tolist() for values in columns.values()]
            stream.writelines(",".join(row) + "\n" for row in zip(*block, strict=True))


def read_csv(path: Path) -> MeshData:
    """Read the points of a text file with columns x, y and z, and perhaps normals, colours, quality and ``bz_*``."""
    try:
        with path.open(encoding="utf-8-sig") as stream:
            head = stream.readline().strip().lstrip("/#").strip()
    except UnicodeDecodeError as error:
        raise FieldFileError(f"{path} is no text: {error}") from error
    delimiter = next((each for each in _DELIMITERS if each in head), None)
    words = [word.strip().strip('"') for word in head.split(delimiter)]
    has_header = not all(map(_is_number, words))
    names = [_column_name(word) for word in words] if has_header else [*AXES, *map(str, range(3, len(words)))]
    missing = [axis for axis in AXES if axis not in names]
    if missing or len(set(names)) < len(names):
        raise FieldFileError(f"{path} has the columns {', '.join(words)}, expected x, y and z among them, each once")
    try:
        with path.open(encoding="utf-8-sig") as stream:
            rows = np.loadtxt(stream, delimiter=delimiter, skiprows=int(has_header), ndmin=2, comments=None)
    except ValueError as error:
        raise FieldFileError(f"{path} has a faulty row: {error}") from error
    if rows.size and rows.shape[1] != len(names):
        raise FieldFileError(f"{path} has {len(names)} names of columns, but {rows.shape[1]} numbers in a row")
    columns = dict(zip(names, rows.reshape(-1, len(names)).T, strict=True))
    return cloud_of_columns(path, columns)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _column_name(word: str) -> str:
    """Name of a column here: lower case, with full names of colours and normals."""
    name = word.lower()
    return _NAMES.get(name, name)


def header_names(line: str) -> list[str] | None:
    """Names of columns in a line of text; None if it consists of numbers."""
    words = line.lstrip("/#").split()
    return None if all(map(_is_number, words)) and not line.startswith("#") else [_column_name(word) for word in words]


def cloud_of_columns(path: Path, columns: Mapping[str, NDArray[Any]]) -> MeshData:
    """Points of columns with names; others than those of this package are not read."""
    columns = {_column_name(name): values for name, values in columns.items()}
    fields = {
        name: np.asarray(v, np.float64) for name, v in columns.items() if name == QUALITY or name.startswith(PREFIX)
    }
    normals = _stack(columns, NORMAL_COLUMNS)
    colors = _stack(columns, COLOR_COLUMNS[:3])
    used = {*AXES, *fields, *(NORMAL_COLUMNS if normals is not None else ())}
    rgba = None
    if colors is not None and ((colors >= 0) & (colors <= _CHANNEL_MAX)).all():
        alpha = columns.get("alpha", np.full(len(colors), _CHANNEL_MAX))
        rgba = np.rint(np.column_stack([colors, alpha])).astype(np.uint8)
        used |= set(COLOR_COLUMNS)
    left = [name for name in columns if name not in used]
    notes = (f"columns that were not read: {', '.join(left)}",) if left else ()
    vertices = np.column_stack([columns[axis] for axis in AXES]).astype(np.float64)
    return MeshData(vertices, np.empty((0, 3), np.int32), normals, rgba, fields, notes)


def _stack(columns: Mapping[str, NDArray[Any]], names: Sequence[str]) -> NDArray[Any] | None:
    return np.column_stack([columns[name] for name in names]) if all(name in columns for name in names) else None


def write_npz(path: Path, data: MeshData) -> None:
    """Write the arrays ``vertices``, ``faces``, ``normals``, ``colors`` and the fields under their names."""
    arrays: dict[str, NDArray[Any]] = {"vertices": data.vertices, "faces": data.faces}
    arrays |= {} if data.normals is None else {"normals": data.normals}
    arrays |= {} if data.colors is None else {"colors": data.colors}
    with path.open("wb") as stream:  # NumPy appends ".npz" to other names
        np.savez_compressed(stream, **(arrays | data.fields))  # type: ignore[arg-type]


def read_npz(path: Path) -> MeshData:
    """Read a mesh of `write_npz`, or any file with the arrays ``vertices`` and, for a surface, ``faces``."""
    arrays = read_fields(path)
    if "vertices" not in arrays:
        raise FieldFileError(f"{path} has no array 'vertices', so it holds no mesh; it has {', '.join(arrays)}")
    vertices, faces = arrays.pop("vertices"), arrays.pop("faces", np.empty((0, 3)))
    n = len(vertices)
    corners = faces.astype(np.int32)
    is_mesh = vertices.shape == (n, 3) and faces.shape == (len(faces), 3) and (corners == faces).all()
    if not is_mesh or (corners.size and not 0 <= corners.min() <= corners.max() < n):
        raise FieldFileError(f"{path} has vertices {vertices.shape} and faces {faces.shape} that are no triangle mesh")
    normals, colors = arrays.pop("normals", None), arrays.pop("colors", None)
    fields = {name: v for name, v in arrays.items() if v.shape in ((n,), (n, 3)) and _is_field(name)}
    left = [name for name in arrays if name not in fields]
    has_colors = colors is not None and colors.shape == (n, 4)
    return MeshData(
        vertices,
        corners,
        normals if normals is not None and normals.shape == (n, 3) else None,
        colors.astype(np.uint8) if colors is not None and has_colors else None,
        split_vectors(fields),
        (f"arrays that were not read: {', '.join(left)}",) if left else (),
    )


def _is_field(name: str) -> bool:
    return name == QUALITY or name.startswith(PREFIX)


def read_las(path: Path) -> MeshData:
    """Read the points, intensities and colours of a LAS file, or of a LAZ file if laspy can decompress it."""
    laspy = import_extra("laspy")
    try:
        las = laspy.read(path)
        points = np.asarray(las.xyz, np.float64)
    except (laspy.LaspyException, ValueError, EOFError, OverflowError) as error:
        raise FieldFileError(f"{path} is no readable LAS file: {error}") from error
    names = list(las.point_format.dimension_names)
    colors = None
    if set(COLOR_COLUMNS[:3]) <= set(names):
        channels = np.column_stack([np.asarray(las[name]) for name in COLOR_COLUMNS[:3]])
        step = _LAS_CHANNEL_STEP if channels.max(initial=0) > _CHANNEL_MAX else 1  # some programs write 8 bits
        colors = np.rint(np.insert(channels / step, 3, _CHANNEL_MAX, axis=1)).astype(np.uint8)
    used = {"X", "Y", "Z", "intensity", *(COLOR_COLUMNS if colors is not None else ())}
    intensity = np.asarray(las["intensity"], np.float64)
    fields = {INTENSITY: intensity} if intensity.any() else {}
    left = [name for name in names if name not in used and np.asarray(las[name]).any()]
    notes = (f"dimensions that were not read: {', '.join(left)}",) if left else ()
    return MeshData(points, np.empty((0, 3), np.int32), None, colors, fields, notes)
