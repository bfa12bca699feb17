"""Write a file whole or not at all."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path whose file replaces `path` when the block succeeds.

    The temporary path lies in the same directory, so that the replacement is a single step, and
    has the same suffix, from which pymeshlab and others pick the format. Whatever ends the block
    early, the temporary file is removed and an existing file at `path` stays as it was. A new
    file gets the usual permissions (umask), a replaced one keeps its own, and a symbolic link
    stays a link.

    Writers that name further files after the first one (OBJ and its MTL) are not covered.

    Parameters
    ----------
    path : path
        File to write or replace.

    Yields
    ------
    Path
        Path to write to; there is no file yet.

    Raises
    ------
    FileNotFoundError
        The directory of `path` does not exist, or the block wrote no file.
    OSError
        `path` exists and is not a regular file.

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
    temporary = target.with_name(f".{uuid.uuid4().hex}{target.suffix}")
    try:
        yield temporary
        if target.exists():
            temporary.chmod(target.stat().st_mode)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
