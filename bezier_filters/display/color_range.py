"""The range of values that a colour map spans."""

from numbers import Real

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.errors import InvalidParameterError

_RESOLUTION = 1e-6  # relative; pymeshlab keeps the ends of the range in single precision
_TINY = 1e-290  # taken for 0, so that steps between the ends do not underflow


def color_range(
    values: FloatArray, *, signed: bool, percentile: float = 2.0, mask: BoolArray | None = None
) -> tuple[float, float]:
    """Values of the lowest and highest colour that a few extreme values do not spoil.

    Parameters
    ----------
    values : (n,) float64
        Field; values that are not finite are ignored.
    signed : bool
        Make the range symmetric about 0, so that the middle colour means zero.
    percentile : float
        Percentage of the values that may lie beyond each end, in [0, 50).
    mask : (n,) bool, optional
        Which values count, for example those that were estimated.

    Returns
    -------
    low, high : float
        ``low < high``, in the unit of the values. A small range around the value if all agree in six
        digits; (-1, 1) if there is no value or all are 0.

    Raises
    ------
    InvalidParameterError
        If `percentile` is out of range.

    Examples
    --------
    >>> color_range(np.array([0.0, 1.0, 2.0, 3.0, 1000.0]), signed=False, percentile=25)
    (1.0, 3.0)
    >>> color_range(np.array([-1.0, 0.0, 2.0]), signed=True, percentile=0)
    (-2.0, 2.0)
    """
    if not isinstance(percentile, Real) or not 0 <= percentile < 50:
        raise InvalidParameterError(f"percentile: got {percentile!r}, expected 0 <= percentile < 50")
    usable = np.isfinite(values) if mask is None else np.isfinite(values) & mask
    if not usable.any():
        return -1.0, 1.0
    low, high = (float(end) for end in np.percentile(values[usable], [percentile, 100.0 - percentile]))
    if _agree(low, high):  # all but a few values are the same: show the few
        low, high = float(values[usable].min()), float(values[usable].max())
    if signed:
        largest = max(abs(low), abs(high))
        low, high = -largest, largest
    if max(abs(low), abs(high)) < _TINY:
        return -1.0, 1.0
    if not _agree(low, high):
        return low, high
    margin = 0.05 * abs(low) or 1.0
    return low - margin, high + margin


def _agree(low: float, high: float) -> bool:
    return high - low <= _RESOLUTION * max(abs(low), abs(high))
