"""Compiled functions on disk: never older than their sources, never damaged, kept wherever files can be written."""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bezier_filters.runtime.kernel_folders import MAX_KEPT_FOLDERS
from bezier_filters.runtime.kernel_key import PACKAGE, kernel_sources, sources_key

pytestmark = pytest.mark.slow

CALLER = """
from bezier_filters.runtime.called import value
from bezier_filters.runtime.jit import jit

@jit()
def twice(x):
    return 2.0 * value(x)
"""
CALLED = """
from bezier_filters.runtime.constants import FACTOR
from bezier_filters.runtime.jit import inner_jit

@inner_jit()
def value(x):
    return FACTOR * x + {added}
"""
RUN = """
import resource
if {largest}:
    resource.setrlimit(resource.RLIMIT_FSIZE, ({largest}, {largest}))
from bezier_filters.runtime.caller import twice
from bezier_filters.runtime.jit import jit
print(twice(1.0), sum(twice.stats.cache_hits.values()))
"""


@pytest.fixture
def installed(tmp_path):
    """A copy of the package with a compiled function that calls one of another module, which has a constant."""
    shutil.copytree(PACKAGE, tmp_path / "bezier_filters", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("home", "temporary"):
        (tmp_path / name).mkdir()
    write_modules(tmp_path)
    return tmp_path


def write_modules(folder, added=0.0, factor=1.0):
    runtime = folder / "bezier_filters" / "runtime"
    (runtime / "caller.py").write_text(CALLER)
    (runtime / "called.py").write_text(CALLED.format(added=added))
    (runtime / "constants.py").write_text(f"FACTOR = {factor}\n")


def run(folder, largest=0, **variables):
    """Value of the function in a process of its own, whether its code was on disk, and the warnings."""
    environment = os.environ | {"PYTHONPATH": str(folder), "HOME": str(folder / "home")}
    environment |= {"TMPDIR": str(folder / "temporary")}
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        environment.pop(name, None)
    command = [sys.executable, "-c", RUN.format(largest=largest)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment | variables, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    value, hits = map(float, done.stdout.split())
    return value, bool(hits), done.stderr


def entries(folder):
    return list(folder.rglob("*.twice-*.nbc"))


def test_a_change_of_what_is_called_or_imported_is_noticed(installed):
    assert run(installed) == (2.0, False, "")
    assert run(installed) == (2.0, True, "")
    write_modules(installed, added=1.0)
    assert run(installed) == (4.0, False, "")
    write_modules(installed, added=1.0, factor=2.0)
    assert run(installed) == (6.0, False, "")
    write_modules(installed)
    assert run(installed) == (2.0, True, "")


@pytest.mark.parametrize(
    "damage",
    ["truncated", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("emptied", "flipped", "exchanged"))],
)
def test_a_damaged_file_is_replaced(installed, damage):
    run(installed)
    (entry,) = entries(installed)
    content = entry.read_bytes()
    middle = len(content) // 2
    flipped = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    damaged = {"emptied": b"", "truncated": content[:middle], "flipped": flipped, "exchanged": b"x" * len(content)}
    entry.write_bytes(damaged[damage])
    assert run(installed) == (2.0, False, "")
    assert run(installed) == (2.0, True, "")


def make_read_only(folder):
    """Permissions would not stop root from writing; a file in the place of a folder does."""
    (folder / "bezier_filters" / "__pycache__").touch()


class TestWhereFoldersCannotBeWritten:
    def test_a_read_only_package_has_its_code_in_the_users_folder(self, installed):
        make_read_only(installed)
        assert run(installed) == (2.0, False, "")
        assert run(installed) == (2.0, True, "")
        assert entries(installed / "home")

    def test_code_that_an_administrator_compiled_is_read_by_all(self, installed):
        run(installed)
        (entry,) = entries(installed)
        value, found, warning = run(installed, NUMBA_CACHE_DIR=str(installed / "bezier_filters" / "__init__.py"))
        assert (value, found, warning) == (2.0, True, "")
        assert entries(installed) == [entry]

    def test_without_a_home_directory_it_is_in_a_temporary_folder_with_one_warning(self, installed):
        make_read_only(installed)
        home = str(installed / "nonexistent")
        value, found, warning = run(installed, HOME=home)
        assert (value, found) == (2.0, False)
        assert warning.count("\n") == 1
        assert f"it is kept in {installed / 'temporary' / 'bezier_filters-'}" in warning
        assert "set NUMBA_CACHE_DIR to a folder that can be written" in warning
        assert run(installed, HOME=home) == (2.0, True, "")
        assert not Path(home).exists()

    @pytest.mark.skipif(not hasattr(os, "getuid"), reason="no permissions")
    @pytest.mark.parametrize("harm", ["others may write", "a link to elsewhere", "a file"])
    def test_nothing_is_read_from_a_temporary_folder_that_others_can_write(self, installed, harm):
        make_read_only(installed)
        home = str(installed / "nonexistent")
        run(installed, HOME=home)
        (folder,) = (installed / "temporary").iterdir()
        if harm == "others may write":
            folder.chmod(0o777)
        else:
            folder.rename(installed / "elsewhere")
            folder.touch() if harm == "a file" else folder.symlink_to(installed / "elsewhere")
        value, found, warning = run(installed, HOME=home)
        assert (value, found) == (2.0, False)
        assert warning.count("\n") == 1
        assert "every process compiles its functions: the code cannot be kept in" in warning

    def test_a_chosen_folder_that_is_none_is_named(self, installed):
        chosen = installed / "chosen"
        chosen.touch()
        value, _, warning = run(installed, NUMBA_CACHE_DIR=str(chosen))
        assert value == 2.0
        assert warning.count("\n") == 1
        assert str(chosen) in warning
        assert entries(installed / "bezier_filters")

    @pytest.mark.skipif(sys.platform == "win32", reason="no limits")
    def test_a_full_disk_is_one_warning(self, installed):
        value, _, warning = run(installed, largest=1000)
        assert value == 2.0
        assert warning.count("\n") == 1
        assert "their code cannot be kept" in warning
        assert run(installed) == (2.0, False, "")


def test_folders_of_old_keys_are_deleted(installed):
    chosen = installed / "chosen"
    chosen.mkdir()
    for k in range(2 * MAX_KEPT_FOLDERS):
        (chosen / f"bezier_filters-{k:016x}").mkdir()
        os.utime(chosen / f"bezier_filters-{k:016x}", (1e9 + k, 1e9 + k))
    (chosen / "bezier_filters-of-the-user").mkdir()
    run(installed, NUMBA_CACHE_DIR=str(chosen))
    kept = {path.name for path in chosen.iterdir()}
    assert len(kept) == MAX_KEPT_FOLDERS + 1
    assert kept > {"bezier_filters-of-the-user", f"bezier_filters-{2 * MAX_KEPT_FOLDERS - 1:016x}"}
    assert len(entries(chosen)) == 1


def test_files_of_numbas_own_cache_are_deleted(installed):
    folder = installed / "bezier_filters" / "meshes" / "__pycache__"
    folder.mkdir()
    for name in ("frames.f-1.py311.nbi", "frames.f-1.py311.1.nbc", "frames.cpython-311.pyc"):
        (folder / name).touch()
    run(installed)
    assert [path.name for path in folder.iterdir()] == ["frames.cpython-311.pyc"]


def imported_by(source, sources):
    """Paths of the modules of the package that a module imports, by its syntax tree."""
    found = set()
    for node in ast.parse(source).body:
        if isinstance(node, ast.ImportFrom) and node.module.startswith("bezier_filters."):
            path = "/".join(node.module.split(".")[1:])
            found |= {f"{path}.py", f"{path}/__init__.py"} | {f"{path}/{alias.name}.py" for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert (node.module, node.level) != ("bezier_filters", 0), "the key does not follow this kind of import"
            assert node.level == 0
        elif isinstance(node, ast.Import):
            assert not any(alias.name.startswith("bezier_filters") for alias in node.names)
    return found & sources.keys()


def test_the_key_is_of_all_modules_with_compiled_functions_and_of_what_they_import():
    sources = {path.relative_to(PACKAGE).as_posix(): path.read_bytes() for path in PACKAGE.rglob("*.py")}
    keyed = kernel_sources(PACKAGE)
    decorated = {
        name
        for name, source in sources.items()
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef) and "jit" in "".join(map(ast.unparse, node.decorator_list))
    }
    assert len(decorated) > 35
    assert decorated <= keyed.keys()
    assert {name for source in keyed.values() for name in imported_by(source, sources)} <= keyed.keys()
    assert keyed.items() <= sources.items()
    assert not any(name.startswith(("cli/", "pictures/", "meshlab/")) for name in keyed)


def test_the_key_changes_with_every_source_its_name_and_the_versions():
    sources = {"a.py": b"1", "b.py": b"2"}
    others = [sources | {"b.py": b"3"}, sources | {"c.py": b""}, {"a.py": b"1"}, {"a.py": b"1", "c.py": b"2"}]
    keys = {
        sources_key(sources, "1.0", "0.68"),
        sources_key(sources, "1.0", "0.69"),
        sources_key(sources, "1.1", "0.68"),
    }
    assert len(keys | {sources_key(other, "1.0", "0.68") for other in others}) == 7


def test_no_function_of_the_package_has_another_cache():
    for path in PACKAGE.rglob("*.py"):
        if path.name != "jit.py":
            assert "njit" not in path.read_text(encoding="utf-8"), f"{path.name}: take a compiler of runtime/jit.py"


PRINT_HASHES = """
from frozen import arrays, cases, digest
for name in ("fill: noisy block", "fill: bunny", "smooth: noisy block"):
    print(name, [(key, digest(array)) for key, array in arrays(cases()[name]())])
"""
FILL_SMALL_HOLES = """
from bezier_filters import fill_holes
from full_meshset import punched_torus
fill_holes(*punched_torus())
"""


@pytest.mark.slow
def test_results_have_the_same_bits_whichever_functions_are_loaded(tmp_path):
    """Kernels share functions, which a process compiles with the first kernel that it does not load."""
    results = list[bytes]()
    for seed, scripts in enumerate(([PRINT_HASHES] * 2, [FILL_SMALL_HOLES, PRINT_HASHES])):
        variables = {"NUMBA_CACHE_DIR": str(tmp_path / str(seed)), "PYTHONHASHSEED": str(seed)}
        variables["PYTHONPATH"] = os.pathsep.join(sys.path)
        results += [subprocess.check_output([sys.executable, "-c", one], env=os.environ | variables) for one in scripts]
    compiled, loaded, _, partly_loaded = results
    assert b"smooth: noisy block" in compiled
    assert compiled == loaded == partly_loaded


def test_functions_that_reorder_sums_are_inlined():
    pattern = re.compile(r"@inner_jit\(([^)]*fastmath[^)]*)\)")
    options = [found for path in PACKAGE.rglob("*.py") for found in pattern.findall(path.read_text("utf-8"))]
    assert options
    assert all('inline="always"' in found for found in options)
