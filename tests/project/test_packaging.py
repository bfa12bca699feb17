"""What is built can be installed and used outside of the tree."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

from bezier_filters import __version__

ROOT = Path(__file__).parents[2]


OUTSIDE = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
"""Variables that do not lead back to this tree."""


def run(*command, cwd, status=0):
    """Run a program in an environment without this tree; its output, or what it says when it fails as expected."""
    done = subprocess.run([*map(str, command)], cwd=cwd, env=OUTSIDE, capture_output=True, text=True)
    assert done.returncode == status, done.stderr + done.stdout
    return done.stderr if status else done.stdout


def python(folder):
    """A fresh virtual environment: its Python and the folder of its programs."""
    venv.create(folder, with_pip=True)
    programs = folder / ("Scripts" if sys.platform == "win32" else "bin")
    return programs / "python", programs


def pip_install(interpreter, *packages):
    run(interpreter, "-m", "pip", "install", "--quiet", *packages, cwd=interpreter.parent)


def test_the_oldest_versions_are_the_lower_bounds():
    from oldest_versions import oldest_versions

    project = {
        "dependencies": ["numpy>=2.0", "rich>=13,<99", "local"],
        "optional-dependencies": {"viz": ["vtk>=9.6"]},
    }
    assert oldest_versions(project) == {"numpy": "2.0", "rich": "13", "vtk": "9.6"}


def test_the_citation_names_this_version():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (.*)$", citation, re.MULTILINE) == [__version__]


def test_the_newest_section_of_the_changelog_is_of_this_version_and_all_have_dates():
    headings = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert headings[0].split()[0] == __version__
    assert all(re.fullmatch(r"\d+\.\d+\.\d+ \(\d{4}-\d{2}-\d{2}\)", heading) for heading in headings)


def test_every_dependency_is_explained():
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    names = set(re.findall(r'"([\w-]+)(?:\[\w+\])?>=', project)) - {"pymeshlab", "numpy", "scipy"}
    assert len(names) > 20
    page = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
    assert {name for name in names if not re.search(rf"\b{name}\b", page)} == set()


def test_the_recipe_for_conda_has_the_version_and_the_dependencies():
    recipe = (ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8")
    assert f'version: "{__version__}"' in recipe
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8").partition("[project.optional-dependencies]")[0]
    needed = re.findall(r'^    "([\w-]+>=[\w.,<]+)",$', project, re.MULTILINE)
    assert len(needed) == 9
    running = recipe.partition("  run:\n")[2].partition("\ntests:")[0]
    found = re.findall(r"^    - ([\w-]+) (.*)$", running, re.MULTILINE)
    assert found == [("python", ">=3.10"), *(tuple(re.split("(?=>=)", line)) for line in needed)]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folder with the wheel and the sdist; the wheel is built from the sdist."""
    folder = tmp_path_factory.mktemp("built")
    interpreter, _ = python(folder / "venv")
    pip_install(interpreter, "build")
    run(interpreter, "-m", "build", "--outdir", folder / "dist", ROOT, cwd=folder)
    return folder / "dist"


@pytest.mark.slow
def test_the_wheel_and_the_sdist_hold_what_they_should(built):
    (wheel,), (sdist,) = built.glob("*.whl"), built.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    assert {name.split("/")[0] for name in names} == {
        "bezier_filters",
        f"bezier_filters-{__version__}.dist-info",
    }
    data = {"py.typed", "__init__.pyi", "pictures/page.html", "pictures/page.js", "pictures/profile.js"}
    assert {f"bezier_filters/{name}" for name in data} <= set(names)
    modules = {f"bezier_filters/{p.relative_to(ROOT / 'bezier_filters')}" for p in ROOT.glob("bezier_filters/**/*.py")}
    assert modules <= set(names)
    with tarfile.open(sdist) as archive:
        names = {name.split("/", 1)[-1] for name in archive.getnames()}
    assert {
        "LICENSE",
        "README.md",
        "CITATION.cff",
        "tests/project/test_packaging.py",
        "sample_meshes/torus.ply",
        "notebooks/terrain.ipynb",
    } <= names


USERS_SCRIPT = """import numpy as np
import bezier_filters as bf

vertices, faces = bf.mesh_arrays("bunny.ply")
g = bf.estimate_vertex_geometry(vertices, faces, rings=3)
curvature: np.ndarray = g.mean_curvature
print(bf.smooth(vertices, faces).volume_ratio, [hole.method for hole in bf.fill_holes(vertices, faces).holes])
bf.estimate_vertex_geometry(vertices, faces, rings="many")
g.no_such_field
"""


@pytest.mark.slow
def test_a_users_script_is_checked_against_the_types_of_the_wheel(built, tmp_path):
    """Two mistakes, on the last two lines, and nothing else is found."""
    interpreter, programs = python(tmp_path / "venv")
    pip_install(interpreter, *built.glob("*.whl"), "mypy")
    (tmp_path / "script.py").write_text(USERS_SCRIPT, encoding="utf-8")
    command = [programs / "mypy", "--strict", "--config-file", os.devnull, "script.py"]
    done = subprocess.run(list(map(str, command)), cwd=tmp_path, env=OUTSIDE, capture_output=True, text=True)
    found = re.findall(r"^script.py:(\d+): error: .* \[(.*)\]$", done.stdout, re.MULTILINE)
    assert found == [("8", "arg-type"), ("9", "attr-defined")], done.stdout


