"""Tables in HTML, as which notebooks show results."""

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from bezier_filters.arrays import FloatArray


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table with a title above it; numbers with four digits, None as nothing.

    >>> html_table("volume", ["before", "after"], [[1.0, None]]).count("<td>")
    2
    """
    head = "".join(f"<th>{escape(text)}</th>" for text in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(_text(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<p><b>{escape(title)}</b></p><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def summary(name: str, unit: str, values: FloatArray) -> list[object]:
    """Row of a table: name, unit, and smallest, median and largest value."""
    numbers = [np.min(values), np.median(values), np.max(values)] if len(values) else [None] * 3
    return [name, unit, *numbers]


def _text(cell: object) -> str:
    if cell is None:
        return ""
    if isinstance(cell, float | np.floating):
        return f"{cell:.4g}"
    return f"{cell:,}" if isinstance(cell, int | np.integer) else str(cell)
