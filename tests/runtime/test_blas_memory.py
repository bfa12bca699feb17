"""Where there is no memory for linear algebra, that is an error, and no loop without an end."""

import subprocess
import sys
from pathlib import Path

import pytest

from bezier_filters.meshlab.meshset import Mesh, MeshSet
from bezier_filters.surfaces import sphere

SAMPLES = Path(__file__).parents[2] / "sample_meshes"
linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the memory of a process")
CODE = """
import resource
import numpy as np
from pathlib import Path
from bezier_filters.runtime.cholesky import factorise
from bezier_filters.runtime.parallel import single_threaded_blas, run_in_chunks, use_threads
factorise(np.eye(1))  # loads what it calls, of which a matrix of one number asks for no memory
matrix = np.eye(600)
LINES
"""
LIMIT = """
there = next(int(line.split()[1]) for line in Path("/proc/self/status").open() if line.startswith("VmSize"))
resource.setrlimit(resource.RLIMIT_AS, ((there << 10) + (20 << 20),) * 2)
"""
CALLS = {
    "LAPACK of SciPy": "factorise(matrix)",
    "a call": "with single_threaded_blas(): matrix @ matrix",
}


@linux
@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_a_lack_of_memory_is_an_error(call):
    lines = f"{LIMIT}\ntry:\n    {call}\nexcept MemoryError as error:\n    print(error)\n"
    command = [sys.executable, "-c", CODE.replace("LINES", lines)]
    result = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=60)
    assert result.stdout == "linear algebra needs 64 MB more\n", result.stderr


@linux
@pytest.mark.slow
@pytest.mark.parametrize("limit", range(800_000, 1_300_000, 50_000))
def test_filling_a_hole_in_little_memory_ends_with_one_line(limit, tmp_path):
    arguments = ["fill-holes", SAMPLES / "punched_patch.ply", tmp_path / "filled.ply", "--quiet"]
    command = f'ulimit -v {limit}; exec "$@"'
    result = subprocess.run(
        ["sh", "-c", command, "sh", sys.executable, "-m", "bezier_filters", *arguments],
        capture_output=True,
        encoding="utf-8",
        timeout=120,
    )
    assert result.returncode in (0, 2), result.stderr
    assert result.stderr.splitlines()[-1:] == [] or result.stderr.splitlines()[-1].startswith("bezier-filters: ")


@linux
@pytest.mark.parametrize("command", ["curvature", "smooth"])
def test_a_lack_of_memory_for_threads_is_a_line(command, tmp_path):
    """Stacks larger than any memory, where the limit of another system might leave too little for a small one."""
    ball = sphere(resolution=40)  # more vertices than one thread takes
    ms = MeshSet()
    ms.add_mesh(Mesh(ball.vertices, ball.faces))
    ms.save_current_mesh(str(tmp_path / "ball.ply"))
    arguments = [command, str(tmp_path / "ball.ply"), str(tmp_path / "out.ply"), "--quiet", "--threads", "2"]
    code = f"""
import sys, threading
from bezier_filters.cli.commands import _run
sys.argv[1:] = {arguments!r}
threading.stack_size(1 << 50)
print(_run())
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", timeout=120)
    assert result.stdout == "there is not enough memory for this mesh; nothing was written\n", result.stderr
    assert not (tmp_path / "out.ply").exists()
