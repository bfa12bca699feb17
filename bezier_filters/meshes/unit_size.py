"""Meshes of any size, computed at about unit size.

Sixth derivatives, their squares and products of these leave the range of float64 long before coordinates do. A mesh
whose size is far from 1 is therefore scaled by a power of two, which changes no digit, and so is what is found.
"""

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from math import frexp, ldexp
from typing import Any, ParamSpec, TypeVar, cast

from numpy.typing import ArrayLike

from bezier_filters.arguments import real_array
from bezier_filters.meshes.mesh import LARGEST, SMALLEST

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

# Metadata of fields of results: the power of length in their unit. Fields without are numbers, directions and counts.
_POWER = "power of length"
LENGTH: Mapping[str, int] = {_POWER: 1}
VOLUME: Mapping[str, int] = {_POWER: 3}
CURVATURE: Mapping[str, int] = {_POWER: -1}
SQUARED_CURVATURE: Mapping[str, int] = {_POWER: -2}

# Power of two up to which a mesh is computed as it is. Squares of sixth derivatives are the highest powers of length,
# and 2^(12 * 48) leaves as much again of float64's range for the sizes of details. Halved, no digit changes; doubled,
# fits of a sphere at 2^90 find no noise model.
MOST_BITS = 48


def normalizes_size(*lengths: str) -> Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Let a function of vertices and faces compute meshes of extreme size at unit size.

    `lengths` names those of its other arguments that are lengths. Results, and results among the arguments, are
    dataclasses whose fields say their unit.

    >>> import numpy as np
    >>> @normalizes_size("step")
    ... def shifted(vertices, faces, step):
    ...     return Shifted(np.add(vertices, step))
    >>> @dataclasses.dataclass
    ... class Shifted:
    ...     vertices: np.ndarray = dataclasses.field(metadata=LENGTH)
    >>> shifted([[1e30, 0, 0]], [], 2e30).vertices
    array([[3.e+30, 2.e+30, 2.e+30]])
    """

    def decorate(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
        signature = inspect.signature(function)

        @wraps(function)
        def normalized(*args: Parameters.args, **options: Parameters.kwargs) -> Result:
            given = cast("ArrayLike", args[0] if args else options.get("vertices"))
            exponent = size_exponent(given)
            if not exponent:
                return function(*args, **options)
            bound = signature.bind(*args, **options)
            for name, value in bound.arguments.items():
                if name == "vertices":
                    bound.arguments[name] = real_array(given) * ldexp(1.0, -exponent)
                elif name in lengths and value is not None:
                    bound.arguments[name] = value * ldexp(1.0, -exponent)
                elif dataclasses.is_dataclass(value):
                    bound.arguments[name] = _rescale(value, -exponent)
            return cast("Result", _rescale(function(*bound.args, **bound.kwargs), exponent))

        return normalized

    return decorate


def size_exponent(vertices: ArrayLike) -> int:
    """Power of two that the largest coordinate lies below, 0 if a mesh is computed as it is, or will be refused."""
    try:
        points = real_array(vertices)
    except (TypeError, ValueError):
        return 0
    largest = max(points.max(initial=0.0), -points.min(initial=0.0))
    if not SMALLEST <= largest <= LARGEST:
        return 0
    exponent = frexp(largest)[1]
    return exponent if abs(exponent) > MOST_BITS else 0


def _rescale(value: Any, exponent: int) -> Any:
    """A result of a mesh, as that of the mesh scaled by a power of two."""
    if isinstance(value, tuple):
        return tuple(_rescale(item, exponent) for item in value)
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return value
    changed = {}
    for field in dataclasses.fields(value):
        old, power = getattr(value, field.name), field.metadata.get(_POWER)
        if power is not None and old is not None:
            changed[field.name] = old * ldexp(1.0, power * exponent)
        else:
            changed[field.name] = _rescale(old, exponent)
    return dataclasses.replace(value, **changed)
