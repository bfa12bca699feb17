"""Folders for the machine code of compiled functions, named after its key."""

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

from bezier_filters.runtime.kernel_key import PACKAGE, kernel_key

NAME = PACKAGE.name
DIGITS = 16  # of the key, in the name of a folder
KEPT = 4  # folders in one place, those used last: several environments may use one tree in turn
CHOSEN = str(getattr(config, "CACHE_DIR", ""))  # the user's choice, NUMBA_CACHE_DIR, or empty
_HINT = "set NUMBA_CACHE_DIR to a folder that can be written"


@dataclass(frozen=True)
class KernelFolders:
    """Where compiled functions are kept."""

    readable: tuple[Path, ...]  # in the order in which they are searched
    writable: Path | None  # the last of them, if it can be written
    warning: str = ""  # for the user, if code is kept elsewhere than it should be, or not at all


@cache
def kernel_folders() -> KernelFolders:
    """Folders of the key, up to the first that can be written.

    They are in ``NUMBA_CACHE_DIR``, beside the package, in the user's folder for caches, and in a private one for
    temporary files.
    """
    readable, refusals = list[Path](), list[str]()
    if not kernel_key():
        return KernelFolders((), None, f"every process compiles its functions: there are no sources in {PACKAGE}")
    for place in _places():
        folder = place / f"{NAME}-{kernel_key()[:DIGITS]}"
        is_temporary = place == _temporary_place()
        try:
            if is_temporary:
                _make_private(place)
            if folder.is_dir():
                readable.append(folder)
            _open(folder)
        except OSError as error:
            refusals.append(f"{place} ({error.strerror or error})")
            continue
        refused = f"compiled code cannot be kept in {', '.join(refusals)}; it is kept in {place}. {_HINT}"
        is_wanted = not refusals or not (CHOSEN or is_temporary)  # the user's folder is as good as the package's
        return KernelFolders(tuple(dict.fromkeys([*readable, folder])), folder, "" if is_wanted else refused)
    refused = f"every process compiles its functions: the code cannot be kept in {', '.join(refusals)}. {_HINT}"
    return KernelFolders(tuple(readable), None, refused)


def _places() -> Iterator[Path]:
    """Folders in which that of a key may be, best first."""
    if CHOSEN:
        yield Path(CHOSEN).absolute()
    yield PACKAGE / "__pycache__"
    yield Path(AppDirs(appname=NAME, appauthor=False).user_cache_dir)
    with suppress(OSError):  # there is none
        yield _temporary_place()


def _temporary_place() -> Path:
    user = os.getuid() if hasattr(os, "getuid") else "cache"  # whose folder it is on Windows anyway
    return Path(tempfile.gettempdir(), f"{NAME}-{user}")


def _make_private(place: Path) -> None:
    """Make a folder that nobody else can write to, for code that this process will run; else raise OSError."""
    place.mkdir(mode=0o700, exist_ok=True)
    status = place.lstat()
    if hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & (S_IWGRP | S_IWOTH)):
        raise PermissionError("others can write there")


def _open(folder: Path) -> None:
    """Make the folder of a key, and see that files can be written there; else raise OSError."""
    place, is_new = folder.parent, not folder.is_dir()
    # A home directory that does not exist is not made.
    for path in (place.parent, place, folder):
        path.mkdir(exist_ok=True)
    tempfile.TemporaryFile(dir=folder).close()
    os.utime(folder)
    if is_new:
        _delete_old(place)


def _delete_old(place: Path) -> None:
    """Delete what was made for other keys, all but the folders that were used last."""
    with suppress(OSError):  # another process is at it, too
        folders = sorted(place.glob(f"{NAME}-{'[0-9a-f]' * DIGITS}"), key=os.path.getmtime, reverse=True)
        for folder in folders[KEPT:]:
            shutil.rmtree(folder, ignore_errors=True)
        if place.parent == PACKAGE:
            for path in PACKAGE.rglob("__pycache__/*.nb[ci]"):  # numba's own cache, which earlier versions had
                path.unlink(missing_ok=True)
