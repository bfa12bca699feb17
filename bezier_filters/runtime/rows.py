"""Rows of four numbers in single precision: a vector type for compiled code that works on four signals side by side.

Where numba compiles the functions of this module, a row of an array (n, 4) lives in a vector register, and what is done
to its four numbers is one instruction, which compilers do not make of four variables. The bodies of the functions
define what they do; without the compiler they run as they stand, and rows are arrays of four numbers.
"""

from functools import partial
from typing import TypeAlias

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.datamodel.manager import DataModelManager
from numba.core.typing.templates import Signature
from numba.extending import models, register_model

from bezier_filters.arrays import SingleArray
from bezier_filters.runtime.lanes import Arguments, compile_as, spread_over, vector_address

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


class RowType(types.Type):
    """Type of four float32."""

    def __init__(self) -> None:
        super().__init__(name="Row")


_ROW, _ARRAY = RowType(), types.Array(types.float32, 2, "C")
_VECTOR = ir.VectorType(ir.FloatType(), NUMBERS)


@register_model(RowType)
class _RowModel(models.PrimitiveModel):
    """In a vector register."""

    def __init__(self, manager: DataModelManager, numba_type: RowType) -> None:
        super().__init__(manager, numba_type, _VECTOR)


_address = partial(vector_address, _VECTOR)


def _write(context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Arguments) -> ir.Value:
    array, place, value = arguments
    builder.store(value, _address(context, builder, signature, array, place), align=4)
    return context.get_dummy_value()


def _scale(context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Arguments) -> ir.Value:
    return builder.fmul(spread_over(builder, arguments[0], _VECTOR), arguments[1])


def _add_scaled(context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Arguments) -> ir.Value:
    number, value, total = arguments
    kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
    function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fmuladd.v{NUMBERS}f32")
    return builder.call(function, [spread_over(builder, number, _VECTOR), value, total])


compile_as(zero_row, _ROW(), lambda context, builder, signature, args: ir.Constant(_VECTOR, [0.0] * NUMBERS))
compile_as(
    row_of,
    _ROW(_ARRAY, types.intp),
    lambda context, builder, signature, args: builder.load(_address(context, builder, signature, *args), align=4),
)
compile_as(write_row, types.void(_ARRAY, types.intp, _ROW), _write)
compile_as(scaled, _ROW(types.float32, _ROW), _scale)
compile_as(add_scaled, _ROW(types.float32, _ROW, _ROW), _add_scaled)
