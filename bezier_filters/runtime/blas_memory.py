"""Memory checks for OpenBLAS, which raises no error without memory: SciPy's loops forever, NumPy's ends the process.

It allocates a buffer of 34 MB of addresses for each concurrent call, and keeps it for later calls.
"""

import ctypes
import mmap
from collections.abc import Iterable

_BUFFER_BYTES = 1 << 26  # free address space that a buffer needs, with a margin


def check_blas_memory() -> None:
    """Raise MemoryError if OpenBLAS might fail to allocate another buffer; takes ten microseconds."""
    try:
        mmap.mmap(-1, _BUFFER_BYTES).close()
    except OSError as error:
        raise MemoryError(f"linear algebra needs {_BUFFER_BYTES >> 20} MB more") from error


def reserve_blas_memory(libraries: Iterable[str], threads: int) -> None:
    """Preallocate the buffers of libraries, at these paths, for `threads` concurrent calls; MemoryError if that fails.

    Libraries other than OpenBLAS, and versions that do not export the allocator, are skipped.
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
