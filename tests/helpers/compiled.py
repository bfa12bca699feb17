"""Lets tests call functions that only compiled code can call."""

from functools import cache

import numpy as np
from numba import njit


@cache
def from_python(function):
    """The function behind an entry from Python; without the compiler it warns of no more than compiled code does."""
    plain = getattr(function, "py_func", function)
    return np.errstate(all="ignore")(njit(plain, error_model="numpy"))
