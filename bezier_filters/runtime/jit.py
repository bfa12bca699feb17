"""Decorators for compiled functions, most of them without allocations and reference counting.

Reference counting took half of the time of the kernels: each function increments and decrements the counter of every
array it reads, atomically. `_nrt` is numba's name for its reference-counting runtime.
"""

import os
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numba.core.compiler_lock import global_compiler_lock

from bezier_filters.runtime.compile_time import watch_compiler
from bezier_filters.runtime.kernel_cache import KernelCache
from bezier_filters.runtime.kernel_key import PACKAGE

Function = TypeVar("Function", bound=Callable[..., object])


def jit(**options: object) -> Callable[[Function], Function]:
    """`numba.njit` with a disk cache and without the interpreter lock, for functions that allocate no arrays."""
    return _cache_on_disk(_nrt=False, nogil=True, **options)


def allocating_jit(**options: object) -> Callable[[Function], Function]:
    """`jit` for functions that allocate arrays."""
    return _cache_on_disk(nogil=True, **options)


def short_jit(**options: object) -> Callable[[Function], Function]:
    """`jit` for functions of some microseconds, which keep the lock: reacquiring it takes as long."""
    return _cache_on_disk(_nrt=False, **options)


def inner_jit(**options: object) -> Callable[[Function], Function]:
    """`jit` for functions that only compiled code calls.

    They become part of their callers, in the cache, too. Wrappers for calls from Python would take a quarter of the
    time of the first compilation. A function is compiled again for every literal integer argument, see `opaque`. A call
    with several arrays takes some 30 ns to pass their fields; with ``inline="always"`` there is no call.

    Functions with `fastmath` must be inlined. Otherwise the process that compiles a caller links the separately
    compiled copy of the function, and later processes link the copy in the cache of the caller, whose sums may have
    another order.
    """
    return _compiler(_nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)


def _cache_on_disk(**options: object) -> Callable[[Function], Function]:
    """Compiler with a disk cache, for functions of this package, whose sources are part of the key."""

    def compile_lazily(function: Function) -> Function:
        compiled: Any = _compiler(**options)(function)
        is_ours = function.__module__.partition(".")[0] == PACKAGE.name
        if is_ours and compiled is not function:  # they are the same if the JIT is disabled
            compiled._cache = KernelCache(function)
        return cast("Function", compiled)

    return compile_lazily


def _compiler(*, fastmath: object = False, **options: object) -> Callable[[Function], Function]:
    """`numba.njit` with `fastmath` of the function itself.

    If it is not set, a function inherits it from the caller that is compiled first, and keeps it for all others: the
    order of its sums would depend on which caller a process compiles first, and which ones it loads from the cache.
    """
    compiler = cast("Callable[..., Callable[[Function], Function]]", njit)  # the stubs lack `_nrt`
    return compiler(error_model="numpy", fastmath=fastmath, **options)


@inner_jit()
def opaque(number: int) -> int:
    """Hide a literal or a narrow integer from the compiler, which would specialise the callee for it."""
    return int(np.int64(number))


watch_compiler()
if hasattr(os, "register_at_fork"):  # a fork during a compilation would deadlock its child
    os.register_at_fork(
        before=global_compiler_lock.acquire,
        after_in_parent=global_compiler_lock.release,
        after_in_child=global_compiler_lock.release,
    )
