"""Folders of the kernel cache, named after the key of the sources."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from stat import S_IWGRP, S_IWOTH

from numba import config
from numba.misc.appdirs import AppDirs

from bezier_filters.runtime.kernel_key import KEY_DIGITS, PACKAGE, kernel_key
from bezier_filters.runtime.shipped_code import find_shipped_code

NAME = PACKAGE.name
MAX_KEPT_FOLDERS = 4  # most recently used folders per parent: several environments may share one tree
USER_CACHE_FOLDER = str(getattr(config, "CACHE_DIR", ""))  # NUMBA_CACHE_DIR, or empty
_HINT = "set NUMBA_CACHE_DIR to a folder that can be written"


@dataclass(frozen=True)
class KernelFolders:
    """Folders for compiled functions."""

    readable: tuple[Path, ...]  # in search order
    writable: Path | None  # the last of them, if it can be written
    warning: str = ""  # for the user, if code is cached in a fallback folder or not at all


@cache
def kernel_folders() -> KernelFolders:
    """Folders of the current key, up to the first writable one.

    The code that the package carries comes first. The parents of the others are ``NUMBA_CACHE_DIR``, the package, the
    user's cache folder, and a private temporary folder.
    """
    readable, refusals = list[Path](), list[str]()
    if not kernel_key():
        return KernelFolders((), None, f"every process compiles its functions: there are no sources in {PACKAGE}")
    if shipped := find_shipped_code():
        readable.append(shipped)
    for parent in _parent_folders():
        folder = parent / f"{NAME}-{kernel_key()[:KEY_DIGITS]}"
        is_temporary = parent == _temporary_parent()
        try:
            if is_temporary:
                _make_private(parent)
            if folder.is_dir():
                readable.append(folder)
            _open(folder)
        except OSError as error:
            refusals.append(f"{parent} ({error.strerror or error})")
            continue
        refused = f"compiled code cannot be kept in {', '.join(refusals)}; it is kept in {parent}. {_HINT}"
        # The user's folder is as good as that of the package.
        is_wanted = not refusals or not (USER_CACHE_FOLDER or is_temporary)
        return KernelFolders(tuple(dict.fromkeys([*readable, folder])), folder, "" if is_wanted else refused)
    refused = f"every process compiles its functions: the code cannot be kept in {', '.join(refusals)}. {_HINT}"
    return KernelFolders(tuple(readable), None, refused)


def _parent_folders() -> Iterator[Path]:
    """Parents of the folder of a key, in order of preference."""
    if USER_CACHE_FOLDER:
        yield Path(USER_CACHE_FOLDER).absolute()
    yield PACKAGE / "__pycache__"
    yield Path(AppDirs(appname=NAME, appauthor=False).user_cache_dir)
    with suppress(OSError):  # no temporary folder
        yield _temporary_parent()


def _temporary_parent() -> Path:
    user = os.getuid() if hasattr(os, "getuid") else "cache"  # on Windows the folder is private anyway
    return Path(tempfile.gettempdir(), f"{NAME}-{user}")


def _make_private(parent: Path) -> None:
    """Make a folder that only this user can write to, as this process will run its code; else raise OSError."""
    parent.mkdir(mode=0o700, exist_ok=True)
    status = parent.lstat()
    if hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & (S_IWGRP | S_IWOTH)):
        raise PermissionError("others can write there")


def _open(folder: Path) -> None:
    """Make the folder of a key and check that it is writable; else raise OSError."""
    parent, is_new = folder.parent, not folder.is_dir()
    # A missing home directory is not created.
    for path in (parent.parent, parent, folder):
        path.mkdir(exist_ok=True)
    tempfile.TemporaryFile(dir=folder).close()
    os.utime(folder)
    if is_new:
        _delete_old(parent)


def _delete_old(parent: Path) -> None:
    """Delete the folders of other keys, except the most recently used ones."""
    with suppress(OSError):  # another process may do the same
        folders = sorted(parent.glob(f"{NAME}-{'[0-9a-f]' * KEY_DIGITS}"), key=os.path.getmtime, reverse=True)
        for folder in folders[MAX_KEPT_FOLDERS:]:
            shutil.rmtree(folder, ignore_errors=True)
        if parent.parent == PACKAGE:
            for path in PACKAGE.rglob("__pycache__/*.nb[ci]"):  # numba's own cache, from earlier versions
                path.unlink(missing_ok=True)
