"""Compile what most tests call, in one process: two that start at the same time would both compile all of it."""

import numpy as np
from full_meshset import punched_torus

from baselines import ouyang_feng_normals, razdan_bae
from bezier_filters.compilation import STAGES, run_job
from bezier_filters.surfaces import torus
from survivors import keep_survivors


def compile_kernels() -> None:
    """Compile the kernels of the package, and the functions of the tests and tools."""
    for stage in STAGES:
        for name in stage:
            run_job(name)
    razdan_bae(*punched_torus())
    ouyang_feng_normals(*punched_torus())
    ring = torus(resolution=12, jitter=0.3)
    keep_survivors(ring.vertices, ring.faces, np.arange(len(ring.vertices)) % 2 == 0)


if __name__ == "__main__":
    compile_kernels()
