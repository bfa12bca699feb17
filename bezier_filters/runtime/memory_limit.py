"""A limit to what readers of files may allocate because a header says so."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

ALLOWANCE = 1 << 30
"""Bytes that reading a file of any size may take,"""
PER_BYTE = 500
"""and for each byte of the file: a vertex of ten characters takes some five hundred as part of a mesh with
everything, and compressed files unfold ten times."""
_STATUS = Path("/proc/self/status")


@contextmanager
def memory_limited(file_size: int) -> Iterator[None]:
    """Let allocations fail, with MemoryError, that no file of this size can need; only on Linux, else no limit.

    The limit is that of the whole process, so nothing else should be going on in it.
    """
    used = _data_size()
    if resource is None or used is None:
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_DATA)
    limit = used + ALLOWANCE + PER_BYTE * file_size
    ceilings = [value for value in before if value != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min([limit, *ceilings]), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def _data_size() -> int | None:
    """Bytes of writable memory of this process that RLIMIT_DATA counts, or None if the system does not tell."""
    try:
        lines = _STATUS.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmData:")), None)
