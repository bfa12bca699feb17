"""Sheets: images in rows and columns with titles and colour bars, written as PNG with matplotlib."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

# Matplotlib measures text in points of 1/72 inch; at this resolution a point is a pixel.
_DPI = 72

# In units of the font size.
_TITLE_SIZE = 1.2
_TICK_SIZE = 0.85
_MIN_COLUMN = 16.5  # with a colour bar
_BAR_HEIGHT = 4.4  # with ticks, label and the gap below
_ARROW = 0.04  # length of the ends of a bar beyond its range, in units of its length
_HISTOGRAM = 3.0  # above the bar

_BAR_WIDTH = 0.85  # in units of the column width: the outer ticks stick out

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class ColorBar:
    """A colour scale, whether values lie ``below`` and ``above`` its range, and a histogram of those within."""

    label: str
    unit: str
    limits: tuple[float, float]
    colormap: "Colormap"
    below: bool = False
    above: bool = False
    counts: Sequence[int] = ()

    @property
    def text(self) -> str:
        """Label with unit, and with the power of ten that the ticks leave out."""
        exponent = ticks(*self.limits)[2]
        power = f"10{str(exponent).translate(_SUPERSCRIPT)}" if exponent else ""
        unit = " ".join(filter(None, (power, self.unit)))
        return " ".join(filter(None, (self.label, f"[{unit}]" if unit else "")))


@dataclass(frozen=True)
class Row:
    """Images side by side.

    Attributes
    ----------
    images : sequence of (height, width, 3) uint8
        One per column.
    name : str
        Text left of the row.
    titles : sequence of str
        Text above each image, or none at all.
    bars : sequence of ColorBar or None
        Colour bar below each image, or none at all.
    """

    images: Sequence[NDArray[np.uint8]]
    name: str = ""
    titles: Sequence[str] = ()
    bars: Sequence[ColorBar | None] = ()


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


def write_sheet(
    path: Path, rows: Sequence[Row], title: str = "", bar: ColorBar | None = None, *, font: float, background: str
) -> None:
    """Write rows of images as one PNG file.

    Parameters
    ----------
    path : Path
        File to write.
    rows : sequence of Row
        From top to bottom.
    title : str
        Text above the sheet.
    bar : ColorBar, optional
        Colour bar below the sheet, for all images.
    font : float
        Size of the text in pixels; every distance follows it.
    background : str
        Colour of the sheet.
    """
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure

    items, width, height = _arrange(rows, title, bar, font)
    # A little more than the pixels, because matplotlib cuts fractions off.
    figure = Figure(figsize=((width + 0.1) / _DPI, (height + 0.1) / _DPI), dpi=_DPI)
    ink = "black" if np.dot(to_rgb(background), (0.299, 0.587, 0.114)) > 0.5 else "white"
    for item in items:
        item.paint(figure, height, font, ink)
    figure.savefig(path, format="png", dpi=_DPI, facecolor=background)


@dataclass(frozen=True)
class _Text:
    center: tuple[float, float]  # here and below in pixels, from the upper left corner
    text: str
    size: float
    rotation: float = 0.0

    def paint(self, figure: "Figure", height: int, font: float, ink: str) -> None:
        width = figure.bbox.width
        x, y = self.center[0] / width, 1.0 - self.center[1] / height
        text = figure.text(x, y, self.text, size=self.size, color=ink, ha="center", va="center")
        text.set(rotation=self.rotation, parse_math=False)  # file names may have dollar signs


@dataclass(frozen=True)
class _Image:
    corner: tuple[int, int]
    pixels: NDArray[np.uint8]

    def paint(self, figure: "Figure", height: int, font: float, ink: str) -> None:
        x, y = self.corner
        figure.figimage(self.pixels, x, height - y - len(self.pixels), origin="upper")


@dataclass(frozen=True)
class _Bar:
    top: tuple[float, float]  # middle of the upper edge
    width: float
    bar: ColorBar

    def paint(self, figure: "Figure", height: int, font: float, ink: str) -> None:
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        (x, y), bar = self.top, self.bar
        total = figure.bbox.width
        thick = 0.9 * font
        if bar.counts:
            self._paint_histogram(figure, height, font)
            y += _HISTOGRAM * font
        box = ((x - 0.5 * self.width) / total, 1 - (y + thick) / height, self.width / total, thick / height)
        extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[bar.below, bar.above]
        colors = ScalarMappable(Normalize(*bar.limits), bar.colormap)
        axes = figure.add_axes(box)
        drawn = figure.colorbar(colors, cax=axes, orientation="horizontal", extend=extend, extendfrac=_ARROW)
        places, texts, _ = self._ticks(font)
        drawn.set_ticks(places, labels=texts)
        drawn.outline.set(edgecolor=ink, linewidth=0.04 * font)
        axes.tick_params(
            labelsize=_TICK_SIZE * font, length=0.25 * font, width=0.06 * font, colors=ink, pad=0.15 * font
        )
        _Text((x, y + 3.1 * font), bar.text, font).paint(figure, height, font, ink)

    def _paint_histogram(self, figure: "Figure", height: int, font: float) -> None:
        """Columns in the colours below them, the highest as high as there is room."""
        total, (x, y), bins = figure.bbox.width, self.top, len(self.bar.counts)
        tall = (_HISTOGRAM - 0.3) * font
        box = ((x - 0.5 * self.width) / total, 1 - (y + tall) / height, self.width / total, tall / height)
        axes = figure.add_axes(box)
        places = (np.arange(bins) + 0.5) / bins
        axes.bar(places, self.bar.counts, width=1.0 / bins, color=self.bar.colormap(places))
        axes.set(xlim=(-_ARROW * self.bar.below, 1.0 + _ARROW * self.bar.above), ylim=(0.0, max(*self.bar.counts, 1)))
        axes.set_axis_off()

    def _ticks(self, font: float) -> tuple[list[float], list[str], int]:
        """Five ticks, or only the limits and the middle where five would touch."""
        five = ticks(*self.bar.limits)
        room = sum(_text_width(text, _TICK_SIZE * font) + font for text in five[1])
        return five if room < 1.2 * self.width else ticks(*self.bar.limits, count=3)


def _arrange(
    rows: Sequence[Row], title: str, bar: ColorBar | None, font: float
) -> tuple[list[_Text | _Image | _Bar], int, int]:
    """Place everything; the items and the width and height of the sheet in pixels."""
    widths = [_column_width(rows, column, font) for column in range(max(len(row.images) for row in rows))]
    gap = 1.5 * font
    content = sum(widths) + gap * (len(widths) - 1)
    wanted = max(content, _text_width(title, _TITLE_SIZE * font), _room_for_bar(bar, font))
    left = (2.4 if any(row.name for row in rows) else 1.0) * font + 0.5 * (wanted - content)
    centers = [left + sum(widths[:j]) + gap * j + 0.5 * widths[j] for j in range(len(widths))]
    middle = left + 0.5 * content
    items: list[_Text | _Image | _Bar] = []
    y = font
    if title:
        items.append(_Text((middle, y + 0.6 * font), title, _TITLE_SIZE * font))
        y += 2.2 * font
    for row in rows:
        placed, y = _arrange_row(row, centers, widths, y, font)
        items += placed
    if bar:
        items.append(_Bar((middle, y), _BAR_WIDTH * max(_room_for_bar(bar, font), 0.45 * content), bar))
        y += _bar_height(bar) * font
    return items, math.ceil(middle + 0.5 * wanted + font), math.ceil(y + 0.2 * font)


def _arrange_row(
    row: Row, centers: list[float], widths: list[float], y: float, font: float
) -> tuple[list[_Text | _Image | _Bar], float]:
    """Place a row whose upper edge is at `y`; its items and the upper edge of the next row."""
    items: list[_Text | _Image | _Bar] = []
    if any(row.titles):
        items += [_Text((x, y + 0.5 * font), text, font) for x, text in zip(centers, row.titles, strict=False)]
        y += 1.6 * font
    tall = max(len(image) for image in row.images)
    if row.name:
        items.append(_Text((1.2 * font, y + 0.5 * tall), row.name, 0.9 * font, rotation=90))
    for x, image in zip(centers, row.images, strict=False):
        items.append(_Image((round(x - 0.5 * image.shape[1]), round(y + 0.5 * (tall - len(image)))), image))
    y += tall + 0.8 * font
    if any(row.bars):
        for x, width, bar in zip(centers, widths, row.bars, strict=False):
            if bar:
                items.append(_Bar((x, y), _BAR_WIDTH * width, bar))
        y += max(_bar_height(bar) for bar in row.bars if bar) * font
    return items, y


def _bar_height(bar: ColorBar) -> float:
    return _BAR_HEIGHT + (_HISTOGRAM if bar.counts else 0.0)


def _column_width(rows: Sequence[Row], column: int, font: float) -> float:
    """Width that holds every image, title and colour bar of a column."""
    sizes = [0.0]
    for row in (row for row in rows if column < len(row.images)):
        sizes.append(row.images[column].shape[1])
        sizes += [_text_width(text, font) for text in row.titles[column : column + 1]]
        sizes += [_room_for_bar(bar, font) for bar in row.bars[column : column + 1]]
    return max(sizes)


def _room_for_bar(bar: ColorBar | None, font: float) -> float:
    return max(_MIN_COLUMN * font, _text_width(bar.text, font)) if bar else 0.0


def _text_width(text: str, size: float) -> float:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    return float(TextPath((0, 0), text, prop=FontProperties(size=size)).get_extents().width) if text.strip() else 0.0
