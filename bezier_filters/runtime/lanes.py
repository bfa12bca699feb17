"""Eight numbers at a time: a vector type for compiled code.

Lanes hold a number, float64 or float32, for each of eight vertices. Where numba compiles the functions of this module,
and the operators + - * / between lanes, lanes live in a vector register, or in two or four narrower ones, and
arithmetic on them is explicit vector code, which compilers do not reliably make of loops over eight entries. The bodies
of the functions define what they do; without the compiler they run as they stand, and lanes are arrays of eight
numbers. Arrays of lanes are flat ones in which the eight numbers lie next to each other; see `aligned`.
"""

import operator
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.datamodel.manager import DataModelManager
from numba.core.typing.templates import ConcreteTemplate, Signature, infer_global
from numba.extending import lower_builtin, models, register_model

from bezier_filters.arrays import FloatArray, RealArray

LANES = 8
Place: TypeAlias = int | np.uint32  # in an array; without a sign, compiled code need not ask whether it is from the end
Lanes: TypeAlias = RealArray  # eight numbers; see above what they are in compiled code


def load(array: RealArray, place: Place) -> Lanes:
    """Lanes array[8 place : 8 place + 8] of a flat array."""
    return array[LANES * place : LANES * (place + 1)].copy()


def store(array: RealArray, place: Place, value: Lanes) -> None:
    """Write lanes to array[8 place : 8 place + 8]."""
    array[LANES * place : LANES * (place + 1)] = value


def spread(number: float | np.float32) -> Lanes:
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
    """Array for `count` lanes, holding anything, that starts on a cache line."""
    memory = np.empty(LANES * (count + 1))
    skip = -(memory.ctypes.data // 8) % LANES
    return memory[skip : skip + LANES * count]


class VectorType(types.Type):
    """Type of some numbers side by side."""

    def __init__(self, name: str, number: ir.Type, count: int) -> None:
        super().__init__(name=name)
        self.vector = ir.VectorType(number, count)


@register_model(VectorType)
class _VectorModel(models.PrimitiveModel):
    """In a vector register, or in several."""

    def __init__(self, manager: DataModelManager, numba_type: VectorType) -> None:
        super().__init__(manager, numba_type, numba_type.vector)


# writes what compiled code does with some arguments, and returns the result
Instructions = Callable[[BaseContext, ir.IRBuilder, Signature, Sequence[ir.Value]], ir.Value]


def compile_as(function: Callable[..., object], signatures: Sequence[Signature], instructions: Instructions) -> None:
    """Let compiled code do with a function, for each of some signatures, what the instructions say."""

    @infer_global(function)
    class _Cases(ConcreteTemplate):
        cases = signatures

    for signature in signatures:
        lower_builtin(function, *signature.args)(instructions)


def load_vector(
    context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Sequence[ir.Value]
) -> ir.Value:
    """Read a vector from an array of them, at a place."""
    array = signature.args[0]
    address = _address(context, builder, array, signature.return_type.vector, *arguments)
    return builder.load(address, align=array.dtype.bitwidth // 8)


def store_vector(
    context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Sequence[ir.Value]
) -> ir.Value:
    """Write a vector to an array of them, at a place."""
    array, _, value = signature.args
    address = _address(context, builder, array, value.vector, *arguments[:2])
    builder.store(arguments[2], address, align=array.dtype.bitwidth // 8)
    return context.get_dummy_value()


def _address(
    context: BaseContext,
    builder: ir.IRBuilder,
    numba_type: types.Array,
    vector: ir.VectorType,
    array: ir.Value,
    place: ir.Value,
) -> ir.Value:
    """Where a vector is in an array of them."""
    data = context.make_array(numba_type)(context, builder, array).data
    element = builder.gep(data, [builder.mul(place, ir.Constant(place.type, vector.count))])
    return builder.bitcast(element, vector.as_pointer())


def library_function(name: str) -> Instructions:
    """One of LLVM's functions of vectors; a number stands for a vector of it."""

    def call(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Sequence[ir.Value]
    ) -> ir.Value:
        vector = signature.return_type.vector
        kind = ir.FunctionType(vector, [vector] * len(arguments))
        full_name = f"llvm.{name}.v{vector.count}{vector.element.intrinsic_name}"
        function = cgutils.get_or_insert_function(builder.module, kind, full_name)
        return builder.call(function, [spread_over(builder, argument, vector) for argument in arguments])

    return call


def spread_over(builder: ir.IRBuilder, number: ir.Value, vector: ir.VectorType) -> ir.Value:
    """The same number in all places of a vector; what is one already stays."""
    if number.type == vector:
        return number
    int32, undefined = ir.IntType(32), ir.Constant(vector, ir.Undefined)
    one = builder.insert_element(undefined, number, ir.Constant(int32, 0))
    return builder.shuffle_vector(one, undefined, ir.Constant(ir.VectorType(int32, vector.count), [0] * vector.count))


SINGLE_LANES = VectorType("SingleLanes", ir.FloatType(), LANES)
_KINDS = (VectorType("Lanes", ir.DoubleType(), LANES), types.float64), (SINGLE_LANES, types.float32)
_TWO = [lanes(lanes, lanes) for lanes, _ in _KINDS]
compile_as(operator.add, _TWO, lambda context, builder, signature, args: builder.fadd(*args))
compile_as(operator.sub, _TWO, lambda context, builder, signature, args: builder.fsub(*args))
compile_as(operator.mul, _TWO, lambda context, builder, signature, args: builder.fmul(*args))
compile_as(operator.truediv, _TWO, lambda context, builder, signature, args: builder.fdiv(*args))
compile_as(load, [lanes(types.Array(number, 1, "C"), types.intp) for lanes, number in _KINDS], load_vector)
compile_as(
    store, [types.void(types.Array(number, 1, "C"), types.intp, lanes) for lanes, number in _KINDS], store_vector
)
compile_as(
    spread,
    [lanes(number) for lanes, number in _KINDS],
    lambda context, builder, signature, args: spread_over(builder, args[0], signature.return_type.vector),
)
compile_as(multiply_add, [lanes(lanes, lanes, lanes) for lanes, _ in _KINDS], library_function("fmuladd"))
compile_as(square_root, [lanes(lanes) for lanes, _ in _KINDS], library_function("sqrt"))
compile_as(
    where_greater,
    [lanes(lanes, lanes, lanes, lanes) for lanes, _ in _KINDS],
    lambda context, builder, signature, args: builder.select(builder.fcmp_ordered(">", *args[:2]), *args[2:]),
)
