"""Examples and commands of the README and of the pages run, and what pages name is there."""

import ast
import re
import shlex
import shutil
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import pymeshlab
import pytest
import typer
from command_line import in_this_process
from typer.testing import CliRunner

from bezier_filters.cli.commands import app
from bezier_filters.runtime import worker_processes

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs" / "filters").glob("*.md"))]
EVERY_PAGE = [
    *PAGES,
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs" / "decisions").rglob("*.md")),
    *sorted((ROOT / "docs" / "mathematics").glob("*.md")),
    *ROOT.glob("*/README.md"),
]
PYTHON = re.compile(r"```python\n(.*?)```", re.DOTALL)
COMMAND = re.compile(r"(?:^    |`)bezier-filters ([^`\n]* [^`\n]*|--[^`\n]*)", re.MULTILINE)
SCRIPT = re.compile(r"(?:^    |`)python ([\w/]+\.py)([^`\n]*)", re.MULTILINE)
NAMED_FILE = re.compile(r"`((?:benchmarks|tests|tools)/[\w/]+\.\w+)")
TARGET = re.compile(r"(?:^    |`)make ([a-z-]+)", re.MULTILINE)
FEWER = {"20000": "500", "2%": "10%"}  # vertices of a new mesh, and lines
XML = re.compile(r"```xml\n(.*?)```", re.DOTALL)


def found(pattern, pages=PAGES):
    """Everything that a pattern finds, each once, with the page's name."""
    every = {text: page.name for page in pages for text in pattern.findall(page.read_text(encoding="utf-8"))}
    return [pytest.param(text, id=f"{name}-{k}") for k, (text, name) in enumerate(every.items())]


@pytest.mark.parametrize("code", found(PYTHON))
def test_python_block_runs(code, tmp_path, monkeypatch, capsys):
    shutil.copytree(ROOT / "sample_meshes", tmp_path / "sample_meshes")
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "page", "exec"), {})
    printed = capsys.readouterr().out
    assert "OK" in printed or "status" not in code
    assert printed


def test_script_for_large_meshes_runs(tmp_path):
    """In a process of its own: its workers import it once more."""
    (code,) = re.findall(r"```py\n(.*?)```", (ROOT / "docs" / "scale.md").read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "script.py").write_text(code, encoding="utf-8")
    shutil.copy(ROOT / "sample_meshes" / "torus.ply", tmp_path / "statue.ply")
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "'OK': " in done.stdout
    assert (tmp_path / "curved.ply").is_file()


