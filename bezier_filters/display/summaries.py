"""How results are told: tables in HTML, as which notebooks show them, and the noise in words."""

from collections.abc import Iterable, Sequence
from html import escape
from numbers import Integral, Real
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bezier_filters.arrays import FloatArray

SMALLEST = 1e-4  # times the mean edge: what is less cannot be told from the shape


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table with a title above it; numbers with four digits, None as nothing.

    >>> html_table("volume", ["before", "after"], [[1.0, None]]).count("<td>")
    2
    """
    head = "".join(f"<th>{escape(text)}</th>" for text in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(_text(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<p><b>{escape(title)}</b></p><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def summary(name: str, unit: str, values: "FloatArray") -> list[object]:
    """Row of a table: name, unit, and smallest, median and largest value."""
    import numpy as np

    numbers = [np.min(values), np.median(values), np.max(values)] if len(values) else [None] * 3
    return [name, unit, *numbers]


def _text(cell: object) -> str:
    if cell is None:
        return ""
    if isinstance(cell, Integral):
        return f"{cell:,}"
    return f"{cell:.4g}" if isinstance(cell, Real) else str(cell)


def noise_level(sigma: float | None, edge: float | None = None) -> str:
    """How strong noise is, by its standard deviation: in edges if their mean length is known, or else as a length.

    >>> noise_level(0.02, 0.1), noise_level(0.02), noise_level(1e-9, 0.1), noise_level(None)
    ('0.2 edges', '0.02 (length)', 'too small to be learned', 'unknown')
    """
    if sigma is None:
        return "unknown"
    return "too small to be learned" if sigma <= SMALLEST * (edge or 0.0) else _measured(sigma, edge)


def noise_in_words(sigma: float | None, length: float | None, heavy: bool, edge: float | None = None) -> str:
    """What is known of the noise: its standard deviation, how far it is correlated, and whether it is heavy.

    The length is None if the noise is unknown, and 0 if it is independent from vertex to vertex.

    >>> noise_in_words(0.009, 0.14, False, 0.1)
    'noise 0.09 edges, correlated over 1.4 edges'
    >>> noise_in_words(0.05, 0.0, True, 0.1)
    'noise 0.5 edges in all directions, independent from vertex to vertex'
    >>> noise_in_words(None, None, False)
    'noise unknown: the mesh is too small to learn it'
    """
    level = noise_level(sigma, edge)
    if sigma is None:
        return f"noise {level}: the mesh is too small to learn it"
    if level != _measured(sigma, edge):
        return f"noise {level}"
    correlated = f"correlated over {_measured(length, edge)}" if length else "independent from vertex to vertex"
    return f"noise {level}{' in all directions' * heavy}, {correlated}"


def _measured(length: float, edge: float | None) -> str:
    return f"{length / edge:.2g} edges" if edge else f"{length:.3g} (length)"
