"""Per-vertex fields in files: read them from PLY or NPZ, save a `VertexGeometry` as NPZ.

pymeshlab writes custom attributes to PLY files but cannot read them back.
"""

import math
import os
import zipfile
import zlib
from dataclasses import fields
from pathlib import Path
from typing import BinaryIO

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.errors import FieldFileError
from bezier_filters.estimation.vertex_geometry import VertexGeometry
from bezier_filters.files.fields import CURVATURE_FIELDS, TORSION_FIELD
from bezier_filters.files.ply_columns import read_ply_columns
from bezier_filters.files.ply_header import HEADER_LIMIT
from bezier_filters.runtime.atomic import atomic_write

_DEFLATE_LIMIT = 1032  # largest compression ratio that deflate can reach
_DERIVED = sorted(field.attribute for field in (*CURVATURE_FIELDS.values(), TORSION_FIELD))


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
        plain name, shape (n,) or (n, 3).

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
    path = Path(path)
    with path.open("rb") as stream:
        head = stream.read(HEADER_LIMIT)
        if head.startswith(b"PK"):
            return _read_npz(path, stream)
        return read_ply_columns(path, stream, head)


def save_fields(path: str | os.PathLike[str], geometry: VertexGeometry) -> None:
    """Save every array of a `VertexGeometry` to a compressed NPZ file, whole or not at all.

    The file has the arrays of the dataclass and the derived ``mean_curvature``,
    ``gaussian_curvature``, ``geodesic_torsion``, ``curvedness`` and ``shape_index``, under these
    names and with the units and signs of `VertexGeometry`. `read_fields` and `numpy.load` read it.

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
    >>> from bezier_filters.estimation.vertex_geometry import FitChoice
    >>> choice = FitChoice(rings=2, degree=3, alpha=0.8, noise_sigma=None)
    >>> principal = ones, 3 * ones, vectors, vectors, ones, ones
    >>> geometry = VertexGeometry(vectors, *principal, vectors, *[ones] * 4, codes, codes, choice)
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "sphere.npz"
    >>> save_fields(path, geometry)
    >>> read_fields(path)["mean_curvature"]
    array([2., 2.])
    """
    names = [field.name for field in fields(geometry)] + _DERIVED
    arrays = {name: value for name in names if isinstance(value := getattr(geometry, name), np.ndarray)}
    # An open file, because NumPy appends ".npz" to other names.
    with atomic_write(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]


def _read_npz(path: Path, stream: BinaryIO) -> dict[str, FloatArray]:
    try:
        _check_array_sizes(stream, path.stat().st_size)
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as archive:
            return {name: archive[name].astype(np.float64) for name in archive.files}
    except (ValueError, OSError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise FieldFileError(f"{path} is not a sound NPZ file ({error}); write it again with save_fields") from error


def _check_array_sizes(stream: BinaryIO, size: int) -> None:
    """Refuse arrays of other things than numbers, or larger than the file can hold, before NumPy allocates them."""
    with zipfile.ZipFile(stream) as archive:
        for info in archive.infolist():
            with archive.open(info) as member:
                np.lib.format.read_magic(member)
                shape, _, dtype = np.lib.format.read_array_header_1_0(member)
            if dtype.kind not in "biuf":
                raise ValueError(f"{info.filename} holds {dtype}, not numbers")
            if math.prod(shape) * dtype.itemsize > min(info.file_size, _DEFLATE_LIMIT * size):
                raise ValueError(f"{info.filename} claims the shape {shape}")