def in_help():
    """The examples that the help of the commands has."""
    top = typer.main.get_command(app).commands
    commands = top | {f"scale {name}": command for name, command in top["scale"].commands.items()}
    return [
        pytest.param(command, id=f"help-{name}-{k}", marks=[pytest.mark.slow] if name == "compile" else [])
        for name, entry in commands.items()
        for k, command in enumerate(re.findall(r"^Example: bezier-filters (.*)$", entry.epilog or "", re.MULTILINE))
    ]


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Files of the names that the pages use: a scan with holes, points, and what the commands before made of them."""
    folder = tmp_path_factory.mktemp("documents")
    scan = pymeshlab.MeshSet()
    scan.load_new_mesh(str(ROOT / "sample_meshes" / "punched_patch.ply"))
    scan.meshing_decimation_quadric_edge_collapse(targetfacenum=800, preserveboundary=True)
    scan.save_current_mesh(str(folder / "scan.ply"))
    (script,) = XML.findall((ROOT / "docs" / "scripts.md").read_text(encoding="utf-8"))
    for name in ("repair.mlx", "steps.mlx"):
        (folder / name).write_text(script, encoding="utf-8")
    copies = "clean closed bunny my_scan statue reference model earlier"
    for name in (f"{stem}.ply" for stem in copies.split()):
        shutil.copy(folder / "scan.ply", folder / name)
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(folder / "scan.ply"))
    vertices = ms.current_mesh().vertex_matrix()
    ms.add_mesh(pymeshlab.Mesh(vertices))
    ms.save_current_mesh(str(folder / "points.ply"))
    ms.set_current_mesh(0)
    ms.compute_texcoord_parametrization_triangle_trivial_per_wedge(textdim=1024)
    ms.save_current_mesh(str(folder / "textured.obj"))
    (folder / "scans").mkdir()
    shutil.copy(folder / "scan.ply", folder / "scans")
    for command, result, *options in (
        ("curvature", "curved.ply", "--direction", "0", "0", "-1"),
        ("smooth", "clean.ply", "--quality", "displacement"),
    ):
        arguments = [command, str(folder / "scan.ply"), str(folder / result), *options]
        assert CliRunner().invoke(app, arguments).exit_code == 0
    return folder


@pytest.fixture(scope="module")
def outcome(prepared, tmp_path_factory):
    """Runs a command in files of its own, so that it needs no other before it; what several pages name, once."""

    @cache
    def run(*arguments):
        folder = tmp_path_factory.mktemp("documents")
        shutil.copytree(prepared, folder, dirs_exist_ok=True)
        with pytest.MonkeyPatch.context() as patched:
            patched.chdir(folder)
            patched.setattr(worker_processes, "run_in_processes", in_this_process)
            return CliRunner().invoke(app, arguments)

    return run


@pytest.mark.usefixtures("quick_pictures")
@pytest.mark.parametrize("command", [*found(COMMAND), *in_help()])
def test_command_runs(command, outcome):
    """`view` needs a display, `watch` never ends, completion changes the user's shell, HOST is any machine.

    Their options are parsed. Pictures and new meshes are small.

    Processes for tiles and batches are started by other tests, and by the script above.
    """
    arguments = shlex.split(command, comments=True)
    if arguments[0] in ("view", "watch", "--install-completion") or re.search("HOST|scheduler-file", command):
        arguments.append("--help")
    elif arguments[0] == "scale":
        arguments += ["--scheduler", "synchronous"]
    elif arguments[0] in ("bake", "render"):
        arguments += ["--size", "100"]
    arguments = [FEWER.get(argument, argument) for argument in arguments]
    result = outcome(*arguments)
    assert result.exception is None
    assert result.exit_code == 0


@pytest.mark.parametrize("command", found(SCRIPT, EVERY_PAGE))
def test_script_is_there_and_has_the_options(command):
    name, options = command
    if name.isupper():  # a placeholder
        return
    code = (ROOT / name).read_text(encoding="utf-8")
    assert all(f'"{option}"' in code for option in re.findall(r"--[a-z-]+", options)), options


@pytest.mark.parametrize("page", EVERY_PAGE, ids=lambda page: page.relative_to(ROOT).with_suffix("").as_posix())
def test_files_that_a_page_names_are_there(page):
    names = NAMED_FILE.findall(page.read_text(encoding="utf-8"))
    assert [name for name in names if not (ROOT / name).is_file()] == []


def test_files_that_the_site_needs_are_there_and_nothing_is_loaded_from_the_network():
    """The logo, styles and the script of the search, which the plugin for sites on disk would load by its address."""
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    needed = re.findall(r"(?:logo|favicon|extra_css|polyfills): \[?([\w./-]+)", settings)
    assert len(needed) == 4
    assert [name for name in needed if not (ROOT / "docs" / name).is_file()] == []
    assert any("iframe-worker" in name for name in needed)
    assert re.search(r"^  - offline$", settings, re.MULTILINE)
    assert "http" not in settings


DECISIONS = sorted((ROOT / "docs" / "decisions").glob("*.md"))
SECTIONS = ["Context", "Decision", "Why", "What lost", "Consequences"]


@pytest.mark.parametrize("page", DECISIONS, ids=lambda page: page.stem)
def test_every_decision_has_a_date_and_a_status(page):
    """Accepted, perhaps refined by another, or superseded by another."""
    _, _, line, *_ = page.read_text(encoding="utf-8").splitlines()
    found = re.fullmatch(r"\*(\S{10}), (?:accepted(?:; refined by (.*))?|superseded by (.*))\*", line)
    assert found, line
    assert page.name.startswith(found[1])
    others = re.findall(r"\]\((.*?)\)", line)
    assert bool(others) == bool(found[2] or found[3])
    assert all((page.parent / other).is_file() for other in others)


@pytest.mark.parametrize("page", DECISIONS, ids=lambda page: page.stem)
def test_every_decision_is_short_and_links_its_appendix(page):
    text = page.read_text(encoding="utf-8")
    headings = re.findall(r"^## (.*)$", text, re.MULTILINE)
    assert [name for name in headings if name in SECTIONS] == SECTIONS
    assert len(text.splitlines()) <= 40
    appendix = page.parent / "appendix" / page.name
    assert appendix.is_file() == (f"](appendix/{page.name})" in text)
    assert not appendix.is_file() or f"](../{page.name})" in appendix.read_text(encoding="utf-8")


def test_every_appendix_belongs_to_a_decision():
    appendices = {page.name for page in (ROOT / "docs" / "decisions" / "appendix").glob("*.md")}
    assert appendices
    assert appendices <= {page.name for page in DECISIONS}


def test_targets_of_make_are_there():
    targets = re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    named = {text for page in EVERY_PAGE for text in TARGET.findall(page.read_text(encoding="utf-8"))}
    configured = [ROOT / ".pre-commit-config.yaml", *(ROOT / ".github" / "workflows").glob("*.yml")]
    for file in configured:
        used = re.findall(r"(?:run|entry): make ([a-z-]+)", file.read_text(encoding="utf-8"))
        assert used
        named.update(used)
    assert named <= set(targets)


@pytest.mark.skipif(shutil.which("make") is None, reason="there is no make on this machine")
def test_make_takes_names_with_spaces():
    done = subprocess.run(
        ["make", "-n", "--no-print-directory", "demo", "MESH=my scan.obj", "OUT=my results"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert shlex.split(done.stdout.splitlines()[-1])[-3:] == ["my scan.obj", "--out", "my results"]


def test_every_public_name_has_a_reference():
    """It stands in a page, as what `:::` names, by itself or as one of a module's."""
    stub = (ROOT / "bezier_filters" / "__init__.pyi").read_text(encoding="utf-8")
    pages = "\n".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md"))
    described = {name.rpartition(".")[2] for name in re.findall(r"^::: ([\w.]+)", pages, re.MULTILINE)}
    assert set(re.findall(r" as (\w+)", stub)) - described == {"__version__"}


