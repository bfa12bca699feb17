"""Tells the user when the numerical kernels are compiled, which happens once per installation."""

import logging
from pathlib import Path
from typing import Any

logger = logging.getLogger("bezier_filters")


def announce_first_compilation(kernel: Any) -> None:
    """Log a warning if calling a kernel for the first time will compile it.

    A kernel that was compiled before is loaded from numba's cache on disk in a fraction of a
    second; that is not announced.
    """
    if getattr(kernel, "signatures", True):  # compiled or loaded in this process, or the JIT is off
        return
    cache = Path(kernel.stats.cache_path)
    if not any(cache.glob(f"*{kernel.py_func.__name__}*.nbi")):
        logger.warning("compiling the numerical kernels; this takes about ten seconds, once per installation")
