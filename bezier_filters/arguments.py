"""Checks of the arguments of public functions against the annotations of their parameters.

Arguments of a wrong type are refused here: a list for a number, a text for a truth value, a dict for a result. Which
numbers and words are allowed is checked by the functions.
"""

import inspect
import math
import os
from collections.abc import Callable, Mapping
from functools import wraps
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin

import numpy as np

from bezier_filters.errors import InvalidParameterError

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

_MAX_REPR_LENGTH = 60  # characters of a value in a message
_WORDS: dict[object, str] = {
    bool: "True or False",
    int: "an integer",
    float: "a number",
    str: "a text",
    NoneType: "None",
}
_NUMBERS = {int, float, NoneType}  # parameters of these types alone are checked by the functions
_CLASSES = (os.PathLike, Mapping)  # abstract classes that are checked


def checks_arguments(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Refuse arguments of a function that do not match its annotations, and convert numbers to float.

    >>> @checks_arguments
    ... def scaled(value: float, *, twice: bool = False) -> float:
    ...     return value * (2.0 if twice else 1.0)
    >>> scaled(3, twice=True)
    6.0
    >>> scaled(3, twice="no")
    Traceback (most recent call last):
        ...
    bezier_filters.errors.InvalidParameterError: twice: got 'no', expected True or False
    """
    signature = inspect.signature(function)
    several = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    single = {name: parameter for name, parameter in signature.parameters.items() if parameter.kind not in several}
    kinds = {name: _alternatives(parameter.annotation) for name, parameter in single.items()}
    kinds = {name: kind for name, kind in kinds.items() if all(map(_is_known, kind))}

    @wraps(function)
    def wrapper(*args: Parameters.args, **options: Parameters.kwargs) -> Result:
        try:
            bound = signature.bind(*args, **options)
        except TypeError:  # an unknown or missing name, which Python reports
            return function(*args, **options)
        for name in kinds.keys() & bound.arguments.keys():
            bound.arguments[name] = check_value(name, bound.arguments[name], kinds[name])
        return function(*bound.args, **bound.kwargs)

    return wrapper


def check_value(name: str, value: Any, kinds: tuple[object, ...]) -> Any:
    """Return a value of one of the kinds, as float unless integers are allowed; InvalidParameterError otherwise."""
    if not (set(kinds) <= _NUMBERS or any(_is_of(value, kind) for kind in kinds)):
        expected = list(dict.fromkeys(_describe_kind(kind) for kind in kinds))
        raise InvalidParameterError(f"{name}: got {brief_repr(value)}, expected {' or '.join(expected)}")
    if float in kinds and int not in kinds and isinstance(value, Real) and not isinstance(value, bool | np.bool_):
        try:
            return float(value)
        except OverflowError:
            return math.copysign(math.inf, 1 if value == abs(value) else -1)
    return value


def path_of(path: object, name: str = "path") -> str | os.PathLike[str]:
    """Return a path; InvalidParameterError if it is none."""
    checked: str | os.PathLike[str] = check_value(name, path, (str, os.PathLike))
    return checked


def brief_repr(value: object) -> str:
    """Python's repr of a value if it is short, else the name of its type."""
    if isinstance(value, str | bytes | Real | complex | NoneType) and len(repr(value)) <= _MAX_REPR_LENGTH:
        return repr(value)
    return type(value).__name__


def real_array(values: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Real numbers as a contiguous array of floats; ValueError with the reason otherwise."""
    array = np.asarray(values)
    if np.ma.is_masked(values):
        raise ValueError("some are masked; leave these rows out")
    if array.dtype.kind == "O" and not all(isinstance(value, Real) for value in array.flat):
        raise ValueError("some are no real numbers")
    if array.size and array.dtype.kind not in "iufO":
        raise ValueError(f"got the dtype {array.dtype}")
    try:
        return np.ascontiguousarray(array, dtype=np.float64)
    except OverflowError as error:
        raise ValueError(str(error)) from None


def _alternatives(annotation: object) -> tuple[object, ...]:
    """The kinds that an annotation allows."""
    if get_origin(annotation) in (Union, UnionType):
        return tuple(kind for part in get_args(annotation) for kind in _alternatives(part))
    if _is_literal(annotation):
        return (annotation,)
    return (NoneType if annotation is None else get_origin(annotation) or annotation,)


def _is_literal(annotation: object) -> bool:
    return get_origin(annotation) is Literal


def _is_known(kind: object) -> bool:
    """Whether values can be checked against a kind."""
    return _is_literal(kind) or kind in _WORDS or kind in _CLASSES or _is_ours(kind)


def _is_ours(kind: object) -> bool:
    root = getattr(kind, "__module__", "").partition(".")[0]
    return isinstance(kind, type) and root in ("bezier_filters", "pymeshlab")


def _is_of(value: object, kind: object) -> bool:
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind is int or kind is float:  # texts are for the function: lengths may be percentages
        return isinstance(value, str) or (isinstance(value, Real) and not isinstance(value, bool | np.bool_))
    if _is_literal(kind):
        return isinstance(value, str | Integral | float)
    return isinstance(value, kind) if isinstance(kind, type) else False


def _describe_kind(kind: Any) -> str:
    if _is_literal(kind):
        return " or ".join(map(repr, get_args(kind)))
    if kind in _WORDS:
        return _WORDS[kind]
    root = "pymeshlab." if kind.__module__.partition(".")[0] == "pymeshlab" else ""
    return {os.PathLike: "a path", Mapping: "a mapping"}.get(kind, f"a {root}{kind.__name__}")
