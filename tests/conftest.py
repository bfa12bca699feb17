"""Shared settings and meshes of the tests."""

import functools
import os
import signal
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

# Matrices here are small, and the threads of BLAS would spend most of their time, and that of the tests, on waiting
# for each other. To be said before NumPy and SciPy are loaded; other processes that the tests start inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import Phase, settings

from bezier_filters.surfaces import sampling

settings.register_profile("project", deadline=None)  # the first call of a kernel may compile it
settings.load_profile("project")
settings.register_profile(  # for `make mutants`: the same examples each time, and no search for the shortest that fails
    "mutants", deadline=None, derandomize=True, database=None, phases=[Phase.explicit, Phase.generate]
)


directions_once = functools.lru_cache(maxsize=64)(sampling.sphere_directions)


def sphere_directions(resolution, *, jitter=0.0, seed=0):
    """As `sampling.sphere_directions`; many tests start from the same spheres, whose hulls take longer than they."""
    return tuple(array.copy() for array in directions_once(resolution, jitter=jitter, seed=seed))


sampling.sphere_directions = sphere_directions


@pytest.fixture
def spheres_afresh(monkeypatch):
    """Every sphere is made when it is asked for."""
    monkeypatch.setattr(sampling, "sphere_directions", directions_once.__wrapped__)


def pytest_configure(config):
    """Take Ctrl-C again, which scripts ignore in the background; compile before the processes of the tests start."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        compile_once(config)


def compile_once(config):
    """Compile the kernels in one process, unless that was done since the last change of the package."""
    package = config.rootpath / "bezier_filters"
    state = sha256()
    for path in sorted(package.rglob("*.py")):
        state.update(f"{path} {path.stat().st_mtime_ns}\n".encode())
    if config.cache.get("compiled", None) != state.hexdigest() or not any(package.rglob("*.nbc")):
        paths = [
            config.rootpath,
            config.rootpath / "benchmarks",
            config.rootpath / "tools",
            Path(__file__).with_name("helpers"),
            os.environ.get("PYTHONPATH", ""),
        ]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths)).rstrip(os.pathsep)}
        command = [sys.executable, Path(__file__).with_name("compile_kernels.py")]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:  # the tests go on, and tell more
            print(done.stderr, file=sys.stderr)
        config.cache.set("compiled", state.hexdigest())


def load_sample(name):
    """A MeshSet with a mesh that the pymeshlab wheel ships."""
    import pymeshlab

    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(Path(pymeshlab.__file__).parent / "tests" / "sample_meshes" / name))
    return ms


def pymeshlab_sample(name):
    """Vertices and faces of such a mesh."""
    ms = load_sample(name)
    mesh = ms.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32)


@pytest.fixture(scope="session")
def textured_bunny_file(tmp_path_factory):
    """The bunny with a texture in fewer faces, a quarter of those of the wheel, and the rims of its holes as they are.

    What a filter leaves alone in a MeshSet does not ask for more; the whole mesh is in `test_filters_on_sample_meshes`.
    """
    ms = load_sample("bunny10k_textured.obj")
    ms.meshing_decimation_quadric_edge_collapse_with_texture(
        targetfacenum=2500, preserveboundary=True, boundaryweight=10.0
    )
    path = tmp_path_factory.mktemp("bunny") / "bunny_textured.obj"
    ms.save_current_mesh(str(path))
    return path


@pytest.fixture
def textured_bunny(textured_bunny_file):
    """That bunny in a MeshSet."""
    import pymeshlab

    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(textured_bunny_file))
    return ms


@pytest.fixture
def textured(textured_bunny):
    """The textured bunny in a MeshSet where everything that could get lost is set."""
    return full_bunny(textured_bunny)


def full_bunny(ms):
    """That MeshSet with everything."""
    from full_meshset import add_all_attributes

    ms.create_cube()
    ms.set_current_mesh(0)
    add_all_attributes(ms, height=10, faces=750)
    ms.current_mesh().set_label("my bunny")
    return ms


@pytest.fixture
def quick_pictures(monkeypatch):
    """Pictures are drawn as large as they are, a quarter of the pixels, where no test looks at how smooth edges are."""
    monkeypatch.setattr("bezier_filters.pictures.scene._SUPERSAMPLING", 1)


@pytest.fixture(scope="session")
def bunny():
    """The closed Stanford bunny, 28,088 vertices."""
    return pymeshlab_sample("bunny.obj")
