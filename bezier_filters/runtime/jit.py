"""Compiled functions that allocate nothing, and so need not count references to their arrays.

Counting took half of the time of the kernels: every array that a function of a kernel looks at is
counted up and down again, atomically. `_nrt` is numba's own name for its run time of references.
"""

from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np
from numba import njit

Function = TypeVar("Function", bound=Callable[..., object])


def jit(**options: object) -> Callable[[Function], Function]:
    """`numba.njit`, cached and without the interpreter lock, for functions that create no arrays."""
    return _compiler(cache=True, **options)


def inner_jit(**options: object) -> Callable[[Function], Function]:
    """The same for functions that only compiled code calls.

    They become part of their callers, in the cache, too. An entry from Python for each of them would
    take a quarter of the time of the first compilation. Functions are compiled once more for every literal
    number that they are given, see `variable`.
    """
    return _compiler(no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)


def _compiler(**options: object) -> Callable[[Function], Function]:
    compiler = cast("Callable[..., Callable[[Function], Function]]", njit)  # whose types do not know of `_nrt`
    return compiler(nogil=True, _nrt=False, error_model="numpy", **options)


@inner_jit()
def variable(number: int) -> int:
    """A number that is known when compiling, or a narrower one, as any other integer."""
    return int(np.int64(number))
