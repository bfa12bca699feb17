"""Options of the smoothing, in memory and in tiles."""

from numbers import Integral, Real
from typing import Literal

import numpy as np

from bezier_filters.errors import InvalidParameterError

SmoothingMethod = Literal["auto", "paper"]
SmoothedBorders = Literal["curve", "fixed"]


def check_smoothing(method: object, iterations: object, noise: object, borders: object) -> None:
    """Refuse options that are out of range.

    Raises
    ------
    InvalidParameterError
        It names the parameter.
    """
    if method not in ("auto", "paper"):
        raise InvalidParameterError(f"method: got {method!r}, expected 'auto' or 'paper'")
    if isinstance(iterations, bool) or not isinstance(iterations, Integral) or iterations < 1:
        raise InvalidParameterError(f"iterations: got {iterations!r}, expected an integer of 1 or more")
    is_length = isinstance(noise, Real) and not isinstance(noise, bool) and 0.0 <= float(noise) < np.inf
    if noise is not None and not is_length:
        raise InvalidParameterError(f"noise: got {noise!r}, expected a length of 0 or more, or None to learn it")
    if noise is not None and method == "paper":
        raise InvalidParameterError("noise: the paper's method does not use it; leave it out")
    if borders not in ("curve", "fixed"):
        raise InvalidParameterError(f"borders: got {borders!r}, expected 'curve' or 'fixed'")
