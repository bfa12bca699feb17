"""Per-vertex fields in files: read them from PLY or NPZ, save a `VertexGeometry` as NPZ.

pymeshlab writes custom attributes to PLY files but cannot read them. NumPy reads the block of vertices without the
faces; plyfile, which reads lists one by one, is for unusual layouts.
"""

import math
import os
import warnings
import zipfile
import zlib
from dataclasses import fields
from pathlib import Path
from tokenize import TokenError
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arguments import brief_repr, path_of
from bezier_filters.arrays import FloatArray
from bezier_filters.errors import FieldFileError, InvalidParameterError
from bezier_filters.fields import GRADE, PREFIX, QUALITY
from bezier_filters.files.mesh_headers import (
    BYTE_ORDER,
    HEADER_LIMIT,
    TRIPLE,
    PlyHeader,
    check_lines,
    check_size,
    parse_header,
)
from bezier_filters.files.stored_grades import are_grades, grades_of_codes
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.runtime.atomic import atomic_write

_DEFLATE_LIMIT = 1032  # largest compression ratio that deflate can reach
_DAMAGES = (ValueError, OSError, EOFError, RuntimeError, SyntaxError, TokenError, zipfile.BadZipFile, zlib.error)
# columns of versions up to 0.2.0, which wrote codes instead of grades, the best one 0
_CODES, _RINGS = PREFIX + "fit_status", PREFIX + "rings_used"


def read_fields(path: str | os.PathLike[str]) -> dict[str, FloatArray]:
    r"""Read the per-vertex fields of a PLY file, or of an NPZ file from `save_fields`.

    Parameters
    ----------
    path : path
        PLY file (ASCII or binary of either byte order) or NPZ file; the content decides, not
        the suffix.

    Returns
    -------
    dict of str to float64 array
        From PLY: the scalar vertex properties whose names start with ``bz_``, and ``quality``,
        each of shape (n,), whatever their type in the file. From NPZ: every array under its
        plain name, shape (n,) or (n, 3). Status codes in ``bz_fit_status``, which version 0.2.0 wrote, become the
        grades ``bz_fit_grade`` of `FitStatus`; other values become 0, nothing estimated.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    FieldFileError
        The file is neither PLY nor NPZ, is damaged or too short, or has none of these fields.

    Notes
    -----
    pymeshlab rounds to 6 decimals in ASCII files; binary ones keep every bit.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "points.ply"
    >>> header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty double bz_k\nend_header\n"
    >>> _ = path.write_text(header + "0 1.5\n1 -2\n")
    >>> read_fields(path)
    {'bz_k': array([ 1.5, -2. ])}
    """
    path = Path(path_of(path))
    with path.open("rb") as stream:
        head = stream.read(HEADER_LIMIT)
        if head.startswith(b"PK"):
            return _read_npz(path, stream)
        return _read_ply(path, stream, head)


def save_fields(path: str | os.PathLike[str], geometry: VertexGeometry) -> None:
    """Save every array of a `VertexGeometry` to a compressed NPZ file, atomically.

    The file has the arrays of the dataclass and derived ones such as ``mean_curvature``,
    ``shape_index`` and ``fit_grade``, under these names and with the units and signs of `VertexGeometry`.
    `read_fields` and `numpy.load` read it.

    Parameters
    ----------
    path : path
        File to write or replace, normally ``*.npz``; no suffix is added.
    geometry : VertexGeometry
        Geometry of n vertices.

    Raises
    ------
    OSError
        The file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> ones, vectors, codes = np.ones(2), np.zeros((2, 3)), np.zeros(2, np.int32)
    >>> from bezier_filters.fitting.vertex_geometry import FitChoice
    >>> choice = FitChoice(rings=2, degree=3, alpha=0.8, noise_sigma=None)
    >>> principal = ones, 3 * ones, vectors, vectors, ones, ones
    >>> geometry = VertexGeometry(vectors, *principal, vectors, *[ones] * 4, codes, codes, choice)
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "sphere.npz"
    >>> save_fields(path, geometry)
    >>> read_fields(path)["mean_curvature"]
    array([2., 2.])
    """
    path_of(path)
    if not isinstance(geometry, VertexGeometry):
        raise InvalidParameterError(
            f"geometry: got {brief_repr(geometry)}, expected a VertexGeometry, as of estimate_vertex_geometry; "
            "numpy.savez(path, **arrays) saves a dict of arrays"
        )
    names = [field.name for field in fields(geometry)]
    arrays = {name: value for name in names if isinstance(value := getattr(geometry, name), np.ndarray)}
    # An open file, because NumPy appends ".npz" to other names.
    with atomic_write(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]


