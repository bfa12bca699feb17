"""Display of values: ranges of colours, colour maps, tables for notebooks, and the noise in words.

The help of the command line imports it, so NumPy is imported only where there are arrays.
"""

import math
import re
from collections.abc import Iterable, Sequence
from html import escape
from numbers import Integral, Real
from typing import TYPE_CHECKING, Literal, TypeAlias

from bezier_filters.errors import InvalidParameterError

if TYPE_CHECKING:
    from matplotlib.colors import Colormap

    from bezier_filters.arrays import BoolArray, FloatArray

ColorScale: TypeAlias = Literal["linear", "symlog"]
AUTO = "auto"  # stands for `default_colormap`

_RESOLUTION = 1e-6  # relative difference of the ends of a range; pymeshlab keeps them in single precision
_TINY = 1e-290  # values that count as 0, so that steps between the ends do not underflow
MIN_NOISE_EDGES = 1e-4  # mean edges; weaker noise cannot be distinguished from the shape


def check_percentile(percentile: float) -> None:
    """Refuse a percentage of values beyond each end of a colour range that leaves none, or is no number."""
    if not isinstance(percentile, Real) or not 0 <= percentile < 50:
        raise InvalidParameterError(f"percentile: got {percentile!r}, expected 0 <= percentile < 50")


def color_range(
    values: "FloatArray", *, signed: bool, percentile: float = 2.0, mask: "BoolArray | None" = None
) -> tuple[float, float]:
    """Values of the lowest and highest colour that a few extreme values do not spoil.

    Of the values (n,), those count that are finite and in the mask (n,), and a percentage, in [0, 50), may lie beyond
    each end. Signed fields get a range that is symmetric about 0, so that the middle colour means zero. If all values
    agree in six digits, the range is a small one around them; it is (-1, 1) if there are none or all are 0.

    >>> import numpy as np
    >>> color_range(np.array([0.0, 1.0, 2.0, 3.0, 1000.0]), signed=False, percentile=25)
    (1.0, 3.0)
    >>> color_range(np.array([-1.0, 0.0, 2.0]), signed=True, percentile=0)
    (-2.0, 2.0)
    """
    import numpy as np

    check_percentile(percentile)
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


def round_limits(low: float, high: float) -> tuple[float, float]:
    """Widen a colour range a little, so that its five ticks are round numbers.

    >>> round_limits(-48.3, 48.3), round_limits(4.1, 106.0)
    ((-50.0, 50.0), (0.0, 120.0))
    """
    power = 10.0 ** math.floor(math.log10((high - low) / 4))
    for digits in (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10, 12, 15, 20):
        step = digits * power
        start = -2 * step if low == -high else math.floor(low / step) * step
        if start <= low and high <= start + 4 * step:
            return start, start + 4 * step
    return low, high


# colours (red, green, blue), each channel in 0..1, from the lowest value to the highest, at `palette_places` and linear
# in between, by what users type in any case
PALETTES = {
    # blue below zero, light grey at zero, red above: distinct with any kind of colour vision, and in every shadow
    "Cool Warm": ((0.23, 0.30, 0.75), (0.90, 0.90, 0.90), (0.75, 0.02, 0.15)),
    # of Li, Barsky, Jin (2009), neither for red-green colour blindness. Of the torsion (Figure 6): red is high, blue
    # medium, green low; of the curvatures (Figure 5): red is high, green medium, blue low.
    "Paper": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
    "Paper Curvature": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
    # of inspection: green within the tolerance, which is the middle third, yellow to red above and cyan to blue below
    "Tolerance": (
        (0.10, 0.15, 0.65),
        (0.35, 0.80, 0.95),
        (0.35, 0.75, 0.35),
        (0.35, 0.75, 0.35),
        (1.00, 0.88, 0.25),
        (0.75, 0.05, 0.10),
    ),
}
TOLERANCE = "Tolerance"
TOLERANCES_SHOWN = 3.0  # half of the range of these colours, in tolerances
_STEP = 1e-6  # width of the steps at the tolerance, in ranges
_PLACES = {TOLERANCE: (0.0, 1.0 / 3.0 - _STEP, 1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0 + _STEP, 1.0)}


def palette_places(name: str) -> tuple[float, ...]:
    """Places of the colours of a palette between the ends of the range, from 0 to 1.

    >>> palette_places("Cool Warm")
    (0.0, 0.5, 1.0)
    """
    count = len(PALETTES[name])
    return _PLACES.get(name, tuple(k / (count - 1) for k in range(count)))


