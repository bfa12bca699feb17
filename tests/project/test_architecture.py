"""The imports point one way, and importing the package is cheap."""

import ast
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import bezier_filters

PACKAGE = Path(bezier_filters.__file__).parent
LAYERS = """
_version
errors
arrays
arguments
fields
field_arrays
parameters
status
display
runtime
result_tables
differential_geometry
patches
surfaces
meshes
kernels
sampling
noise
surface_model
fitting
smoothing
estimation
feature_lines
patch_surface
surface_lines
remeshing
inspection
holes
textures
files
scale
compilation
meshlab
pictures
cli
__main__
"""
"""Subpackages and modules at the top, one a line: each imports only from itself and those above it."""


@cache
def syntax_tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def imports_of(path):
    """Modules of the package that a module imports anywhere in its code, as paths from the package."""
    found = set()
    for node in ast.walk(syntax_tree(path)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "bezier_filters":
            parts = node.module.split(".")[1:]
            found.update(module_at(*parts, alias.name) or module_at(*parts) for alias in node.names)
        elif isinstance(node, ast.Import):
            found.update(module_at(*a.name.split(".")[1:]) for a in node.names if a.name.startswith("bezier_filters."))
    return found - {None}


def module_at(*parts):
    """Path of a module from the package, if there is one."""
    path = PACKAGE.joinpath(*parts)
    if parts and path.with_suffix(".py").exists():
        return "/".join(parts)
    return None


def package_imports():
    """Every module with the modules that it imports."""
    found = {}
    for path in PACKAGE.rglob("*.py"):
        if path.stem != "__init__":
            found[path.relative_to(PACKAGE).with_suffix("").as_posix()] = imports_of(path)
    return found


def test_no_import_points_upwards():
    level = {name: k for k, layer in enumerate(LAYERS.split("\n")) for name in layer.split()}
    imports = package_imports()
    assert sum(map(len, imports.values())) > 500
    for name, imported_names in imports.items():
        for imported in imported_names:
            assert level[imported.split("/")[0]] <= level[name.split("/")[0]], f"{name} must not import {imported}"


def test_there_are_no_import_cycles():
    TopologicalSorter(package_imports()).prepare()


def test_every_module_is_short():
    long = {path.stem: len(path.read_text(encoding="utf-8").splitlines()) for path in PACKAGE.rglob("*.py")}
    assert {name: lines for name, lines in long.items() if lines > 500} == {}


def test_one_module_imports_pymeshlab():
    importing = [
        path.stem
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(syntax_tree(path))
        if isinstance(node, ast.Import | ast.ImportFrom) and "pymeshlab" in ast.unparse(node)
    ]
    assert importing == ["meshset"]


def run(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_importing_the_package_loads_neither_pymeshlab_nor_numba():
    loaded = run("import sys, bezier_filters; print(*sys.modules)").split()
    assert "pymeshlab" not in loaded
    assert "numba" not in loaded


def test_estimating_loads_no_pymeshlab():
    code = "import sys, bezier_filters; bezier_filters.estimate_vertex_geometry; print(*sys.modules)"
    assert "pymeshlab" not in run(code).split()


def test_help_loads_neither_numpy_nor_rich():
    code = "import sys; from bezier_filters.cli import commands; print(*sys.modules)"
    assert not {"numpy", "rich"} & set(run(code).split())


def test_every_public_name_exists():
    for name in bezier_filters.__all__:
        assert getattr(bezier_filters, name) is not None
