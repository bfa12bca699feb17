"""The first compilation is announced; a second process loads the cache in silence."""

import gc
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import bezier_filters
from bezier_filters.compilation import first_compilation

CODE = """
from bezier_filters import estimate_vertex_geometry
from bezier_filters.surfaces import sphere
from bezier_filters.lane_kernel import fit_in_lanes
ball = sphere(resolution=3)
estimate_vertex_geometry(ball.vertices, ball.faces)
print(sum(fit_in_lanes.stats.cache_hits.values()), sum(fit_in_lanes.stats.cache_misses.values()))
"""


def run(folder):
    home = folder / "home"
    environment = os.environ | {"PYTHONPATH": str(folder), "HOME": str(home), "PYTHONDONTWRITEBYTECODE": "1"}
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        environment.pop(name, None)
    return subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, env=environment, cwd=folder, check=True
    )


@pytest.mark.slow
@pytest.mark.parametrize("writable", [True, False], ids=["writable", "read-only"])
def test_first_compilation_is_announced_and_cached(tmp_path, writable):
    source = Path(bezier_filters.__file__).parent
    shutil.copytree(source, tmp_path / "bezier_filters", ignore=shutil.ignore_patterns("__pycache__"))
    if not writable:  # permissions would not stop root from writing
        (tmp_path / "bezier_filters" / "__pycache__").touch()
    first, second = run(tmp_path), run(tmp_path)
    assert "compiling the numerical kernels" in first.stderr
    assert first.stdout.split() == ["0", "1"]
    assert second.stderr == ""
    assert second.stdout.split() == ["1", "0"]
    assert bool(list((tmp_path / "home").rglob("*.nbi"))) == (not writable)


def test_the_garbage_collector_is_held_back_while_compiling_only(tmp_path):
    class NeverCompiled:
        """What is looked at of a compiled function."""

        signatures = ()
        stats = SimpleNamespace(cache_path=str(tmp_path))
        py_func = run

    before, during = gc.get_threshold(), []

    def fail():
        during.append(gc.get_threshold())
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), first_compilation(NeverCompiled):
        fail()
    assert during[0][2] > before[2]
    assert gc.get_threshold() == before
    (tmp_path / "module.run-1.nbi").touch()
    with first_compilation(NeverCompiled):
        assert gc.get_threshold() == before
