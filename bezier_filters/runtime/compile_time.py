"""The compilation of functions: it is announced once per process, and a clock stands still meanwhile."""

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import Any

from numba.core.event import Listener, register

from bezier_filters.runtime.kernel_key import PACKAGE
from bezier_filters.runtime.shipped_code import CODE_FOLDER, find_shipped_code

ANNOUNCEMENTS = logging.getLogger("bezier_filters.compilation")  # which the command line silences with --quiet
_SLOW_PACKAGES = frozenset(["kernels", "fitting", "smoothing", "holes"])  # their kernels take seconds each
_OTHER_TARGET = ": the machine code in the package is for other processors, or another version of numba"


class _Compilations:
    """Total time in which at least one thread compiled."""

    def __init__(self) -> None:
        self._lock, self._running, self._begin, self._total = Lock(), 0, 0.0, 0.0

    def begin(self) -> None:
        with self._lock:
            if self._running == 0:
                self._begin = time.perf_counter()
            self._running += 1

    def end(self) -> None:
        with self._lock:
            self._running -= 1
            if self._running == 0:
                self._total += time.perf_counter() - self._begin

    def seconds(self) -> float:
        with self._lock:
            return self._total + (time.perf_counter() - self._begin if self._running else 0.0)


class _CompileEvents(Listener):
    """Times and announces compilations; loads from the cache are none."""

    def __init__(self) -> None:
        self._announced = False

    def on_start(self, event: Any) -> None:
        """Stop the clock, and announce the first kernel of this package."""
        _compilations.begin()
        package, kind = [*event.data["dispatcher"].py_func.__module__.split("."), ""][:2]
        if package == PACKAGE.name and kind in _SLOW_PACKAGES and not self._announced:
            self._announced = True
            reason = _OTHER_TARGET if CODE_FOLDER.is_dir() and find_shipped_code() is None else ""
            ANNOUNCEMENTS.warning(
                "compiling kernels, once per installation, for up to a minute (bezier-filters compile compiles all)%s",
                reason,
            )

    def on_end(self, event: Any) -> None:
        """Let the clock go on."""
        _compilations.end()


_compilations = _Compilations()


@cache
def watch_compiler() -> None:
    """Let numba report its compilations to this module."""
    register("numba:compile", _CompileEvents())  # type: ignore[no-untyped-call]


def clock_without_compilation() -> float:
    """`time.perf_counter` without the time in which functions were compiled, in seconds."""
    return time.perf_counter() - _compilations.seconds()


@contextmanager
def count_as_compilation() -> Iterator[None]:
    """Count the time of the block as compilation, for example the wait for another process that compiles."""
    _compilations.begin()
    try:
        yield
    finally:
        _compilations.end()