def _read_npz(path: Path, stream: BinaryIO) -> dict[str, FloatArray]:
    try:
        with zipfile.ZipFile(stream) as archive:  # arrays are looked at before NumPy allocates them
            for info in archive.infolist():
                with archive.open(info) as member:
                    np.lib.format.read_magic(member)
                    shape, _, dtype = np.lib.format.read_array_header_1_0(member)
                if dtype.kind not in "biuf":
                    raise ValueError(f"{info.filename} holds {dtype}, not numbers")
                if math.prod(shape) * dtype.itemsize > min(info.file_size, _DEFLATE_LIMIT * path.stat().st_size):
                    raise ValueError(f"{info.filename} claims the shape {shape}")
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as arrays:
            return {name: arrays[name].astype(np.float64) for name in arrays.files}
    except _DAMAGES as error:
        raise FieldFileError(f"{path} is not a complete NPZ file ({error}); write it again with save_fields") from error


def _read_ply(path: Path, stream: BinaryIO, head: bytes) -> dict[str, FloatArray]:
    """The scalar columns ``bz_*`` and ``quality`` of the vertices of a file that begins with `head`."""
    header = parse_header(path, head)
    names = _field_names(path, header)
    check_size(path, header)
    if header.is_ascii:
        check_lines(path, stream, header)
    rows = _read_regular(stream, header)
    if rows is None:
        rows = _read_irregular(path)
    return _repair_grades({name: rows[name].astype(np.float64) for name in names})


def _repair_grades(columns: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Make the column of grades valid, if there is one, for files of earlier versions and other programs."""
    if GRADE in columns:
        columns[GRADE] = np.where(are_grades(columns[GRADE]), columns[GRADE], 0.0)
    if _CODES in columns:
        grades = grades_of_codes(columns.pop(_CODES), columns.get(_RINGS))
        columns.setdefault(GRADE, grades)
    return columns


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


def _read_regular(stream: BinaryIO, header: PlyHeader) -> NDArray[Any] | None:
    """Vertices as a structured array, without reading the faces; None if lists make rows irregular.

    Faces behind the vertices cost nothing.
    """
    before, vertex = header.elements[: header.vertex_index], header.elements[header.vertex_index]
    if any(item.length_type for element in before for item in element.properties):
        return None
    stream.seek(header.size)
    if header.is_ascii:
        numbers = np.dtype([(name, "f8") for name, _ in vertex.columns])
        skipped = sum(element.count for element in before)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # NumPy only warns of empty lines
                rows = np.loadtxt(stream, numbers, comments=None, skiprows=skipped, max_rows=vertex.count, ndmin=1)
        except (ValueError, UserWarning):
            return None
    else:
        stream.seek(sum(element.count * element.least_row_size(is_ascii=False) for element in before), os.SEEK_CUR)
        dtype = np.dtype([(name, BYTE_ORDER[header.format] + code) for name, code in vertex.columns])
        rows = np.fromfile(stream, dtype, vertex.count)
    lists = [item.name for item in vertex.properties if item.length_type]
    if len(rows) < vertex.count or any((rows[f"{name} length"] != TRIPLE).any() for name in lists):
        return None
    return rows


def _read_irregular(path: Path) -> NDArray[Any]:
    """Vertices read by plyfile: slow, but correct for every layout, with messages about faults."""
    import plyfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # plyfile warns of empty lists
            rows: NDArray[Any] = plyfile.PlyData.read(str(path), mmap=False)["vertex"].data
    except (plyfile.PlyParseError, ValueError, OverflowError) as error:
        raise FieldFileError(f"{path} is damaged or cut short: {error}") from error
    return rows
