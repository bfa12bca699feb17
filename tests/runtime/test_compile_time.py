"""Compilation is announced once, not with --quiet, and is no part of reported times."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from numba import njit

from bezier_filters.compilation import STAGES
from bezier_filters.runtime.compile_time import clock_without_compilation, count_as_compilation

ROOT = Path(__file__).parents[2]


def elapsed(action):
    """Seconds that an action takes, and seconds that the clock shows."""
    wall, shown = time.perf_counter(), clock_without_compilation()
    action()
    return time.perf_counter() - wall, clock_without_compilation() - shown


def test_the_clock_stands_still_while_a_function_is_compiled():
    compiled = njit(lambda x: x + 1.0)
    wall, shown = elapsed(lambda: compiled(1.0))
    assert shown < 0.5 * wall
    assert elapsed(lambda: time.sleep(0.05))[1] >= 0.05


def test_times_that_overlap_count_once():
    def wait_twice():
        with count_as_compilation(), count_as_compilation():
            time.sleep(0.05)

    wall, shown = elapsed(wait_twice)
    assert 0.0 <= shown < 0.04 < wall


@pytest.mark.slow
def test_a_command_says_once_that_it_compiles_and_does_not_count_it(tmp_path):
    command = [sys.executable, "-m", "bezier_filters", "smooth", ROOT / "sample_meshes" / "torus.ply", "out.ply"]
    outputs = []
    for options in ((), ("--quiet",)):
        folder = tmp_path / f"cache{len(options)}"
        folder.mkdir()
        environment = os.environ | {"NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": str(ROOT)}
        begin = time.perf_counter()
        done = subprocess.run([*command, *options], env=environment, cwd=tmp_path, capture_output=True, text=True)
        outputs.append((done.stdout, done.stderr, time.perf_counter() - begin))
    (printed, announced, seconds), silent = outputs
    assert announced.count("compiling") == 1
    assert silent[:2] == ("", "")
    assert float(re.search(r"wrote out.ply \((.*) s\)", printed)[1]) < 0.5 * seconds


@pytest.mark.slow
def test_every_function_with_a_cache_is_compiled_by_the_command(tmp_path):
    """The names of all functions with a cache are those of the files; the second time, all is there."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "bezier_filters", "compile"]
    printed = [subprocess.check_output(command, env=environment, text=True) for _ in range(2)]
    counts = [int(line.split()[0]) for line in printed]
    names = {path.name.rpartition("-")[0] for path in tmp_path.rglob("*.nbc")}
    sources = "\n".join(path.read_text("utf-8") for path in (ROOT / "bezier_filters").rglob("*.py"))
    functions = re.findall(r"^@(?:jit|allocating_jit|short_jit)\(.*\)\ndef (\w+)", sources, re.MULTILINE)
    assert len(functions) > 100
    assert {name.rpartition(".")[2] for name in names} == set(functions)
    assert counts == [len(list(tmp_path.rglob("*.nbc")))] * 2


def test_jobs_have_names_of_their_own():
    names = [name for stage in STAGES for name in stage]
    assert len(set(names)) == len(names)
