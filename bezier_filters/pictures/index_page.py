"""One page for many files, with what became of each and links to its report."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from urllib.parse import quote

from bezier_filters.pictures.page import fill_template, read_template


@dataclass(frozen=True)
class IndexRow:
    """A file on the page: its name, outcome, remark, and the report to link, relative to the page, if there is one."""

    name: str
    result: str
    remark: str
    report: str | None


def index_page(title: str, about: Sequence[str], rows: Sequence[IndexRow]) -> str:
    """The page of a batch, with what needs a look first.

    >>> "a.html" in index_page("batch", [], [IndexRow("a.ply", "done", "", "a.html")])
    True
    """
    urgency = {"failed": 0, "look": 1}
    ordered = sorted(rows, key=lambda row: urgency.get(row.result, len(urgency)))
    body = "".join(
        f"<tr>{_name(row)}<td>{escape(row.result)}</td><td>{escape(row.remark)}</td></tr>" for row in ordered
    )
    head = "".join(f'<th scope="col">{text}</th>' for text in ("file", "result", "remark"))
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    style = read_template("page.css").replace("#paper { display: none; }", "").partition("@page")[0]
    about_text = escape(" \u00b7 ".join(about))
    return fill_template("index.html", title=escape(title), style=style, about=about_text, table=table)


def _cell(text: str) -> str:
    return f"<td>{escape(text)}</td>"


def _name(row: IndexRow) -> str:
    name = escape(row.name)
    linked = name if row.report is None else f'<a href="{escape(quote(row.report))}">{name}</a>'
    return f'<th scope="row">{linked}</th>'
