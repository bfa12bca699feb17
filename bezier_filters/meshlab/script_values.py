"""Parameters of filter scripts, text, as the values that the filters take, and back."""

import inspect
import types
from collections.abc import Callable, Mapping
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from bezier_filters.errors import InvalidScriptError
from bezier_filters.files.filter_scripts import ScriptStep
from bezier_filters.meshlab.meshset import Color, PercentageValue, PureValue

_NOT_IN_SCRIPTS = ("ms", "progress")
_TYPES = {bool: "RichBool", int: "RichInt", float: "RichFloat"}  # MeshLab's names; anything else is text


def script_step(name: str, **parameters: Any) -> ScriptStep:
    """Step of a script, with parameters given as Python values; those that are None are left out.

    Parameters
    ----------
    name : str
        Name of a filter of this package or of pymeshlab.
    **parameters
        Numbers, text, booleans, `pymeshlab.PercentageValue` or `pymeshlab.PureValue`.

    Examples
    --------
    >>> script_step("apply_coord_bezier_patch_smoothing", iterations=2).parameters["iterations"]
    {'type': 'RichInt', 'value': '2'}
    """
    given = {key: value for key, value in parameters.items() if value is not None}
    return ScriptStep(name, {key: _attributes(value) for key, value in given.items()})


def _attributes(value: Any) -> dict[str, str]:
    if isinstance(value, bool):
        return {"type": "RichBool", "value": str(value).lower()}
    if type(value) is PercentageValue:
        return {"type": "RichString", "value": f"{value.value()!r}%"}
    if type(value) is PureValue:
        return {"type": "RichAbsPerc", "value": repr(value.value())}
    if isinstance(value, tuple):
        return {"type": "RichString", "value": " ".join(map(str, value))}
    return {"type": _TYPES.get(type(value), "RichString"), "value": str(value)}


def parameters_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Parameters of a filter of this package that a script can set, and their types."""
    hints = get_type_hints(function)
    return {name: hints[name] for name in inspect.signature(function).parameters if name not in _NOT_IN_SCRIPTS}


def value_of_type(hint: Any, attributes: Mapping[str, str]) -> Any:
    """Value of a parameter of ours.

    Raises
    ------
    InvalidScriptError
        If the text is no value of this type; the message says what was got and what is allowed.

    Examples
    --------
    >>> value_of_type(int | Literal["auto"], {"value": "3"})
    3
    """
    text = _value(attributes)
    options = _options(hint)
    for option in options:
        value = _read(option, text)
        if value is not _UNREADABLE:
            return value
    raise InvalidScriptError(f"got {text!r}, expected {' or '.join(dict.fromkeys(map(_described, options)))}")


_UNREADABLE = object()


def _options(hint: Any) -> list[Any]:
    if get_origin(hint) in (Union, types.UnionType):
        return [option for part in get_args(hint) for option in _options(part)]
    return list(get_args(hint)) if get_origin(hint) is Literal else [hint]


def _read(option: Any, text: str) -> Any:
    try:
        if option is type(None):
            return None if text.lower() in ("", "none") else _UNREADABLE
        if option is bool:
            return _flag(text)
        if option is PercentageValue:
            return PercentageValue(float(text.removesuffix("%"))) if text.endswith("%") else _UNREADABLE
        if option in (int, float, PureValue):
            return option(float(text)) if option is PureValue else option(text)
    except ValueError:
        return _UNREADABLE
    if option is str:
        return text
    if get_origin(option) is tuple:
        values = tuple(_read(kind, part) for kind, part in zip(get_args(option), text.split(), strict=False))
        fits = len(values) == len(text.split()) == len(get_args(option)) and _UNREADABLE not in values
        return values if fits else _UNREADABLE
    return option if text == option else _UNREADABLE  # one of the words of a Literal


def _described(option: Any) -> str:
    names = {
        bool: "true or false",
        int: "an integer",
        float: "a number",
        PureValue: "a number",
        PercentageValue: "a percentage such as 2%",
        type(None): "nothing",
    }
    if get_origin(option) is tuple:
        return f"{len(get_args(option))} numbers"
    return names.get(option, repr(option)) if isinstance(option, type) else repr(option)


def value_like(default: Any, attributes: Mapping[str, str]) -> Any:
    """Value of a parameter of a filter of MeshLab, whose default in pymeshlab is known.

    Raises
    ------
    InvalidScriptError
        If the text is no value of this type; the message says what was got and what is allowed.
    """
    if isinstance(default, np.ndarray):
        return _array(default.shape, attributes)
    if type(default) is Color:
        return Color(*(int(_value(attributes, channel)) for channel in "rgba"))
    text = _value(attributes)
    if isinstance(default, bool):
        return value_of_type(bool, attributes)
    if isinstance(default, int):  # a number, a word of an enumeration, or its number
        return int(text) if text.lstrip("-").isdecimal() else text
    if isinstance(default, float):
        if attributes.get("type") == "RichAbsPerc" and not text.endswith("%"):
            return PureValue(value_of_type(float, attributes))
        return value_of_type(PercentageValue | float, attributes)
    return text


def _array(shape: tuple[int, ...], attributes: Mapping[str, str]) -> Any:
    """A point or direction (x, y, z) or a matrix (val0 to val15), or numbers in one text."""
    size = int(np.prod(shape))
    keys = ("x", "y", "z") if size == 3 else tuple(f"val{k}" for k in range(size))
    try:
        texts = [attributes[key] for key in keys] if keys[0] in attributes else _value(attributes).split()
        return np.array([float(text) for text in texts]).reshape(shape)
    except (KeyError, ValueError) as error:
        raise InvalidScriptError(f"got {dict(attributes)}, expected {size} numbers {', '.join(keys)}") from error


def _flag(text: str) -> bool:
    if text.lower() not in ("true", "false", "1", "0"):
        raise ValueError
    return text.lower() in ("true", "1")


def _value(attributes: Mapping[str, str], key: str = "value") -> str:
    if key not in attributes:
        raise InvalidScriptError(f"has no attribute {key}=")
    return attributes[key].strip()
