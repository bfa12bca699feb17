"""What happens around the first call, which compiles the numerical kernels, once per installation."""

import gc
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

logger = logging.getLogger("bezier_filters")


@contextmanager
def first_compilation(kernel: Any) -> Iterator[None]:
    """Around the first call of a kernel: if it will be compiled, log a warning and hold back the garbage collector.

    A kernel that was compiled before is loaded from numba's cache on disk in a fraction of a
    second; that is not announced. The compiler makes millions of objects that live on, and looking
    through the oldest of them again and again would take a fifteenth of its time.
    """
    if not _will_be_compiled(kernel):
        yield
        return
    logger.warning("compiling the numerical kernels; this takes about ten seconds, once per installation")
    thresholds = gc.get_threshold()
    gc.set_threshold(*thresholds[:2], 100_000)
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)


def _will_be_compiled(kernel: Any) -> bool:
    if getattr(kernel, "signatures", True):  # compiled or loaded in this process, or the JIT is off
        return False
    return not any(Path(kernel.stats.cache_path).glob(f"*{kernel.py_func.__name__}*.nbi"))
