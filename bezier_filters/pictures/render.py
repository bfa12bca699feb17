"""Pictures of fields on meshes: PNG sheets with one column per field and one row per view."""

import difflib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bezier_filters.display.color_range import color_range
from bezier_filters.display.palettes import AUTO, PALETTES, matplotlib_colormap
from bezier_filters.errors import InvalidParameterError
from bezier_filters.pictures import rendering, sheets
from bezier_filters.pictures.rendering import UP_AXES, VIEW_NAMES, Panel, RenderingUnavailableError, View
from bezier_filters.pictures.sheets import ColorBar, Row
from bezier_filters.runtime.atomic import atomic_write

__all__ = [
    "UP_AXES",
    "VIEW_NAMES",
    "Panel",
    "RenderingUnavailableError",
    "check_picture",
    "panel_limits",
    "render_panels",
    "require_libraries",
]

_Image: TypeAlias = NDArray[np.uint8]

_OWN_MAPS = (AUTO, *(palette.name for palette in PALETTES))
_SIZES = (50, 4000)  # pixels; graphics drivers end at 16384, twice supersampled
_BINS = 60  # of histograms
_FONT = 0.04  # size of the text in units of the larger side of a panel


def render_panels(
    path: str | os.PathLike[str],
    panels: Sequence[Panel],
    *,
    views: Sequence[str] = ("front",),
    columns: int | None = None,
    size: tuple[int, int] = (600, 600),
    background: str = "white",
    title: str | None = None,
    up: str = "auto",
) -> None:
    """Write one PNG sheet that shows panels side by side and views below one another.

    The projection is parallel, and all images have the same scale. Each panel has a colour bar,
    with an arrow where values lie beyond its end. A single panel has its views side by side. No
    display is needed.

    Parameters
    ----------
    path : path
        PNG file to write or replace, whole or not at all.
    panels : sequence of Panel
        What is shown.
    views : sequence of str
        Any of ``"front"``, ``"back"``, ``"left"``, ``"right"``, ``"top"``, ``"bottom"`` and
        ``"iso"``. Left and right are the sides from which a viewer in front would look.
    columns : int, optional
        Images per row; by default all panels, or all views of a single panel.
    size : (width, height)
        Largest size of an image in pixels; the sheet is trimmed to what the meshes need.
    background : str
        Any colour that matplotlib knows.
    title : str, optional
        Text above the sheet.
    up : str
        Axis that points up in the front view: ``"x"``, ``"y"``, ``"z"``, ``"-x"``, ``"-y"``,
        ``"-z"``, or ``"auto"``: y, but z if the meshes are tall in z, and -z if they lie flat in
        x and z, so that they are seen from above.

    Raises
    ------
    RenderingUnavailableError
        Pyvista or matplotlib is missing.
    InvalidParameterError
        No panels, or a parameter out of range.
    OSError
        The file cannot be written.

    Examples
    --------
    >>> vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> panel = Panel(vertices, np.array([[0, 1, 2]], np.int32), vertices[:, 0], label="x", unit="length")
    >>> render_panels("triangle.png", [panel], views=["front", "iso"])  # doctest: +SKIP
    """
    check_picture(path)
    require_libraries()
    background = _checked(panels, views, columns, size, background, up)
    up = rendering.up_axis(panels) if up == "auto" else up
    axes = [rendering.view_axes(view, up) for view in views]
    seen = [[rendering.view_of(panel, one) for one in axes] for panel in panels]
    scale = _common_scale([view for own in seen for view in own], size)
    options: dict[str, Any] = {"font": max(10.0, _FONT * max(size)), "background": background}
    with atomic_write(path) as temporary:
        images, bars = [], []
        for panel, own in zip(panels, seen, strict=True):
            limits = panel_limits(panel)
            images.append(rendering.draw(panel, own, limits=limits, scale=scale, background=background))
            bars.append(_color_bar(panel, limits))
        if len(panels) == 1 and len(views) > 1:
            heading = ": ".join(filter(None, (title, panels[0].title)))
            sheets.write_sheet(temporary, _rows_of_views(images[0], views, columns), heading, bars[0], **options)
        else:
            rows = _rows_of_panels(panels, images, bars, views, columns)
            sheets.write_sheet(temporary, rows, title or "", **options)