def default_colormap(*, signed: bool) -> str:
    """Colour map for a field: Cool Warm if zero is the middle of its range, else Viridis.

    Both are distinct with any kind of colour vision.

    >>> default_colormap(signed=True)
    'Cool Warm'
    """
    return "Cool Warm" if signed else "Viridis"


def matplotlib_colormap(name: str, *, signed: bool = False) -> "Colormap":
    """Colour map for pictures: ``"auto"``, a palette or any of matplotlib's; KeyError if there is none of this name."""
    import matplotlib
    from matplotlib.colors import LinearSegmentedColormap

    name = default_colormap(signed=signed) if name == AUTO else name
    for own, colors in PALETTES.items():
        if own.lower() == name.lower():
            nodes = list(zip(palette_places(own), colors, strict=True))
            return LinearSegmentedColormap.from_list(own, nodes, N=1024)
    known = {key.lower(): key for key in matplotlib.colormaps}
    return matplotlib.colormaps[name if name in matplotlib.colormaps else known[name.lower()]]


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table with a title above it; numbers with four digits, None as nothing.

    >>> html_table("volume", ["before", "after"], [[1.0, None]]).count("<td>")
    2
    """
    head = "".join(f"<th>{escape(text)}</th>" for text in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell_text(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<p><b>{escape(title)}</b></p><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def summary(name: str, unit: str, values: "FloatArray") -> list[object]:
    """Row of a table: name, unit, and smallest, median and largest value."""
    import numpy as np

    numbers = [np.min(values), np.median(values), np.max(values)] if len(values) else [None] * 3
    return [name, unit, *numbers]


def cell_text(cell: object) -> str:
    """Text of a cell of a table: integers with commas, other numbers with four digits, None as nothing."""
    if cell is None:
        return ""
    if isinstance(cell, Integral):
        return f"{cell:,}"
    return f"{cell:.4g}" if isinstance(cell, Real) else str(cell)


def noise_level(sigma: float | None, edge: float | None = None) -> str:
    """Standard deviation of noise in words: in mean edges if their length is known, else as a length.

    >>> noise_level(0.02, 0.1), noise_level(0.02), noise_level(1e-9, 0.1), noise_level(None)
    ('0.2 edges', '0.02 (length)', 'too small to be learned', 'unknown')
    """
    if sigma is None:
        return "unknown"
    return "too small to be learned" if sigma <= MIN_NOISE_EDGES * (edge or 0.0) else _format_length(sigma, edge)


def noise_stays(before: float | None, after: float | None) -> bool:
    """Whether noise before and after smoothing (lengths, or None if unknown) agrees in the two digits that are shown.

    >>> noise_stays(0.0454, 0.0451), noise_stays(0.0454, 0.02), noise_stays(None, None)
    (True, False, False)
    """
    return before is not None and after is not None and f"{before:.2g}" == f"{after:.2g}"


def noise_in_words(
    sigma: float | None, length: float | None, heavy: bool, edge: float | None = None, *, reason: str = ""
) -> str:
    """The noise in words: standard deviation, correlation length, and whether it is heavy.

    The length is None if the noise is unknown, for a reason, and 0 if it is independent from vertex to vertex.

    >>> noise_in_words(0.009, 0.14, False, 0.1)
    'noise 0.09 edges, correlated over 1.4 edges'
    >>> noise_in_words(0.05, 0.0, True, 0.1)
    'noise 0.5 edges in all directions, independent from vertex to vertex'
    >>> noise_in_words(None, None, False, reason="no vertex has a normal")
    'noise unknown: no vertex has a normal'
    """
    level = noise_level(sigma, edge)
    if sigma is None:
        return ": ".join(filter(None, [f"noise {level}", reason]))
    if level != _format_length(sigma, edge):
        return f"noise {level}"
    correlated = f"correlated over {_format_length(length, edge)}" if length else "independent from vertex to vertex"
    return f"noise {level}{' in all directions' * heavy}, {correlated}"


def shell_remark(text: str) -> str:
    """A remark on holes with names of options instead of parameters.

    >>> shell_remark("the outer rim of an open sheet; outer_rims=True fills it, too")
    'the outer rim of an open sheet; --outer-rims fills it, too'
    """
    text = re.sub(r"(\w+)=True( of the filter)?", lambda found: f"--{found[1].replace('_', '-')}", text)
    return re.sub(r"\bmax_(edges|perimeter|diameter)\b=?", lambda found: f"--max-{found[1]} ", text).rstrip()


def _format_length(length: float, edge: float | None) -> str:
    return f"{length / edge:.2g} edges" if edge else f"{length:.3g} (length)"
