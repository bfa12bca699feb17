"""Cholesky factorisation by LAPACK without the interpreter lock, which SciPy's own call holds."""

from collections.abc import Callable
from ctypes import CFUNCTYPE, byref, c_char_p, c_int64, c_void_p
from functools import cache
from typing import Any

from numba.extending import get_cython_function_address

from bezier_filters.arrays import FloatArray
from bezier_filters.runtime.blas_memory import check_blas_memory


def factorise(matrix: FloatArray) -> bool:
    """Replace the lower triangle of a symmetric matrix (n, n) by its factor L; False if it is not positive definite.

    Entries above the diagonal are neither read nor written. MemoryError if LAPACK's buffers cannot be allocated.

    >>> import numpy as np
    >>> matrix = np.array([[4.0, 9.0], [2.0, 5.0]])
    >>> factorise(matrix), matrix.tolist()
    (True, [[2.0, 9.0], [1.0, 2.0]])
    """
    # LAPACK is column-major, so that its upper triangle is the lower one here. Its integers have 32 or 64 bits.
    check_blas_memory()
    size, problem = c_int64(len(matrix)), c_int64(0)
    _dpotrf()(b"U", byref(size), matrix.ctypes.data, byref(size), byref(problem))
    return problem.value == 0


@cache
def _dpotrf() -> Callable[..., None]:
    """LAPACK's dpotrf, as SciPy exports it for compiled code."""
    pointer: Any = c_void_p
    signature = CFUNCTYPE(None, c_char_p, pointer, pointer, pointer, pointer)
    address = get_cython_function_address("scipy.linalg.cython_lapack", "dpotrf")
    return signature(address)
