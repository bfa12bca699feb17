"""Atomic writes: a file is replaced as a whole or not at all."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from bezier_filters.runtime.process_end import remove_on_exit

# prefix of temporary files, which remain only if a process is killed
TEMPORARY_PREFIX = ".bezier_filters-"
_PROBE_BYTES = 1 << 16  # written after a file, to detect a full disk


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path whose file replaces `path` when the block succeeds.

    The temporary path lies in the same directory, so that the replacement is a single step, and
    has the same suffix, from which pymeshlab and others determine the format. If the block fails,
    the temporary file is removed and an existing file at `path` does not change. A new file gets
    the default permissions (umask), a replaced one keeps its own, and a symbolic link stays a link.

    Further files of the same writer (the MTL of an OBJ) are not covered. The file is flushed to the disk before the
    replacement, so that it survives a power failure.
    """
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise FileNotFoundError(f"cannot write {path}: there is no directory {target.parent}")
    if target.exists() and not target.is_file():
        raise OSError(f"cannot write {path}: it exists and is not a regular file")
    temporary = target.with_name(f"{TEMPORARY_PREFIX}{uuid.uuid4().hex}{target.suffix}")
    with remove_on_exit(temporary):
        try:
            yield temporary
            _check_free_space(temporary)
            if target.exists():
                temporary.chmod(target.stat().st_mode)
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def temporary_folder(folder: str | os.PathLike[str] | None = None) -> Iterator[Path]:
    """Yield a new folder, in a given one or in that of the system, which is removed after the block."""
    with TemporaryDirectory(prefix=TEMPORARY_PREFIX if folder else "bezier_filters_", dir=folder) as name:
        path = Path(name)
        with remove_on_exit(path):
            yield path


def _check_free_space(path: Path) -> None:
    """Raise OSError if no further bytes can be written to a file.

    Writers that ignore errors of their last write, like those of pymeshlab, truncate the file when the disk is full or
    a quota is reached; then a further write fails, too.
    """
    size = path.stat().st_size
    with path.open("r+b") as file:
        file.seek(size)
        file.write(b"\0" * _PROBE_BYTES)
        file.flush()
        os.fsync(file.fileno())  # some file systems report errors only here
        file.truncate(size)
