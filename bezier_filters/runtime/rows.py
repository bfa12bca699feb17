"""Rows of four numbers in single precision: a vector type for compiled code that works on four signals side by side.

Where numba compiles the functions of this module, a row of an array (n, 4) lives in a vector register, and what is done
to its four numbers is one instruction, which compilers do not make of four variables. The bodies of the functions
define what they do; without the compiler they run as they stand, and rows are arrays of four numbers.
"""

from typing import TypeAlias

import numpy as np
from llvmlite import ir
from numba import types

from bezier_filters.arrays import SingleArray
from bezier_filters.runtime.lanes import (
    VectorType,
    compile_as,
    library_function,
    load_vector,
    spread_over,
    store_vector,
)

NUMBERS = 4
Place: TypeAlias = int | np.uint32  # of a row; without a sign, compiled code need not ask whether it is from the end
Row: TypeAlias = SingleArray  # four numbers; see above what they are in compiled code


def zero_row() -> Row:
    """Four zeros."""
    return np.zeros(NUMBERS, dtype=np.float32)


def row_of(array: SingleArray, place: Place) -> Row:
    """One row of an array (n, 4)."""
    result: Row = array[place].copy()
    return result


def write_row(array: SingleArray, place: Place, value: Row) -> None:
    """Write one row of an array (n, 4)."""
    array[place] = value


def scaled(number: np.float32, value: Row) -> Row:
    """A number times a row."""
    result: Row = number * value
    return result


def add_scaled(number: np.float32, value: Row, total: Row) -> Row:
    """A number times a row, plus another row, rounded once where the processor can."""
    return number * value + total


_ROW, _ARRAY = VectorType("Row", ir.FloatType(), NUMBERS), types.Array(types.float32, 2, "C")
compile_as(zero_row, _ROW(), lambda context, builder, signature, args: ir.Constant(_ROW.vector, [0.0] * NUMBERS))
compile_as(row_of, _ROW(_ARRAY, types.intp), load_vector)
compile_as(write_row, types.void(_ARRAY, types.intp, _ROW), store_vector)
compile_as(
    scaled,
    _ROW(types.float32, _ROW),
    lambda context, builder, signature, args: builder.fmul(spread_over(builder, args[0], _ROW.vector), args[1]),
)
compile_as(add_scaled, _ROW(types.float32, _ROW, _ROW), library_function("fmuladd"))
