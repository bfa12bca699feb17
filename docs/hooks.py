"""Pages of the site that are generated when it is built: gallery, notebooks, command line, decisions."""

import ast
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from html import unescape
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

import bezier_filters as bf
from bezier_filters.cli.commands import app

sys.path.append(str(Path(__file__).parents[1] / "tools"))
from notebook_cells import FOLDER, run_notebook

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("ex*.py"))
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
RESULTS = ROOT / "benchmarks" / "results"


def on_config(config: Any) -> None:
    """Complete the navigation with the decisions and their appendices."""
    docs = Path(config.docs_dir)
    decisions = [f"decisions/{path.name}" for path in sorted((docs / "decisions").glob("*.md"))]
    appendices = [
        {_title(docs / "decisions" / path.name): f"decisions/appendix/{path.name}"}
        for path in sorted((docs / "decisions" / "appendix").glob("*.md"))
    ]
    config.nav.insert(-2, {"Decisions": [*decisions, {"Appendices": appendices}]})
    (entry,) = (entry for entry in config.nav if "Notebooks" in entry)
    entry["Notebooks"] = [entry["Notebooks"], *(f"notebooks/{path.stem}.md" for path in NOTEBOOKS)]
    config.watch += [str(ROOT / "examples"), str(ROOT / "notebooks"), str(ROOT / "bezier_filters")]


def _title(path: Path) -> str:
    return path.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")


