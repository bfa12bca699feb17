"""Memory of OpenBLAS, whose own reaction to a lack of it is no error: SciPy's loops for ever, NumPy's ends the process.

It takes a buffer of 34 MB of addresses for each call that is under way, and keeps that for later calls.
"""

import ctypes
import mmap
from collections.abc import Iterable

_ROOM = 1 << 26  # bytes that must be there for a buffer


def check_blas_memory() -> None:
    """Raise MemoryError where OpenBLAS might not find room for another buffer; takes ten microseconds."""
    try:
        mmap.mmap(-1, _ROOM).close()
    except OSError as error:
        raise MemoryError(f"linear algebra needs {_ROOM >> 20} MB more") from error


def reserve_blas_memory(libraries: Iterable[str], threads: int) -> None:
    """Let libraries, at these paths, have buffers for calls from so many threads at a time; MemoryError without room.

    Others than OpenBLAS, and versions of it that do not export their function for that, are left alone.
    """
    for path in libraries:
        library = ctypes.CDLL(path)
        if not (hasattr(library, "blas_memory_alloc") and hasattr(library, "blas_memory_free")):
            continue
        library.blas_memory_alloc.restype = ctypes.c_void_p
        buffers = []
        try:
            for _ in range(threads):
                check_blas_memory()
                buffers.append(library.blas_memory_alloc(1))
        finally:
            for buffer in buffers:
                library.blas_memory_free(ctypes.c_void_p(buffer))
