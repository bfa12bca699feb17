"""Write a file whole or not at all."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from bezier_filters.runtime.process_end import removed_at_last

# how the names of temporary files begin; one stays behind only where a process is killed outright
TEMPORARY = ".bezier_filters-"
_MARGIN = 1 << 16


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path whose file replaces `path` when the block succeeds.

    The temporary path lies in the same directory, so that the replacement is a single step, and
    has the same suffix, from which pymeshlab and others pick the format. Whatever ends the block
    early, the temporary file is removed and an existing file at `path` stays as it was. A new
    file gets the usual permissions (umask), a replaced one keeps its own, and a symbolic link
    stays a link.

    Writers that name further files after the first one (OBJ and its MTL) are not covered. In the end the file is on the
    disk, and will be there after a power cut, too.
    """
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise FileNotFoundError(f"cannot write {path}: there is no directory {target.parent}")
    if target.exists() and not target.is_file():
        raise OSError(f"cannot write {path}: it exists and is not a regular file")
    temporary = target.with_name(f"{TEMPORARY}{uuid.uuid4().hex}{target.suffix}")
    with removed_at_last(temporary):
        try:
            yield temporary
            _check_room(temporary)
            if target.exists():
                temporary.chmod(target.stat().st_mode)
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def temporary_folder(folder: str | os.PathLike[str] | None = None) -> Iterator[Path]:
    """Yield a new folder, below another one or where the system has such, that is removed after the block."""
    with TemporaryDirectory(prefix=TEMPORARY if folder else "bezier_filters_", dir=folder) as name:
        path = Path(name)
        with removed_at_last(path):
            yield path


def _check_room(path: Path) -> None:
    """Raise OSError if no more could be written to a file.

    Writers that do not look whether their last bytes arrived, as those of pymeshlab, leave a file cut short when the
    disk is full or a quota is reached; then there is no room for more either.
    """
    size = path.stat().st_size
    with path.open("r+b") as file:
        file.seek(size)
        file.write(b"\0" * _MARGIN)
        file.flush()
        os.fsync(file.fileno())  # some file systems find out only here
        file.truncate(size)
