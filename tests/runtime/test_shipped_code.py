"""Machine code that the package carries: used where it fits, and only there."""

import os
import shutil
import subprocess
import sys

import pytest
from test_kernel_cache import entries, installed  # noqa: F401  # a fixture

from bezier_filters.runtime.kernel_folders import kernel_folders
from bezier_filters.runtime.shipped_code import generic_processor, has_features

RUN = """
{first}
from bezier_filters.runtime.caller import twice
print(twice(1.0), sum(twice.stats.cache_hits.values()))
"""
WITHOUT_VECTORS = """
import llvmlite.binding
real = llvmlite.binding.get_host_cpu_features
def without_vectors():
    found = real()
    found.update((name, False) for name in ("fma", "neon") if name in found)
    return found
llvmlite.binding.get_host_cpu_features = without_vectors
"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        generic_processor() is None or not has_features(generic_processor()),
        reason="wheels have no code for this processor",
    ),
]


def run(folder, first="", **variables):
    """Value of the function in a process of its own, and whether its code was on disk."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA", "XDG"))}
    environment |= {"PYTHONPATH": str(folder), "HOME": str(folder / "home"), "TMPDIR": str(folder / "temporary")}
    command = [sys.executable, "-c", RUN.format(first=first)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment | variables, cwd=folder, check=True)
    value, hits = done.stdout.split()
    return float(value), bool(int(hits))


@pytest.fixture
def shipped(installed):  # noqa: F811
    """A package that carries the code of its function, compiled for the generic processor."""
    processor = generic_processor()
    cache = installed / "built"
    cache.mkdir()
    built_for = {"NUMBA_CPU_NAME": processor.name, "NUMBA_CPU_FEATURES": processor.flags}
    assert run(installed, NUMBA_CACHE_DIR=str(cache), **built_for) == (2.0, False)
    (folder,) = cache.iterdir()
    shutil.move(folder, installed / "bezier_filters" / "machine_code" / folder.name.rpartition("-")[2])
    return installed


def test_the_code_of_the_package_is_used_and_nothing_is_written(shipped):
    assert run(shipped) == (2.0, True)
    assert len(entries(shipped)) == 1


def test_it_is_used_where_nothing_can_be_written(shipped):
    (shipped / "bezier_filters" / "__pycache__").touch()
    assert run(shipped, HOME=str(shipped / "nonexistent"), TMPDIR=str(shipped / "none")) == (2.0, True)


def test_a_processor_without_a_feature_compiles(shipped):
    if not generic_processor().features:
        pytest.skip("all processors of this platform have what the code needs")
    assert run(shipped, WITHOUT_VECTORS) == (2.0, False)
    assert run(shipped, WITHOUT_VECTORS) == (2.0, True)  # its own code
    assert len(entries(shipped)) == 2


def test_a_processor_that_the_user_chose_is_respected(shipped):
    assert run(shipped, NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == (2.0, False)


def test_changed_sources_are_compiled(shipped):
    called = shipped / "bezier_filters" / "runtime" / "called.py"
    called.write_text(called.read_text().replace("+ 0.0", "+ 1.0"))
    assert run(shipped) == (4.0, False)


def test_the_tree_itself_carries_no_code():
    assert not any(folder.parent.name == "machine_code" for folder in kernel_folders().readable)
