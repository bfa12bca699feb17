"""The same bits whatever goes on: threads, repetition, processes, several threads of Python; and no memory is lost."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, is_dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from full_meshset import full_meshset, punched_torus
from meshset_state import mesh_state

from baselines import ouyang_feng_normals
from bezier_filters import estimate_vertex_geometry, fill_holes, smooth
from bezier_filters.meshlab.scripts import FILTERS

pytestmark = pytest.mark.slow

FUNCTIONS = {
    "estimate": estimate_vertex_geometry,
    "robust": lambda v, f, **options: estimate_vertex_geometry(v, f, robust=True, **options),
    "points": lambda v, f, **options: estimate_vertex_geometry(v, None, **options),
    "paper": lambda v, f, **options: estimate_vertex_geometry(v, f, smoothness="paper", **options),
    "smooth": smooth,
    "fill": fill_holes,
    "ouyang_feng": ouyang_feng_normals,
}
RESOLUTION = 12


def digest(value):
    """Hash of every array and number in a result, to the bit."""
    if is_dataclass(value):
        return sha256(repr([digest(getattr(value, field.name)) for field in fields(value)]).encode()).hexdigest()
    if isinstance(value, np.ndarray):
        return sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
    if isinstance(value, list | tuple):
        return sha256(repr([digest(part) for part in value]).encode()).hexdigest()
    return repr(value)


def result_of(name, threads=1, resolution=RESOLUTION):
    return digest(FUNCTIONS[name](*punched_torus(resolution), threads=threads))


def digest_of(ms):
    return digest(sorted((key, str(value)) for key, value in mesh_state(ms).items()))


def meshset_after(number, resolution=12):
    ms = full_meshset(*punched_torus(resolution))
    FILTERS[number](ms, threads=1)
    return digest_of(ms)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_threads_and_repetition_change_no_bit(name):
    assert len({result_of(name, threads) for threads in (1, 2, 1, 2)}) == 1


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_thread_gives_the_bits_of_the_main_thread(name):
    """Large enough for threads of BLAS in the systems of fills; the main thread has called it first."""
    here = result_of(name, resolution=30)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(result_of, name, resolution=30).result() == here


@pytest.mark.parametrize("name", FUNCTIONS)
def test_python_threads_do_not_disturb_each_other(name):
    sizes = [RESOLUTION, RESOLUTION + 4] * 3
    alone = [result_of(name, resolution=size) for size in sizes[:2]]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda size: result_of(name, 2, size), sizes))
    assert together == alone * 3


def test_many_mesh_sets_in_two_threads():
    """The MeshSets are made and looked at in one thread: pymeshlab itself cannot do that in two."""
    numbers = [*range(len(FILTERS))] * 2
    alone = [meshset_after(number) for number in numbers]
    meshsets = [full_meshset(*punched_torus()) for _ in numbers]
    with ThreadPoolExecutor(2) as pool:
        tasks = [pool.submit(FILTERS[number], ms, threads=1) for number, ms in zip(numbers, meshsets, strict=True)]
        assert all(task.result() for task in tasks)
    assert [digest_of(ms) for ms in meshsets] == alone


ROOT = Path(__file__).parents[2]
FOLDERS = [str(ROOT / folder) for folder in ("tests/whole", "tests", "tests/helpers", "benchmarks")]
"""Of this module, and of what all tests share."""
POOL = """
import multiprocessing, sys
from concurrent.futures import ProcessPoolExecutor
sys.path[:0] = {folders!r}
import test_load
if __name__ == "__main__":
    names = list(test_load.FUNCTIONS)
    numbers = range(len(test_load.FILTERS))
    here = [test_load.result_of(name, 2) for name in names] + [test_load.meshset_after(k) for k in numbers]
    with ProcessPoolExecutor(2, multiprocessing.get_context({method!r})) as pool:
        there = [pool.submit(test_load.result_of, name, 2) for name in names]
        there += [pool.submit(test_load.meshset_after, k) for k in numbers]
        assert [task.result() for task in there] == here
"""


@pytest.mark.parametrize(
    "method",
    [
        pytest.param("fork", marks=pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")),
        pytest.param("spawn", marks=pytest.mark.slow),
    ],
)
def test_a_pool_of_processes_gives_the_same(method, tmp_path):
    """The parent has used threads and compiled functions before it forks."""
    script = tmp_path / "pool.py"
    script.write_text(POOL.format(folders=FOLDERS, method=method))
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "2"}  # so that BLAS has used threads, too
    result = subprocess.run(
        [sys.executable, script], capture_output=True, encoding="utf-8", timeout=300, env=environment
    )
    assert result.returncode == 0, result.stderr


OVERWRITING = """
import multiprocessing, sys
import pymeshlab
import bezier_filters as bf
def columns_overwritten(_):
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=2)
    for rings in (2, 3):
        report = bf.compute_curvature_by_bezier_patch_per_vertex(ms, rings=rings, alpha=0.8)
    return report["statistics"]
if __name__ == "__main__":
    if {by_the_user}:
        ms = pymeshlab.MeshSet()
        ms.create_sphere(subdiv=5)
        ms.compute_selection_point_cloud_outliers()
    here = columns_overwritten(0)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map_async(columns_overwritten, range(2)).get(60) == [here, here]
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
@pytest.mark.parametrize("by_the_user", [False, True])
def test_a_forked_pool_overwrites_columns(by_the_user, tmp_path):
    """pymeshlab's filter for it has threads of OpenMP, which a fork lacks; so do the user's own filters."""
    script = tmp_path / "pool.py"
    script.write_text(OVERWRITING.format(by_the_user=by_the_user))
    result = subprocess.run([sys.executable, script], capture_output=True, encoding="utf-8", timeout=120)
    assert result.returncode == 0, result.stderr


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts the memory of a process")
@pytest.mark.parametrize("kind", ["functions", "filters"])
def test_a_thousand_repetitions(kind):
    """Memory stays flat to 1 %, and the results the same."""
    command = [sys.executable, str(Path(__file__).with_name("repetitions.py")), kind]
    result = subprocess.run(
        command, capture_output=True, encoding="utf-8", env=os.environ | {"PYTHONPATH": os.pathsep.join(FOLDERS)}
    )
    assert result.returncode == 0, result.stderr
    different, before, after = map(int, result.stdout.split())
    print(f"a thousand times all {kind}: {after / before:.4f} times the memory")
    assert different == 1
    assert after < 1.01 * before


KEPT = """
import sys
import pymeshlab
sys.path[:0] = {folders!r}
from full_meshset import punched_torus
from repetitions import FILTERS, resident_memory
vertices, faces = punched_torus(24)
def new():
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    return ms
def growth(repeat):
    for k in range(30):
        repeat()
    before = resident_memory()
    for k in range(200):
        repeat()
    return resident_memory() - before
(curvature,) = (function for function in FILTERS if "curvature" in function.__name__)
columns = len(curvature(new())["attributes"])
print(growth(lambda: curvature(new())) / 200 / vertices[:, 0].nbytes, columns)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts the memory of a process")
def test_on_new_meshsets_nothing_grows_but_the_attributes_that_pymeshlab_keeps():
    """pymeshlab frees no custom attribute with its mesh, whoever made it."""
    code = KEPT.format(folders=FOLDERS)
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True)
    leaked, columns = map(float, result.stdout.split())
    print(f"each new MeshSet keeps {leaked:.1f} arrays of the length of the mesh; the filter writes {columns:.0f}")
    assert leaked < 1.25 * columns
