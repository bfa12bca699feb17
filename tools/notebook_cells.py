"""Reads the cells of notebooks and runs them, without Jupyter: for the tests and the site."""

import ast
import json
import os
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "notebooks"


@dataclass(frozen=True)
class Cell:
    """A cell that was run, or text.

    Attributes
    ----------
    is_code : bool
        Whether the source is code, not Markdown.
    source : str
        Its text.
    printed : str
        What the code printed.
    shown : object
        The value of its last line; None where that is a statement.
    """

    is_code: bool
    source: str
    printed: str = ""
    shown: Any = None


def read_notebook(path: Path) -> dict[str, Any]:
    """The notebook as it is stored."""
    return dict(json.loads(path.read_text(encoding="utf-8")))


def run_notebook(path: Path, folder: Path) -> list[Cell]:
    """The cells in turn, run in a folder, where they may write files."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    before = Path.cwd()
    os.chdir(folder)
    try:
        return [_run_cell(cell, path.stem, namespace) for cell in read_notebook(path)["cells"]]
    finally:
        os.chdir(before)


def _run_cell(cell: dict[str, Any], name: str, namespace: dict[str, Any]) -> Cell:
    source = "".join(cell["source"])
    if cell["cell_type"] != "code":
        return Cell(False, source)
    tree, output, place = ast.parse(source), StringIO(), f"{name}, cell {cell['id']}"
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    with redirect_stdout(output):
        exec(compile(tree, place, "exec"), namespace)
        shown = last and eval(compile(ast.Expression(last.value), place, "eval"), namespace)
    return Cell(True, source, output.getvalue(), shown)