# --- glossary -------------------------------------------------------------------------------------


@cache
def names_defined_in(path):
    """Functions, classes, their methods, and variables that a module of the package defines, without their owners."""
    nodes = list(ast.walk(ast.parse((ROOT / "bezier_filters" / path).read_text(encoding="utf-8"))))
    defined = {node.name for node in nodes if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    return defined | {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}


@cache
def modules_of_the_package():
    """Paths of all modules from the package."""
    return [path.relative_to(ROOT / "bezier_filters").as_posix() for path in (ROOT / "bezier_filters").rglob("*.py")]


@cache
def names_of_the_package():
    """What any module defines."""
    return set().union(*map(names_defined_in, modules_of_the_package()))


def cells_of_glossary():
    """The last column of every row, without rows that name nothing."""
    rows = re.findall(r"^\|.*\|$", (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8"), re.MULTILINE)
    for row in rows:
        term, *_, cell = re.split(r"(?<!\\)\|", row.strip("|"))
        if "`" in cell:
            yield pytest.param(re.findall(r"`([^`]+)`", cell), id=term.strip().replace(" ", "-"))


@pytest.mark.parametrize("names", list(cells_of_glossary()))
def test_glossary_names_what_the_code_has(names):
    """In the files of the cell or, if it has none, anywhere."""
    files = [name for name in names if name.endswith(".py")]
    assert set(files) <= set(modules_of_the_package())
    defined = set().union(*map(names_defined_in, files)) if files else names_of_the_package()
    assert [name for name in names if name not in files and not defined.issuperset(name.split("."))] == []


# --- mathematics ----------------------------------------------------------------------------------

MATHEMATICS = sorted((ROOT / "docs" / "mathematics").glob("*.md"))
NAMED = re.compile(r"`((?:\w+\.)+\w+)`(?: = (-?[\d.]+(?:e-?\d+)?))?")


@cache
def module_of(path):
    """The module with the last parts of this path, as `fit_spec` or `surface_model.learn`; there must be only one."""
    files = (ROOT / "bezier_filters").rglob("/".join(path.split(".")) + ".py")
    names = [".".join(file.relative_to(ROOT).with_suffix("").parts) for file in files]
    assert len(names) == 1, f"{path}: {names or 'no such module'}"
    return import_module(names[0])


def named(text):
    """What a page names by module and name: a function, a constant, a class or one of its fields."""
    module, _, name = text.rpartition(".")
    owner = None
    if module.rpartition(".")[2][0].isupper():
        module, _, owner = module.rpartition(".")
    there = module_of(module)
    if owner is None:
        return getattr(there, name)
    cls = getattr(there, owner)
    fields = {field for base in cls.__mro__ for field in getattr(base, "__annotations__", {})}
    assert name in fields or hasattr(cls, name), f"{owner} has no {name}"
    return cls


def names_of_mathematics():
    for page in MATHEMATICS:
        found = {match.groups() for match in NAMED.finditer(page.read_text(encoding="utf-8")) if match[1][:3] != "bf."}
        yield from (pytest.param(*one, id=f"{page.stem}-{one[0]}") for one in sorted(found, key=str))


@pytest.mark.parametrize(("text", "value"), list(names_of_mathematics()))
def test_mathematics_names_what_the_code_has(text, value):
    """With the value of constants."""
    what = named(text)
    if value is not None:
        assert float(value) == pytest.approx(what, rel=1e-12)


@pytest.mark.parametrize("page", MATHEMATICS, ids=lambda page: page.stem)
def test_mathematics_names_the_code_and_shows_figures(page):
    """Constants are given with their values, so that the test above can compare them."""
    text = page.read_text(encoding="utf-8")
    assert len(NAMED.findall(text)) >= 30
    assert any(value for _, value in NAMED.findall(text))
    pictures = re.findall(r"!\[[^\]]+\]\(\.\./images/(mathematics_\w+)\.png\)", text)
    assert len(pictures) >= 2
    script = (ROOT / "docs" / "images" / f"mathematics_{page.stem}.py").read_text(encoding="utf-8")
    assert all(f"def draw_{name.removeprefix('mathematics_')}(" in script for name in pictures)
