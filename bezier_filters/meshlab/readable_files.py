"""Files as pymeshlab can open and read them: under names in UTF-8, and as PLY files where it lacks the format."""

import uuid
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bezier_filters.errors import FieldFileError, MeshFileNote
from bezier_filters.files.host_formats import READERS
from bezier_filters.files.mesh_data import write_ply
from bezier_filters.files.readable_copies import is_misread, write_copy
from bezier_filters.files.scan_formats import has_only_coordinates
from bezier_filters.meshlab.meshset import BezierFilterError
from bezier_filters.meshlab.save_formats import FIELD_SUFFIX
from bezier_filters.runtime.atomic import temporary_folder
from bezier_filters.runtime.file_names import is_utf8, name_pipe, printable_path, user_path

_MAYBE_PLAIN = (".xyz", ".pts")  # formats that pymeshlab reads where a row is three coordinates


@contextmanager
def open_as_ply(path: Path) -> Iterator[Path]:
    """A PLY file with the content of a file that pymeshlab does not read, under its name in messages."""
    suffix = path.suffix.lower()
    read = READERS.get(suffix)
    try:
        is_plain = read is None or (suffix in _MAYBE_PLAIN and has_only_coordinates(path))
        data = None if is_plain or read is None else read(path)
    except FieldFileError as error:
        raise BezierFilterError(
            f"cannot read {printable_path(path)}: it {str(error).removeprefix(f'{path} ')}"
        ) from error
    if data is None:
        yield path
        return
    if not len(data.vertices):
        raise BezierFilterError(f"cannot read {printable_path(path)}: it has no vertices")
    for note in data.notes:
        warnings.warn(f"{printable_path(path)}: {note}", MeshFileNote, stacklevel=3)
    with temporary_folder() as folder:
        copy = folder / f"{uuid.uuid4().hex}{FIELD_SUFFIX}"
        write_ply(copy, data)
        name_pipe(copy, user_path(path))
        yield copy


@contextmanager
def openable(path: Path) -> Iterator[Path]:
    """A path that pymeshlab can open: UTF-8, and not starting with a colon.

    Otherwise a temporary folder has links to all files of the folder, so that textures and materials are found, and
    a copy of the file if pymeshlab would misread it.
    """
    absolute, converts = path.absolute(), is_misread(path)
    if is_utf8(str(absolute)) and not absolute.name.startswith(":") and not converts:
        yield absolute
        return
    with temporary_folder() as folder:
        for other in absolute.parent.iterdir():
            if is_utf8(other.name):
                (folder / other.name).symlink_to(other)
        link = folder / f"{uuid.uuid4().hex}{absolute.suffix}"
        if converts:
            write_copy(absolute, link)
        else:
            link.symlink_to(absolute)
        yield link


@contextmanager
def utf8_folder(folder: Path) -> Iterator[Path]:
    """A folder, or a link to it that pymeshlab can name."""
    if is_utf8(str(folder)):
        yield folder
        return
    with temporary_folder() as outer:
        link = outer / "folder"
        link.symlink_to(folder, target_is_directory=True)
        yield link
