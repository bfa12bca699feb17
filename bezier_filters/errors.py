"""Errors that the array functions raise; the MeshSet filters translate them for pymeshlab scripts."""

from numbers import Integral, Real
from typing import TypeGuard


class InvalidMeshError(ValueError):
    """The arrays do not describe a triangle mesh; the message names the fault and the remedy."""


class InvalidParameterError(ValueError):
    """A parameter is out of range; the message gives what was got and what is allowed."""


class CancelledError(RuntimeError):
    """A progress callback returned ``False``; nothing was changed."""


class FieldFileError(ValueError):
    """A file holds no readable vertex fields; the message says what was found and what to do."""


class InvalidScriptError(ValueError):
    """A filter script cannot be read or run; the message names the step and what is allowed."""


class MeshFileWarning(UserWarning):
    """Part of a mesh file was not read."""


class MeshFileNote(UserWarning):
    """Rows of a mesh file were omitted, because they hold nothing or were to be skipped."""


def is_real(value: object) -> TypeGuard[float]:
    """Whether a parameter is a real number, and neither a text nor a truth value."""
    return isinstance(value, Real) and not isinstance(value, bool)


def is_integer(value: object) -> TypeGuard[int]:
    """Whether a parameter is an integer, of Python or NumPy, and no truth value."""
    return isinstance(value, Integral) and not isinstance(value, bool)
