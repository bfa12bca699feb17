"""Pictures of fields on meshes: PNG sheets with one column per field and one row per view."""

import difflib
import io
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bezier_filters.arguments import brief_repr, checks_arguments
from bezier_filters.display import AUTO, PALETTES, matplotlib_colormap
from bezier_filters.errors import InvalidParameterError, is_integer, is_real
from bezier_filters.pictures import scene
from bezier_filters.pictures.scene import Image, Panel
from bezier_filters.pictures.views import AUTO_AXIS, VIEW_NAMES, check_axes, view_axes
from bezier_filters.runtime.atomic import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OWN_MAPS = (AUTO, *PALETTES)
_SIZES = (50, 4000)  # pixels; graphics drivers end at 16384, twice supersampled
_SUFFIXES = (".png", ".jpg", ".jpeg", ".svg", ".pdf")
_DPI = 72  # matplotlib measures text in points of 1/72 inch: at this resolution a point is a pixel
_FONT = 0.04  # size of the text in units of the larger side of a panel
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_EMPTY: Image = np.zeros((0, 0, 3), np.uint8)

# In units of the font size.
_TITLE_SIZE = 1.2
_NAME_SIZE = 0.9
_TICK_SIZE = 0.85
_COLUMN_GAP = 1.5
_ROW_GAP = 0.7
_BAR_WIDTH = 14.0  # at least
_BAR_HEIGHT = 0.9
_HISTOGRAM = 2.7  # height of the columns above the bar

_BAR_SHARE = 0.85  # of the width of the images above a bar: the outer ticks stick out
_COMMON_BAR_SHARE = 0.4  # of the width of all images, where they have one bar
_ARROW = 0.04  # length of the ends of a bar beyond its range, in units of its length
_BINS = 60  # of histograms
_DECADES = 12  # of sizes that ticks may have on logarithmic scales
_TICK_GAP = 0.11  # between ticks on logarithmic scales, in units of the length of the bar


