"""Results as tables of text and HTML, as dictionaries and as data frames."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any, cast

from bezier_filters.display import cell_text, html_table
from bezier_filters.runtime.extras import import_extra

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Table:
    """Rows under a header, with a title above them."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[object]]

    def __str__(self) -> str:
        """Lines of columns, the first one flush left, numbers with four digits.

        >>> print(Table("volume", ["", "before", "after"], [["torus", 1.25, None]]))
        volume
               before  after
        torus    1.25
        """
        cells = [[*map(str, self.header)], *([cell_text(cell) for cell in row] for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [[first.ljust(widths[0]), *map(str.rjust, rest, widths[1:])] for first, *rest in cells]
        return "\n".join([self.title, *("  ".join(line).rstrip() for line in lines)])


class TabularResult:
    """Conversions of a result: a dataclass, in which derived values are fields that base classes compute when read."""

    def _tables(self) -> list[Table]:
        """What is shown of the result."""
        raise NotImplementedError

    def _columns(self) -> Mapping[str, object]:
        """Columns of equal length, by name."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """All attributes, derived ones too, by name: arrays as they are, not copied, nested results as dicts."""
        return cast("dict[str, Any]", _plain(self))

    def to_pandas(self) -> "pandas.DataFrame":
        """Table with one row for each vertex, hole or line; a vector has three columns, x, y and z.

        Fields of vertices have the names that they have in files, such as ``bz_k_min``.

        Raises
        ------
        ImportError
            If pandas is missing.
        """
        library: Any = import_extra("pandas")
        return cast("pandas.DataFrame", library.DataFrame(dict(self._columns())))

    def __str__(self) -> str:
        """Tables of the most important numbers."""
        return "\n\n".join(map(str, self._tables()))

    def _repr_html_(self) -> str:
        """Tables for notebooks."""
        return "".join(html_table(table.title, table.header, table.rows) for table in self._tables())


def _plain(value: Any) -> Any:
    """Dataclasses as dicts, at any depth."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    return [_plain(item) for item in value] if isinstance(value, tuple | list) else value
