"""Rows of four single-precision numbers: a vector type for compiled code that filters four signals in parallel.

In compiled code, a row of an array (n, 4) lives in a vector register, and an operation on its four numbers is one
instruction, which compilers do not generate from four variables. Two adjacent rows are single-precision lanes. The
Python bodies of the functions define their meaning; without the compiler they run as they are, and rows are arrays of
four numbers.
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
    broadcast_value,
    compile_as,
    library_function,
    load_vector,
    store_vector,
)

ROW_LENGTH = 4
Row: TypeAlias = SingleArray  # four numbers; a vector in compiled code


def zero_row() -> Row:
    """Four zeros."""
    return np.zeros(ROW_LENGTH, dtype=np.float32)


def load_row(array: SingleArray, place: Place) -> Row:
    """Load one row of an array (n, 4)."""
    result: Row = array[place].copy()
    return result


def store_row(array: SingleArray, place: Place, value: Row) -> None:
    """Store one row of an array (n, 4)."""
    array[place] = value


def scale_row(number: np.float32, value: Row) -> Row:
    """A number times a row."""
    result: Row = number * value
    return result


def add_scaled_row(number: np.float32, value: Row, total: Row) -> Row:
    """A number times a row, plus another row, fused (rounded once) if the processor supports it."""
    return number * value + total


def zero_w(rows: Lanes) -> Lanes:
    """Set the last number of each of two rows to 0, so that rows are vectors (x, y, z, 0)."""
    return np.where(np.arange(2 * ROW_LENGTH) % ROW_LENGTH == ROW_LENGTH - 1, np.float32(0.0), rows)


def duplicate_low(rows: Lanes) -> Lanes:
    """Replace two rows by two copies of the first."""
    return np.concatenate([rows[:ROW_LENGTH], rows[:ROW_LENGTH]])


def inner_products(a: Lanes, b: Lanes) -> Lanes:
    """Inner product of the first three numbers of each of two rows, broadcast to its four numbers."""
    products = (a * b).reshape(2, ROW_LENGTH)
    return np.repeat(products[:, 0] + products[:, 1] + products[:, 2], ROW_LENGTH)


_ROW, _ARRAY = VectorType("Row", ir.FloatType(), ROW_LENGTH), types.Array(types.float32, 2, "C")
compile_as(zero_row, [_ROW()], lambda context, builder, signature, args: ir.Constant(_ROW.vector, [0.0] * ROW_LENGTH))
compile_as(load_row, [_ROW(_ARRAY, types.intp)], load_vector)
compile_as(store_row, [types.void(_ARRAY, types.intp, _ROW)], store_vector)
compile_as(
    scale_row,
    [_ROW(types.float32, _ROW)],
    lambda context, builder, signature, args: builder.fmul(broadcast_value(builder, args[0], _ROW.vector), args[1]),
)
compile_as(add_scaled_row, [_ROW(types.float32, _ROW, _ROW)], library_function("fmuladd"))


def _shuffle(builder: ir.IRBuilder, value: ir.Value, places: Sequence[int]) -> ir.Value:
    """Emit a shuffle of the numbers of a vector, by index; the index after the last gives 0."""
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(places)), list(places))
    return builder.shuffle_vector(value, ir.Constant(value.type, [0.0] * value.type.count), mask)


def _inner_products(
    context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Sequence[ir.Value]
) -> ir.Value:
    products = builder.fmul(*arguments)
    x, y, z = (_shuffle(builder, products, [k] * ROW_LENGTH + [ROW_LENGTH + k] * ROW_LENGTH) for k in range(3))
    return builder.fadd(builder.fadd(x, y), z)


_UNARY = [SINGLE_LANES(SINGLE_LANES)]
compile_as(
    zero_w,
    _UNARY,
    lambda context, builder, signature, args: _shuffle(builder, args[0], [0, 1, 2, 8, 4, 5, 6, 8]),
)
compile_as(
    duplicate_low, _UNARY, lambda context, builder, signature, args: _shuffle(builder, args[0], 2 * [0, 1, 2, 3])
)
compile_as(inner_products, [SINGLE_LANES(SINGLE_LANES, SINGLE_LANES)], _inner_products)
