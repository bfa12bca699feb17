"""The first call on a machine, which compiles the numerical kernels, once per installation.

They are compiled in two parts that take about equally long, on two cores if there are two.
"""

import gc
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bezier_filters.fitting.fallbacks import QUADRATIC, FitAttempt, fit_with_fallbacks
from bezier_filters.fitting.mesh_neighbourhoods import MeshNeighbourhoods
from bezier_filters.fitting.vertex_geometry import empty_geometry
from bezier_filters.kernels.fit_kernel import fit_in_lanes
from bezier_filters.kernels.graph_geometry import bound_errors
from bezier_filters.kernels.kernel_input import UNTRIED, kernel_mesh, prepare_kernel_mesh
from bezier_filters.meshes.adjacency import Adjacency, Rows
from bezier_filters.meshes.frames import TangentPlanes
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.spatial_order import sort_spatially
from bezier_filters.runtime.compile_time import count_as_compilation
from bezier_filters.runtime.kernel_cache import SUFFIX
from bezier_filters.runtime.parallel import usable_threads
from bezier_filters.runtime.process_end import end_with_parent
from bezier_filters.runtime.supervision import python_command
from bezier_filters.status import FitStatus
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.learn import learn_surface
from bezier_filters.surfaces import sphere


@contextmanager
def first_call() -> Iterator[None]:
    """Context of every estimate: compile the kernels in its first call on a machine."""
    code = f"from {__name__} import {compile_the_rest.__name__} as compile; compile()"
    with first_compilation(fit_in_lanes, compile_fit, code):
        yield


@contextmanager
def first_compilation(kernel: Any, compile_kernel: Callable[[], object], compile_others: str) -> Iterator[None]:
    """Context of the first call of a kernel: compile it and the others in parallel, if there are two cores.

    A kernel that was compiled before is loaded from disk in a fraction of a second.
    Otherwise this process compiles the largest kernel, and another one runs the code `compile_others`
    for the other kernels, which this process finds in the cache. If that process fails, they are compiled here on
    their first call.
    """
    compiled = getattr(kernel, "signatures", True)  # or loaded in this process, or the JIT is disabled
    folder = None if compiled else kernel.stats.cache_path
    if compiled or (folder and any(Path(folder).glob(f"*.{kernel.py_func.__name__}-*{SUFFIX}"))):
        yield
        return
    # The compiler makes millions of long-lived objects; repeated full collections would take a fifteenth of its time.
    thresholds = gc.get_threshold()
    gc.set_threshold(*thresholds[:2], 100_000)
    try:
        # Only a Python interpreter can run the code, not a program that embeds one.
        is_python = Path(sys.executable or "").name.lower().startswith("python")
        if is_python and folder and usable_threads() > 1:
            nothing = subprocess.DEVNULL
            guard = f"from {end_with_parent.__module__} import {end_with_parent.__name__} as end; end({os.getpid()})"
            command = python_command(f"{guard}; {compile_others}")
            with subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing) as process:
                try:
                    with count_as_compilation():
                        compile_kernel()
                        process.wait()
                finally:
                    process.kill()
        yield
    finally:
        gc.set_threshold(*thresholds)


def compile_fit(*, robust: bool = False, conditions: bool = False) -> None:
    """Compile a variant of the fit, which is half of the work, on a vertex without neighbours."""
    mesh, nothing = triangle_mesh(np.zeros((1, 3)), []), Rows(np.zeros(2, np.int32), np.zeros(0, np.int32))
    planes = TangentPlanes(np.array([[0.0, 0.0, 1.0]]), np.zeros(1, np.float32))
    arrays = kernel_mesh(mesh, Adjacency(nothing, nothing, np.zeros(1, np.bool_)), planes)
    attempt = FitAttempt(FitStatus.OK, frozenset({UNTRIED}), 1, QUADRATIC)
    geometry = replace(empty_geometry(1), condition_number=np.zeros(1) if conditions else None)
    fit_with_fallbacks(arrays, np.zeros(1, np.int32), [attempt], geometry, robust=robust)


def compile_the_rest() -> None:
    """Compile the kernels that prepare a mesh and learn from it, on a small sphere."""
    ball = sphere(resolution=8)
    ordered = sort_spatially(triangle_mesh(ball.vertices, ball.faces))
    arrays = prepare_kernel_mesh(ordered.mesh, ordered, with_barriers=True)
    learn_surface(MeshNeighbourhoods(arrays), FitOptions())
    # regions of a surface may need it later
    bound_errors(arrays, np.zeros(0, np.int32), np.zeros(0), np.zeros(0), 0, 0)
