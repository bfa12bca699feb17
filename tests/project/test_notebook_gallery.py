"""The notebooks of the gallery run, and are stored without results. Their cells assert what is known of the truth."""

import re

import pytest

import bezier_filters as bf
from notebook_cells import FOLDER, read_notebook, run_notebook

NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


@each_notebook
def test_notebook_runs(path, tmp_path):
    """All cells in turn, in a folder of its own; the page at its end has fields, and a form for notebooks."""
    pages = [cell.shown for cell in run_notebook(path, tmp_path) if isinstance(cell.shown, bf.Page)]
    assert pages
    assert all(page.fields and "<iframe" in page._repr_html_() for page in pages)


@each_notebook
def test_notebook_is_short_and_stored_without_results(path):
    """A title, text between the code, truths that are asserted; no outputs, counts or data of a user."""
    notebook = read_notebook(path)
    text = [cell for cell in notebook["cells"] if cell["cell_type"] == "markdown"]
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    assert set(notebook["metadata"]) == {"kernelspec", "language_info"}
    assert text[0]["source"][0].startswith("# ")
    assert 6 <= len(code) <= 12
    assert len(text) >= 6
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    assert any("assert " in line for cell in code for line in cell["source"])
    assert len({cell["id"] for cell in notebook["cells"]}) == len(notebook["cells"])


def test_the_page_lists_every_notebook():
    page = (FOLDER.parent / "docs" / "notebooks.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\]\(notebooks/(\w+)\.md\)", page)) == {path.stem for path in NOTEBOOKS}
