"""Computation at unit size for meshes of any size.

Products of squares of sixth derivatives leave the range of float64 long before coordinates do. A mesh whose size is
far from 1 is therefore scaled by a power of two, which is exact, and results are scaled back.
"""

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from math import frexp, ldexp
from typing import Any, ParamSpec, TypeVar, cast

from numpy.typing import ArrayLike

from bezier_filters.arguments import real_array
from bezier_filters.errors import is_real
from bezier_filters.meshes.mesh import MAX_COORDINATE, MIN_COORDINATE

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

# Metadata of result fields: the power of length in their unit. Other fields are dimensionless.
_POWER = "power of length"
LENGTH: Mapping[str, int] = {_POWER: 1}
AREA: Mapping[str, int] = {_POWER: 2}
VOLUME: Mapping[str, int] = {_POWER: 3}
CURVATURE: Mapping[str, int] = {_POWER: -1}
SQUARED_CURVATURE: Mapping[str, int] = {_POWER: -2}

# Exponent of two up to which a mesh is not scaled. Squares of sixth derivatives are the highest powers of length, and
# 2^(12 * 48) leaves half of the exponents of float64 for the sizes of details. Halved, no digit changes; doubled, fits
# of a sphere at 2^90 find no noise model.
MAX_UNSCALED_EXPONENT = 48


def normalizes_size(*lengths: str) -> Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Make a function of vertices and faces scale meshes of extreme size to unit size.

    `lengths` names the other arguments that are lengths, or arrays of coordinates. Results, and arguments that are
    results, are dataclasses with the units of their fields as metadata.

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
        def wrapper(*args: Parameters.args, **options: Parameters.kwargs) -> Result:
            given = cast("ArrayLike", args[0] if args else options.get("vertices"))
            exponent = size_exponent(given)
            if not exponent:
                return function(*args, **options)
            bound = signature.bind(*args, **options)
            for name, value in bound.arguments.items():
                if name == "vertices":
                    bound.arguments[name] = real_array(given) * ldexp(1.0, -exponent)
                elif name in lengths:
                    bound.arguments[name] = _scale(value, -exponent)
                elif dataclasses.is_dataclass(value):
                    bound.arguments[name] = rescale(value, -exponent)
            return cast("Result", rescale(function(*bound.args, **bound.kwargs), exponent))

        return wrapper

    return decorate


def _scale(value: Any, exponent: int) -> Any:
    """A positive length, or real coordinates, times two to a power; others stay, and are refused by the function."""
    if is_real(value):
        return value * ldexp(1.0, exponent) if value > 0.0 else value
    try:
        array = None if value is None else real_array(value)
        return value if array is None or array.shape[-1:] != (3,) else array * ldexp(1.0, exponent)
    except (TypeError, ValueError):
        return value


def size_exponent(vertices: ArrayLike) -> int:
    """Exponent of the power of two above the largest coordinate; 0 if no scaling is needed, or the mesh is invalid."""
    try:
        points = real_array(vertices)
    except (TypeError, ValueError):
        return 0
    largest = max(points.max(initial=0.0), -points.min(initial=0.0))
    if not MIN_COORDINATE <= largest <= MAX_COORDINATE:
        return 0
    exponent = frexp(largest)[1]
    return exponent if abs(exponent) > MAX_UNSCALED_EXPONENT else 0


def rescale(value: Any, exponent: int) -> Any:
    """Scale the fields of a result to those of a mesh scaled by two to a power."""
    if isinstance(value, tuple):
        return tuple(rescale(item, exponent) for item in value)
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return value
    changed = {}
    for field in dataclasses.fields(value):
        if not field.init:  # derived from others
            continue
        old, power = getattr(value, field.name), field.metadata.get(_POWER)
        if power is not None and old is not None:
            changed[field.name] = old * ldexp(1.0, power * exponent)
        else:
            changed[field.name] = rescale(old, exponent)
    return dataclasses.replace(value, **changed)
