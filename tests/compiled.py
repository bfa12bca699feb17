"""Lets tests call functions that only compiled code can call."""

from functools import cache

from numba import njit


@cache
def from_python(function):
    """The function behind an entry from Python."""
    return njit(lambda *arguments: function(*arguments))
