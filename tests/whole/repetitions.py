"""Does the same a thousand times and prints the memory of the process before and after: `repetitions.py filters`."""

import ctypes
import gc
import inspect
import os
import sys

import numpy as np
from full_meshset import full_meshset, punched_torus
from test_load import FUNCTIONS, digest_of, result_of

from bezier_filters.meshlab.hole_filter import meshing_close_holes_by_bezier_patch
from bezier_filters.meshlab.mesh_attributes import write_coordinates
from bezier_filters.meshlab.meshset import preserve_filter_script
from bezier_filters.meshlab.scripts import FILTERS

WARM_UP, REPETITIONS = 100, 1000
free_unused_memory = getattr(ctypes.CDLL(None), "malloc_trim", lambda _: 0)


def resident_memory():
    gc.collect()
    free_unused_memory(0)
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def all_functions():
    """Call every function once, and return a hash of the results."""
    return hash(tuple(result_of(name, threads=2) for name in FUNCTIONS))


def all_filters(ms, rough):
    """Run every filter on a mesh whose coordinates are made rough again, and return a hash of the MeshSet."""
    for function in FILTERS:
        if "refmesh" in inspect.signature(function).parameters:  # it needs another layer
            continue
        if function.__name__.startswith(("meshing_surface_subdivision_", "meshing_remeshing_")):  # other vertices
            continue
        report = function(ms, threads=1)
        if report.get("polylines_id") is not None:  # a new layer each time
            main = ms.current_mesh_id()
            ms.set_current_mesh(report["polylines_id"])
            ms.delete_current_mesh()
            ms.set_current_mesh(main)
    state = digest_of(ms)
    with preserve_filter_script(ms):
        write_coordinates(ms, rough)
    return state


def repeat(work):
    """Number of different results, and bytes of memory before and after."""
    for _ in range(WARM_UP):
        work()
    before = resident_memory()
    results = {work() for _ in range(REPETITIONS)}
    return len(results), before, resident_memory()


if __name__ == "__main__":
    if sys.argv[1] == "functions":
        print(*repeat(all_functions))
    else:
        mesh_set = full_meshset(*punched_torus())
        meshing_close_holes_by_bezier_patch(mesh_set)
        coordinates = np.array(mesh_set.current_mesh().vertex_matrix())
        print(*repeat(lambda: all_filters(mesh_set, coordinates)))