@pytest.mark.slow
def test_the_wheel_works_outside_of_the_tree(built, tmp_path):
    interpreter, programs = python(tmp_path / "venv")
    pip_install(interpreter, *built.glob("*.whl"))
    origin = run(interpreter, "-c", "import bezier_filters; print(bezier_filters.__file__)", cwd=tmp_path)
    assert Path(origin.strip()).is_relative_to(tmp_path / "venv")
    command = programs / "bezier-filters"
    assert run(command, "--version", cwd=tmp_path) == f"bezier-filters {__version__}\n"
    torus = ROOT / "sample_meshes" / "torus.ply"
    assert json.loads(run(command, "info", torus, "--json", cwd=tmp_path))["genus"] == 1
    report = json.loads(run(command, "curvature", torus, "curved.ply", "--json", cwd=tmp_path))
    assert report["status"] == {"OK": 1440}
    assert (tmp_path / "curved.ply").is_file()
    # Without the extra, one line says what to install.
    message = run(command, "render", "curved.ply", "curved.png", cwd=tmp_path, status=2)
    assert 'pip install "bezier-filters[viz]"' in message


@pytest.mark.slow
def test_a_wheel_with_machine_code_compiles_nothing(tmp_path):
    """In a package that cannot be written, without a home; for another processor it compiles, and says so."""
    interpreter, programs = python(tmp_path / "venv")
    pip_install(interpreter, "build")
    command = [interpreter, "-m", "build", "--wheel", "--outdir", tmp_path / "dist", ROOT]
    subprocess.run(command, env=OUTSIDE | {"HATCH_BUILD_HOOK_ENABLE_CUSTOM": "1"}, check=True)
    (wheel,) = (tmp_path / "dist").iterdir()
    tag = f"cp{sys.version_info[0]}{sys.version_info[1]}-none-"
    assert tag in wheel.name
    assert not wheel.name.endswith("-any.whl")
    pip_install(interpreter, wheel)
    (package,) = (tmp_path / "venv").rglob("site-packages/bezier_filters")
    shutil.rmtree(package / "__pycache__", ignore_errors=True)
    (package / "__pycache__").touch()  # permissions would not stop root from writing
    shipped = {path.name for path in package.rglob("*.nbc")}
    assert len(shipped) > 100
    patch = ROOT / "sample_meshes" / "punched_patch.ply"
    (tmp_path / "temporary").mkdir()
    environment = OUTSIDE | {"HOME": str(tmp_path / "nonexistent"), "TMPDIR": str(tmp_path / "temporary")}
    environment = {name: value for name, value in environment.items() if not name.startswith(("NUMBA", "XDG"))}
    for name in ("curvature", "smooth", "fill-holes", "creases"):
        command = [programs / "bezier-filters", name, patch, "out.ply"]
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
        assert "compiling" not in done.stderr, done.stderr
    assert not list((tmp_path / "temporary").rglob("*.nbc"))
    command = [programs / "bezier-filters", "curvature", patch, "out.ply"]
    other = environment | {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    done = subprocess.run(command, env=other, cwd=tmp_path, capture_output=True, text=True)
    assert done.stderr.count("compiling kernels") == 1
    assert "for other processors" in done.stderr


CALLED, CHANGED = (
    "store(outputs, OUT_K_MAX, mean + torsion)",
    "store(outputs, OUT_K_MAX, mean + torsion + mean + torsion)",
)
K_MAX = """
from bezier_filters import estimate_vertex_geometry
from bezier_filters.surfaces import sphere
ball = sphere(resolution=12)
print(estimate_vertex_geometry(ball.vertices, ball.faces, rings=2, alpha=1.0).k_max.mean())
"""


@pytest.mark.slow
def test_an_upgrade_brings_its_machine_code_along(tmp_path):
    """Two wheels differ in a function that the fit calls: the new one gives other curvatures at once."""
    values, target = [], tmp_path / "installed"
    for name in ("old", "new"):
        source = tmp_path / name
        package = source / "bezier_filters"
        shutil.copytree(ROOT / "bezier_filters", package, ignore=shutil.ignore_patterns("__pycache__"))
        for file in ("pyproject.toml", "README.md", "LICENSE"):
            shutil.copy(ROOT / file, source)
        if name == "new":
            called = package / "kernels" / "graph_geometry.py"
            text = called.read_text(encoding="utf-8")
            assert text.count(CALLED) == 1
            called.write_text(text.replace(CALLED, CHANGED), encoding="utf-8")
        run(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", source, source, cwd=tmp_path)
        with zipfile.ZipFile(*source.glob("*.whl")) as wheel:
            wheel.extractall(target)  # what was compiled stays, as it does when pip installs over an older version
        environment = OUTSIDE | {"PYTHONPATH": str(target)}
        for _ in range(2):
            command = [sys.executable, "-W", "error", "-c", K_MAX]
            done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
            values.append(float(done.stdout))
    assert values[0] == pytest.approx(1.0, abs=0.05)
    assert values == [values[0]] * 2 + [2.0 * values[0]] * 2
