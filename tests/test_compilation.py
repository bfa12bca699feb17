"""The first compilation is announced; a second process loads the cache in silence."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import bezier_filters

CODE = """
from bezier_filters import estimate_vertex_geometry
from bezier_filters.surfaces import sphere
from bezier_filters.lane_kernel import fit_in_lanes
ball = sphere(resolution=3)
estimate_vertex_geometry(ball.vertices, ball.faces)
print(sum(fit_in_lanes.stats.cache_hits.values()), sum(fit_in_lanes.stats.cache_misses.values()))
"""


def run(folder):
    environment = os.environ | {"PYTHONPATH": str(folder)}
    environment.pop("NUMBA_CACHE_DIR", None)
    return subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, env=environment, cwd=folder, check=True
    )


@pytest.mark.slow
def test_first_compilation_is_announced_and_cached(tmp_path):
    source = Path(bezier_filters.__file__).parent
    shutil.copytree(source, tmp_path / "bezier_filters", ignore=shutil.ignore_patterns("__pycache__"))
    first, second = run(tmp_path), run(tmp_path)
    assert "compiling the numerical kernels" in first.stderr
    assert first.stdout.split() == ["0", "1"]
    assert second.stderr == ""
    assert second.stdout.split() == ["1", "0"]
