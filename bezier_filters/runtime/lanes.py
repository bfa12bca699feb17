"""Eight numbers at a time: a vector type for compiled code.

Lanes hold a float64 for each of eight vertices. Where numba compiles the functions of this module, and the
operators + - * / between lanes, lanes live in a vector register, or in two or four narrower ones, and arithmetic on
them is explicit vector code, which compilers do not reliably make of loops over eight entries. The bodies of the
functions define what they do; without the compiler they run as they stand, and lanes are arrays of eight numbers.
Arrays of lanes are flat float64 arrays in which the eight numbers lie next to each other; see `aligned`.
"""

import operator
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.datamodel.manager import DataModelManager
from numba.core.typing.templates import ConcreteTemplate, Signature, infer_global
from numba.extending import lower_builtin, models, register_model

from bezier_filters.arrays import FloatArray

LANES = 8
Lanes: TypeAlias = FloatArray  # eight numbers; see above what they are in compiled code


def load(array: FloatArray, place: int) -> Lanes:
    """Lanes array[8 place : 8 place + 8] of a flat float64 array."""
    return array[LANES * place : LANES * (place + 1)].copy()


def store(array: FloatArray, place: int, value: Lanes) -> None:
    """Write lanes to array[8 place : 8 place + 8]."""
    array[LANES * place : LANES * (place + 1)] = value


def spread(number: float) -> Lanes:
    """The same number in all lanes."""
    return np.full(LANES, number)


def multiply_add(a: Lanes, b: Lanes, c: Lanes) -> Lanes:
    """Lanes a b + c, rounded once where the processor can."""
    return a * b + c


def square_root(a: Lanes) -> Lanes:
    """Lanes of square roots."""
    return np.sqrt(a)


def where_greater(a: Lanes, b: Lanes, chosen: Lanes, other: Lanes) -> Lanes:
    """Lanes of `chosen` where a > b, and of `other` where not, or where one of them is NaN."""
    return np.where(a > b, chosen, other)


def aligned(count: int) -> FloatArray:
    """Array for `count` lanes, filled with zeros, that starts on a cache line."""
    memory = np.zeros(LANES * (count + 1))
    skip = -(memory.ctypes.data // 8) % LANES
    return memory[skip : skip + LANES * count]


class LanesType(types.Type):
    """Type of eight float64."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


_LANES, _ARRAY = LanesType(), types.Array(types.float64, 1, "C")
_DOUBLE, _INT32 = ir.DoubleType(), ir.IntType(32)
_VECTOR = ir.VectorType(_DOUBLE, LANES)

Arguments = Sequence[ir.Value]
# writes what compiled code does with some arguments, and returns the result
Instructions = Callable[[BaseContext, ir.IRBuilder, Signature, Arguments], ir.Value]


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    """In a vector register."""

    def __init__(self, manager: DataModelManager, numba_type: LanesType) -> None:
        super().__init__(manager, numba_type, _VECTOR)


def compile_as(function: Callable[..., object], signature: Signature, instructions: Instructions) -> None:
    """Let compiled code do with a function of some types what the instructions say."""

    @infer_global(function)
    class _Cases(ConcreteTemplate):
        cases = [signature]  # noqa: RUF012

    lower_builtin(function, *signature.args)(instructions)


def _library_function(name: str) -> Instructions:
    """One of LLVM's vector functions."""

    def call(context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Arguments) -> ir.Value:
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * len(arguments))
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64")
        return builder.call(function, arguments)

    return call


def vector_address(
    vector: ir.VectorType,
    context: BaseContext,
    builder: ir.IRBuilder,
    signature: Signature,
    array: ir.Value,
    place: ir.Value,
) -> ir.Value:
    """Where a vector is in an array of them."""
    data = context.make_array(signature.args[0])(context, builder, array).data
    element = builder.gep(data, [builder.mul(place, ir.Constant(place.type, vector.count))])
    return builder.bitcast(element, vector.as_pointer())


_address = partial(vector_address, _VECTOR)


def _store(context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Arguments) -> ir.Value:
    array, place, value = arguments
    builder.store(value, _address(context, builder, signature, array, place), align=8)
    return context.get_dummy_value()


def spread_over(builder: ir.IRBuilder, number: ir.Value, vector: ir.VectorType) -> ir.Value:
    """The same number in all places of a vector."""
    undefined = ir.Constant(vector, ir.Undefined)
    one = builder.insert_element(undefined, number, ir.Constant(_INT32, 0))
    return builder.shuffle_vector(one, undefined, ir.Constant(ir.VectorType(_INT32, vector.count), [0] * vector.count))


_TWO = _LANES(_LANES, _LANES)
compile_as(operator.add, _TWO, lambda context, builder, signature, args: builder.fadd(*args))
compile_as(operator.sub, _TWO, lambda context, builder, signature, args: builder.fsub(*args))
compile_as(operator.mul, _TWO, lambda context, builder, signature, args: builder.fmul(*args))
compile_as(operator.truediv, _TWO, lambda context, builder, signature, args: builder.fdiv(*args))
compile_as(
    load, _LANES(_ARRAY, types.intp), lambda c, builder, s, args: builder.load(_address(c, builder, s, *args), align=8)
)
compile_as(store, types.void(_ARRAY, types.intp, _LANES), _store)
compile_as(
    spread, _LANES(types.float64), lambda context, builder, signature, args: spread_over(builder, args[0], _VECTOR)
)
compile_as(multiply_add, _LANES(_LANES, _LANES, _LANES), _library_function("fmuladd"))
compile_as(square_root, _LANES(_LANES), _library_function("sqrt"))
compile_as(
    where_greater,
    _LANES(_LANES, _LANES, _LANES, _LANES),
    lambda context, builder, signature, args: builder.select(builder.fcmp_ordered(">", *args[:2]), *args[2:]),
)