def on_files(files: Files, *, config: Any) -> Files:
    """Add the gallery with its pictures, the notebooks, the command line, and plots of the benchmarks."""
    files.append(File.generated(config, "command_line.md", content=command_line()))
    files.append(File.generated(config, "gallery.md", content=gallery()))
    for name, picture in pictures():
        files.append(File.generated(config, f"gallery/{name}", content=picture))
    for path in NOTEBOOKS:
        files.append(File.generated(config, f"notebooks/{path.name}", content=path.read_bytes()))
        for name, content in notebook_files(path):
            files.append(File.generated(config, f"notebooks/{name}", content=content))
    for plot in RESULTS.glob("*.png"):
        files.append(File.generated(config, f"results/{plot.name}", content=plot.read_bytes()))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Pages name plots of the benchmarks where the tree has them; the site has its own folder. Names become links."""
    return linked(markdown.replace("](../benchmarks/results/", "](results/"))


def on_page_content(html: str, **_: Any) -> str:
    """Equations as MathML, which browsers draw without any script; pictures that open in full size.

    Names in tables may be broken after an underscore, a dot or a slash, so that tables fit; options may not.
    """
    html = re.sub(r"(?<!<pre>)(?<!</span>)<code>([^<]*)</code>", _breakable, html)
    html = re.sub(r'(<img [^>]*src="([^"]+)"[^>]*>)(?!</a>)', r'<a href="\2">\1</a>', html)
    return re.sub(r'<(span|div) class="arithmatex">(.*?)</\1>', _mathml, html, flags=re.DOTALL)


def _breakable(found: re.Match[str]) -> str:
    text = re.sub(r"(?<=\w\w\w[_./])(?=[A-Za-z]\w\w)", "<wbr>", found[1])
    return "<code>" + re.sub(r"(?<![\w-])(--?[a-z][a-z-]*)", r'<span class="option">\1</span>', text) + "</code>"


def _mathml(found: re.Match[str]) -> str:
    equation = unescape(found[2]).strip()[2:-2]
    if found[1] == "span":
        return convert(equation, display="inline")
    return f'<div class="equation">{convert(equation, display="block")}</div>'


def references() -> dict[str, str]:
    """What the pages describe by `:::`, by the last part of its name."""
    pages = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))
    return {name.rpartition(".")[2]: name for name in re.findall(r"^::: ([\w.]+)", pages, re.MULTILINE)}


def _is_name(found: re.Match[str], known: dict[str, str]) -> bool:
    """Whether a text is a name of the package, and not that of a command or a word."""
    text, name = found.groups()
    return name in known and (text != name or "_" in name or not name.islower())


def linked(markdown: str) -> str:
    """The text with links from names of the package to what describes them, but for code, headings and links."""
    known, lines, in_code = references(), [], False
    for line in markdown.splitlines():
        in_code ^= line.lstrip().startswith("```")
        if not in_code and not line.startswith(("    ", "#", ":::")):
            line = re.sub(
                r"(?<![\[`])`((?:bezier_filters\.|bf\.)?(\w+)(?:\(\))?)`(?![\]`])",
                lambda found: f"[`{found[1]}`][{known[found[2]]}]" if _is_name(found, known) else found[0],
                line,
            )
        lines.append(line)
    return "\n".join(lines)


def pictures() -> Iterator[tuple[str, bytes]]:
    """The pictures of all examples, by name."""
    sys.path.insert(0, str(ROOT / "examples"))
    try:
        for path in EXAMPLES:
            with tempfile.TemporaryDirectory() as folder:
                import_module(path.stem).main(Path(folder))
                yield from ((picture.name, picture.read_bytes()) for picture in sorted(Path(folder).glob("*.png")))
    finally:
        sys.path.remove(str(ROOT / "examples"))


def gallery() -> str:
    """What every example shows, and its code."""
    parts = ["# Gallery", "Short scripts to start from, in `examples/`; `python examples/NAME.py FOLDER` runs one."]
    for path in EXAMPLES:
        code = path.read_text(encoding="utf-8")
        heading, _, text = (ast.get_docstring(ast.parse(code)) or "").partition("\n")
        shown = re.findall(r'out / "(\w+\.png)"', code)
        parts += [f"## {heading.rstrip('.')}", text.replace("``", "`").strip()]
        parts += [f"![{heading}](gallery/{name})" for name in shown]
        parts.append(f'??? example "{path.name}"\n\n    ```python\n{_indented(code)}\n    ```')
    return "\n\n".join(parts)


def notebook_files(path: Path) -> Iterator[tuple[str, str]]:
    """A page with the cells of a notebook and their results, and the pages that it shows, by name."""
    parts = []
    with tempfile.TemporaryDirectory() as folder:
        for number, cell in enumerate(run_notebook(path, Path(folder))):
            if not cell.is_code:
                parts.append(cell.source)
                continue
            parts.append(f"```python\n{cell.source}\n```")
            if cell.printed:
                parts.append(f"```text\n{cell.printed.rstrip()}\n```")
            if isinstance(cell.shown, bf.Page):
                name = f"{path.stem}_{number}.html"
                yield name, cell.shown.html
                parts.append(f'<iframe class="mesh" src="{name}" title="The mesh" loading="lazy"></iframe>')
            elif cell.shown is not None:
                html = getattr(cell.shown, "_repr_html_", None)
                parts.append(html() if html else f"```text\n{cell.shown}\n```")
    parts.insert(1, f"[Download the notebook]({path.name}){{ download }} to run and change it.")
    yield f"{path.stem}.md", "\n\n".join(parts)


def _indented(code: str) -> str:
    return "\n".join(f"    {line}".rstrip() for line in code.strip().splitlines())


def summary(text: str) -> str:
    """The first paragraph of a help, as one line."""
    return " ".join(text.partition("\n\n")[0].split())


def command_line() -> str:
    """Every command with its arguments and options, as typer documents them."""
    command = [sys.executable, "-m", "typer", "bezier_filters.cli.commands", "utils", "docs"]
    command += ["--name", "bezier-filters", "--title", "Command line"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    for name, entry in typer.main.get_command(app).commands.items():  # the list cuts them off
        done.stdout = re.sub(rf"(?m)^\* `{name}`: .*$", f"* `{name}`: {summary(entry.help)}", done.stdout)
    completion = "`bezier-filters --install-completion` makes the shell complete commands and options."
    return re.sub(r"^Example: (.*)$", r"Example:\n\n    \1", done.stdout, flags=re.MULTILINE).replace(
        "**Usage**", f"{completion}\n\n**Usage**", 1
    )
