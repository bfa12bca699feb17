"""Checks of the parameters that the surfaces share."""

import numpy as np

from bezier_filters.errors import InvalidParameterError

MAX_JITTER = 0.35
"""Half the width of a right triangle with unit legs: no corner moves past the opposite edge."""


def check_resolution(resolution: int, minimum: int) -> None:
    """Raise `InvalidParameterError` unless `resolution` is an int of at least `minimum`."""
    if not isinstance(resolution, (int, np.integer)) or isinstance(resolution, bool) or resolution < minimum:
        raise InvalidParameterError(f"resolution is {resolution!r}, but must be an int of at least {minimum}")


def check_jitter(jitter: float) -> None:
    """Raise `InvalidParameterError` unless ``0 <= jitter < 0.35``."""
    if not 0 <= jitter < MAX_JITTER:
        raise InvalidParameterError(
            f"jitter is {jitter!r}, but must be at least 0 and less than {MAX_JITTER} edges; 0.3 is very irregular"
        )


def check_positive(**lengths: float) -> None:
    """Raise `InvalidParameterError` unless each named value is positive and finite."""
    for name, value in lengths.items():
        if not 0 < value < np.inf:
            raise InvalidParameterError(f"{name} is {value!r}, but must be a positive length")


def check_finite(**values: float) -> None:
    """Raise `InvalidParameterError` unless each named value is finite."""
    for name, value in values.items():
        if not np.isfinite(value):
            raise InvalidParameterError(f"{name} is {value!r}, but must be finite")
