"""Write a file whole or not at all."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

TEMPORARY = ".bezier_filters-"
"""How the names of temporary files begin; one stays behind only where a process is killed outright."""
_MARGIN = 1 << 16


@contextmanager
def atomic_write(path: str | os.PathLike[str], *, lasting: bool = True) -> Iterator[Path]:
    """Yield a temporary path whose file replaces `path` when the block succeeds.

    The temporary path lies in the same directory, so that the replacement is a single step, and
    has the same suffix, from which pymeshlab and others pick the format. Whatever ends the block
    early, the temporary file is removed and an existing file at `path` stays as it was. A new
    file gets the usual permissions (umask), a replaced one keeps its own, and a symbolic link
    stays a link.

    Writers that name further files after the first one (OBJ and its MTL) are not covered. What is `lasting` is on the
    disk at the end, and will be there after a power cut, too.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "notes.txt"
    >>> with atomic_write(target) as temporary:
    ...     _ = temporary.write_text("whole")
    >>> target.read_text()
    'whole'
    """
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise FileNotFoundError(f"cannot write {path}: there is no directory {target.parent}")
    if target.exists() and not target.is_file():
        raise OSError(f"cannot write {path}: it exists and is not a regular file")
    temporary = target.with_name(f"{TEMPORARY}{uuid.uuid4().hex}{target.suffix}")
    try:
        yield temporary
        if lasting:
            _check_room(temporary)
        if target.exists():
            temporary.chmod(target.stat().st_mode)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


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
