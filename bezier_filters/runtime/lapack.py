"""LAPACK's Cholesky factorisation, called without the interpreter lock, which scipy's own wrapper keeps."""

import ctypes
from functools import cache
from typing import Any

from numba.extending import get_cython_function_address

from bezier_filters.arrays import FloatArray


@cache
def _dpotrf() -> Any:
    integer = ctypes.POINTER(ctypes.c_int)
    signature = ctypes.CFUNCTYPE(None, ctypes.c_char_p, integer, ctypes.c_void_p, integer, integer)
    return signature(get_cython_function_address("scipy.linalg.cython_lapack", "dpotrf"))


def factor_in_place(matrix: FloatArray, first: int = 0) -> bool:
    """Replace the lower triangle of a symmetric matrix, from a row and column on, by its Cholesky factor.

    Parameters
    ----------
    matrix : (n, n) float64
        Rows of contiguous numbers, one after another. What is above the diagonal does not matter and stays.
    first : int
        Rows and columns before this one stay, too.

    Returns
    -------
    bool
        False if the matrix is not positive definite; what is in it then means nothing.

    Examples
    --------
    >>> import numpy as np
    >>> matrix = np.array([[4.0, 9.0], [2.0, 5.0]])
    >>> factor_in_place(matrix), np.tril(matrix).tolist()
    (True, [[2.0, 0.0], [1.0, 2.0]])
    """
    count, width, problem = (ctypes.c_int(number) for number in (len(matrix) - first, len(matrix), 0))
    start = matrix.ctypes.data + first * (len(matrix) + 1) * matrix.itemsize
    _dpotrf()(b"U", count, start, width, problem)  # rows here are columns there
    return problem.value == 0
