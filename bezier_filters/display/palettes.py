"""The project's own colour maps: a diverging one for signed fields, and the one of the paper's figures."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.colors import Colormap

AUTO = "auto"
"""Stands for `default_colormap`."""


@dataclass(frozen=True)
class Palette:
    """A colour map by the colours at its nodes, linear in between.

    Attributes
    ----------
    name : str
        What users type, in any case.
    colors : tuple of (red, green, blue)
        From the lowest value to the highest, evenly spaced, each channel in 0..1.
    """

    name: str
    colors: tuple[tuple[float, float, float], ...]

    def positions(self) -> tuple[float, ...]:
        """Places of the nodes, from 0 to 1."""
        return tuple(k / (len(self.colors) - 1) for k in range(len(self.colors)))


COOL_WARM = Palette("Cool Warm", ((0.23, 0.30, 0.75), (0.90, 0.90, 0.90), (0.75, 0.02, 0.15)))
"""Blue below zero, light grey at zero, red above: told apart with any kind of colour vision, and in every shadow."""

PAPER = Palette("Paper", ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)))
"""Of the torsion in Li, Barsky, Jin (2009): red is high, blue medium, green low. Not for red-green colour blindness."""

PALETTES = (COOL_WARM, PAPER)


def find_palette(name: str) -> Palette | None:
    """Palette of a name in any case, or None."""
    return next((palette for palette in PALETTES if palette.name.lower() == name.lower()), None)


def default_colormap(*, signed: bool) -> str:
    """Colour map for a field: Cool Warm if zero is the middle of its range, else Viridis.

    Both are told apart with any kind of colour vision.

    >>> default_colormap(signed=True)
    'Cool Warm'
    """
    return COOL_WARM.name if signed else "Viridis"


def matplotlib_colormap(name: str, *, signed: bool = False) -> "Colormap":
    """Colour map for pictures: ``"auto"``, a palette or any of matplotlib's.

    Raises
    ------
    KeyError
        If there is none of this name.
    """
    import matplotlib
    from matplotlib.colors import LinearSegmentedColormap

    name = default_colormap(signed=signed) if name == AUTO else name
    palette = find_palette(name)
    if palette is not None:
        return LinearSegmentedColormap.from_list(palette.name, list(palette.colors), N=1024)
    known = {key.lower(): key for key in matplotlib.colormaps}
    return matplotlib.colormaps[name if name in matplotlib.colormaps else known[name.lower()]]