@checks_arguments
def render_panels(
    path: str | os.PathLike[str],
    panels: Sequence[Panel],
    *,
    views: Sequence[str] = ("front",),
    columns: int | None = None,
    size: tuple[int, int] = (600, 600),
    background: str = "white",
    title: str | None = None,
    up: str = AUTO_AXIS,
    front: str = AUTO_AXIS,
    dpi: float = 100.0,
) -> None:
    """Write one sheet that shows panels side by side and views below one another.

    The projection is parallel, and all images have the same scale. Each panel has a colour bar,
    with an arrow where values lie beyond its end. A single panel has its views side by side. No
    display is needed.

    Parameters
    ----------
    path : path
        File to write or replace, whole or not at all: PNG, JPEG, or an SVG or PDF file with the same pixels.
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
        ``"-z"``, or ``"auto"``, for each panel: that of its file's convention, else z if its mesh is tall in z,
        else y; what lies flat is seen from above, and x of open sheets points to the right.
    front : str
        Axis that points towards the viewer in the front view, perpendicular to `up`; ``"auto"`` is the side that the
        normals of an open sheet face, and else z, but -y where z points up.
    dpi : float
        Pixels per inch, stored in the file, for its size on paper.

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
    scene.require_libraries()
    from matplotlib.image import imsave

    background = _check_panels(panels, views, columns, size, background)
    check_axes(up, front)
    style = _Style(max(10.0, _FONT * max(size)), background)
    oriented = [scene.orientation(panel, up, front) for panel in panels]
    seen = [
        [scene.view_of(panel, view_axes(view, *axes)) for view in views]
        for panel, axes in zip(panels, oriented, strict=True)
    ]
    scale = _common_scale([view for own in seen for view in own], size)
    with atomic_write(path) as temporary:
        images = [
            scene.draw(panel, own, scale=scale, background=background) for panel, own in zip(panels, seen, strict=True)
        ]
        imsave(temporary, _sheet(panels, images, views, columns, title or "", style), dpi=dpi)


def _check_panels(
    panels: Sequence[Panel], views: Sequence[str], columns: int | None, size: tuple[int, int], background: str
) -> str:
    """Check the parameters of `render_panels`; the background as a colour that every library knows."""
    from matplotlib.colors import is_color_like, to_hex

    if not isinstance(panels, Sequence) or not all(isinstance(panel, Panel) for panel in panels):
        raise InvalidParameterError(f"panels: got {brief_repr(panels)}, expected a list of Panel")
    if not isinstance(views, Sequence) or isinstance(views, str):
        raise InvalidParameterError(f"views: got {brief_repr(views)}, expected a list of names")
    if not panels or not views:
        raise InvalidParameterError("got no panels or no views, expected at least one of each")
    check_views(views)
    for panel in panels:
        check_colormap(panel.colormap)
    if columns is not None and not (is_integer(columns) and columns >= 1):
        raise InvalidParameterError(f"columns: got {brief_repr(columns)}, expected at least 1")
    if not isinstance(size, Sequence) or not all(map(is_real, size)) or len(size) != len(("width", "height")):
        raise InvalidParameterError(f"size: got {brief_repr(size)}, expected a width and a height")
    if not all(_SIZES[0] <= side <= _SIZES[1] for side in size):
        raise InvalidParameterError(f"size: got {size}, expected a width and a height of {_SIZES[0]} to {_SIZES[1]}")
    if not is_color_like(background):
        raise InvalidParameterError(f"background: got {background!r}, expected a colour such as 'white' or '#202020'")
    return to_hex(background)


def check_views(views: Sequence[str]) -> None:
    """Refuse what is no view."""
    for view in views:
        _check_choice("view", view, VIEW_NAMES)


def check_colormap(name: str) -> None:
    """Refuse what is no colour map of a picture."""
    import matplotlib

    try:
        matplotlib_colormap(name)
    except KeyError:
        _check_choice("colormap", name, [*_OWN_MAPS, *matplotlib.colormaps], (*_OWN_MAPS, "turbo", "RdBu"))


def check_picture(path: str | os.PathLike[str]) -> None:
    """Refuse a file name that is not that of a picture: that of a mesh would be lost."""
    if Path(path).suffix.lower() not in _SUFFIXES:
        raise InvalidParameterError(
            f"picture: got {str(path)!r}, expected a picture to write, whose name ends in one of {' '.join(_SUFFIXES)}"
        )


def _check_choice(parameter: str, got: str, allowed: Sequence[str], examples: Sequence[str] | None = None) -> None:
    if got not in allowed:
        close = difflib.get_close_matches(got, allowed, n=3)
        names = ", ".join(dict.fromkeys([*close, *(examples or allowed)]))
        raise InvalidParameterError(f"{parameter}: got {got!r}, expected one of {names}")


def _common_scale(views: Sequence[scene.View], size: tuple[int, int]) -> float:
    """Pixels per unit of length with which every view fits into the size."""
    room = np.array(size) - 2.0 * scene.MARGIN_PIXELS
    extent = np.max([view.extent[:2] for view in views], axis=0)
    return float(np.min(room[extent > 0] / extent[extent > 0], initial=np.inf)) if extent.any() else 1.0


@dataclass(frozen=True)
class _Style:
    """Size of the text in pixels, which every distance follows, and the colour of the sheet."""

    font: float
    background: str

    @property
    def ink(self) -> str:
        from matplotlib.colors import to_rgb

        return "black" if np.dot(to_rgb(self.background), (0.299, 0.587, 0.114)) > 0.5 else "white"

    def color(self) -> Image:
        """Of the background, as a pixel."""
        from matplotlib.colors import to_rgb

        return np.round(255 * np.array(to_rgb(self.background))).astype(np.uint8)


def _sheet(
    panels: Sequence[Panel],
    images: Sequence[Sequence[Image]],
    views: Sequence[str],
    columns: int | None,
    title: str,
    style: _Style,
) -> Image:
    """Panels side by side with a row per view, or the views of a single panel side by side with one colour bar."""
    bar = _EMPTY
    names = views if len(views) > 1 else [""]
    titles = [panel.title for panel in panels]
    with_bars = panels
    if len(panels) == 1 and len(views) > 1:
        title = ": ".join(filter(None, (title, panels[0].title)))
        images, titles, names, with_bars = [[image] for image in images[0]], list(views), [""], []
    step = columns or len(images)
    widths = [max(image.shape[1] for own in images[k::step] for image in own) for k in range(min(step, len(images)))]
    cells: list[list[Image]] = []
    for start in range(0, len(images), step):
        part = slice(start, start + step)
        cells.append([_EMPTY, *(_text(text, style) for text in titles[part])])
        for k, name in enumerate(names):
            cells.append([_text(name, style, _NAME_SIZE, rotation=90), *(own[k] for own in images[part])])
        bars = zip(with_bars[part], widths, strict=False)
        cells.append([_EMPTY, *(_color_bar(panel, _BAR_SHARE * width, style) for panel, width in bars)])
    content = _grid(cells, style)
    if not with_bars:
        bar = _color_bar(panels[0], _COMMON_BAR_SHARE * content.shape[1], style)
    return _grid([[_text(title, style, _TITLE_SIZE)], [content], [bar]], style, margin=round(style.font))


def _grid(rows: Sequence[Sequence[Image]], style: _Style, margin: int = 0) -> Image:
    """Images in the middle of the cells of a table; rows and columns of empty ones take no room."""
    heights = [max(len(cell) for cell in row) for row in rows]
    widths = [max(cell.shape[1] for cell in column) for column in zip_longest(*rows, fillvalue=_EMPTY)]
    tops, height = _places(heights, round(_ROW_GAP * style.font))
    lefts, width = _places(widths, round(_COLUMN_GAP * style.font))
    result = np.tile(style.color(), (height + 2 * margin, width + 2 * margin, 1))
    for row, top, tall in zip(rows, tops, heights, strict=True):
        for cell, left, wide in zip(row, lefts, widths, strict=False):
            y, x = margin + top + (tall - len(cell)) // 2, margin + left + (wide - cell.shape[1]) // 2
            result[y : y + len(cell), x : x + cell.shape[1]] = cell
    return result


def _places(sizes: Sequence[int], gap: int) -> tuple[list[int], int]:
    """Where things of these sizes begin, with gaps in between, and where the last one ends."""
    ends = list(accumulate(size + gap if size else 0 for size in sizes))
    return [end - size - gap if size else end for size, end in zip(sizes, ends, strict=True)], max(ends[-1] - gap, 0)


def _text(text: str, style: _Style, size: float = 1.0, *, rotation: float = 0.0) -> Image:
    """A line of text, as large as it is."""
    from matplotlib.figure import Figure

    if not text.strip():
        return _EMPTY
    figure = Figure()
    drawn = figure.text(0, 0, text, size=size * style.font, color=style.ink, rotation=rotation)
    drawn.set_parse_math(False)  # file names may have dollar signs
    return _pixels(figure, style)


def _pixels(figure: "Figure", style: _Style) -> Image:
    """What is drawn on a figure, and beyond its edges."""
    from matplotlib.image import imread

    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=_DPI, facecolor=style.background, bbox_inches="tight", pad_inches=0)
    buffer.seek(0)
    return np.round(255 * imread(buffer)[..., :3]).astype(np.uint8)


def _color_bar(panel: Panel, width: float, style: _Style) -> Image:
    """Colours of a panel's values with ticks, label and unit, and an arrow where values lie beyond an end."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

    if panel.values is None:
        return _key(panel, style)
    if panel.names:
        return _grid([[_color_bar(replace(panel, names=()), width, style)], [_key(panel, style)]], style)
    low, high = panel.color_limits()
    below, above = find_clipping(panel)
    colormap = matplotlib_colormap(panel.colormap, signed=panel.signed)
    font, wide = style.font, max(width, _BAR_WIDTH * style.font)
    tall = _BAR_HEIGHT * font
    figure = Figure(figsize=(wide / _DPI, tall / _DPI), dpi=_DPI)
    if panel.histogram:
        axes = figure.add_axes((0.0, 1.0 + 0.3 * font / tall, 1.0, _HISTOGRAM * font / tall))
        counts, _ = np.histogram(panel.norm()(panel.values[panel.drawn()]).filled(np.nan), bins=_BINS, range=(0.0, 1.0))
        ends = np.linspace(0.0, 1.0, _BINS + 1)
        axes.bar(ends[:-1], counts, width=1.0 / _BINS, align="edge", color=colormap(ends[:-1] + 0.5 / _BINS))
        axes.stairs(
            counts, ends, baseline=0, color=style.ink, linewidth=0.04 * font, clip_on=False
        )  # light colours are seen, too
        most = f"up to {max(counts):,} vertices"
        axes.text(0.5, 1.05, most, size=_TICK_SIZE * font, color=style.ink, transform=axes.transAxes, ha="center")
        axes.set(xlim=(-_ARROW * below, 1.0 + _ARROW * above), ylim=(0.0, max(*counts, 1)))
        axes.set_axis_off()
    extend = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[below, above]
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    colors = ScalarMappable(panel.norm(), colormap)
    bar = figure.colorbar(colors, cax=axes, orientation="horizontal", extend=extend, extendfrac=_ARROW)
    places, texts, exponent = ticks(low, high)
    if panel.linear_below:
        places, exponent = symlog_ticks(panel.norm(), low, high), 0
        texts = [f"{place:g}".replace("-", "\N{MINUS SIGN}") for place in places]
    elif sum(0.64 * _TICK_SIZE * font * len(text) + font for text in texts) > 1.2 * wide:  # a digit is 0.64 wide
        places, texts, exponent = ticks(low, high, count=3)
    bar.set_ticks(places, labels=texts)
    bar.outline.set(edgecolor=style.ink, linewidth=0.04 * font)
    axes.tick_params(
        labelsize=_TICK_SIZE * font, length=0.25 * font, width=0.06 * font, colors=style.ink, pad=0.15 * font
    )
    axes.set_xlabel(legend(panel, exponent), size=font, color=style.ink, labelpad=0.3 * font, parse_math=False)
    return _pixels(figure, style)


