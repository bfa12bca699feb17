"""Rows of a mesh file that its reader lost, found by comparing counts."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bezier_filters.arrays import BoolArray
from bezier_filters.errors import FieldFileError
from bezier_filters.files.file_contents import FileContents, read_contents
from bezier_filters.files.mesh_counts import MeshCounts

_MAX_LISTED_ROWS = 5  # rows that a message lists


@dataclass(frozen=True)
class LostRows:
    """Rows of a file that are missing from its mesh."""

    kept: BoolArray | None = None  # mask of the vertices of the file that are in the mesh; None for all
    notes: tuple[str, ...] = ()  # on rows that hold nothing, or that were to be skipped
    warnings: tuple[str, ...] = ()


def find_lost_rows(path: Path, promised: MeshCounts, vertices: int, faces: int, *, skip: bool) -> LostRows:
    """Compare a file with the numbers of vertices and triangles that were read.

    `FieldFileError` if vertices are lost, except vertices without finite coordinates if these are to be skipped.
    """
    losses = [promised.surplus] if promised.surplus else []
    if not promised.is_odd and promised.vertices in (None, vertices) and promised.faces in (None, faces):
        return LostRows(warnings=tuple(losses))
    contents = read_contents(path)
    if contents is None:
        if promised.vertices not in (None, vertices):
            raise FieldFileError(_counts(path, "vertices", promised.vertices, vertices))
        return LostRows(warnings=(*losses, _counts(path, "faces", promised.faces, faces)))
    is_finite = contents.is_finite
    kept = int(is_finite.sum())
    notes = list[str]()
    if kept < len(is_finite):
        if not skip:
            raise FieldFileError(_not_finite(path, contents))
        notes.append(f"{len(is_finite) - kept} vertices without finite coordinates were left out, with their faces")
    if kept != vertices and not contents.welds:
        raise FieldFileError(_counts(path, "vertices with finite coordinates", kept, vertices))
    expected, uncertain, without_area = _triangles(contents, is_finite)
    if without_area:
        notes.append(f"{without_area} faces with fewer than three different corners were left out")
    if promised.faces is not None and not expected <= faces <= expected + uncertain:
        losses.append(_counts(path, "triangles", expected, faces))
    return LostRows(None if kept == len(is_finite) else is_finite, tuple(notes), tuple(losses))


def _counts(path: Path, what: str, promised: int | None, found: int) -> str:
    return f"{path} has {promised} {what}, but its reader gives {found}"


def _not_finite(path: Path, contents: FileContents) -> str:
    bad = np.flatnonzero(~contents.is_finite)
    names = ", ".join(contents.vertex_name(int(index)) for index in bad[:_MAX_LISTED_ROWS])
    more = f" and {len(bad) - _MAX_LISTED_ROWS} more" if len(bad) > _MAX_LISTED_ROWS else ""
    return f"{path} has vertices without finite coordinates: {names}{more}; skip=True leaves them and their faces out"


def _triangles(contents: FileContents, is_finite: BoolArray) -> tuple[int, int, int]:
    """Triangles of polygons on finite vertices, triangles that other polygons may yield, and faces without any."""
    count = uncertain = without_area = 0
    all_finite = bool(is_finite.all())
    for face in contents.faces:
        if not all_finite and not all(is_finite[corner] for corner in face):
            uncertain += max(len(face) - 3, 0)  # some readers triangulate first and keep part of such polygons
        elif len(set(face)) < 3:
            without_area += 1
        else:
            count += len(face) - 2 - (len(face) - len(set(face)))
    return count, uncertain, without_area
