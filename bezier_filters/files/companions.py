"""Files that a mesh file refers to: only regular files in its folder or below are opened."""

import os
import re
import stat
from pathlib import Path

from bezier_filters.errors import FieldFileError

_MAX_COMPANION_BYTES = 1 << 32  # bytes of a companion file
_COMPANION_BLOCK_BYTES = 1 << 24
_MATERIALS = re.compile(rb"mtllib[ \t]+([^\r\n\0]+)")


def companion(path: Path, name: str) -> Path | None:
    """Path of a file that a mesh file names, None if it does not exist; `FieldFileError` if it must not be opened."""
    folder = path.parent.resolve()
    try:
        found = (folder / name).resolve()
        status = found.stat()
    except (FileNotFoundError, NotADirectoryError):
        found, status = (folder / os.path.normpath(name)).absolute(), None
    except (OSError, ValueError, RuntimeError) as error:
        raise FieldFileError(f"{path} names the file {name[:80]!r}, which cannot be opened: {error}") from error
    if not found.is_relative_to(folder):
        raise FieldFileError(f"{path} names the file {name[:80]!r}, which is outside of its folder; copy it there")
    if status is None:
        return None
    if not stat.S_ISREG(status.st_mode):
        raise FieldFileError(f"{path} names {name[:80]!r}, which is not a regular file")
    if status.st_size > _MAX_COMPANION_BYTES:
        raise FieldFileError(
            f"{path} names the file {name[:80]!r} of {status.st_size} bytes; {_MAX_COMPANION_BYTES} are the limit"
        )
    return found


def check_companions(path: Path) -> None:
    """Refuse an OBJ file whose material file exists but is not a regular file, for example a pipe."""
    if path.suffix.lower() != ".obj":
        return
    with path.open("rb") as stream:
        while block := stream.read(_COMPANION_BLOCK_BYTES):
            block += stream.readline(_COMPANION_BLOCK_BYTES)
            for found in _MATERIALS.finditer(block) if b"mtllib" in block else ():
                name = os.fsdecode(found[1].strip()).replace("\\", "/")
                target = path.parent / name
                if target.exists() and not target.is_file():
                    raise FieldFileError(f"{path} names the material file {name[:80]!r}, which is not a regular file")
