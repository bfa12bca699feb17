"""Colours of fields in all hosts: the limits and the colour maps that the package's own pictures have."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.display import PALETTES, color_range, default_colormap, round_limits
from bezier_filters.fields import FIELDS
from bezier_filters_adapters.filled_fields import Values

# matplotlib's Viridis at evenly spaced places, within 0.02 in between; not every host has matplotlib
_VIRIDIS = (
    (0.27, 0.0, 0.33),
    (0.28, 0.09, 0.42),
    (0.28, 0.18, 0.48),
    (0.26, 0.25, 0.52),
    (0.23, 0.32, 0.55),
    (0.2, 0.39, 0.55),
    (0.17, 0.45, 0.56),
    (0.15, 0.51, 0.56),
    (0.13, 0.57, 0.55),
    (0.12, 0.63, 0.53),
    (0.16, 0.68, 0.5),
    (0.25, 0.74, 0.45),
    (0.37, 0.79, 0.38),
    (0.52, 0.83, 0.29),
    (0.68, 0.86, 0.19),
    (0.85, 0.89, 0.1),
    (0.99, 0.91, 0.14),
)
_SIGNED = {field.column: field.signed for field in FIELDS}


@dataclass(frozen=True)
class FieldColors:
    """The values of the first and the last colour, and whether the middle colour is zero."""

    limits: tuple[float, float]
    signed: bool

    @property
    def name(self) -> str:
        """Name of the colour map."""
        return default_colormap(signed=self.signed)

    @property
    def palette(self) -> FloatArray:
        """Its colours (k, 3), each channel in 0..1, evenly spaced and linear in between."""
        return np.array(PALETTES.get(self.name, _VIRIDIS))

    def rgb(self, values: Values) -> FloatArray:
        """Colours (n, 3) of values (n,), each channel in 0..1; values beyond the limits have the colours of these."""
        places = np.linspace(*self.limits, len(self.palette))
        return np.stack([np.interp(values, places, channel) for channel in self.palette.T], axis=1)


def field_colors(column: str, values: Values) -> FieldColors:
    """Colours of a column (n,): those of a picture of `bezier-filters render`.

    >>> found = field_colors("bz_mean_curvature", np.array([-0.9, 0.0, 0.4]))
    >>> found.name, found.limits
    ('Cool Warm', (-1.0, 1.0))
    >>> found.rgb(np.array([0.0])).tolist()
    [[0.9, 0.9, 0.9]]
    """
    numbers = np.asarray(values, np.float64)
    signed = _SIGNED.get(column, bool(numbers.min(initial=0.0) < 0.0 < numbers.max(initial=0.0)))
    return FieldColors(round_limits(*color_range(numbers, signed=signed)), signed)
