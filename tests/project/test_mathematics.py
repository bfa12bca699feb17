"""The pages of formulas name places and constants of the code that exist, and figures that a script draws."""

import inspect
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs" / "mathematics").glob("*.md"))
NAME = re.compile(r"`([a-z_]\w*(?:\.\w+)+)`(?: = (\d+(?:\.\d+)?(?:e-\d+)?))?")
FEWEST_NAMES = 20  # of a page: each symbol has one

quoted = [
    pytest.param(name, value, id=f"{page.stem}-{name}")
    for page in PAGES
    for name, value in dict(NAME.findall(page.read_text(encoding="utf-8"))).items()
]


def find(name):
    """The module that a dotted name begins with, and what it stands for; fields of classes count."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            module = found = import_module(".".join(["bezier_filters", *parts[:count]]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            fields = inspect.get_annotations(found) if inspect.isclass(found) else {}
            found = fields[part] if part in fields and not hasattr(found, part) else getattr(found, part)
        return module, found
    raise LookupError(name)


def test_every_page_names_the_code():
    assert {page.stem for page in PAGES} == {"curvature", "smoothing", "holes"}
    for page in PAGES:
        assert len(set(NAME.findall(page.read_text(encoding="utf-8")))) >= FEWEST_NAMES, page.name


@pytest.mark.parametrize(("name", "value"), quoted)
def test_quoted_name_is_there(name, value):
    module, found = find(name)
    own_name = getattr(found, "__name__", None)  # of a function or class, but not of a constant
    if name.rpartition(".")[2] == own_name:
        assert found.__module__ == module.__name__  # not where it is imported
    if value:
        assert np.isclose(found, float(value), rtol=1e-12)


@pytest.mark.parametrize("name", ["surface_model.fit_spec.no_such_name", "no_such_module.name", "holes.loops.a.b"])
def test_missing_names_are_noticed(name):
    with pytest.raises((AttributeError, LookupError)):
        find(name)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_figures_are_there_and_drawn_by_the_script(page):
    script = (ROOT / "docs" / "images" / "mathematics.py").read_text(encoding="utf-8")
    figures = re.findall(r"\]\((\.\./images/\w+\.png)\)", page.read_text(encoding="utf-8"))
    assert figures
    for figure in figures:
        assert (page.parent / figure).is_file()
        assert f'"{Path(figure).name}"' in script


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_sources_are_listed(page):
    """Every (author year) of the text is in its list of sources."""
    text, _, sources = page.read_text(encoding="utf-8").partition("## Sources")
    for author, year in re.findall(r"([A-Z][\w-]+)(?:,| et al\.)? (?:\()?((?:19|20)\d\d)\)?[;,): ]", text):
        assert re.search(rf"{author}.*{year}", sources), (author, year)
