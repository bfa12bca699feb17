"""Eight numbers at a time: a vector type for compiled code.

Lanes hold one number, float64 or float32, for each of eight vertices. In compiled code they live in a vector register,
or in two or four narrower ones, and the operators + - * / and the functions of this module are explicit vector
instructions, which compilers do not reliably generate from loops over eight entries. The Python bodies of the functions
define their meaning; without the compiler they run as they are, and lanes are arrays of eight numbers. Arrays of lanes
are flat, with the eight numbers of an entry adjacent; see `lane_array`.
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
Place: TypeAlias = int | np.uint32  # index; unsigned ones need no check for negative indices in compiled code
Lanes: TypeAlias = RealArray  # eight numbers; a vector in compiled code


def load(array: RealArray, place: Place) -> Lanes:
    """Lanes array[8 place : 8 place + 8] of a flat array."""
    return array[LANES * place : LANES * (place + 1)].copy()


def store(array: RealArray, place: Place, value: Lanes) -> None:
    """Write lanes to array[8 place : 8 place + 8]."""
    array[LANES * place : LANES * (place + 1)] = value


def broadcast(number: float | np.float32) -> Lanes:
    """Copy a number to all lanes."""
    return np.full(LANES, number)


def multiply_add(a: Lanes, b: Lanes, c: Lanes) -> Lanes:
    """Lanes a b + c, fused (rounded once) if the processor supports it."""
    return a * b + c


def square_root(a: Lanes) -> Lanes:
    """Lanes of square roots."""
    return np.sqrt(a)


def where_greater(a: Lanes, b: Lanes, chosen: Lanes, other: Lanes) -> Lanes:
    """Lanes of `chosen` where a > b, else of `other`, also for NaN."""
    return np.where(a > b, chosen, other)


def lane_array(count: int) -> FloatArray:
    """Uninitialised array of `count` lanes, aligned to a cache line."""
    memory = np.empty(LANES * (count + 1))
    skip = -(memory.ctypes.data // 8) % LANES
    return memory[skip : skip + LANES * count]


class VectorType(types.Type):
    """Numba type of a vector of numbers."""

    def __init__(self, name: str, number: ir.Type, count: int) -> None:
        super().__init__(name=name)
        self.vector = ir.VectorType(number, count)


@register_model(VectorType)
class _VectorModel(models.PrimitiveModel):
    """Data model: one or several vector registers."""

    def __init__(self, manager: DataModelManager, numba_type: VectorType) -> None:
        super().__init__(manager, numba_type, numba_type.vector)


# emits LLVM instructions for the arguments of a call and returns its result
Instructions = Callable[[BaseContext, ir.IRBuilder, Signature, Sequence[ir.Value]], ir.Value]


def compile_as(function: Callable[..., object], signatures: Sequence[Signature], instructions: Instructions) -> None:
    """Register the instructions of a function in compiled code, for each of its signatures."""

    @infer_global(function)
    class _Cases(ConcreteTemplate):
        cases = signatures

    for signature in signatures:
        lower_builtin(function, *signature.args)(instructions)


def load_vector(
    context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Sequence[ir.Value]
) -> ir.Value:
    """Emit a vector load from an array at an index."""
    array = signature.args[0]
    address = _address(context, builder, array, signature.return_type.vector, *arguments)
    return builder.load(address, align=array.dtype.bitwidth // 8)


def store_vector(
    context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Sequence[ir.Value]
) -> ir.Value:
    """Emit a vector store to an array at an index."""
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
    """Emit the address of a vector in an array."""
    data = context.make_array(numba_type)(context, builder, array).data
    element = builder.gep(data, [builder.mul(place, ir.Constant(place.type, vector.count))])
    return builder.bitcast(element, vector.as_pointer())


def library_function(name: str) -> Instructions:
    """Instructions that call a vector intrinsic of LLVM; scalar arguments are broadcast."""

    def call(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Sequence[ir.Value]
    ) -> ir.Value:
        vector = signature.return_type.vector
        kind = ir.FunctionType(vector, [vector] * len(arguments))
        full_name = f"llvm.{name}.v{vector.count}{vector.element.intrinsic_name}"
        function = cgutils.get_or_insert_function(builder.module, kind, full_name)
        return builder.call(function, [broadcast_value(builder, argument, vector) for argument in arguments])

    return call


def broadcast_value(builder: ir.IRBuilder, number: ir.Value, vector: ir.VectorType) -> ir.Value:
    """Broadcast a number to a vector; vectors are returned unchanged."""
    if number.type == vector:
        return number
    int32, undefined = ir.IntType(32), ir.Constant(vector, ir.Undefined)
    one = builder.insert_element(undefined, number, ir.Constant(int32, 0))
    return builder.shuffle_vector(one, undefined, ir.Constant(ir.VectorType(int32, vector.count), [0] * vector.count))


SINGLE_LANES = VectorType("SingleLanes", ir.FloatType(), LANES)
_LANE_TYPES = (VectorType("Lanes", ir.DoubleType(), LANES), types.float64), (SINGLE_LANES, types.float32)
_BINARY = [lanes(lanes, lanes) for lanes, _ in _LANE_TYPES]
compile_as(operator.add, _BINARY, lambda context, builder, signature, args: builder.fadd(*args))
compile_as(operator.sub, _BINARY, lambda context, builder, signature, args: builder.fsub(*args))
compile_as(operator.mul, _BINARY, lambda context, builder, signature, args: builder.fmul(*args))
compile_as(operator.truediv, _BINARY, lambda context, builder, signature, args: builder.fdiv(*args))
compile_as(load, [lanes(types.Array(number, 1, "C"), types.intp) for lanes, number in _LANE_TYPES], load_vector)
compile_as(
    store, [types.void(types.Array(number, 1, "C"), types.intp, lanes) for lanes, number in _LANE_TYPES], store_vector
)
compile_as(
    broadcast,
    [lanes(number) for lanes, number in _LANE_TYPES],
    lambda context, builder, signature, args: broadcast_value(builder, args[0], signature.return_type.vector),
)
compile_as(multiply_add, [lanes(lanes, lanes, lanes) for lanes, _ in _LANE_TYPES], library_function("fmuladd"))
compile_as(square_root, [lanes(lanes) for lanes, _ in _LANE_TYPES], library_function("sqrt"))
compile_as(
    where_greater,
    [lanes(lanes, lanes, lanes, lanes) for lanes, _ in _LANE_TYPES],
    lambda context, builder, signature, args: builder.select(builder.fcmp_ordered(">", *args[:2]), *args[2:]),
)