def _key(panel: Panel, style: _Style) -> Image:
    """What the colours of a panel stand for."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    if not panel.names:
        return _EMPTY
    figure = Figure(dpi=_DPI)
    handles = [Patch(facecolor=color, edgecolor=style.ink, label=name) for name, color in panel.names]
    figure.legend(handles=handles, frameon=False, fontsize=style.font, labelcolor=style.ink, borderpad=1.0)
    return _pixels(figure, style)


def find_clipping(panel: Panel) -> tuple[bool, bool]:
    """Whether visible values lie below and above the range of the colours."""
    if panel.values is None:
        return False, False
    low, high = panel.color_limits()
    seen = panel.values[panel.drawn()]
    return bool((seen < low).any()), bool((seen > high).any())


def legend(panel: Panel, exponent: int = 0) -> str:
    """Label with unit, and with the power of ten that the ticks leave out."""
    power = f"10{str(exponent).translate(_SUPERSCRIPT)}" if exponent else ""
    unit = " ".join(filter(None, (power, panel.unit)))
    return " ".join(filter(None, (panel.label, f"[{unit}]" if unit else "")))


def ticks(low: float, high: float, count: int = 5) -> tuple[list[float], list[str], int]:
    """Evenly spaced ticks with both limits among them, their texts, and a power of ten taken out of those.

    >>> ticks(-57.5, 57.5)
    ([-57.5, -28.75, 0.0, 28.75, 57.5], ['−57.5', '−28.8', '0', '28.8', '57.5'], 0)
    >>> ticks(0.0, 3e-7, count=3)[1:]
    (['0', '1.5', '3.0'], -7)
    """
    places = np.linspace(low, high, count)
    exponent = math.floor(math.log10(max(abs(low), abs(high), 1e-300)))
    exponent = 0 if -2 <= exponent <= 4 else exponent
    scaled = places / 10.0**exponent
    close = 0.005 * (scaled[1] - scaled[0])
    decimals = next((d for d in range(15) if np.all(np.abs(np.round(scaled, d) - scaled) <= close)), 15)
    texts = [
        f"{value:.{decimals}f}".replace("-", "\N{MINUS SIGN}") if round(value, decimals) else "0" for value in scaled
    ]
    return places.tolist(), texts, exponent


def symlog_ticks(place_of: Callable[[float], float], low: float, high: float) -> list[float]:
    """Round numbers 0 and +-1, 2, 5 times powers of ten within limits for a symmetric logarithmic scale.

    `place_of` gives places from 0 to 1; powers of ten from the largest on are chosen first, none too close to another.
    """
    largest = math.floor(math.log10(max(abs(low), abs(high))))
    decades = [10.0**k for k in range(largest, largest - _DECADES, -1)]
    sizes = [digit * decade for digit in (1.0, 5.0, 2.0) for decade in decades]
    chosen: list[float] = []
    for value in (0.0, *(sign * size for size in sizes for sign in (1.0, -1.0))):
        if low <= value <= high and all(abs(place_of(value) - place_of(other)) > _TICK_GAP for other in chosen):
            chosen.append(value)
    return sorted(chosen)
