"""Eight numbers at a time: a vector type for compiled code.

A `Lanes` value holds a float64 for each of eight vertices and lives in a vector register, or in
two or four narrower ones. Arithmetic on it is explicit vector code, which compilers do not
reliably make of loops over eight entries. Arrays of lanes are flat float64 arrays in which the
eight numbers lie next to each other; see `aligned`.

There is no such type in plain Python: code that uses it runs compiled only.
"""

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, models, register_model

from bezier_filters.arrays import FloatArray

LANES = 8
_intrinsic: Callable[[Callable[..., Any]], Any] = intrinsic
_DOUBLE, _INT32 = ir.DoubleType(), ir.IntType(32)
_VECTOR = ir.VectorType(_DOUBLE, LANES)


class LanesType(types.Type):
    """Type of eight float64."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


lanes_type = LanesType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    """In a vector register."""

    def __init__(self, manager: Any, numba_type: LanesType) -> None:
        super().__init__(manager, numba_type, _VECTOR)


def _define_operator(operation: Callable[..., Any], instruction: str) -> None:
    """Give two lanes an operator."""

    @infer_global(operation)
    class _Operator(ConcreteTemplate):
        cases = [lanes_type(lanes_type, lanes_type)]  # noqa: RUF012

    @lower_builtin(operation, lanes_type, lanes_type)
    def _lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return getattr(builder, instruction)(*arguments)


for _operation, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _define_operator(_operation, _instruction)


def _address(context: Any, builder: Any, array_type: Any, array: Any, place: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    element = builder.gep(data, [builder.mul(place, ir.Constant(place.type, LANES))])
    return builder.bitcast(element, _VECTOR.as_pointer())


@_intrinsic
def load(typing_context: Any, array: Any, place: Any) -> Any:
    """Lanes array[8 place : 8 place + 8] of a flat float64 array."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_address(context, builder, signature.args[0], *arguments), align=8)

    return lanes_type(array, types.intp), generate


@_intrinsic
def store(typing_context: Any, array: Any, place: Any, value: Any) -> Any:
    """Write lanes to array[8 place : 8 place + 8]."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, place, value = arguments
        builder.store(value, _address(context, builder, signature.args[0], array, place), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type), generate


@_intrinsic
def spread(typing_context: Any, number: Any) -> Any:
    """The same number in all lanes."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        undefined = ir.Constant(_VECTOR, ir.Undefined)
        one = builder.insert_element(undefined, arguments[0], ir.Constant(_INT32, 0))
        return builder.shuffle_vector(one, undefined, ir.Constant(ir.VectorType(_INT32, LANES), [0] * LANES))

    return lanes_type(types.float64), generate


def _library_function(name: str, arity: int) -> Any:
    """One of LLVM's vector functions."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * arity)
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64")
        return builder.call(function, arguments)

    return generate


@_intrinsic
def multiply_add(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Lanes a b + c."""
    return lanes_type(lanes_type, lanes_type, lanes_type), _library_function("fmuladd", 3)


@_intrinsic
def square_root(typing_context: Any, a: Any) -> Any:
    """Lanes of square roots."""
    return lanes_type(lanes_type), _library_function("sqrt", 1)


@_intrinsic
def where_greater(typing_context: Any, a: Any, b: Any, chosen: Any, other: Any) -> Any:
    """Lanes of `chosen` where a > b, and of `other` where not, or where one of them is NaN."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, b, chosen, other = arguments
        return builder.select(builder.fcmp_ordered(">", a, b), chosen, other)

    return lanes_type(lanes_type, lanes_type, lanes_type, lanes_type), generate


def aligned(count: int) -> FloatArray:
    """Array for `count` lanes, filled with zeros, that starts on a cache line."""
    memory = np.zeros(LANES * (count + 1))
    skip = -(memory.ctypes.data // 8) % LANES
    return memory[skip : skip + LANES * count]
