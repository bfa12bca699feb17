"""Disk cache of compiled functions, keyed by a hash of all sources that enter the machine code.

numba's own cache checks the source file of a function, but not the files of its callees, and confuses variants of a
function that two processes compile at the same time. Here each variant has its own file with a checksum, in a folder
named after the key.
"""

import logging
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba import config
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from bezier_filters.runtime.atomic import atomic_write
from bezier_filters.runtime.kernel_folders import kernel_folders
from bezier_filters.runtime.shipped_code import find_shipped_code, generic_processor

_logger = logging.getLogger("bezier_filters")

SUFFIX = ".nbc"
_DIGEST_BYTES = sha256().digest_size
# settings of numba that change the machine code and are not part of its description of the processor
_SETTINGS = ("OPT", "BOUNDSCHECK", "LOOP_VECTORIZE", "SLP_VECTORIZE", "DEBUGINFO_DEFAULT")


class KernelCache(NullCache):
    """Cache of the variants of one function, which replaces that of numba."""

    def __init__(self, function: Callable[..., object]) -> None:
        self._prefix = f"{function.__module__.partition('.')[2]}.{function.__qualname__}-"

    @property
    def cache_path(self) -> str | None:
        """Folder with variants of this function, else the folder for new ones, or None."""
        folders = kernel_folders()
        filled = (folder for folder in folders.readable if any(folder.glob(f"{self._prefix}*{SUFFIX}")))
        folder = next(filled, folders.writable)
        return None if folder is None else str(folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the variant for a signature, or None; a damaged file is deleted."""
        target_context.refresh()
        for folder in kernel_folders().readable:
            path = folder / self._file_name(sig, _target(folder, target_context.codegen()))
            try:
                content = path.read_bytes()
            except OSError:
                continue
            try:
                return CompileResult._rebuild(target_context, *_unpack(content, sig))
            except Exception as error:  # whatever it is, the function can be compiled
                _logger.info("%s is damaged (%s) and is compiled again", path, error)
                with suppress(OSError):
                    path.unlink()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write a variant; if that fails, warn once."""
        if data.lifted or data.library.has_dynamic_globals:  # holds addresses of this process
            return
        folders = kernel_folders()
        _warn_once(folders.warning)
        if folders.writable is None:
            return
        # The types of all lines, with the path of the source, are a third of the file, and only for `inspect_types`.
        payload = dumps((sig, data._replace(type_annotation="")._reduce()))
        try:
            folders.writable.mkdir(exist_ok=True)  # another process may have deleted it as old
            with atomic_write(folders.writable / self._file_name(sig, data.codegen.magic_tuple())) as path:
                path.write_bytes(sha256(payload).digest() + payload)
        except OSError as error:
            _warn_once(f"other processes will compile the same functions: their code cannot be kept ({error})")

    def _file_name(self, sig: Any, target: tuple[str, ...]) -> str:
        settings = [str(getattr(config, name, None)) for name in _SETTINGS]
        variant = repr((str(sig), target, sys.implementation.cache_tag, settings))
        return f"{self._prefix}{sha256(variant.encode()).hexdigest()[:16]}{SUFFIX}"


def _target(folder: Path, codegen: Any) -> tuple[str, ...]:
    """System and processor of the code in a folder, as numba describes them."""
    system, *here = codegen.magic_tuple()
    processor = generic_processor() if folder == find_shipped_code() else None
    return (system, *here) if processor is None else (system, processor.name, processor.flags)


def _unpack(content: bytes, sig: Any) -> Any:
    """Check the content of a file, and return the serialised variant for the signature."""
    digest, payload = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
    if sha256(payload).digest() != digest:
        raise ValueError("its checksum differs")
    signature, reduced = pickle.loads(payload)
    if signature != sig:
        raise ValueError("it is of another signature")
    return reduced


@cache
def _warn_once(message: str) -> None:
    if message:
        _logger.warning(message)
