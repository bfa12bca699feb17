"""The first compilation is announced; a second process loads the cache in silence."""

import gc
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import bezier_filters
from bezier_filters import estimate_vertex_geometry
from bezier_filters.fitting.first_call import compile_fit, compile_the_rest, first_compilation
from bezier_filters.kernels.fit_kernel import fit_in_lanes
from bezier_filters.kernels.graph_geometry import bound_errors
from bezier_filters.sampling.ring_kernel import analyse_in_lanes
from bezier_filters.surfaces import sphere

CODE = """
from bezier_filters import estimate_vertex_geometry
from bezier_filters.surfaces import sphere
from bezier_filters.kernels.fit_kernel import fit_in_lanes
from bezier_filters.sampling.ring_kernel import analyse_in_lanes
ball = sphere(resolution=3)
estimate_vertex_geometry(ball.vertices, ball.faces)
for kernel in (fit_in_lanes, analyse_in_lanes):
    print(sum(kernel.stats.cache_hits.values()), sum(kernel.stats.cache_misses.values()))
"""


def run(folder, threads):
    home = folder / "home"
    home.mkdir(exist_ok=True)
    environment = os.environ | {"PYTHONPATH": str(folder), "HOME": str(home), "PYTHONDONTWRITEBYTECODE": "1"}
    environment["BEZIER_FILTERS_THREADS"] = threads
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        environment.pop(name, None)
    return subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, env=environment, cwd=folder, check=True
    )


@pytest.mark.slow
@pytest.mark.parametrize("threads", ["1", "2"])
@pytest.mark.parametrize("writable", [True, False], ids=["writable", "read-only"])
def test_first_compilation_is_announced_and_cached(tmp_path, writable, threads):
    source = Path(bezier_filters.__file__).parent
    shutil.copytree(source, tmp_path / "bezier_filters", ignore=shutil.ignore_patterns("__pycache__"))
    if not writable:  # permissions would not stop root from writing
        (tmp_path / "bezier_filters" / "__pycache__").touch()
    first, second = run(tmp_path, threads), run(tmp_path, threads)
    assert first.stderr.count("compiling kernels, once per installation") == 1
    # With two threads another process has compiled the second one.
    assert first.stdout.split() == ["0", "1", *(["0", "1"] if threads == "1" else ["1", "0"])]
    assert second.stderr == ""
    assert second.stdout.split() == ["1", "0", "1", "0"]
    assert bool(list((tmp_path / "home").rglob("*.nbc"))) == (not writable)
    assert bool(list(tmp_path.rglob("*bound_errors*.nbc"))) == (threads == "2")  # this sphere does not need it yet


@pytest.fixture
def never_compiled(tmp_path, monkeypatch):
    """What is looked at of a compiled function, on a machine with two cores."""
    monkeypatch.setenv("BEZIER_FILTERS_THREADS", "2")
    return SimpleNamespace(signatures=(), stats=SimpleNamespace(cache_path=str(tmp_path)), py_func=run)


def test_the_garbage_collector_is_held_back_while_compiling_only(never_compiled, tmp_path):
    before, during = gc.get_threshold(), []

    def fail():
        during.append(gc.get_threshold())
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), first_compilation(never_compiled, fail, "pass"):
        pass
    assert during[0][2] > before[2]
    assert gc.get_threshold() == before
    (tmp_path / "module.run-1.nbc").touch()
    with first_compilation(never_compiled, fail, "pass"):
        assert gc.get_threshold() == before


class TestTheOtherProcess:
    def test_has_finished_when_the_call_begins_and_has_the_same_modules(self, never_compiled, tmp_path, monkeypatch):
        (tmp_path / "only_here.py").write_text("from pathlib import Path\n")
        monkeypatch.syspath_prepend(tmp_path)
        code = f"import time, only_here; time.sleep(0.3); only_here.Path({str(tmp_path / 'done')!r}).touch()"
        with first_compilation(never_compiled, lambda: None, code):
            assert (tmp_path / "done").exists()

    def test_may_fail(self, never_compiled):
        compiled = []
        with first_compilation(never_compiled, lambda: compiled.append("here"), "raise SystemExit('no space left')"):
            compiled.append("called")
        assert compiled == ["here", "called"]

    def test_is_killed_by_an_interrupt(self, never_compiled, tmp_path):
        code = f"import time, pathlib; time.sleep(2); pathlib.Path({str(tmp_path / 'done')!r}).touch()"

        def interrupt():
            raise KeyboardInterrupt

        begin = time.monotonic()
        with pytest.raises(KeyboardInterrupt), first_compilation(never_compiled, interrupt, code):
            pass
        assert time.monotonic() - begin < 1.5
        assert not (tmp_path / "done").exists()

    @pytest.mark.parametrize("executable", ["", None, "/opt/meshlab/bin/meshlab"])
    def test_is_not_started_by_programs_that_python_is_built_into(self, never_compiled, executable, monkeypatch):
        monkeypatch.setattr(sys, "executable", executable)
        with first_compilation(never_compiled, lambda: pytest.fail("nothing to be gained"), "pass"):
            pass


def test_both_parts_compile_what_an_estimate_calls():
    ball = sphere(resolution=24)
    noise = np.random.default_rng(0).standard_normal((len(ball.vertices), 1))
    noise *= np.where(ball.vertices[:, :1] > 0.7, 0.02, 0.002)  # parts, of which one keeps the fit with larger errors
    estimate_vertex_geometry(ball.vertices * (1.0 + noise), ball.faces)
    kernels = fit_in_lanes, analyse_in_lanes, bound_errors
    called = [kernel.signatures for kernel in kernels]
    assert all(called)
    compile_fit()
    compile_the_rest()
    assert [kernel.signatures for kernel in kernels] == called