def _checked(
    panels: Sequence[Panel], views: Sequence[str], columns: int | None, size: tuple[int, int], background: str, up: str
) -> str:
    """Check the parameters of `render_panels`; the background as a colour that every library knows."""
    import matplotlib
    from matplotlib.colors import is_color_like, to_hex

    if not panels or not views:
        raise InvalidParameterError("got no panels or no views, expected at least one of each")
    for view in views:
        _check_choice("view", view, VIEW_NAMES)
    _check_choice("up", up, ("auto", *UP_AXES))
    for panel in panels:
        try:
            matplotlib_colormap(panel.colormap)
        except KeyError:
            _check_choice(
                "colormap", panel.colormap, [*_OWN_MAPS, *matplotlib.colormaps], (*_OWN_MAPS, "turbo", "RdBu")
            )
    if columns is not None and columns < 1:
        raise InvalidParameterError(f"columns is {columns}, expected at least 1")
    if not all(_SIZES[0] <= side <= _SIZES[1] for side in size):
        raise InvalidParameterError(f"size is {size}, expected a width and a height of {_SIZES[0]} to {_SIZES[1]}")
    if not is_color_like(background):
        raise InvalidParameterError(f"background is {background!r}, expected a colour such as 'white' or '#202020'")
    return to_hex(background)


def check_picture(path: str | os.PathLike[str]) -> None:
    """Refuse a file name that does not end in .png: that of a mesh would be lost.

    Raises
    ------
    InvalidParameterError
        With what it should be.
    """
    if Path(path).suffix.lower() != ".png":
        raise InvalidParameterError(f"picture: got {str(path)!r}, expected a file name that ends in .png")


def require_libraries() -> None:
    """Refuse to draw without the libraries of the extra."""
    try:
        import matplotlib  # noqa: F401
        import pyvista  # noqa: F401
    except ImportError as error:
        raise RenderingUnavailableError(
            f'pictures need pyvista and matplotlib: pip install "bezier-filters[viz]" ({error})'
        ) from error


def _check_choice(parameter: str, got: str, allowed: Sequence[str], examples: Sequence[str] | None = None) -> None:
    if got not in allowed:
        close = difflib.get_close_matches(got, allowed, n=3)
        names = ", ".join(dict.fromkeys([*close, *(examples or allowed)]))
        raise InvalidParameterError(f"{parameter} is {got!r}, expected {'one' if examples else 'any'} of {names}")


def _common_scale(views: Sequence[View], size: tuple[int, int]) -> float:
    """Pixels per unit of length with which every view fits into the size."""
    room = np.array(size) - 2.0 * rendering.MARGIN
    extent = np.max([view.extent[:2] for view in views], axis=0)
    return float(np.min(room[extent > 0] / extent[extent > 0], initial=np.inf)) if extent.any() else 1.0


def panel_limits(panel: Panel) -> tuple[float, float]:
    """Values of the first and the last colour."""
    if panel.limits is not None or panel.values is None:
        return panel.limits or (0.0, 1.0)
    return sheets.round_limits(*color_range(panel.values, signed=panel.signed, mask=panel.drawn()))


def _color_bar(panel: Panel, limits: tuple[float, float]) -> ColorBar | None:
    if panel.values is None:
        return None
    seen = panel.values[panel.drawn()]
    low, high = limits
    colormap = matplotlib_colormap(panel.colormap, signed=panel.signed)
    below, above = bool((seen < low).any()), bool((seen > high).any())
    counts = np.histogram(seen, bins=_BINS, range=limits)[0].tolist() if panel.histogram else []
    return ColorBar(panel.label, panel.unit, limits, colormap, below=below, above=above, counts=counts)


def _rows_of_views(images: list[_Image], views: Sequence[str], columns: int | None) -> list[Row]:
    """Rows of the views of a single panel."""
    step = columns or len(views)
    return [Row(images[k : k + step], titles=views[k : k + step]) for k in range(0, len(views), step)]


def _rows_of_panels(
    panels: Sequence[Panel],
    images: list[list[_Image]],
    bars: list[ColorBar | None],
    views: Sequence[str],
    columns: int | None,
) -> list[Row]:
    """One row per view, and again for the panels that do not fit side by side."""
    step = columns or len(panels)
    rows = []
    for start in range(0, len(panels), step):
        part = slice(start, start + step)
        for k, view in enumerate(views):
            rows.append(
                Row(
                    [own[k] for own in images[part]],
                    name=view if len(views) > 1 else "",
                    titles=[panel.title for panel in panels[part]] if k == 0 else (),
                    bars=bars[part] if k == len(views) - 1 else (),
                )
            )
    return rows
