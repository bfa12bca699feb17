"""The names of `jit` before it was called so, for modules that still use them."""

from bezier_filters.runtime.jit import inner_jit as inner_njit
from bezier_filters.runtime.jit import jit as lean_njit
from bezier_filters.runtime.jit import variable

__all__ = ["inner_njit", "lean_njit", "variable"]
