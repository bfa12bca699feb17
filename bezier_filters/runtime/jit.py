"""Compiled functions that allocate nothing, and so need not count references to their arrays.

Counting took half of the time of the kernels: every array that a function of a kernel looks at is
counted up and down again, atomically. `_nrt` is numba's own name for its run time of references.
"""

import logging
import os
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numba.core.compiler_lock import global_compiler_lock
from numba.core.event import Listener, register

from bezier_filters.runtime.kernel_cache import KernelCache
from bezier_filters.runtime.kernel_key import PACKAGE

_logger = logging.getLogger("bezier_filters")

Function = TypeVar("Function", bound=Callable[..., object])


def jit(**options: object) -> Callable[[Function], Function]:
    """`numba.njit`, cached and without the interpreter lock, for functions that create no arrays."""
    return _cached(_nrt=False, nogil=True, **options)


def allocating_jit(**options: object) -> Callable[[Function], Function]:
    """The same for functions that create arrays."""
    return _cached(nogil=True, **options)


def short_jit(**options: object) -> Callable[[Function], Function]:
    """The same for work of some microseconds, which keeps the lock: taking it again takes threads as long."""
    return _cached(_nrt=False, **options)


def inner_jit(**options: object) -> Callable[[Function], Function]:
    """The same for functions that only compiled code calls.

    They become part of their callers, in the cache, too. An entry from Python for each of them would
    take a quarter of the time of the first compilation. Functions are compiled once more for every literal
    number that they are given, see `variable`. A call with several arrays takes some 30 ns, as each is handed over in
    parts: with ``inline="always"`` there is none.

    Those with `fastmath` must have that, too: of a function that is not inlined, the process that compiles links the
    copy that was compiled by itself, and later ones link that of the caller, whose sums may be in another order.
    """
    return _compiler(_nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)


def _cached(**options: object) -> Callable[[Function], Function]:
    """Compiler whose code is kept on disk, if the key that it is kept under knows of the function."""

    def compile_lazily(function: Function) -> Function:
        compiled: Any = _compiler(**options)(function)
        if function.__module__.partition(".")[0] == PACKAGE.name and compiled is not function:  # as without the JIT
            compiled._cache = KernelCache(function)
        return cast("Function", compiled)

    return compile_lazily


def _compiler(**options: object) -> Callable[[Function], Function]:
    compiler = cast("Callable[..., Callable[[Function], Function]]", njit)  # whose types do not know of `_nrt`
    return compiler(error_model="numpy", **options)


@inner_jit()
def variable(number: int) -> int:
    """A number that is known when compiling, or a narrower one, as any other integer."""
    return int(np.int64(number))


_KINDS = {"kernels": "fit patches", "estimation": "read point clouds", "smoothing": "smooth", "holes": "fill holes"}


class _Announcements(Listener):
    """Says what is compiled, before each kind of work takes its seconds; what numba finds in its cache is none."""

    def __init__(self) -> None:
        self.said: set[str] = set()

    def on_start(self, event: Any) -> None:
        """Announce each kind once, and the fit once more for its second variant, of weights against outliers."""
        function = event.data["dispatcher"]
        package, kind = [*function.py_func.__module__.split("."), ""][:2]
        if package != __name__.partition(".")[0] or kind not in _KINDS:
            return
        what = _KINDS[kind] + " where there are outliers" * (kind == "kernels" and len(function.signatures) > 0)
        if what not in self.said:
            self.said.add(what)
            _logger.warning("compiling the kernels that %s; this takes 10 to 30 seconds, once per installation", what)

    def on_end(self, event: Any) -> None:
        """Nothing is said then."""


register("numba:compile", _Announcements())  # type: ignore[no-untyped-call]
if hasattr(os, "register_at_fork"):  # a fork waits for what is compiled or loaded, else its child would wait for ever
    os.register_at_fork(
        before=global_compiler_lock.acquire,
        after_in_parent=global_compiler_lock.release,
        after_in_child=global_compiler_lock.release,
    )
