"""What happens around the first call, which compiles the numerical kernels, once per installation."""

import gc
import logging
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bezier_filters.runtime.parallel import thread_count

logger = logging.getLogger("bezier_filters")


@contextmanager
def first_compilation(kernel: Any, compile_kernel: Callable[[], object], compile_others: str) -> Iterator[None]:
    """Around the first call of a kernel: if it will be compiled, say so, and compile on two cores if there are two.

    A kernel that was compiled before is loaded from numba's cache on disk in a fraction of a second; then nothing
    of this happens. Otherwise this process compiles the largest kernel and another one the rest, which
    this one finds in the cache. Whatever goes wrong there, is compiled here when it is called. The
    garbage collector is held back: the compiler makes millions of objects that live on, and looking through the
    oldest of them again and again would take a fifteenth of its time.

    Parameters
    ----------
    kernel : numba function
        Which tells whether there is anything to compile.
    compile_kernel : callable
        Calls it with arguments of the right types.
    compile_others : str
        Python code that calls the others.
    """
    if not _will_be_compiled(kernel):
        yield
        return
    logger.warning("compiling the numerical kernels; this takes about ten seconds, once per installation")
    thresholds = gc.get_threshold()
    gc.set_threshold(*thresholds[:2], 100_000)
    try:
        if _is_python(sys.executable) and thread_count(None) > 1:
            with _another_process(compile_others) as process:
                compile_kernel()
                process.wait()
        yield
    finally:
        gc.set_threshold(*thresholds)


def _will_be_compiled(kernel: Any) -> bool:
    if getattr(kernel, "signatures", True):  # compiled or loaded in this process, or the JIT is off
        return False
    return not any(Path(kernel.stats.cache_path).glob(f"*{kernel.py_func.__name__}*.nbi"))


def _is_python(executable: str | None) -> bool:
    """Whether a program may be asked to run Python code, rather than being one that Python is built into."""
    return bool(executable) and Path(str(executable)).name.lower().startswith("python")


@contextmanager
def _another_process(code: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process that runs Python code in silence, with the modules of this one; killed once it is not waited for."""
    same_modules = f"import sys; sys.path[:] = {sys.path!r}; {code}"
    nothing = subprocess.DEVNULL
    process = subprocess.Popen([sys.executable, "-c", same_modules], stdin=nothing, stdout=nothing, stderr=nothing)
    try:
        yield process
    finally:
        process.kill()
        process.wait()
