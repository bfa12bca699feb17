"""Rows of four numbers in single precision: a vector type for compiled code that works on four signals side by side.

Where numba compiles the functions of this module, a row of an array (n, 4) lives in a vector register, and what is done
to its four numbers is one instruction, which compilers do not make of four variables. Two rows next to each other are
lanes in single precision. The bodies of the functions define what they do; without the compiler they run as they stand,
and rows are arrays of four numbers.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.base import BaseContext
from numba.core.typing.templates import Signature

from bezier_filters.arrays import SingleArray
from bezier_filters.runtime.lanes import (
    SINGLE_LANES,
    Lanes,
    Place,
    VectorType,
    compile_as,
    library_function,
    load_vector,
    spread_over,
    store_vector,
)

NUMBERS = 4
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


def vectors(rows: Lanes) -> Lanes:
    """Two rows whose last numbers are 0."""
    return np.where(np.arange(2 * NUMBERS) % NUMBERS == NUMBERS - 1, np.float32(0.0), rows)


def first_twice(rows: Lanes) -> Lanes:
    """The first of two rows in place of both."""
    return np.concatenate([rows[:NUMBERS], rows[:NUMBERS]])


def inner_products(a: Lanes, b: Lanes) -> Lanes:
    """Those of the first three numbers of two rows each, four times."""
    products = (a * b).reshape(2, NUMBERS)
    return np.repeat(products[:, 0] + products[:, 1] + products[:, 2], NUMBERS)


_ROW, _ARRAY = VectorType("Row", ir.FloatType(), NUMBERS), types.Array(types.float32, 2, "C")
compile_as(zero_row, [_ROW()], lambda context, builder, signature, args: ir.Constant(_ROW.vector, [0.0] * NUMBERS))
compile_as(row_of, [_ROW(_ARRAY, types.intp)], load_vector)
compile_as(write_row, [types.void(_ARRAY, types.intp, _ROW)], store_vector)
compile_as(
    scaled,
    [_ROW(types.float32, _ROW)],
    lambda context, builder, signature, args: builder.fmul(spread_over(builder, args[0], _ROW.vector), args[1]),
)
compile_as(add_scaled, [_ROW(types.float32, _ROW, _ROW)], library_function("fmuladd"))


def _shuffled(builder: ir.IRBuilder, value: ir.Value, places: Sequence[int]) -> ir.Value:
    """Numbers of a vector, and a 0 that follows them, by their places."""
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(places)), list(places))
    return builder.shuffle_vector(value, ir.Constant(value.type, [0.0] * value.type.count), mask)


def _inner_products(
    context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Sequence[ir.Value]
) -> ir.Value:
    products = builder.fmul(*arguments)
    x, y, z = (_shuffled(builder, products, [k] * NUMBERS + [NUMBERS + k] * NUMBERS) for k in range(3))
    return builder.fadd(builder.fadd(x, y), z)


_OF_ONE = [SINGLE_LANES(SINGLE_LANES)]
compile_as(
    vectors,
    _OF_ONE,
    lambda context, builder, signature, args: _shuffled(builder, args[0], [0, 1, 2, 8, 4, 5, 6, 8]),
)
compile_as(
    first_twice, _OF_ONE, lambda context, builder, signature, args: _shuffled(builder, args[0], 2 * [0, 1, 2, 3])
)
compile_as(inner_products, [SINGLE_LANES(SINGLE_LANES, SINGLE_LANES)], _inner_products)
