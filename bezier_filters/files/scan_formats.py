"""Point clouds as scanners and their programs write them: PCD, PTS, PTX, XYZ and E57 files.

Coordinates stay in double precision, with their offset. Points that a scanner has not measured are left out, and their
number is noted. Intensities become the column ``bz_intensity``, and the places of the scanner, where files have them,
the columns ``bz_viewpoint_x`` to ``_z``.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import FloatArray
from bezier_filters.errors import FieldFileError
from bezier_filters.fields import AXES, NORMAL_COLUMNS, VIEWPOINT_COLUMNS
from bezier_filters.files.data_tables import cloud_of_columns, header_names
from bezier_filters.files.mesh_data import COLOR_COLUMNS, MeshData
from bezier_filters.runtime.extras import import_extra

_RGB = COLOR_COLUMNS[:3]
# columns of text without names, by their number; six are coordinates with colours or with normals
_COLUMNS = {3: AXES, 4: (*AXES, "intensity"), 7: (*AXES, "intensity", *_RGB), 9: (*AXES, *_RGB, *NORMAL_COLUMNS)}
_UNIT_LENGTH_TOLERANCE = 0.01  # of the normals in six columns
_PTX_HEADER_ROWS = 8  # position, three axes and the four rows of a matrix, after the two counts
_PCD_KINDS = {"F": "f", "I": "i", "U": "u"}
_PCD_WORDS = ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA")
_LZF_LITERALS = 32  # control bytes below this are lengths of literal bytes, less 1; others refer to earlier bytes


def has_only_coordinates(path: Path) -> bool:
    """Whether the first row of an XYZ or PTS file is three numbers; pymeshlab reads such files."""
    words = next((words for words in map(str.split, _text_lines(path)) if len(words) > 1), [])
    return len(words) == len(AXES) and header_names(" ".join(words)) is None


def read_xyz(path: Path) -> MeshData:
    """Read rows of numbers, after a header with names, comments or a number of points, or after none."""
    lines, names = _text_lines(path), tuple[str, ...]()
    first: list[str] = []
    for line in lines:
        found = header_names(line)
        if found is None:
            if len(line.split()) > 1:
                first = [line]
                break
        elif set(AXES) <= set(found):
            names = tuple(found)
    rows = _table(path, _chain(first, lines))
    return _cloud_of_rows(path, rows, names)


def read_pts(path: Path) -> MeshData:
    """Read the scans of a PTS file: a number of points before the rows x y z, intensity and colours of each."""
    announced = list[int]()

    def rows_of_points() -> Iterator[str]:
        for line in _text_lines(path):
            if line.isdigit():
                announced.append(int(line))
            else:
                yield line

    rows = _table(path, rows_of_points())
    if announced and sum(announced) != len(rows):
        raise FieldFileError(
            f"{path} is cut short or damaged: it announces {sum(announced)} points, but holds {len(rows)}"
        )
    return _cloud_of_rows(path, rows)


def read_ptx(path: Path) -> MeshData:
    """Read the scans of a PTX file: two numbers of points, a pose, and rows in the frame of the scanner."""
    lines, scans, places = _text_lines(path), [], []
    for line in lines:
        try:
            count = int(line) * int(next(lines))
            pose = np.array([list(map(float, next(lines).split()))[:4] for _ in range(_PTX_HEADER_ROWS)][4:])
        except (StopIteration, ValueError) as error:
            raise FieldFileError(f"{path} has a faulty header of a scan: {error}") from error
        rows = _table(path, (row for _, row in zip(range(count), lines, strict=False)))
        if len(rows) < count or pose.shape != (4, 4):
            raise FieldFileError(f"{path} has a scan of {len(rows)} points, expected {count}, or no pose of 4 x 4")
        measured = rows[rows[:, :3].any(axis=1)]
        measured[:, :3] = measured[:, :3] @ pose[:3, :3] + pose[3, :3]
        scans.append((measured, count - len(measured)))
        places.append(np.tile(pose[3, :3], (len(measured), 1)))
    if not scans:
        raise FieldFileError(f"{path} has no scans")
    if len({rows.shape[1] for rows, _ in scans}) > 1:
        raise FieldFileError(f"{path} has scans with different columns")
    viewpoints = dict(zip(VIEWPOINT_COLUMNS, np.concatenate(places).T, strict=True))
    data = _cloud_of_rows(path, np.concatenate([rows for rows, _ in scans]), more=viewpoints)
    return _note_missing(data, sum(missing for _, missing in scans))


def read_pcd(path: Path) -> MeshData:
    """Read the points of a PCD file: text, binary or compressed."""
    header: dict[str, list[str]] = {}
    with path.open("rb") as stream:
        while "DATA" not in header:
            line = stream.readline(4096)
            if not line:
                raise FieldFileError(f"{path} has no complete header of a PCD file")
            words = line.decode("latin-1").split("#")[0].split()
            if words:
                header[words[0].upper()] = words[1:]
        body = stream.read()
    missing = [word for word in _PCD_WORDS if not header.get(word)]
    if missing:
        raise FieldFileError(f"{path} has no {', '.join(missing)} in its header")
    try:
        counts = list(map(int, header.get("COUNT", ["1"] * len(header["FIELDS"]))))
        kinds = [_PCD_KINDS[kind] + size for kind, size in zip(header["TYPE"], header["SIZE"], strict=True)]
        fields = list(zip(header["FIELDS"], kinds, counts, strict=True))
        dtype = np.dtype([(f"{name}.{k}", f"<{kind}", (count,)) for k, (name, kind, count) in enumerate(fields)])
        table = _pcd_table(body, header["DATA"][0].lower(), dtype, int(header["POINTS"][0]))
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise FieldFileError(f"{path} is a damaged PCD file: {error}") from error
    columns: dict[str, NDArray[Any]] = {}
    for key, (name, _, count) in zip(dtype.names or (), fields, strict=True):
        if count == 1 and name in ("rgb", "rgba"):
            bits = np.ascontiguousarray(table[key][:, 0]).astype(table[key].dtype.newbyteorder("=")).view(np.uint32)
            columns |= {channel: (bits >> shift) & 255 for channel, shift in zip(_RGB, (16, 8, 0), strict=True)}
        elif count == 1:
            columns[name] = table[key][:, 0]
    place = _numbers(header.get("VIEWPOINT", []))[:3]
    if len(place) == len(AXES) and any(place):  # all 0, as most programs write, says nothing
        columns |= {name: np.full(len(table), value) for name, value in zip(VIEWPOINT_COLUMNS, place, strict=True)}
    return _cloud_of_measured(path, columns)


def _numbers(words: list[str]) -> list[float]:
    """Words as numbers; none if one of them is not a finite number."""
    try:
        values = list(map(float, words))
    except ValueError:
        return []
    return values if np.isfinite(values).all() else []


def _pcd_table(body: bytes, kind: str, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
    """The rows of a PCD file."""
    if kind == "ascii":
        widths = [dtype[name].shape[0] for name in dtype.names or ()]
        rows = np.array(body.split(), dtype=np.bytes_).reshape(count, sum(widths))
        table, start = np.empty(count, dtype=dtype), 0
        for name, width in zip(dtype.names or (), widths, strict=True):
            part = rows[:, start : start + width]
            base = dtype[name].base
            # through integers no digits of packed colours are lost
            table[name] = part.astype(base if base.kind in "iu" else np.float64)
            start += width
        return table
    if kind == "binary":
        return np.frombuffer(body, dtype, count)
    if kind != "binary_compressed":
        raise ValueError(f"DATA {kind}, expected ascii, binary or binary_compressed")
    packed, whole = np.frombuffer(body, "<u4", 2)
    content = decompress_lzf(body[8 : 8 + int(packed)], int(whole))
    table, start = np.empty(count, dtype=dtype), 0
    for name in dtype.names or ():  # one column after the other
        size = dtype[name].itemsize * count
        table[name] = np.frombuffer(content[start : start + size], dtype[name].base).reshape(count, -1)
        start += size
    return table


def decompress_lzf(packed: bytes, size: int) -> bytes:
    """Decompress bytes of the LZF format; ValueError if there are not `size` of them.

    >>> decompress_lzf(bytes([2]) + b"abc" + bytes([0x20 + 0x20, 2]), 7)
    b'abcabca'
    """
    result, at = bytearray(), 0
    while at < len(packed):
        control = packed[at]
        at += 1
        if control < _LZF_LITERALS:
            result += packed[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[at]
            at += 1
        start = len(result) - ((control & 31) << 8) - packed[at] - 1
        at += 1
        if start < 0:
            raise ValueError("compressed data refer to bytes before the first")
        for k in range(start, start + length + 2):
            result.append(result[k])
    if len(result) != size:
        raise ValueError(f"compressed data have {len(result)} bytes, expected {size}")
    return bytes(result)


def read_e57(path: Path) -> MeshData:
    """Read the points of all scans of an E57 file, in their common frame."""
    pye57 = import_extra("pye57")
    try:
        file = pye57.E57(str(path))
        scans = [
            file.read_scan(k, intensity=True, colors=True, ignore_missing_fields=True) for k in range(file.scan_count)
        ]
        for k, scan in enumerate(scans):
            if (head := file.get_header(k)).has_pose():
                places = zip(VIEWPOINT_COLUMNS, head.translation, strict=True)
                scan |= {name: np.full(len(scan["cartesianX"]), value) for name, value in places}
    except Exception as error:  # the library raises its own types and bare ones
        raise FieldFileError(f"{path} is no readable E57 file: {error}") from error
    if not scans:
        raise FieldFileError(f"{path} has no scans")
    names = {f"cartesian{axis.upper()}": axis for axis in AXES} | {"intensity": "intensity"}
    names |= {f"color{name.capitalize()}": name for name in _RGB} | {name: name for name in VIEWPOINT_COLUMNS}
    shared = [name for name in names if all(name in scan for scan in scans)]
    return _cloud_of_measured(path, {names[name]: np.concatenate([scan[name] for scan in scans]) for name in shared})


def _text_lines(path: Path) -> Iterator[str]:
    """Lines of a text file with points instead of commas and semicolons, without empty ones."""
    try:
        with path.open(encoding="utf-8-sig") as stream:
            for line in stream:
                if text := line.replace(",", " ").replace(";", " ").strip():
                    yield text
    except UnicodeDecodeError as error:
        raise FieldFileError(f"{path} is no text: {error}") from error


def _chain(first: Iterable[str], rest: Iterator[str]) -> Iterator[str]:
    yield from first
    yield from rest


def _table(path: Path, lines: Iterator[str]) -> FloatArray:
    """Numbers of lines of the same length, (k, c)."""
    try:
        return np.loadtxt(lines, ndmin=2, comments="#")
    except ValueError as error:
        raise FieldFileError(f"{path} has a faulty row: {error}") from error


def _cloud_of_rows(
    path: Path, rows: FloatArray, names: tuple[str, ...] = (), more: dict[str, FloatArray] | None = None
) -> MeshData:
    """Points of rows of numbers, with names of the columns or by their number, and of more columns."""
    count = rows.shape[1]
    if not names and count == 6:
        lengths = np.linalg.norm(rows[:, 3:], axis=1)
        are_normals = len(rows) and (np.abs(lengths - 1.0) < _UNIT_LENGTH_TOLERANCE).mean() > 0.5
        names = (*AXES, *(NORMAL_COLUMNS if are_normals else _RGB))
    names = names or tuple(_COLUMNS.get(count, ()))
    if len(names) != count:
        expected = f"{len(names)} names" if names else "3, 4, 6, 7 or 9"
        raise FieldFileError(f"{path} has rows of {count} numbers, expected {expected}")
    return _cloud_of_measured(path, dict(zip(names, rows.T, strict=True)) | (more or {}))


def _cloud_of_measured(path: Path, columns: dict[str, NDArray[Any]]) -> MeshData:
    """Points with finite coordinates, of columns with names."""
    if not set(AXES) <= set(columns):
        raise FieldFileError(f"{path} has the columns {', '.join(columns)}, expected x, y and z among them")
    is_measured = np.all([np.isfinite(columns[axis]) for axis in AXES], axis=0)
    kept = {name: values[is_measured] for name, values in columns.items()}
    return _note_missing(cloud_of_columns(path, kept), int((~is_measured).sum()))


def _note_missing(data: MeshData, missing: int) -> MeshData:
    """A note of points without coordinates."""
    if not missing:
        return data
    return replace(data, notes=(*data.notes, f"{missing:,} points that were not measured were left out"))
