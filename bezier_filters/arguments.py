"""Arguments of public functions, checked by the annotations of their parameters before anything is done with them.

What is wrong in kind is refused here: a list in the place of a number, a text in that of a truth value, a dict in that
of a result. Which numbers and words are allowed, the functions say themselves.
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

_LONGEST = 60  # characters of a value that is shown
_WORDS: dict[object, str] = {
    bool: "True or False",
    int: "an integer",
    float: "a number",
    str: "a text",
    NoneType: "None",
}
_NUMBERS = {int, float, NoneType}  # where there is nothing else, functions say which numbers they take
_CLASSES = (os.PathLike, Mapping)  # the generic ones that are checked


def checks_arguments(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Refuse arguments of a function that are of another kind than its annotations say, and make floats of numbers.

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
    def checked(*args: Parameters.args, **options: Parameters.kwargs) -> Result:
        try:
            bound = signature.bind(*args, **options)
        except TypeError:  # a name that is unknown, or missing: Python says which
            return function(*args, **options)
        for name in kinds.keys() & bound.arguments.keys():
            bound.arguments[name] = checked_value(name, bound.arguments[name], kinds[name])
        return function(*bound.args, **bound.kwargs)

    return checked


def checked_value(name: str, value: Any, kinds: tuple[object, ...]) -> Any:
    """A value of one of some kinds, a number as a float where no integer is asked for, or an InvalidParameterError."""
    if not (set(kinds) <= _NUMBERS or any(_is_of(value, kind) for kind in kinds)):
        expected = list(dict.fromkeys(_in_words(kind) for kind in kinds))
        raise InvalidParameterError(f"{name}: got {in_short(value)}, expected {' or '.join(expected)}")
    if float in kinds and int not in kinds and isinstance(value, Real) and not isinstance(value, bool | np.bool_):
        try:
            return float(value)
        except OverflowError:
            return math.copysign(math.inf, 1 if value == abs(value) else -1)
    return value


def path_of(path: object, name: str = "path") -> str | os.PathLike[str]:
    """A path, or an InvalidParameterError."""
    checked: str | os.PathLike[str] = checked_value(name, path, (str, os.PathLike))
    return checked


def in_short(value: object) -> str:
    """A value as Python writes it if that is short, else what it is."""
    if isinstance(value, str | bytes | Real | complex | NoneType) and len(repr(value)) <= _LONGEST:
        return repr(value)
    return type(value).__name__


def real_array(values: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Real numbers as a contiguous array of floats; a ValueError that says why they are none."""
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
    """Whether it is known what belongs to a kind."""
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


def _in_words(kind: Any) -> str:
    if _is_literal(kind):
        return " or ".join(map(repr, get_args(kind)))
    if kind in _WORDS:
        return _WORDS[kind]
    root = "pymeshlab." if kind.__module__.partition(".")[0] == "pymeshlab" else ""
    return {os.PathLike: "a path", Mapping: "a mapping"}.get(kind, f"a {root}{kind.__name__}")
